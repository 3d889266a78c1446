# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Every limit of the signal processing, just inside and just outside."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from sar_imaging.signal.background import subtract_background
from sar_imaging.signal.pulses import PulseBlock
from sar_imaging.signal.pulses.buffer import PulseBuffer
from sar_imaging.signal.pulses.sequence import RestartDetector
from sar_imaging.signal.radar import SPEED_OF_LIGHT, RadarParameters, Waveform
from sar_imaging.signal.range_compression import RangeCompressor, fast_length
from sar_imaging.signal.waveforms import check_lfm
from sar_imaging.signal.windows import parse_window

LFM = RadarParameters(carrier_hz=10e9, bandwidth_hz=100e6, sample_rate_hz=125e6,
                      first_sample_delay_s=1e-6, pulse_length_s=1e-6, chirp_rate_hz_per_s=1e14)
PROFILES = dataclasses.replace(LFM, pulse_length_s=0.0, chirp_rate_hz_per_s=0.0)
PASSBAND = RadarParameters(carrier_hz=4e9, bandwidth_hz=2e9, sample_rate_hz=10e9,
                           first_sample_delay_s=1e-8, waveform=Waveform.PASSBAND)
STEPPED = RadarParameters(carrier_hz=10e9, bandwidth_hz=100e6, sample_rate_hz=100e6,
                          first_sample_delay_s=1e-6, waveform=Waveform.STEPPED_FREQUENCY)
SPACING_M = SPEED_OF_LIGHT / 2 / 125e6  # of the profiles


def lfm(**changes):
    return check_lfm(dataclasses.replace(LFM, **changes))


def plan(radar=PROFILES, n_samples=200, compressed=True, **options):
    return RangeCompressor(radar, n_samples, compressed=compressed, **options)


def passband(**changes):
    return plan(dataclasses.replace(PASSBAND, **changes), 500, False)


def window_from(start, stop):
    """Profiles of 200 samples, of which 0 is at 149.9 m, cut by numbers of samples."""
    return plan(oversampling=1.0, range_window_m=tuple(PROFILES.range_start_m + n * SPACING_M
                                                       for n in (start, stop)))


def stepped_window(start_m, stop_m):
    """100 frequencies tell apart 149.9 m around 149.9 m."""
    return plan(STEPPED, 100, False, range_window_m=(start_m, stop_m))


def pulses(n, waveform=PROFILES):
    return PulseBlock(waveform, True, np.arange(n), np.arange(n), np.ones((n, 1, 8)),
                      np.ones((n, 1, 3)), np.ones((n, 1, 3)))


LIMITS = [
    # What must work, what must not, and the words of the refusal.
    (lambda: lfm(bandwidth_hz=100e6 / 1.0099), lambda: lfm(bandwidth_hz=100e6 / 1.0101),
     'sweeps its bandwidth once'),
    (lambda: lfm(bandwidth_hz=100e6 / 0.9901), lambda: lfm(bandwidth_hz=100e6 / 0.9899),
     'sweeps its bandwidth once'),
    (lambda: lfm(sample_rate_hz=100e6), lambda: lfm(sample_rate_hz=99.9e6),
     'need at least the bandwidth'),
    (lambda: lfm(pulse_length_s=1.01 / 125e6, chirp_rate_hz_per_s=100e6 * 125e6 / 1.01),
     lambda: lfm(pulse_length_s=1 / 125e6, chirp_rate_hz_per_s=100e6 * 125e6),
     'shorter than two samples'),
    (lambda: plan(LFM, 125, False), lambda: plan(LFM, 124, False), 'less than one pulse'),
    (lambda: plan(oversampling=1.0), lambda: plan(oversampling=0.999), 'at least 1.0 output'),
    (lambda: plan(n_samples=2), lambda: plan(n_samples=1), 'at least two samples'),
    (lambda: passband(sample_rate_hz=10.0e9), lambda: passband(sample_rate_hz=9.99e9),
     'hold frequencies up to half'),
    (lambda: passband(bandwidth_hz=2e9, carrier_hz=1e9),
     lambda: passband(bandwidth_hz=2e9, carrier_hz=0.99e9), 'hold frequencies up to half'),
    (lambda: window_from(198.9, 400), lambda: window_from(199.1, 400), 'outside the profiles'),
    (lambda: window_from(-50, 0.1), lambda: window_from(-50, -0.1), 'outside the profiles'),
    (lambda: window_from(5, 5.01), lambda: window_from(5, 5), 'larger farthest distance'),
    (lambda: stepped_window(224.8, 300.0), lambda: stepped_window(224.9, 300.0), 'lies outside'),
    (lambda: stepped_window(10.0, 75.0), lambda: stepped_window(10.0, 74.9), 'lies outside'),
    (lambda: fast_length(2**24), lambda: fast_length(2**24 + 1), 'expected at most 16777216'),
    (lambda: subtract_background(pulses(3)), lambda: subtract_background(pulses(2)),
     'at least three pulses'),
    (lambda: parse_window('taylor:1:0.1'), lambda: parse_window('taylor:0:35'), 'whole number'),
    (lambda: parse_window('taylor:4:0.1'), lambda: parse_window('taylor:4:0'), 'positive'),
    (lambda: parse_window('kaiser:0'), lambda: parse_window('kaiser:-0.01'), 'not be negative'),
    (lambda: PulseBuffer(pulses_per_aperture=1, pulses_per_block=1, reorder_window_pulses=0),
     lambda: PulseBuffer(pulses_per_aperture=1, reorder_window_pulses=-1), 'is negative'),
]


@pytest.mark.parametrize(('inside', 'outside', 'message'), LIMITS)
def test_what_is_just_inside_works_and_what_is_just_outside_is_refused(inside, outside, message):
    inside()
    with pytest.raises(ValueError, match=message):
        outside()


@pytest.mark.parametrize('wanted', [1, 7, 200.0, 997.4])
def test_fast_lengths_are_long_enough_and_hardly_longer(wanted):
    n = fast_length(wanted)
    assert wanted <= n <= 1.05 * wanted + 3
    assert fast_length(n * (1 + 1e-13)) == n  # rounding does not make it longer


@pytest.mark.parametrize(('near', 'far', 'start', 'stop'), [
    (60.0, 100.0, 44, 117), (60.5, 100.5, 44, 118), (15.0, 400.0, 0, 200), (16.0, 182.9, 0, 200),
    (17.0, 182.0, 1, 199)])
def test_a_cut_keeps_sixteen_samples_more_at_each_end(near, far, start, stop):
    some = 1e-6  # of a sample, so that rounding does not decide
    planned = window_from(near + some, far - some)
    assert planned.n_output == stop - start
    offset_m = planned.output_radar.range_start_m - PROFILES.range_start_m
    assert offset_m / SPACING_M == pytest.approx(start, abs=1e-6)
    block = PulseBlock(PROFILES, True, [0], [0], np.arange(200.0)[None, None])
    np.testing.assert_array_equal(planned(block).samples[0, 0].real, np.arange(start, stop))


@pytest.mark.parametrize(('behind', 'later_ns', 'taken', 'restarted'), [
    (16, -1, 1, False), (17, -1, 0, False),  # the window; what lies beyond is held
    (17, 0, 0, False), (17, 1, 1, True),  # sent after the newest: a restart at once
    (1, 1, 1, True), (0, 1, 1, False), (-5, -1, 1, False)])
def test_a_block_is_held_beyond_the_window_and_a_restart_when_sent_later(behind, later_ns, taken,
                                                                         restarted):
    def block(counter, stamp_ns):
        return dataclasses.replace(pulses(1), counter=[counter], stamp_ns=[stamp_ns])

    detector = RestartDetector(window=16)
    detector.submit(block(109, 500))
    verdict = detector.submit(block(109 - behind, 500 + later_ns))
    assert (len(verdict.accepted), verdict.restarted) == (taken, restarted)
    assert detector.held_pulses == 1 - taken
