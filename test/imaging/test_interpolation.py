"""The polynomial interpolator against exact tones, and its predicted error."""

import numpy as np
import pytest

from sar_imaging.imaging.interpolation import (
    LINE_DEGREE,
    POINT_DEGREE,
    TAPS,
    design_interpolator,
    polynomial_planes,
)


def _planes(samples, interpolator, phases=1):
    dense = np.pad(samples.reshape(-1, phases).T, ((0, 0), (TAPS, TAPS)))[None]
    real, imag = (np.ascontiguousarray(a, np.float32) for a in (dense.real, dense.imag))
    out = np.empty((1, phases, interpolator.n_planes, len(samples) // phases), np.float32)
    polynomial_planes(real, imag, interpolator.weights, interpolator.first, 0, out)
    return out[0]


def _evaluate(planes, phase, cell, t):
    real, imag = np.split(planes[phase, :, cell], 2)
    return np.polynomial.polynomial.polyval(t, real + 1j * imag)


@pytest.mark.parametrize('oversampling', [1.6, 2.5, 4.0])
@pytest.mark.parametrize('margin', [0.0, 0.3])
@pytest.mark.parametrize('degree', [POINT_DEGREE, LINE_DEGREE])
def test_predicted_error_is_the_measured_one(oversampling, margin, degree):
    interpolator = design_interpolator(oversampling, margin, degree=degree)
    rng = np.random.default_rng(3)
    error = power = 0.0
    for frequency in rng.uniform(-0.5, 0.5, 40) / oversampling:
        samples = np.exp(2j * np.pi * frequency * np.arange(32))
        planes = _planes(samples, interpolator)
        t = rng.uniform(-margin, 1 + margin, 200)
        exact = np.exp(2j * np.pi * frequency * (15 + t))
        error += np.sum(np.abs(_evaluate(planes, 0, 15, t) - exact) ** 2)
        power += t.size
    measured = 10 * np.log10(error / power)
    # 40 random tones sample the band's average to about 1 dB; float32 planes add -130 dB
    assert measured == pytest.approx(interpolator.error_db, abs=2.0)


def test_more_oversampling_means_less_error():
    errors = [design_interpolator(r).error_db for r in (1.5, 2.0, 3.0, 4.0)]
    assert errors == sorted(errors, reverse=True)
    assert errors[2] < -80  # three samples per resolution cell suffice for the default target


def test_phases_are_interleaved_samples():
    interpolator = design_interpolator(6.0)
    samples = np.exp(2j * np.pi * 0.05 * np.arange(60))
    planes = _planes(samples, interpolator, phases=3)
    for phase in range(3):
        value = _evaluate(planes, phase, 9, 0.4)
        exact = np.exp(2j * np.pi * 0.05 * (9 * 3 + phase + 0.4))
        assert abs(value - exact) < 1e-4  # -92 dB predicted for a flat band, tone inside it


@pytest.mark.parametrize(('oversampling', 'margin', 'message'), [
    (1.0, 0.0, 'sampled above its bandwidth'), (2.0, -0.1, 'must not be negative')])
def test_impossible_designs_are_refused(oversampling, margin, message):
    with pytest.raises(ValueError, match=message):
        design_interpolator(oversampling, margin)
