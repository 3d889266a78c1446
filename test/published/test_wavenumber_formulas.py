# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Kernels of the wavenumber imager against their formulas."""

import math

import numpy as np
from hypothesis import given, settings, strategies as st

from sar_imaging.geometry.grids import MapGrid
from sar_imaging.geometry.track import StraightTrack
from sar_imaging.published.wavenumber import SlantImage, spread

SEEDS = st.integers(0, 2 ** 32)


@settings(max_examples=30)
@given(seed=SEEDS, n_rows=st.integers(1, 4), n=st.integers(1, 60), half=st.integers(1, 8))
def test_values_are_spread_by_a_windowed_sinc(seed, n_rows, n, half):
    """Rosenberg & Gray, equation 11: Hamming window over `taps` samples around each place."""
    rng = np.random.default_rng(seed)
    taps, n_out = 2 * half, 120
    place = rng.uniform(taps, n_out - taps, (n_rows, n))
    place[0, 0] = np.rint(place[0, 0])  # a sample itself
    values = rng.standard_normal((n_rows, n, 2)).view(complex)[..., 0]
    out = np.zeros((n_rows, n_out), np.complex64)
    spread(values, place, taps, out)
    t = place[..., None] - np.arange(n_out)
    first = np.floor(place)[..., None] - half + 1
    inside = (np.arange(n_out) >= first) & (np.arange(n_out) < first + taps)
    window = np.where(inside, 0.54 + 0.46 * np.cos(2 * np.pi * t / taps), 0.0)
    wanted = np.einsum('rn,rnj->rj', values, window * np.sinc(t))
    # complex64 sums
    assert np.linalg.norm(out - wanted) <= 1e-6 * np.linalg.norm(wanted)


@settings(max_examples=30)
@given(seed=SEEDS, n_y=st.integers(1, 12), n_x=st.integers(1, 12), rows=st.integers(1, 20),
       columns=st.integers(1, 20))
def test_pixels_of_a_slant_plane_image(seed, n_y, n_x, rows, columns):
    """``sum_yx F_yx exp(j k_y (y - Y_c) + j k_x (x - X_c))``, written out."""
    rng = np.random.default_rng(seed)
    spectrum = rng.standard_normal((rows, columns, 2)).astype(np.float32)
    spectrum = spectrum.view(np.complex64)[..., 0]
    turn = rng.uniform(0, 2 * math.pi)
    track = StraightTrack(np.array([1.0, -2.0, 40.0]),
                          np.array([math.cos(turn), math.sin(turn), 0.0]), 1.0, 1, np.zeros(1))
    grid = MapGrid((60.0, 20.0, 0.0), n_x, n_y, 0.7)
    offset = grid.points() - track.origin_m
    along = offset @ track.direction
    distance = np.linalg.norm(offset - along[..., None] * track.direction, axis=-1)
    centre = float(along.mean()), float(distance.mean())
    first, steps = rng.uniform(-20, 20, 2), rng.uniform(0.05, 0.2, 2)
    scale = complex(*rng.standard_normal(2))
    image = SlantImage.from_spectrum(spectrum, first, steps, centre).read(grid, track, scale)
    k_y, k_x = (f + s * np.arange(n) for f, s, n in zip(first, steps, spectrum.shape, strict=True))
    wanted = np.einsum('kl,kyx,lyx->yx', spectrum, np.exp(
        1j * np.multiply.outer(k_y, along - centre[0])), np.exp(
            1j * np.multiply.outer(k_x, distance - centre[1])))
    wanted = wanted * scale * np.sqrt(distance)
    # The kernel of non-uniform transforms errs by 1e-5 of all terms together (rms).
    allowed = 1e-4 * abs(scale) * np.linalg.norm(spectrum) * np.sqrt(distance.max() * grid.n_x
                                                                     * grid.n_y)
    assert np.linalg.norm(image - wanted) <= allowed
