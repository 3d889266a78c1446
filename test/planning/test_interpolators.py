# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""The polynomial interpolator against exact tones, and its predicted error."""

import numpy as np
import pytest

from sar_imaging.planning.interpolators import (
    LINE_DEGREE,
    POINT_DEGREE,
    TAPS,
    design_interpolator,
    sufficient_interpolators,
)


def _read(samples, interpolator, place, t):
    """Between samples `place` and `place` + 1."""
    neighbours = samples[place + interpolator.first + np.arange(TAPS)]
    return np.polynomial.polynomial.polyval(t, interpolator.weights.astype(float) @ neighbours)


@pytest.mark.parametrize('oversampling', [1.6, 2.5, 4.0])
@pytest.mark.parametrize('margin', [0.0, 0.3])
@pytest.mark.parametrize('degree', [POINT_DEGREE, LINE_DEGREE])
def test_predicted_error_is_the_measured_one(oversampling, margin, degree):
    interpolator = design_interpolator(oversampling, margin, degree=degree)
    rng = np.random.default_rng(3)
    error = power = 0.0
    for frequency in rng.uniform(-0.5, 0.5, 40) / oversampling:
        samples = np.exp(2j * np.pi * frequency * np.arange(32))
        t = rng.uniform(-margin, 1 + margin, 200)
        exact = np.exp(2j * np.pi * frequency * (15 + t))
        error += np.sum(np.abs(_read(samples, interpolator, 15, t) - exact) ** 2)
        power += t.size
    measured = 10 * np.log10(error / power)
    # 40 random tones sample the band's average to about 1 dB; float32 planes add -130 dB
    assert measured == pytest.approx(interpolator.error_db, abs=2.0)


@pytest.mark.parametrize(('taps', 'oversampling'), [(6, 1.18), (6, 1.5), (8, 1.1), (8, 1.3)])
def test_corrected_spectra_need_few_taps(taps, oversampling):
    interpolator = design_interpolator(oversampling, taps=taps, degree=5, deapodised=True)
    assert interpolator.error_db < -62.0  # 14 taps of 1.18 times sampled tones: -45
    frequency = (np.arange(400) + 0.5) / 400 * 0.5 / oversampling
    t = np.linspace(0, 1, 101)
    weights = interpolator.weights.T.astype(float) @ t ** np.arange(6)[:, None]
    tones = np.exp(2j * np.pi * np.outer(frequency, np.arange(taps) + interpolator.first))
    read = interpolator.gain(frequency)[:, None] * (tones @ weights)
    error = np.abs(read - np.exp(2j * np.pi * np.outer(frequency, t))) ** 2
    # 0.0 to 0.5 dB apart: fewer nodes of the quadrature
    assert 10 * np.log10(error.mean()) == pytest.approx(interpolator.error_db, abs=1.0)
    np.testing.assert_array_equal(interpolator.gain(-frequency), interpolator.gain(frequency))


def test_the_coarsest_interpolator_reaches_its_error_just_so():
    found = next(sufficient_interpolators(-63.0, taps=6, degree=5, deapodised=True))
    coarser = design_interpolator(found.oversampling - 0.02, taps=6, degree=5, deapodised=True)
    assert found.error_db <= -63.0 < coarser.error_db
    plain = next(sufficient_interpolators(-63.0, taps=14, degree=5))
    assert plain.oversampling > found.oversampling
    assert not list(sufficient_interpolators(-150.0, taps=2, degree=1))


def test_more_oversampling_means_less_error():
    errors = [design_interpolator(r).error_db for r in (1.5, 2.0, 3.0, 4.0)]
    assert errors == sorted(errors, reverse=True)
    assert errors[2] < -80  # three samples per resolution cell suffice for the default target


@pytest.mark.parametrize(('oversampling', 'margin', 'message'), [
    (1.0, 0.0, 'sampled above its bandwidth'), (2.0, -0.1, 'must not be negative')])
def test_impossible_designs_are_refused(oversampling, margin, message):
    with pytest.raises(ValueError, match=message):
        design_interpolator(oversampling, margin)
