# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""When apertures are looked at for a mistake, and what is told of them."""

import dataclasses
import types

import numpy as np
import pytest

from sar_imaging.nodes.images import focus_watch
from sar_imaging.simulation.scenarios import SCENARIOS

LENGTH = 50  # pulses of an aperture
WHOLE = next(iter(SCENARIOS['psf']().blocks(100)))
NOISE, SHARP = (types.SimpleNamespace(at_noise_level=noise) for noise in (True, False))


class Told:
    """What a node would log and put into its diagnostics."""

    def __init__(self):
        self.figures, self.warnings, self.texts = {}, [], []
        self.set, self.warning = self.figures.__setitem__, self.warnings.append

    def tell(self, key, text):
        assert key == 'mistake'
        self.texts.append(text)


@pytest.fixture
def examined(monkeypatch):
    """Counters of the pulses of each diagnosis, which says what `examined.says` holds."""
    seen = types.SimpleNamespace(
        pulses=[], says=types.SimpleNamespace(focused=True, advice='', coherence=0.9))

    def diagnose(block, grid):
        seen.pulses.append(block.counter.tolist())
        if isinstance(seen.says, Exception):
            raise seen.says
        return seen.says

    monkeypatch.setattr(focus_watch, 'diagnose', diagnose)
    monkeypatch.setattr(focus_watch, 'aside', lambda work, name: work())
    monkeypatch.setattr(focus_watch, 'compile_kernels', lambda: None)
    return seen


def aperture(watch, number, figure=SHARP, block=WHOLE, n_pulses=LENGTH):
    """Two blocks of an aperture, and its image."""
    counters = number * LENGTH + np.arange(n_pulses)
    some = dataclasses.replace(block.select(slice(0, n_pulses)), counter=counters)
    for part in (slice(0, n_pulses // 2), slice(n_pulses // 2, n_pulses)):
        watch.see(some.select(part))
    watch.judge(number, figure)


def test_the_first_aperture_is_looked_at_and_again_once_images_sink_into_noise(examined):
    told = Told()
    watch = focus_watch.FocusWatch(None, LENGTH, told)
    for number, figure in enumerate([SHARP, NOISE, NOISE, NOISE, NOISE]):
        examined.says.focused = number == 0
        aperture(watch, number, figure)
    # all pulses of the first, and of the one after the first image of noise: then none was focused
    assert examined.pulses == [[*range(0, 50)], [*range(100, 150)]]
    assert told.figures['focus_coherence'] == 0.9 and told.figures['diagnosis_seconds'] >= 0.0
    assert not told.warnings and not any(told.texts)


def test_a_mistake_is_told_until_another_radar_comes(examined):
    told = Told()
    watch = focus_watch.FocusWatch(None, LENGTH, told)
    examined.says = types.SimpleNamespace(focused=False, advice='Set it.', coherence=0.1)
    aperture(watch, 0)
    assert told.texts[-1] == 'Set it.'
    assert told.warnings[0].startswith('aperture 0: ')
    examined.says.advice = ''
    other = dataclasses.replace(
        WHOLE, radar=dataclasses.replace(WHOLE.radar, carrier_hz=WHOLE.radar.carrier_hz / 2))
    aperture(watch, 1, block=other)
    assert len(examined.pulses) == 2 and told.texts[-1] == '' and len(told.warnings) == 1


def test_few_pulses_wait_for_more_and_errors_end_nothing(examined):
    told = Told()
    watch = focus_watch.FocusWatch(None, LENGTH, told)
    aperture(watch, 0, n_pulses=15)
    assert not examined.pulses
    examined.says = RuntimeError('no scatterer')
    aperture(watch, 1, n_pulses=16)
    assert len(examined.pulses) == 1
    assert told.warnings == ['aperture 1 could not be examined: no scatterer']
    # seconds alone: they were NaN meanwhile, and evaluate waits for that to end
    assert set(told.figures) == {'diagnosis_seconds'} and told.figures['diagnosis_seconds'] >= 0.0


def test_where_the_diagnosis_would_be_wrong_nothing_is_looked_at(examined):
    watch = focus_watch.FocusWatch(None, LENGTH, Told(), watching=False)
    for number, figure in enumerate([SHARP, NOISE, NOISE]):
        aperture(watch, number, figure)
    assert not examined.pulses
