# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Common parts of the nodes that form images: grid, terrain, autofocus, focus and topics.

`image_grid` defines the pixels, `autofocus` and `focus_watch` check the focus,
`image_products` and `obstacle_products` publish the results.
"""
