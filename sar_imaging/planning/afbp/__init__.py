# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Plans of accelerated fast backprojection (AFBP): sub-apertures, their grids, beams and errors.

`subapertures` cuts the aperture and plans the images of its parts, `beams` those that come from
beams, `polar_grids` the fusion; `live` plans from a track that is foreseen.
"""
