# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Passband samples to profiles, and the removal of what the antennas return themselves."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from sar_imaging.signal.background import subtract_background
from sar_imaging.signal.pulses import PulseBlock
from sar_imaging.signal.radar import SPEED_OF_LIGHT, RadarParameters, Waveform
from sar_imaging.signal.range_compression import RangeCompressor
from sar_imaging.signal.windows import window as window_weights
from sar_imaging.simulation.echoes import EchoSimulator


def _radar(**changes):
    """3.2 to 4.7 GHz, sampled at 16.4 GHz from a range of 2 m on."""
    return RadarParameters(**{
        'carrier_hz': 3.95e9, 'bandwidth_hz': 1.5e9, 'sample_rate_hz': 16.4e9,
        'first_sample_delay_s': 2 * 2.0 / SPEED_OF_LIGHT, 'waveform': Waveform.PASSBAND} | changes)


def _samples(radar, n, point, centres):
    simulate = EchoSimulator(radar, n, compressed=False, points_m=[point], amplitudes=[0.8j])
    return simulate(centres, centres)


@pytest.mark.parametrize('n', [960, 951])
@pytest.mark.parametrize('name', ['none', 'hamming'])
def test_passband_samples_become_the_signal_model(n, name):
    radar = _radar()
    range_m = 5.4321
    block = PulseBlock(radar, False, [0], [0],
                       _samples(radar, n, [range_m, 0, 0], np.zeros((1, 1, 3))))
    assert not block.samples.imag.any()
    profiles = RangeCompressor.for_block(block, window=name)(block)
    output = profiles.radar
    assert 1.0 <= output.sample_rate_hz / 3e9 < 1.05
    tau = 2 * range_m / SPEED_OF_LIGHT
    delays = output.first_sample_delay_s + np.arange(profiles.n_samples) / output.sample_rate_hz
    step = radar.sample_rate_hz / n
    frequency = np.arange(np.ceil(3.2e9 / step), np.floor(4.7e9 / step) + 1) * step
    weights = window_weights(name, frequency.size)
    # Sum over the band's absolute frequencies, mixed down by the carrier.
    expected = 0.8j * (np.exp(2j * np.pi * np.outer(delays - tau, frequency)) @ weights
                       / weights.sum() * np.exp(-2j * np.pi * (3.95e9 * delays % 1.0)))
    # complex64; the band may have one bin more at an edge (1 of 88)
    np.testing.assert_allclose(profiles.samples[0, 0], expected, rtol=0, atol=3e-6)


def test_peak_has_amplitude_and_carrier_phase():
    radar, range_m = _radar(), 7.77
    block = PulseBlock(radar, False, [0], [0],
                       _samples(radar, 960, [range_m, 0, 0], np.zeros((1, 1, 3))))
    profiles = RangeCompressor.for_block(block, oversampling=32.0)(block)
    peak = np.abs(profiles.samples[0, 0]).argmax()
    radar = profiles.radar
    assert radar.range_start_m + peak * radar.sample_spacing_m == pytest.approx(
        range_m, abs=0.51 * radar.sample_spacing_m)
    tau = 2 * range_m / SPEED_OF_LIGHT
    # The band's bins lie 0.4 bins beside the carrier on average: 0.4 / 88 cells, 1/64 cells off
    expected = 0.8j * np.exp(-2j * np.pi * (3.95e9 * tau % 1.0))
    assert abs(profiles.samples[0, 0, peak] - expected) < 2e-3


@pytest.mark.parametrize('changes', [{'sample_rate_hz': 9.3e9}, {'bandwidth_hz': 8e9}])
def test_band_that_the_samples_cannot_hold_is_refused(changes):
    with pytest.raises(ValueError, match='hold frequencies up to half'):
        RangeCompressor(_radar(**changes), 960)


@pytest.mark.parametrize('changes', [{'sample_rate_hz': 9.41e9}, {'bandwidth_hz': 7.89e9}])
def test_band_that_the_samples_just_hold_is_accepted(changes):
    """Up to 4.7 GHz of 4.705; and down to 5 MHz."""
    radar = _radar(**changes)
    output = RangeCompressor(radar, 960).output_radar
    assert 1.0 <= output.sample_rate_hz / (2 * radar.bandwidth_hz) < 1.05


def test_background_is_removed_and_the_moving_echo_stays():
    radar, n = _radar(), 960
    centres = np.zeros((41, 1, 3))
    centres[:, 0, 1] = np.linspace(-2, 2, 41)
    echo = _samples(radar, n, [6.0, 0.3, 0.0], centres)
    leakage = 30 * np.exp(-np.arange(n) / 200) * np.cos(1.5 * np.arange(n))
    block = PulseBlock(radar, False, np.arange(41), np.arange(41), echo + leakage)
    clean = subtract_background(block)
    # Around 6 m the echo passes each sample in few pulses, and the median is the background but
    # for sidelobes: measured 0.18 of the echo's peak at its turning point, 0.012 beyond it.
    error = np.abs(clean.samples - echo)[:, 0]
    assert error[:, 560:].max() < 0.02 * 0.8 and np.median(error) < 0.01
    assert np.abs(block.samples - echo).max() > 29
    compressed = dataclasses.replace(block, compressed=True, samples=block.samples * (1 - 2j))
    np.testing.assert_allclose(subtract_background(compressed).samples, clean.samples * (1 - 2j),
                               rtol=0, atol=1e-5)


def test_background_of_samples_that_are_not_contiguous():
    rng = np.random.default_rng(3)
    samples = (rng.normal(size=(2, 5, 8)) + 1j * rng.normal(size=(2, 5, 8))).astype(np.complex64)
    turned = PulseBlock(_radar(), True, np.arange(5), np.arange(5), samples.swapaxes(0, 1))
    assert not turned.samples.flags.c_contiguous
    copied = dataclasses.replace(turned, samples=np.ascontiguousarray(turned.samples))
    for block in (turned, dataclasses.replace(turned, samples=turned.samples[..., ::2])):
        expected = block.samples - (np.median(block.samples.real, axis=0)
                                    + 1j * np.median(block.samples.imag, axis=0))
        np.testing.assert_allclose(subtract_background(block).samples, expected, rtol=0,
                                   atol=1e-6)  # a float32's last digits
    np.testing.assert_array_equal(subtract_background(turned).samples,
                                  subtract_background(copied).samples)


def test_background_of_too_few_pulses_is_refused():
    block = PulseBlock(_radar(), False, [0, 1], [0, 1], np.zeros((2, 1, 8)))
    with pytest.raises(ValueError, match='at least three pulses'):
        subtract_background(block)
