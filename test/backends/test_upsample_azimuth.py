# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Images of parts, merged by compiled code and by the formula; waves arrive as predicted."""

import numpy as np
from hypothesis import given, settings, strategies as st

from sar_imaging.backends.cpu.polar_image import AzimuthUpsampling
from sar_imaging.backends.reference.upsample_azimuth import upsample_azimuth
from sar_imaging.geometry.polar import PolarGrid
from sar_imaging.planning.exact.polar_image import DEGREE, TAPS, AzimuthParts
from sar_imaging.planning.interpolators import design_interpolator

OVERSAMPLING = 1.6


def make_parts(rng, n_parts, n_coarse, n_fine, n_range):
    """Fine lines, closer than the coarse ones, anywhere within what their neighbours cover."""
    coarse = PolarGrid((0.0, 0.0, 0.0), (1.0, 0.0), 1, 0.0, 1000.0, 0.3, n_range,
                       rng.uniform(-0.3, 0.2), 1e-3, n_coarse)
    beyond = TAPS // 2 - 1
    span = (n_coarse - 1 - 2 * beyond) * coarse.alpha_spacing
    spacing = rng.uniform(0.3, 1.0) * min(span / max(n_fine - 1, 1), coarse.alpha_spacing)
    start = coarse.alpha[beyond] + rng.random() * (span - (n_fine - 1) * spacing)
    fine = PolarGrid((0.0, 0.0, 0.0), (1.0, 0.0), 1, 0.0, 1000.0, 0.3, n_range, start, spacing,
                     n_fine)
    interpolator = design_interpolator(OVERSAMPLING, taps=TAPS, degree=DEGREE)
    frequency = rng.uniform(-1, 1, n_parts) * 2e4
    return AzimuthParts(tuple(slice(i, i + 1) for i in range(n_parts)), frequency, coarse, fine,
                        interpolator, interpolator.error_db, 1.0)


@settings(max_examples=30)
@given(seed=st.integers(0, 2 ** 32), n_parts=st.integers(1, 6), n_coarse=st.integers(11, 40),
       n_fine=st.integers(1, 90), n_range=st.integers(1, 600))
def test_images_of_parts_are_interpolated_and_added(seed, n_parts, n_coarse, n_fine, n_range):
    rng = np.random.default_rng(seed)
    parts = make_parts(rng, n_parts, n_coarse, n_fine, n_range)
    images = rng.standard_normal((n_parts, 2, n_coarse, n_range)).astype(np.float32)
    before = rng.standard_normal((2, n_fine, n_range)).astype(np.float32)
    total = before.copy()

    def form(number, image):
        image[..., :n_range] += images[number]

    AzimuthUpsampling(parts).add_all(form, total)
    wanted = upsample_azimuth(images[:, 0] + 1j * images[:, 1].astype(float), parts)
    wanted += before[0] + 1j * before[1].astype(float)
    # phasors, weights and sums in float32
    error = np.linalg.norm(total[0] + 1j * total[1] - wanted)
    assert error <= 1e-6 * (np.linalg.norm(wanted) + np.sqrt(wanted.size))


@settings(max_examples=20)
@given(seed=st.integers(0, 2 ** 32), share=st.floats(-1.0, 1.0))
def test_waves_of_the_band_arrive(seed, share):
    """``exp(j f alpha)`` with f anywhere in the band that the interpolator is for."""
    rng = np.random.default_rng(seed)
    parts = make_parts(rng, 1, 40, 300, 1)
    half = np.pi / parts.coarse.alpha_spacing / OVERSAMPLING
    frequency = parts.frequency[0] + share * half
    image = np.exp(1j * frequency * parts.coarse.alpha)[None, :, None]
    merged = upsample_azimuth(image, parts)[:, 0]
    wanted = np.exp(1j * frequency * parts.fine.alpha)
    # of single frequencies, by the table of the plan; 300 places between lines
    error = parts.interpolator.error_at(share * 0.5 / OVERSAMPLING)
    assert np.mean(np.abs(merged - wanted) ** 2) <= 1.5 * error + 1e-12
