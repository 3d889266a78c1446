# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Spectra joined by compiled code and by the formula; waves of any band arrive."""

import numpy as np
from hypothesis import given, settings, strategies as st

from sar_imaging.backends import backend
from sar_imaging.geometry.polar import PolarGrid
from sar_imaging.planning.afbp.polar_grids import UnifiedPolarGrids


def make_grid(rng, n_coarse, n_fine, n_range, n_coarse_range, n_fine_range, for_map):
    guard = min(3.0, 0.2 * n_coarse)
    n_alpha = n_fine - 2 * int(np.ceil(guard * n_fine / n_coarse))
    polar = PolarGrid((0.0, 0.0, 50.0), (1.0, 0.0), 1, 0.0, 900.0, 0.25, n_range,
                      rng.uniform(-0.2, 0.1), rng.uniform(1e-4, 4e-4), n_alpha)
    return UnifiedPolarGrids(polar, n_coarse, n_fine, guard, 4.0, n_coarse_range, n_fine_range,
                      rng.uniform(2.0, 8.0), 10e9, *(1.3, 1.5) if for_map else (1.0, 1.0))


@settings(max_examples=25)
@given(seed=st.integers(0, 2 ** 32), n_coarse=st.integers(8, 60), finer=st.integers(-2, 90),
       n_range=st.integers(4, 120), guard=st.integers(2, 20), fewer=st.integers(0, 10),
       n_parts=st.integers(0, 5), planes=st.booleans(), keep=st.booleans(), for_map=st.booleans())
def test_any_subapertures(seed, n_coarse, finer, n_range, guard, fewer, n_parts, planes, keep,
                          for_map):
    """Of random samples, with bands on either side, far beyond the grid's own and overlapping."""
    rng = np.random.default_rng(seed)
    n_fine_range = n_range + 2 * guard
    n_coarse_range = max(n_fine_range - fewer, n_fine_range // guard + 1)
    grid = make_grid(rng, n_coarse, n_coarse + finer, n_range, n_coarse_range, n_fine_range,
                     for_map)
    images = rng.standard_normal((n_parts, 2, n_coarse, n_coarse_range)).astype(np.float32)
    centres = rng.uniform(-60, 60, n_parts)
    made = [backend(name).SpectrumFusion(grid, keep=keep) for name in ('cpu', 'reference')]
    for fusion in made:
        for number, (image, centre_m) in enumerate(zip(images, centres, strict=True)):
            fusion.add(number, image if planes else image[0] + 1j * image[1], centre_m)
        if keep and n_parts > 1:
            fusion.remove(0)
            fusion.add(1, images[0], -centres[0])
    baseband_m = 0.0 if planes else rng.uniform(-30, 30)
    compiled, wanted = (fusion.polar_image(baseband_m) for fusion in made)
    # float32 in tapers, two transforms and phases: 4e-7 measured
    assert np.linalg.norm(compiled - wanted) <= 2e-6 * np.linalg.norm(wanted)
    if not baseband_m:
        compiled, wanted = (fusion.take_polar_image() for fusion in made)
        assert np.linalg.norm(compiled - wanted) <= 2e-6 * np.linalg.norm(wanted)
        assert not made[0].included


@settings(max_examples=20)
@given(seed=st.integers(0, 2 ** 32), bin_of_band=st.integers(-8, 8))
def test_waves_of_a_band_arrive(seed, bin_of_band):
    """``exp(j K_alpha alpha)`` around ``K x_u`` is the same on fine lines, whatever x_u."""
    rng = np.random.default_rng(seed)
    grid = make_grid(rng, 64, 256, 40, 80, 80, False)
    centre_m = rng.uniform(-30, 30)
    fusion = backend('reference').SpectrumFusion(grid)
    step = 2 * np.pi / grid.extent
    frequency = np.rint(grid.wavenumber_rad_per_m * centre_m / step) * step + bin_of_band * step
    coarse = np.exp(1j * frequency * grid.coarse.alpha)[:, None] * np.ones(grid.n_coarse_range)
    fusion.add(0, coarse, centre_m)
    image = fusion.polar_image()
    image = image[0] + 1j * image[1]
    wanted = np.exp(1j * frequency * grid.polar.alpha)[:, None]
    phase = 2 * np.pi * np.fmod(2 * grid.fine_range_guard * grid.polar.range_spacing_m
                                / grid.wavelength_m, 1.0)
    # Away from the guards the taper is 1; its own spectrum, some 20 bins on either side, has
    # to fit between the ends of the band, 32 bins from its middle: 5e-3 measured 12 bins off.
    error = np.abs(image * np.exp(-1j * phase) - wanted)[20:-20, 5:-5]
    assert error.max() < 5e-3
