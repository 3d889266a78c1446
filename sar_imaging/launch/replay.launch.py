# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Check the configuration, start the nodes, and replay a recording into them."""

from sar_imaging.tools.launching import describe


def generate_launch_description():
    """Nodes of sar_imaging.launch.py, or of sar_pipeline.launch.py, and `ros2 bag play`."""
    return describe(pipeline=False, replay=True)
