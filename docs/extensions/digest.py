# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""The name of a mermaid block's drawings: a digest of the block."""

import hashlib


def digest(block: str) -> str:
    """First 16 hexadecimal digits of the SHA-256 of a block without the space around it."""
    return hashlib.sha256(block.strip().encode()).hexdigest()[:16]
