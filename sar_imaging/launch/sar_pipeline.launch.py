# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Check the configuration, then start all stages in one process."""

from sar_imaging.tools.launching import describe


def generate_launch_description():
    """Node sar_pipeline."""
    return describe(pipeline=True)
