# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""The formulas themselves, in plain NumPy and float64: what every other backend is tested against.

One module holds one operation of the seam between plans and backends, with its formula and its
source. `entries` chains them to the four entries of `backends.protocol.Backend`; correlation is an
entry by itself. Images are formed as a plan says, with its windows, grids and interpolators. What
compiled code approximates beyond that is done exactly here: profiles are read by their Fourier
series, paths are computed for each pixel, and nothing is rounded to float32 but the images. Small
images take seconds.
"""

from .correlation import correlate_profiles, correlate_spectra
from .entries import Backprojection, SpectrumFusion, SubapertureImager, form_map
from .project_points import TrialImages

ILLUMINATION = True  # of plans is followed
GROUPS = True  # of echoes: their maps are computed point by point

__all__ = ['Backprojection', 'SpectrumFusion', 'SubapertureImager', 'TrialImages',
           'correlate_profiles', 'correlate_spectra', 'form_map']
