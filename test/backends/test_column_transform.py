# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Transforms down columns against NumPy's in double precision."""

import numpy as np
import pytest

from sar_imaging.backends.cpu.fft import LANES, rows_to_transform, transform_columns

# all radices, one part and two, factors too large for it
LENGTHS = (1, 2, 3, 5, 16, 54, 98, 105, 144, 242, 512, 660, 1000, 7, 11, 26, 527)


@pytest.mark.parametrize('inverse', [False, True], ids=['forward', 'inverse'])
@pytest.mark.parametrize('n', LENGTHS)
@pytest.mark.parametrize('weighted', [False, True], ids=['', 'weighted'])
def test_columns_are_transformed_in_place(n, inverse, weighted):
    rng = np.random.default_rng(n)
    n_columns = 9 * LANES + 5
    data = rng.standard_normal((n, 11 * LANES, 2)).astype(np.float32).view(np.complex64)[..., 0]
    before, rows = data.copy(), rows_to_transform(n)
    data[rows] = before
    gain = rng.uniform(0.5, 1.5, n) if weighted else None
    transform_columns(data, n_columns, inverse=inverse, gain=gain)
    exact = before.astype(np.complex128) * (gain[:, None] if weighted else 1.0)
    exact = np.fft.ifft(exact, axis=0) * n if inverse else np.fft.fft(exact, axis=0)
    error = data[:, :n_columns] - exact[:, :n_columns]
    # 1.8e-7 measured at most, as SciPy's in single precision
    assert np.sqrt((np.abs(error) ** 2).mean() / n) <= 4e-7
    np.testing.assert_array_equal(data[rows, 10 * LANES:], before[:, 10 * LANES:])


def test_other_arrays_are_refused():
    for data in (np.zeros((16, 32)), np.zeros((16, 32), np.complex64)[::2],
                 np.zeros((16, 3 * LANES // 2), np.complex64)):
        with pytest.raises(ValueError, match='contiguous complex64'):
            transform_columns(data, 16)
