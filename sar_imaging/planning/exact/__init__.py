# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Plans of exact backprojection: the quickest route that meets the error asked for.

`backprojection` chooses among the lines of a grid, a polar image that is then interpolated to the
map (`polar_image`), and single points (`points`); `illumination` is for antennas with a pattern.
`pulse_power` tells how bright an image should be.
"""
