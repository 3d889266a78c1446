# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Echoes of an antenna with a pattern: each scatterer by itself, times its amplitude."""

import numpy as np
import pytest

from sar_imaging.geometry.illumination import AntennaPattern, Illumination, PatternCut, Pointing
from sar_imaging.signal.radar import RadarParameters, Waveform
from sar_imaging.signal.range_compression import RangeCompressor
from sar_imaging.simulation.echoes import EchoSimulator
from sar_imaging.simulation.scenarios import SCENARIOS

PATTERN = AntennaPattern(PatternCut.gaussian(0.15), PatternCut.cosine(0.8))


@pytest.mark.parametrize(('waveform', 'compressed'), [
    (Waveform.LFM, True), (Waveform.LFM, False), (Waveform.STEPPED_FREQUENCY, False),
    (Waveform.FMCW, False)])
def test_scatterers_return_the_two_way_amplitude(waveform, compressed):
    rng = np.random.default_rng(3)
    length_s = 64 / 120e6 if waveform == Waveform.FMCW else 0.3e-6
    radar = RadarParameters(9.6e9, 100e6, 120e6, 2 * 60 / 299792458.0, length_s,
                            100e6 / length_s, waveform)
    tx = np.zeros((9, 2, 3))
    tx[..., 0] = np.linspace(-15, 15, 9)[:, None]
    rx = tx + [[[0, 0, 0], [0.2, 0, 0.1]]]
    points = np.c_[rng.uniform(-20, 20, 4), rng.uniform(78, 90, 4), np.full(4, -5.0)]
    amplitudes = np.exp(2j * np.pi * rng.random(4))
    lit = Illumination.of_pulses(PATTERN, Pointing.beside_track(tx.mean(axis=1), 1), tx, rx)
    weight = lit.amplitude(points).reshape(9, 2, 4)
    assert (weight == 0).any() and weight.max() > 0.8
    found = EchoSimulator(radar, 64, compressed=compressed, points_m=points,
                          amplitudes=amplitudes)(tx, rx, lit)
    expected = sum(
        weight[..., p, None] * EchoSimulator(radar, 64, compressed=compressed,
                                             points_m=points[p:p + 1],
                                             amplitudes=amplitudes[p:p + 1])(tx, rx)
        for p in range(4))
    np.testing.assert_allclose(found, expected, atol=1e-12)


def test_the_stripmap_is_lit_for_its_dwell():
    """The silo on boresight has half power of one way at 3 degrees: 52.4 m of the track."""
    scenario = SCENARIOS['stripmap']()
    [block] = scenario.blocks(scenario.n_pulses)
    lit = Illumination.of_pulses(scenario.antenna.amplitudes(), block.pointing, block.tx_m,
                                 block.rx_m)
    amplitude = lit.amplitude(np.zeros((1, 3)))[:, 0]
    assert amplitude.max() == pytest.approx(1, abs=1e-4)
    metres = (amplitude >= 0.5).sum() * 40 / 320
    assert metres == pytest.approx(2 * 500 * np.tan(np.radians(3)), abs=0.25)  # two pulses
    # pulses add up by the square of that: those beyond the beam's nulls hold noise alone
    profiles = RangeCompressor.for_block(block)(block)
    where = np.rint((500.0 - profiles.radar.range_start_m) / profiles.radar.sample_spacing_m)
    silo = np.abs(profiles.samples[:, 0, int(where)])
    assert np.median(silo[590:690]) > 5 * np.median(silo[amplitude == 0])
