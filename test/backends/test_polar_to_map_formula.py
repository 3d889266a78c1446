# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Random polar images on maps, by compiled code and by the formula."""

import numpy as np
from hypothesis import given, settings, strategies as st

from sar_imaging.backends.cpu.polar_to_map import polar_to_map
from sar_imaging.backends.reference.polar_to_map import polar_to_map as map_of
from sar_imaging.geometry.grids import MapGrid
from sar_imaging.geometry.polar import PolarGrid, edge_positions
from sar_imaging.planning.interpolators import design_interpolator
from sar_imaging.planning.polar_cover import DEAPODISED_TAPS, DEGREE, TAPS, margin


@settings(max_examples=30)
@given(seed=st.integers(0, 2 ** 32), n_x=st.integers(1, 90), n_y=st.integers(1, 90),
       axis=st.integers(0, 1), ahead=st.sampled_from([-1.0, 1.0]), deapodised=st.booleans(),
       added=st.booleans())
def test_any_image(seed, n_x, n_y, axis, ahead, deapodised, added):
    rng = np.random.default_rng(seed)
    pitch_m = rng.uniform(0.1, 0.5)
    height_m = rng.uniform(0.0, 60.0)
    look = np.array([rng.uniform(150.0, 2000.0) * ahead, rng.uniform(-30.0, 30.0)])
    grid = MapGrid((*look[::1 - 2 * axis], 0.0), n_x, n_y, pitch_m)
    turn = rng.uniform(-0.3, 0.3)
    track = np.array([-np.sin(turn), np.cos(turn)])[::1 - 2 * axis]
    origin = 0.0, 0.0, height_m
    x, y = look[::1 - 2 * axis]
    side = 1 if y * track[0] - x * track[1] >= 0 else -1
    spacing_m, alpha_spacing = rng.uniform(0.5, 1.5) * pitch_m, rng.uniform(1e-4, 1e-3)
    taps = DEAPODISED_TAPS if deapodised else TAPS
    between = design_interpolator(1.5, taps=taps, degree=DEGREE, deapodised=deapodised)
    along = design_interpolator(1.3, taps=TAPS, degree=DEGREE)
    before, beside = margin(TAPS), margin(taps)
    r, alpha = edge_positions(grid, origin, track, axis, before * spacing_m)
    n_range = -(-int(np.ptp(r) / spacing_m + 2 * before + 3) // 16) * 16
    # no pixel exactly at a range, where polynomials of two intervals meet
    start_m = r.min() - (before + 0.1 + 0.8 * rng.random()) * spacing_m
    polar = PolarGrid(origin, tuple(track), side, 0.0, start_m, spacing_m, n_range,
                      alpha.min() - beside * alpha_spacing, alpha_spacing,
                      int(np.ptp(alpha) / alpha_spacing) + 2 * beside + 2)
    lines = rng.standard_normal((2, polar.n_alpha, n_range)).astype(np.float32)
    options = {'axis': axis, 'wavelength_m': rng.uniform(0.02, 0.5), 'between': between,
               'along': along}
    wanted = map_of(lines[0] + 1j * lines[1].astype(float), polar, grid, **options)
    if added:
        start = rng.standard_normal((*grid.shape, 2)).astype(np.float32).view(np.complex64)[..., 0]
        image = start.copy()
        polar_to_map(lines, polar, grid, **options, onto=image)
        wanted += start
    else:
        image = polar_to_map(lines, polar, grid, **options)
    # Weights and places between neighbours in float32: white noise, which changes within a
    # neighbour's distance, shows it most. 4e-6 measured
    assert np.linalg.norm(image - wanted) <= 3e-5 * (np.linalg.norm(wanted)
                                                     + np.sqrt(wanted.size))
