# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Images while the pulses arrive: apertures filled, sub-apertures formed and fused, strips grown.

- `aperture`: one image per aperture by exact backprojection;
- `subapertures`, `fusion`: the two stages of AFBP, with `subaperture_image` between them;
- `reimaging`: corrected trajectories for an image that is there already;
- `mosaic`: a strip of map patches that follows the platform;
"""
