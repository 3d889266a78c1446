# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Mistakes are named on a simulated rail, and on measured data; never on what is right."""

import dataclasses
import re
import sys
from pathlib import Path

import pytest

from sar_imaging.diagnosis import diagnose
from sar_imaging.signal.dechirp import fmcw_parameters
from sar_imaging.signal.pulses import concatenate
from sar_imaging.signal.range_compression import RangeCompressor
from sar_imaging.simulation.scenarios import SCENARIOS

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))
from benchmarks import mistakes
from benchmarks.support import mistake_recordings

data = pytest.mark.data
needs_data = pytest.mark.skipif(not mistake_recordings.DATA.is_dir(),
                                reason='measured recordings in ../shared/data')


def moved(block, change):
    return dataclasses.replace(block, tx_m=change(block.tx_m), rx_m=change(block.rx_m))


def with_radar(block, **changes):
    return dataclasses.replace(block, radar=dataclasses.replace(block.radar, **changes))


MISTAKES = {
    'samples conjugated': lambda b: dataclasses.replace(b, samples=b.samples.conj()),
    'x and y exchanged': lambda b: moved(b, lambda p: p[..., [1, 0, 2]]),
    'track mirrored in y': lambda b: moved(b, lambda p: p * [1, -1, 1]),
    'positions in millimetres': lambda b: moved(b, lambda p: 1000 * p),
    'positions in kilometres': lambda b: moved(b, lambda p: 1e-3 * p),
    'positions reversed': lambda b: moved(b, lambda p: p[::-1]),
}


@pytest.mark.parametrize(('name', 'compressed'), [
    *((name, False) for name in MISTAKES), ('samples conjugated', True)])
def test_mistake_is_named(right, grid, name, compressed):
    block = MISTAKES[name](right)
    if compressed:  # as backprojection has it
        block = RangeCompressor.for_block(block, window='hamming')(block)
    diagnosis = diagnose(block, grid)
    assert diagnosis.mistake == name
    assert not diagnosis.focused
    # In focus the figure is that of the right data, 3.1: it is above 2.5 with either window.
    assert diagnosis.corrected > 2.5 > diagnosis.coherence
    assert diagnosis.advice in str(diagnosis)


@pytest.mark.parametrize('compressed', [False, True])
def test_wrong_sign_of_the_slope(right, grid, compressed):
    radar = fmcw_parameters(start_frequency_hz=23.5e9, slope_hz_per_s=-10e12,
                            sample_rate_hz=2.5e6, n_samples=192, adc_start_s=6e-6)
    block = dataclasses.replace(right, radar=radar)
    if compressed:
        block = RangeCompressor.for_block(block)(block)
    assert diagnose(block, grid).mistake == 'sign of the slope'


@pytest.mark.parametrize('offset', [-30, 45])
def test_clock_offset_is_named_with_its_size(right, grid, offset):
    n = right.n_pulses
    pulses, places = (slice(0, n - offset), slice(offset, n))
    if offset < 0:
        pulses, places = slice(-offset, n), slice(0, n + offset)
    block = dataclasses.replace(right.select(pulses), tx_m=right.tx_m[places],
                                rx_m=right.rx_m[places])
    diagnosis = diagnose(block, grid)
    assert diagnosis.mistake == 'clock offset'
    sign, value = re.search(r'at t ([+-]) ([\d.]+) s', diagnosis.advice).groups()
    # The text has two digits; a pulse is 0.01 s long.
    assert float(sign + value) == pytest.approx(-offset / 100, abs=0.015)


def test_right_data_are_not_accused(right, grid):
    diagnosis = diagnose(right, grid)
    assert diagnosis.focused and not diagnosis.advice
    assert diagnosis.coherence > 2.5
    profiles = RangeCompressor.for_block(right, window='hamming')(right)
    assert not diagnose(profiles, grid).mistake


def test_noise_alone_is_told_and_nobody_accused(empty, grid):
    diagnosis = diagnose(empty, grid)
    assert not diagnosis.mistake and not diagnosis.focused
    assert 'nothing stands out from noise, and no hypothesis' in diagnosis.advice
    # Beta(1, 63): 0.98; 5 % for the number of independent pixels
    assert diagnosis.coherence == pytest.approx(0.98, abs=0.08)


def test_places_that_no_pulse_reaches(right, grid):
    far = moved(right, lambda p: p + [0.0, 5e5, 0.0])
    assert 'do not reach the grid' in diagnose(far, grid).advice


def test_few_pulses_are_not_judged(right, grid):
    diagnosis = diagnose(right.select(slice(0, 8)), grid)
    assert '8 pulses are too few' in diagnosis.advice and not diagnosis.mistake


@pytest.mark.parametrize('name', ['letter_s', 'moving_targets'])  # `make mistakes` tries all
def test_right_scenarios_are_not_accused(name):
    scenario = SCENARIOS[name]()
    pulses = concatenate(list(scenario.blocks())).select(slice(0, scenario.pulses_per_aperture))
    assert not diagnose(pulses, scenario.grid).advice


@data
@needs_data
@pytest.mark.parametrize('name', ['arcsar', 'gotcha', 'team5'])  # `make mistakes` tries all
def test_measured_data_are_not_accused(name):
    recording = mistake_recordings.MEASURED[name]()
    assert not diagnose(recording.block, recording.grid, window=recording.window).advice


@data
@needs_data
@pytest.mark.parametrize(('name', 'mistake'), [
    ('arcsar', mistakes.slope_sign), ('gotcha', mistakes.one_way_delay),
    ('team6', mistakes.left_out), ('team6', mistakes.clock_offset)])
def test_mistakes_in_measured_data_are_named(name, mistake):
    text, _ = mistakes.named(mistake_recordings.MEASURED[name](), mistake)
    assert any(word in text for word in mistakes.MISTAKES[mistake])
