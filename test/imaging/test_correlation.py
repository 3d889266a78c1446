# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Time-domain correlation against direct sums and Rosenberg & Gray's figures."""

import numpy as np
import pytest

from sar_imaging.imaging.correlation import correlate
from sar_imaging.signal import SPEED_OF_LIGHT
from sar_imaging.signal.spectra import band_spectrum


def test_equals_the_sum_of_equation_8(make_case):
    case = make_case(200.0, channels=3, pulses=7, n_points=2)
    frequencies, spectra = band_spectrum(case.block)
    points = case.grid.points()[::40, ::31]
    image = correlate(frequencies, spectra, case.block.tx_m, case.block.rx_m, points)
    expected = np.zeros(points.shape[:2], complex)
    for m in range(7):
        for c in range(3):
            path = (np.linalg.norm(points - case.block.tx_m[m, c], axis=-1)
                    + np.linalg.norm(points - case.block.rx_m[m, c], axis=-1))
            phase = np.multiply.outer(path / SPEED_OF_LIGHT, frequencies)
            expected += np.exp(2j * np.pi * phase) @ spectra[m, c]
    # float64 phases of 1.4e4 cycles leave 1e-11 of the sum of magnitudes
    np.testing.assert_allclose(image, expected, atol=1e-9 * np.abs(spectra).sum())


def test_a_scatterer_images_to_its_number_of_samples(make_case):
    case = make_case(1000.0, channels=2, n_points=1)
    frequencies, spectra = band_spectrum(case.block)
    peak = correlate(frequencies, spectra, case.block.tx_m, case.block.rx_m, case.points)
    # complex64 profiles limit the agreement
    assert peak[0] == pytest.approx(48 * 2 * len(frequencies), rel=1e-6)


def _sidelobe_ratio_db(power):
    """Energy outside the nulls next to the middle over energy inside, dB."""
    left = right = len(power) // 2
    while power[left - 1] < power[left]:
        left -= 1
    while power[right + 1] < power[right]:
        right += 1
    main = power[left:right + 1].sum()
    return 10 * np.log10((power.sum() - main) / main)


@pytest.mark.parametrize(('axis', 'half_width_m', 'paper_db'), [(0, 3.0, -10.49),
                                                               (1, 15.0, -10.53)])
def test_sidelobe_ratio_of_the_paper(axis, half_width_m, paper_db):
    # Table 1: 10 GHz, 300 MHz, five receivers at half a wavelength, 200 pulses at 667 Hz and
    # 200 m/s, 10 km; 95 bins of the spectrum of 126 range bins at 400 MHz lie in the band.
    frequencies = 10e9 + (np.arange(95) - 47) * 400e6 / 126
    tx = np.zeros((200, 5, 3))
    tx[..., 1] = ((np.arange(200) - 99.5) * 200 / 667)[:, None]
    rx = tx + np.arange(-2, 3)[:, None] * [0, SPEED_OF_LIGHT / 10e9 / 2, 0]
    focus = np.array([10e3, 0, 0])
    path = np.linalg.norm(tx - focus, axis=-1) + np.linalg.norm(rx - focus, axis=-1)
    cycles = np.multiply.outer(path / SPEED_OF_LIGHT, frequencies)
    cut = np.tile(focus, (2001, 1))
    cut[:, axis] += np.linspace(-half_width_m, half_width_m, 2001)
    image = correlate(frequencies, np.exp(-2j * np.pi * np.mod(cycles, 1)), tx, rx, cut)
    assert _sidelobe_ratio_db(np.abs(image) ** 2) == pytest.approx(paper_db, abs=0.02)


def test_any_number_of_points(make_case):
    case = make_case(200.0, pulses=3, n_points=1)
    frequencies, spectra = band_spectrum(case.block)
    positions = case.block.tx_m, case.block.rx_m
    points = case.grid.points().reshape(-1, 3)[:4100]
    whole = correlate(frequencies, spectra, *positions, points)
    for count in (0, 1, 17):
        part = correlate(frequencies, spectra, *positions, points[:count])
        np.testing.assert_allclose(part, whole[:count], rtol=1e-9)


@pytest.mark.parametrize(('change', 'message'), [
    ({'frequencies_hz': np.array([1e9, 1.1e9, 1.3e9])}, 'not equally spaced'),
    ({'spectra': np.ones((2, 1, 4))}, r'spectra.shape=\(2, 1, 4\) does not match 3 frequencies'),
    ({'tx_m': np.zeros((3, 1, 3))}, r'tx_m.shape=\(3, 1, 3\); expected \(2, 1, 3\)'),
    ({'rx_m': np.full((2, 1, 3), np.nan)}, 'rx_m contains NaN'),
    ({'points': np.zeros((5, 2))}, r'points.shape=\(5, 2\); expected \(..., 3\)'),
])
def test_bad_input_is_named(change, message):
    good = {'frequencies_hz': np.array([1e9, 1.1e9, 1.2e9]), 'spectra': np.ones((2, 1, 3)),
            'tx_m': np.zeros((2, 1, 3)), 'rx_m': np.zeros((2, 1, 3)), 'points': np.ones((5, 3))}
    with pytest.raises(ValueError, match=message):
        correlate(**(good | change))
