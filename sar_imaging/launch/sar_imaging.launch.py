# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Check the configuration, then start every stage as a process of its own."""

from sar_imaging.tools.launching import describe


def generate_launch_description():
    """Nodes pulse_buffer, range_compression and backprojection, afbp_fusion where needed."""
    return describe(pipeline=False)
