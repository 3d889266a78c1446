# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Positions in the nodes: poses from odometry, poses or tf, and lever arms.

`pose_input` passes poses to the worker thread, of topics and of tf, and `known_positions` keeps
the phase centres around an aperture.
"""
