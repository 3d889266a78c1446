# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Parts of `evaluate`: replay a recording through the running nodes and judge the image.

`node_launch` starts the nodes, `replay` sends the pulses, `observer` watches what the
nodes publish and log, and `examination` says what is wrong with an image.
"""
