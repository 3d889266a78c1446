# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""What evaluate says of an image that is fine though its pulses hold no strong reflector."""

import types

import numpy as np
import pytest

from sar_imaging.diagnosis import Diagnosis
from sar_imaging.geometry import MapGrid
from sar_imaging.tools.evaluation import examination

GRID = MapGrid((0.0, 0.0, 0.0), 128, 128, 0.25)
NOTHING = 'nothing stands out from noise'


def _image(brightest):
    """Speckle, and one pixel so many times brighter than its rms."""
    rng = np.random.default_rng(1)
    image = (rng.normal(size=GRID.shape) + 1j * rng.normal(size=GRID.shape)).astype(np.complex64)
    if brightest:
        image[60, 70] = brightest
    return image


@pytest.mark.parametrize(('diagnosis', 'brightest', 'advice'), [
    (Diagnosis(1.15, 1.0, '', NOTHING), 40.0, ''),  # focused clutter, 28 dB over the median
    (Diagnosis(1.15, 1.0, '', NOTHING), 0.0, NOTHING),  # noise
    (Diagnosis(1.15, 1.0, 'conjugated', 'conjugate'), 40.0, 'conjugate'),
    (Diagnosis(0.0, 0.0, '', 'the profiles do not reach'), 40.0, 'the profiles do not reach'),
])
def test_advice_is_given_where_something_is_wrong(monkeypatch, diagnosis, brightest, advice):
    monkeypatch.setattr(examination, 'diagnose', lambda *_, **__: diagnosis)
    monkeypatch.setattr(examination, '_pulses', lambda *_: None)
    recording = types.SimpleNamespace(truth=None)
    focus = examination.examine(recording, 0, 64, _image(brightest), GRID)
    assert focus['advice'] == advice
    assert focus['at_noise_level'] is (not brightest)
    assert ('warning' in examination.describe(focus)) is bool(advice)


@pytest.mark.parametrize(('verdict', 'mistake'), [
    ('focused by autofocus', ''), ('focused already', ''),
    ('sharpened by autofocus, focus not confirmed', 'clock offset'),
    ('not changed by autofocus, focus not confirmed', 'clock offset'),
    ('autofocus failed', 'clock offset')])
def test_mistakes_of_recorded_positions_are_none_of_an_image_in_focus(monkeypatch, verdict,
                                                                       mistake):
    monkeypatch.setattr(examination, 'diagnose', lambda *_, **__: Diagnosis(
        1.15, 1.0, 'clock offset', 'set pose.time_offset_s'))
    monkeypatch.setattr(examination, '_pulses', lambda *_: None)
    focus = examination.examine(types.SimpleNamespace(truth=None), 0, 64, _image(40.0), GRID,
                                {'verdict': verdict})
    assert focus['mistake'] == mistake
    assert examination.doubtful(focus) is bool(mistake)
