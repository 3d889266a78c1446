# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Constructors name the unit, axis or number that was probably meant."""

import dataclasses

import numpy as np
import pytest

from sar_imaging.signal.dechirp import fmcw_parameters
from sar_imaging.signal.pulses import PulseBlock, check_profiles
from sar_imaging.signal.radar import RadarParameters
from sar_imaging.signal.range_compression import RangeCompressor

RADAR = {'carrier_hz': 10e9, 'bandwidth_hz': 500e6, 'sample_rate_hz': 600e6,
         'first_sample_delay_s': 6.5e-6, 'pulse_length_s': 3e-7,
         'chirp_rate_hz_per_s': 500e6 / 3e-7}
RAMP = {'start_frequency_hz': 77e9, 'slope_hz_per_s': 30e12, 'sample_rate_hz': 5e6,
        'n_samples': 256, 'adc_start_s': 6e-6}
P, C, N = 12, 2, 40


def block(**changes):
    centres = np.zeros((P, C, 3))
    centres[..., 0] = 0.1 * np.arange(P)[:, None]
    fields = {'radar': RadarParameters(**RADAR), 'compressed': True,
              'stamp_ns': 10**6 * np.arange(P), 'counter': np.arange(P),
              'samples': np.ones((P, C, N), np.complex64), 'tx_m': centres, 'rx_m': centres}
    return PulseBlock(**fields | changes)


@pytest.mark.parametrize(('changes', 'message'), [
    ({'carrier_hz': 10.0}, r'carrier_hz=10 Hz.*meant in GHz: pass carrier_hz=1e\+10'),
    ({'carrier_hz': 9600.0}, r'meant in MHz: pass carrier_hz=9.6e\+09'),
    ({'carrier_hz': 180e12}, '1e[+]06 to 2e[+]12 Hz'),
    ({'bandwidth_hz': 500.0}, r'bandwidth_hz=500 Hz.*in MHz: pass bandwidth_hz=5e\+08'),
    ({'sample_rate_hz': 600.0}, r'in MHz: pass sample_rate_hz=6e\+08'),
    ({'first_sample_delay_s': 6.5}, 'in us: pass first_sample_delay_s=6.5e-06'),
    ({'chirp_rate_hz_per_s': 1666.7}, r'in MHz/us: pass chirp_rate_hz_per_s=1.6667e\+15'),
    ({'sample_rate_hz': 0.0}, 'sample_rate_hz=0.0 must be positive')])
def test_radar_in_other_units(changes, message):
    with pytest.raises(ValueError, match=message):
        RadarParameters(**RADAR | changes)


@pytest.mark.parametrize('changes', [
    {'carrier_hz': 1e6, 'bandwidth_hz': 1e4}, {'carrier_hz': 2e12, 'bandwidth_hz': 1e12},
    {'first_sample_delay_s': 3.0}, {'first_sample_delay_s': -3.0}, {'sample_rate_hz': 1e3},
    {'chirp_rate_hz_per_s': -1e4}, {'chirp_rate_hz_per_s': 0.0}])
def test_ends_of_what_radars_have(changes):
    RadarParameters(**RADAR | changes)
    name, value = next(iter(changes.items()))
    if value:
        beyond = value * (0.99 if name in ('sample_rate_hz', 'chirp_rate_hz_per_s')
                          or value == 1e6 else 1.01)
        with pytest.raises(ValueError, match=name):
            RadarParameters(**RADAR | changes | {name: beyond})


@pytest.mark.parametrize(('changes', 'message'), [
    ({'adc_start_s': 6.0}, 'would move 1.8e[+]14 Hz before.*in us: pass adc_start_s=6e-06'),
    ({'slope_hz_per_s': 30.0}, r'in MHz/us: pass slope_hz_per_s=3e\+13'),
    ({'slope_hz_per_s': -30.0}, r'in MHz/us: pass slope_hz_per_s=-3e\+13'),
    ({'start_frequency_hz': 77.0}, r'in GHz: pass start_frequency_hz=7.7e\+10'),
    ({'sample_rate_hz': 5.0}, r'in MHz: pass sample_rate_hz=5e\+06'),
    ({'slope_hz_per_s': 30e15, 'adc_start_s': 0.0}, 'would sweep 1.536e[+]12 Hz'),
    ({'slope_hz_per_s': 30e15}, r'before the first sample.*by slope_hz_per_s=3e\+16'),
    ({'n_samples': 2**25}, 'not of all')])
def test_ramp_in_other_units(changes, message):
    with pytest.raises(ValueError, match=message):
        fmcw_parameters(**RAMP | changes)


def test_sweep_of_a_pulse_in_other_units():
    radar = RadarParameters(**RADAR | {'pulse_length_s': 0.3})
    with pytest.raises(ValueError, match='pulse_length_s is probably in microseconds'):
        RangeCompressor(radar, 400)


@pytest.mark.parametrize(('order', 'shape'), [((2, 1, 0), (N, C, P)), ((2, 0, 1), (N, P, C)),
                                              ((1, 0, 2), (C, P, N)), ((1, 2, 0), (C, N, P))])
def test_transposed_samples(order, shape):
    samples = np.ones((P, C, N)).transpose(order)
    assert samples.shape == shape
    with pytest.raises(ValueError, match='the samples are transposed') as error:
        block(samples=samples)
    proposed = eval(str(error.value).split('samples.transpose')[1])  # what it says, done
    assert samples.transpose(proposed).shape == (P, C, N)


def test_transposed_channels():
    with pytest.raises(ValueError, match=r'channels and samples.*samples.transpose\(0, 2, 1\)'):
        block(samples=np.ones((P, N, C)))


@pytest.mark.parametrize(('changes', 'message'), [
    ({'samples': np.ones((P, N))}, r'one channel is samples\[:, None\]'),
    ({'tx_m': np.zeros((P, 3))}, r'tx_m\[:, None\]'),
    ({'tx_m': np.zeros((P - 2, C, 3))}, '2 of 12 pulses have no position'),
    ({'rx_m': np.zeros((3, P))}, 'rx_m is transposed'),
    ({'stamp_ns': 1.7e9 + 0.001 * np.arange(P)}, r'in seconds: pass np.rint\(1e9'),
    ({'stamp_ns': 1e18 + np.arange(P)}, 'float64; expected whole nanoseconds'),
    ({'counter': np.zeros(P, int)}, 'counter is 0 for all 12 pulses'),
    ({'counter': np.arange(P) - 1}, r'pass counter % 2\*\*32'),
    ({'counter': np.arange(P) / 2}, 'expected whole numbers')])
def test_arrays_that_do_not_belong_together(changes, message):
    with pytest.raises(ValueError, match=message):
        block(**changes)


def test_pulses_without_finite_position_are_named():
    tx = block().tx_m.copy()
    tx[[3, 4, 9], 1, 2] = np.nan
    with pytest.raises(ValueError, match=r'3 of 12 pulses contain NaN.*3\.\.4, 9'):
        block(tx_m=tx)


def test_one_pulse_that_came_twice_is_no_mistake():
    one = block().select([4, 4])
    assert (one.counter == 4).all()


@pytest.mark.parametrize('bad', [np.nan, np.inf, -np.inf])
def test_samples_that_are_not_finite_are_counted_and_named(bad):
    samples = np.ones((P, C, N), np.complex64)
    samples[5, 1, [2, 3]], samples[8, 0, 0] = bad, 1j * bad
    spoilt = block(samples=samples)
    message = r'3 of 960 samples are NaN or infinite, in 2 of 12 pulses \(5, 8'
    with pytest.raises(ValueError, match=message):
        check_profiles(spoilt, spoilt.radar, N)
    with pytest.raises(ValueError, match=message):
        RangeCompressor.for_block(spoilt)(spoilt)
    advice = spoilt.select(np.isfinite(spoilt.samples).all(axis=(1, 2)))
    check_profiles(advice, advice.radar, N)
    assert advice.n_pulses == P - 2


def test_large_samples_whose_sum_overflows_are_finite():
    large = block(samples=np.full((P, C, N), 3e38, np.complex64))
    check_profiles(large, large.radar, N)
    with pytest.raises(ValueError, match='raw'):
        check_profiles(dataclasses.replace(large, compressed=False), large.radar, N)
