# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Public measured data: programs that image them. `sar_imaging.recordings` loads them.

Airborne X band (AFRL Gotcha), a rail with an ultra-wideband radar (BWSI team 6), a 77 GHz radar on
a rotating arm (ArcSAR), and a 60 GHz MIMO array.
"""
