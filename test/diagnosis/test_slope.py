# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""The slope of chirps that a filter compresses."""

import dataclasses

import numpy as np
import pytest

from sar_imaging.diagnosis.signals import slope_findings
from sar_imaging.signal.pulses import PulseBlock
from sar_imaging.signal.radar import RadarParameters, Waveform


@pytest.mark.parametrize('factor', [1.063, 1.137, 1.302])
def test_a_wrong_slope_is_told_to_a_fraction_of_a_step(factor):
    """Chirps of 1,500 for the product of time and bandwidth, of which 0.1 % are a radian."""
    radar = RadarParameters(9.6e9, 150e6, 187.5e6, 2e-6, 10e-6, 150e6 / 10e-6, Waveform.LFM)
    time_s = 2e-6 + np.arange(2500) / radar.sample_rate_hz
    samples = np.zeros((4, 1, 2500), np.complex64)
    for pulse, delay_s in enumerate([2.5e-6, 3e-6, 3.1e-6, 4e-6]):
        since = time_s - delay_s
        samples[pulse, 0] = np.where(
            (since >= 0) & (since < 10e-6),
            np.exp(1j * np.pi * radar.chirp_rate_hz_per_s * (since - 5e-6) ** 2), 0)
    wrong = dataclasses.replace(radar, chirp_rate_hz_per_s=factor * radar.chirp_rate_hz_per_s,
                                bandwidth_hz=factor * radar.bandwidth_hz)
    block = PulseBlock(wrong, False, np.arange(4), np.arange(4), samples)
    [finding] = slope_findings(block)
    # steps of 0.0125, a ninth of which the search goes on with
    assert float(finding.evidence.split()[1]) == pytest.approx(1 / factor, abs=0.001)
