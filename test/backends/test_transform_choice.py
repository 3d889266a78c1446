# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""SciPy's transforms in place of the own ones: where the environment asks for them."""

import numpy as np
import pytest
import scipy.fft

from benchmarks.goldens import difference_db, form
from benchmarks.support.golden_cases import CASES
from sar_imaging.backends.cpu import fft
from sar_imaging.backends.cpu.fft import (
    LANES,
    OWN,
    SCIPY,
    VARIABLE,
    rows_to_transform,
    transform_columns,
    transform_rows,
)

SAME_DB = -120.0  # both round float32


@pytest.fixture
def scipy_alone(monkeypatch):
    """SciPy's transforms; the own ones fail where they are used."""
    def fail(*arguments):
        raise AssertionError('own transforms are used')

    def choose():
        monkeypatch.setenv(VARIABLE, SCIPY)
        monkeypatch.setattr(fft, 'compiled_passes', fail)
        monkeypatch.setattr(fft, 'plan_passes', fail)
    return choose


@pytest.mark.parametrize('name', ['afbp_1km', 'afbp_phase_history', 'live'])
def test_images_are_the_same(name, scipy_alone):
    own = form(CASES[name])
    scipy_alone()
    other = form(CASES[name])
    assert -np.inf < difference_db(other.image, own.image) <= SAME_DB
    assert (other.plan, other.predicted_error_db) == (own.plan, own.predicted_error_db)


@pytest.mark.parametrize('n', [256, 1024])
@pytest.mark.parametrize('inverse', [False, True])
def test_rows_and_columns(n, inverse, scipy_alone):
    scipy_alone()
    rng = np.random.default_rng(n)
    data = (rng.standard_normal((n, 3 * LANES, 2)).astype(np.float32)).view(np.complex64)[..., 0]
    transform = np.fft.ifft if inverse else np.fft.fft
    options = {'norm': 'forward'} if inverse else {}
    expected = transform(data.astype(complex), axis=0, **options)
    columns = np.empty_like(data)
    columns[rows_to_transform(n)] = data
    transform_columns(columns, 3 * LANES, inverse=inverse)
    rows = np.ascontiguousarray(data.T)
    transform_rows(rows, inverse=inverse)
    for found in (columns, rows.T):  # 3e-7 measured for both libraries
        assert np.linalg.norm(found - expected) <= 1e-6 * np.linalg.norm(expected)


@pytest.mark.parametrize('n', [256, 1024, 4096, 4800, 6144])
def test_own_transforms_round_no_more_than_those_of_scipy(n):
    """Twiddle factors are rounded from float64. Measured 0.2 to 0.5 dB better, alike within 0.1 dB
    where the processor has no fused multiplications."""
    rng = np.random.default_rng(n)
    data = rng.standard_normal((n, 4 * LANES, 2)).astype(np.float32).view(np.complex64)[..., 0]
    exact = np.fft.fft(data.astype(complex), axis=0)
    columns = np.empty_like(data)
    columns[rows_to_transform(n)] = data
    transform_columns(columns, 4 * LANES)
    rows = np.ascontiguousarray(data.T)
    transform_rows(rows)
    most = np.linalg.norm(scipy.fft.fft(data, axis=0) - exact)
    for found in (columns, rows.T):
        assert 0 < np.linalg.norm(found - exact) <= 1.03 * most


def test_other_choices_are_refused(monkeypatch):
    monkeypatch.setenv(VARIABLE, 'fftw')
    with pytest.raises(ValueError, match="SAR_IMAGING_TRANSFORMS='fftw'; expected own, or scipy"):
        transform_rows(np.zeros((2, 256), np.complex64))
    monkeypatch.setenv(VARIABLE, OWN)
    transform_rows(np.zeros((2, 256), np.complex64))
