# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Blocks to convert: a factory for chosen shapes and a strategy for arbitrary ones."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from msg_conversions.float_pairs import MAX_OFFSET_NS
from sar_imaging.geometry.illumination import Pointing
from sar_imaging.signal.pulses import PulseBlock
from sar_imaging.signal.radar import SPEED_OF_LIGHT, RadarParameters, Waveform


@pytest.fixture(scope='session')
def radar():
    return RadarParameters(carrier_hz=10e9, bandwidth_hz=300e6, sample_rate_hz=360e6,
                           first_sample_delay_s=66.7e-6, pulse_length_s=10e-6,
                           chirp_rate_hz_per_s=-3e13)


@pytest.fixture(scope='session')
def make_block(radar):
    def make(n_pulses=3, n_channels=2, n_samples=4, positions=True, **changes):
        rng = np.random.default_rng(n_pulses + 10 * n_channels + 100 * n_samples)
        samples = rng.standard_normal((n_pulses, n_channels, n_samples, 2), np.float32)
        fields = {
            'radar': radar, 'compressed': False,
            'stamp_ns': 1_700_000_000_123_456_789 + 1_000_003 * np.arange(n_pulses),
            'counter': 2**32 - n_pulses + np.arange(n_pulses, dtype=np.int64),
            'samples': samples.view(np.complex64)[..., 0]}
        if positions:
            centres = rng.uniform(-6.4e6, 6.4e6, (2, n_pulses, n_channels, 3))
            fields |= {'tx_m': centres[0], 'rx_m': centres[1]}
        return PulseBlock(**fields | changes)

    return make


def _radars():
    # The limits of RadarParameters
    return st.builds(RadarParameters, carrier_hz=st.floats(1e6, 2e12),
                     bandwidth_hz=st.floats(1e4, 1e12), sample_rate_hz=st.floats(1e3, 1e13),
                     first_sample_delay_s=st.floats(-1.0, 1.0),
                     pulse_length_s=st.floats(0.0, 1.0),
                     chirp_rate_hz_per_s=st.floats(-1e18, -1e4) | st.floats(1e4, 1e18)
                     | st.just(0.0),
                     waveform=st.sampled_from(Waveform),
                     propagation_speed_m_per_s=st.just(SPEED_OF_LIGHT)
                     | st.floats(1e6, SPEED_OF_LIGHT))


@st.composite
def _blocks(draw):
    shape = n_pulses, n_channels, n_samples = [draw(st.integers(1, 4)) for _ in range(3)]
    latest = 2**31 * 10**9 - 1 - MAX_OFFSET_NS  # what a header of a message can hold
    epoch = draw(st.integers(-latest, latest))
    offsets = [0] + draw(st.lists(st.integers(-MAX_OFFSET_NS, MAX_OFFSET_NS),
                                  min_size=n_pulses - 1, max_size=n_pulses - 1))
    counter = draw(st.lists(st.integers(0, 2**32 - 1), min_size=n_pulses, max_size=n_pulses,
                            unique=True))
    finite = st.floats(width=32, allow_nan=False, allow_infinity=False)
    iq = draw(hnp.arrays(np.float32, (*shape, 2), elements=finite))
    fields = {'radar': draw(_radars()), 'compressed': draw(st.booleans()),
              'stamp_ns': np.array([epoch + offset for offset in offsets], np.int64),
              'counter': counter, 'samples': iq.view(np.complex64)[..., 0]}
    if draw(st.booleans()):
        centres = hnp.arrays(np.float64, (n_pulses, n_channels, 3),
                             elements=st.floats(-6.4e6, 6.4e6))
        fields |= {'tx_m': draw(centres), 'rx_m': draw(centres)}
    if draw(st.booleans()):
        angle = draw(hnp.arrays(np.float64, n_pulses, elements=st.floats(-7, 7)))
        fields['pointing'] = Pointing(np.stack([np.cos(angle), np.sin(angle), -0.3 + 0 * angle],
                                               axis=1))
    fields['frame'] = draw(st.sampled_from(['', 'odom', 'robot1/map']))
    return PulseBlock(**fields)


@pytest.fixture(scope='session')
def blocks():
    """Strategy of valid blocks: any times within 78 h, counters, samples, positions, pointing."""
    return _blocks()


@pytest.fixture(scope='session')
def assert_same_block():
    def check(received: PulseBlock, sent: PulseBlock):
        assert received.compressed == sent.compressed
        assert received.frame == sent.frame
        assert received.radar.waveform == sent.radar.waveform
        for name in ('carrier_hz', 'bandwidth_hz', 'sample_rate_hz', 'first_sample_delay_s',
                     'pulse_length_s', 'chirp_rate_hz_per_s', 'propagation_speed_m_per_s'):
            # A pair keeps 48 bits; below about 1e-30 float32 itself ends at 2**-149.
            assert getattr(received.radar, name) == pytest.approx(
                getattr(sent.radar, name), rel=2**-48, abs=2**-149)
        for name in ('stamp_ns', 'counter'):
            assert getattr(received, name).dtype == getattr(sent, name).dtype
            np.testing.assert_array_equal(getattr(received, name), getattr(sent, name))
        assert received.samples.shape == sent.samples.shape
        assert received.samples.tobytes() == sent.samples.tobytes()  # negative zeros included
        assert received.has_positions == sent.has_positions
        if sent.has_positions:
            np.testing.assert_allclose(received.tx_m, sent.tx_m, rtol=0, atol=1e-8)
            np.testing.assert_allclose(received.rx_m, sent.rx_m, rtol=0, atol=1e-8)
        assert (received.pointing is None) == (sent.pointing is None)
        if sent.pointing is not None:
            for name in ('boresight', 'up'):  # pairs keep 48 bits
                np.testing.assert_allclose(getattr(received.pointing, name),
                                           getattr(sent.pointing, name), rtol=0, atol=1e-14)

    return check
