# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Transforms of rows against NumPy's in double precision."""

import numpy as np
import pytest
import scipy.fft
from hypothesis import given, settings, strategies as st

from sar_imaging.backends.cpu.fft import transform_rows
from sar_imaging.backends.cpu.memory import aligned_empty
from sar_imaging.compilation import numba
from sar_imaging.planning.transform_lengths import row_length, row_shape

# multiples of LANES and others, all radices; too short, no two factors, and too large ones
LENGTHS = (256, 400, 2048, 3000, 9000, 12288, 14406, 15400, 18432, 131220,
           7, 180, 1331, 1021, 3400)
# rms relative to that of the exact result: 1.7e-7 measured at most up to 30000, as SciPy's
ERROR = 3e-7


def _check(lines, inverse):
    before = lines.astype(np.complex128)
    transform_rows(lines, inverse=inverse)
    exact = np.fft.ifft(before, norm='forward') if inverse else np.fft.fft(before)
    assert np.linalg.norm(lines - exact) <= ERROR * np.linalg.norm(exact)


def _noise(n_rows, n, seed=0):
    parts = np.random.default_rng(seed).standard_normal((n_rows, n, 2)).astype(np.float32)
    return parts.view(np.complex64)[..., 0]


@pytest.mark.parametrize('inverse', [False, True], ids=['forward', 'inverse'])
@pytest.mark.parametrize('n', LENGTHS)
def test_rows_are_transformed_in_place(n, inverse):
    _check(_noise(3, n), inverse)


@settings(max_examples=30, deadline=None)
@given(n=st.integers(16, 70).flatmap(lambda height: st.integers(16, 70).map(height.__mul__)),
       n_rows=st.integers(0, 5), offset=st.integers(0, 9), beyond=st.integers(0, 20),
       inverse=st.booleans())
def test_nothing_beside_the_rows_changes(n, n_rows, offset, beyond, inverse):
    memory = aligned_empty((offset + n_rows * (n + beyond) + 20,), np.complex64)
    memory[:] = _noise(1, len(memory), n)
    before = memory.copy()
    rows = slice(offset, offset + n_rows * (n + beyond))
    _check(memory[rows].reshape(n_rows, n + beyond)[:, :n], inverse)
    before[rows].reshape(n_rows, n + beyond)[:, :n] = memory[rows].reshape(
        n_rows, n + beyond)[:, :n]
    np.testing.assert_array_equal(memory, before)


@pytest.mark.parametrize('n', [3000, 18432])
def test_number_of_threads_does_not_matter(n):
    rows = [_noise(5, n) for _ in range(2)]
    transform_rows(rows[0])
    threads = numba.get_num_threads()
    numba.set_num_threads(1)
    try:
        transform_rows(rows[1])
    finally:
        numba.set_num_threads(threads)
    np.testing.assert_array_equal(*rows)


@settings(max_examples=50, deadline=None)
@given(least=st.integers(1, 40000))
def test_lengths_are_little_longer(least):
    length = row_length(least)
    assert least <= length <= max(1.12 * least, least + 1)
    assert scipy.fft.next_fast_len(length) == length


def test_lengths_of_long_rows_are_closer():
    for least in range(2000, 30000, 37):
        assert least <= row_length(least) <= 1.03 * least


@pytest.mark.parametrize('n', [12288, 18432, 24000, 30000])
def test_rows_become_nearly_square_matrices(n):
    """Columns of a long one would take more passes or leave the cache."""
    height, width = row_shape(n)
    assert height * width == n
    assert max(height, width) < 2 * min(height, width)


def test_other_arrays_are_refused():
    for data in (np.zeros((4, 256)), np.zeros((256, 4), np.complex64).T):
        with pytest.raises(ValueError, match='samples of a row side by side'):
            transform_rows(data)


@pytest.mark.parametrize('n', [256, 1021])
def test_no_rows(n):
    transform_rows(np.zeros((0, n), np.complex64))
