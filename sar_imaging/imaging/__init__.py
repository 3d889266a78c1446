# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Image formation: from range profiles or phase histories of many pulses to a focused image.

- `imager`: `plan_image`, the one entry that chooses the method; `image`: what it returns;
- `exact`: exact backprojection, over the two-way path of every channel; `darkness`: its images
  that err more than planned, since what is bright lies beyond them;
- `afbp`: accelerated fast backprojection, the quickest where many pulses make an image;
- `correlation`: time-domain correlation, the exact reference.

Other published methods, for comparison, are in `sar_imaging.published`.
"""
