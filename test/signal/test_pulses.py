# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Radar parameters and pulse blocks: shapes, derived figures, refusals."""

import dataclasses

import numpy as np
import pytest

from sar_imaging.signal import PulseBlock, RadarParameters, Waveform, concatenate
from sar_imaging.signal.pulses import check_frame

RADAR = RadarParameters(10e9, 300e6, 400e6, 66.6e-6, 1e-6, 3e14)


def make_block(**changes):
    pulses, channels, samples = 4, 2, 8
    rng = np.random.default_rng(0)
    fields = {'radar': RADAR, 'compressed': False, 'stamp_ns': np.arange(pulses) * 1000,
              'counter': np.arange(pulses),
              'samples': rng.standard_normal((pulses, channels, samples)),
              'tx_m': rng.standard_normal((pulses, channels, 3)),
              'rx_m': rng.standard_normal((pulses, channels, 3))}
    return PulseBlock(**(fields | changes))


def test_derived_figures():
    # Rosenberg & Gray's table 1: 3 cm, 0.5 m between nulls; the rest is arithmetic
    assert RADAR.wavelength_m == pytest.approx(0.03, rel=1e-3)
    assert RADAR.range_resolution_m == pytest.approx(0.4997, abs=1e-4)
    assert RADAR.sample_spacing_m == pytest.approx(0.3747, abs=1e-4)
    assert RADAR.range_start_m == pytest.approx(9983.1, abs=0.1)
    assert RADAR.wavenumber_rad_per_m == pytest.approx(4 * np.pi / RADAR.wavelength_m)


@pytest.mark.parametrize(('change', 'message'), [
    ({'carrier_hz': 0.0}, 'carrier_hz=0.0 must be positive'),
    ({'bandwidth_hz': -1.0}, 'bandwidth_hz=-1.0 must be positive'),
    ({'sample_rate_hz': np.nan}, 'sample_rate_hz=nan is not finite'),
    ({'pulse_length_s': -1e-6}, 'must not be negative'),
    ({'waveform': 9}, '9 is not a valid Waveform'),
])
def test_impossible_radars_are_refused(change, message):
    with pytest.raises(ValueError, match=message):
        dataclasses.replace(RADAR, **change)


def test_block_converts_and_describes_itself():
    block = make_block()
    assert (block.n_pulses, block.n_channels, block.n_samples) == (4, 2, 8)
    assert block.samples.dtype == np.complex64 and block.counter.dtype == np.uint32
    assert block.radar.waveform is Waveform.LFM and block.has_positions
    expected = 0.5 * (block.tx_m.mean(axis=1) + block.rx_m.mean(axis=1))
    np.testing.assert_allclose(block.phase_centre_m, expected)


@pytest.mark.parametrize(('change', 'message'), [
    ({'samples': np.zeros((4, 8))}, r'samples.shape=\(4, 8\); expected \(pulses, channels'),
    ({'counter': np.arange(5)}, r'counter.shape=\(5,\) does not match'),
    ({'tx_m': None}, 'given together or not at all'),
    ({'rx_m': np.zeros((4, 1, 3))}, r'rx_m.shape=\(4, 1, 3\).*expected \(4, 2, 3\)'),
    ({'tx_m': np.full((4, 2, 3), np.inf)}, 'NaN or infinity'),
])
def test_inconsistent_blocks_are_refused(change, message):
    with pytest.raises(ValueError, match=message):
        make_block(**change)


@pytest.mark.parametrize('with_positions', [True, False])
def test_select_and_concatenate_are_inverse(with_positions):
    block = make_block(**({} if with_positions else {'tx_m': None, 'rx_m': None}))
    joined = concatenate([block.select(slice(0, 1)), block.select([1, 2]), block.select([3])])
    for field in dataclasses.fields(block):
        np.testing.assert_array_equal(getattr(joined, field.name), getattr(block, field.name))
    assert concatenate([block]) is block


def test_different_blocks_do_not_join():
    with pytest.raises(ValueError, match='blocks differ'):
        concatenate([make_block(), make_block(samples=np.zeros((4, 2, 9)))])
    with pytest.raises(ValueError, match='blocks differ in radar parameters, frame'):
        concatenate([make_block(frame='odom'), make_block(frame='map')])
    with pytest.raises(ValueError, match='at least one block'):
        concatenate([])


def test_positions_in_another_frame_than_the_grid_are_refused():
    for block in (make_block(), make_block(frame='map'), make_block(frame='/map'),
                  make_block(frame='odom', tx_m=None, rx_m=None)):  # poses will tell
        check_frame(block, 'map')
    with pytest.raises(ValueError, match="centres are in frame 'odom', the image grid is in "
                       "frame_id='map'; set frame_id to the same frame in all nodes"):
        check_frame(make_block(frame='odom'), 'map')
