# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Bands of sub-aperture images in the fused spectrum, against sums written out."""

import numpy as np
import pytest

from sar_imaging.backends.cpu.fft import GROUP_BYTES, LANES, panel_groups, rows_to_transform
from sar_imaging.backends.cpu.fusion import Band, add_transformed
from sar_imaging.backends.cpu.memory import aligned_empty, aligned_zeros


# 700 are transformed in two parts, 74 by SciPy; with 24 fine lines bands meet themselves.
@pytest.mark.parametrize(('n_coarse', 'n_fine'), [(40, 120), (700, 1000), (74, 120), (40, 24)])
@pytest.mark.parametrize('first', [-13, 95])
def test_transformed_lines_are_added_to_their_band(n_coarse, n_fine, first):
    rng = np.random.default_rng(n_coarse)
    n_bins = 2 * 8 * LANES + 5  # more than one panel, and no whole vector at the end
    width = -(-n_bins // LANES) * LANES
    samples = rng.standard_normal((n_coarse, width, 2)).astype(np.float32)
    samples = samples.view(np.complex64)[..., 0]
    slope = first + np.arange(n_bins) // 20  # of the band over range wavenumbers
    row = np.arange(slope[0], slope[-1] + n_coarse)
    band = Band(int(row[0]), np.searchsorted(slope, row - n_coarse, 'right'),
                np.searchsorted(slope, row, 'right'))
    rows = rows_to_transform(n_fine)
    lines = aligned_empty((n_coarse, width), np.complex64)
    lines[rows_to_transform(n_coarse)] = samples
    spectrum = aligned_zeros((n_fine, width), np.complex64)
    spectrum[:, :n_bins] = before = rng.standard_normal((n_fine, n_bins)).astype(np.complex64)
    add_transformed(lines, n_bins, band, rows, spectrum)

    transformed = np.fft.fft(samples.astype(complex), axis=0)
    expected = before[rows].astype(complex)  # in the order of wavenumbers
    for b in range(n_bins):
        for wavenumber in range(slope[b], slope[b] + n_coarse):
            expected[wavenumber % n_fine, b] += transformed[wavenumber % n_coarse, b]
    # float32 transforms: 1e-6 measured
    np.testing.assert_allclose(spectrum[rows, :n_bins], expected,
                               atol=1e-5 * np.abs(expected).max())
    assert not spectrum[:, n_bins:].any()


def test_panels_are_for_columns_that_stay_in_cache():
    assert panel_groups(140) * GROUP_BYTES == 1024
    assert 1 < panel_groups(500) <= (160 << 10) / 500 / GROUP_BYTES
    assert panel_groups(700) is None
    assert panel_groups(74) is None
