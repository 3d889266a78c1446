# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Windows against their textbook figures."""

from __future__ import annotations

import numpy as np
import pytest

from sar_imaging.signal.windows import WINDOW_NAMES, parse_window, window

ZERO_PADDING = 256  # samples of the response per 1 / B


def _response_db(name, n):
    """Response of n bins in dB below its peak, sampled every 1 / (256 B)."""
    response = np.abs(np.fft.fft(window(name, n), n * ZERO_PADDING))[:n * ZERO_PADDING // 2]
    return 20 * np.log10(np.maximum(response / response[0], 1e-12))


# Width at -3 dB and first null in 1 / B, highest sidelobe in dB: Harris 1978 for the cosine
# windows; Taylor's level is designed; Kaiser's null is at hypot(pi, beta) / pi.
FIGURES = [('none', 0.8859, 1.0, -13.26), ('hamming', 1.303, 2.0, -42.67),
           ('hann', 1.441, 2.0, -31.47), ('taylor:4:35', 1.184, 1.664, -35.2),
           ('kaiser:6', 1.402, 2.156, -43.8), ('kaiser:0', 0.8859, 1.0, -13.26)]


@pytest.mark.parametrize(('name', 'width', 'null', 'sidelobe_db'), FIGURES)
def test_response_has_the_known_figures(name, width, null, sidelobe_db):
    response = _response_db(name, 512)
    first_null = int(np.argmax(np.diff(response) > 0))
    # Samples of the response are 1/256 apart; the levels are tabulated to 0.1 dB.
    assert 2 * np.argmax(response < -3.0103) / ZERO_PADDING == pytest.approx(width, abs=0.008)
    assert first_null / ZERO_PADDING == pytest.approx(null, abs=0.006)
    assert response[first_null:].max() == pytest.approx(sidelobe_db, abs=0.06)


@pytest.mark.parametrize('name', WINDOW_NAMES)
@pytest.mark.parametrize('n', [1, 2, 95, 96])
def test_weights_are_symmetric_and_at_most_one(name, n):
    weights = window(name, n)
    assert weights.shape == (n,)
    np.testing.assert_allclose(weights, weights[::-1], rtol=0, atol=1e-14)
    assert 0 < weights.min() and weights.max() <= 1 + 1e-12
    if n % 2:
        assert weights[n // 2] == pytest.approx(1.0, abs=1e-12)


def test_parameters_default_and_change_the_window():
    np.testing.assert_array_equal(window('taylor', 64), window('taylor:4:35', 64))
    np.testing.assert_array_equal(window('kaiser', 64), window('kaiser:6.0', 64))
    assert parse_window('taylor:5') == ('taylor', (5.0, 35.0))
    assert window('taylor:5:45', 64)[0] < window('taylor:5:30', 64)[0]


@pytest.mark.parametrize(('name', 'message'), [
    ('blackman', 'use one of none, hamming'), ('hamming:3', 'takes 0'),
    ('taylor:4:35:1', 'takes 2'), ('taylor:four', 'must be numbers'),
    ('taylor:2.5:35', 'whole number'), ('taylor:4:-35', '35 dB below'),
    ('kaiser:-1', 'not be negative'), ('kaiser:nan', 'finite')])
def test_bad_names_are_refused_with_advice(name, message):
    with pytest.raises(ValueError, match=message):
        parse_window(name)


def test_no_bins_are_refused():
    with pytest.raises(ValueError, match='at least one bin'):
        window('none', 0)
