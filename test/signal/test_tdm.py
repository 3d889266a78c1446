# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Transmitters in turns on a moving platform, and what it costs to ignore that they are."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from benchmarks.support.references import exact_image
from sar_imaging.geometry.alignment import Alignment
from sar_imaging.geometry.grids import MapGrid
from sar_imaging.geometry.poses import PoseTrack
from sar_imaging.imaging.correlation import correlate
from sar_imaging.signal.dechirp import fmcw_parameters
from sar_imaging.signal.pulses import PulseBlock
from sar_imaging.signal.range_compression import RangeCompressor
from sar_imaging.signal.spectra import band_spectrum
from sar_imaging.signal.tdm import TdmSchedule, locate_channels, move_channels
from sar_imaging.simulation.echoes import EchoSimulator

# A car radar at 77 GHz: two transmitters and four receivers, a turn every 60 us.
RADAR = fmcw_parameters(start_frequency_hz=76.5e9, slope_hz_per_s=20e12, sample_rate_hz=10e6,
                        n_samples=256, adc_start_s=3e-6)
SCHEDULE = TdmSchedule.in_turns(2, 4, 60e-6, first_s=15.8e-6)
LEVER_TX = np.repeat([[0.0, 0.0, 0.0], [0.0, 7.8e-3, 0.0]], 4, axis=0)
LEVER_RX = np.tile(np.stack([0 * np.arange(4), 1.95e-3 * np.arange(4), 0 * np.arange(4)], axis=1),
                   (2, 1))
PULSE_S = 200e-6


def _block(velocity, n_pulses=96, points=((12.0, 3.0, 0.0),)):
    """Cycles of a platform that moves evenly: exact places, and those at the stamps alone."""
    time_s = PULSE_S * np.arange(n_pulses)
    velocity = np.asarray(velocity, float)
    sent_s = time_s[:, None] + SCHEDULE.offset_s
    place = sent_s[..., None] * velocity
    tx, rx = place + LEVER_TX, place + LEVER_RX
    simulate = EchoSimulator(RADAR, 256, compressed=False, points_m=points,
                             amplitudes=np.ones(len(points)))
    stamp_ns = 10**18 + np.rint(time_s * 1e9).astype(np.int64)
    exact = PulseBlock(RADAR, False, stamp_ns, np.arange(n_pulses), simulate(tx, rx), tx, rx)
    start = (time_s[:, None] * velocity)[:, None]
    return exact, dataclasses.replace(exact, tx_m=start + LEVER_TX, rx_m=start + LEVER_RX)


def test_turns_are_numbered_as_channels_are():
    np.testing.assert_allclose(TdmSchedule.in_turns(3, 2, 1e-4).offset_s,
                               [0, 0, 1e-4, 1e-4, 2e-4, 2e-4])


def test_channels_are_where_the_platform_is_at_their_time():
    velocity = (3.0, 14.0, 0.0)
    exact, at_stamps = _block(velocity)
    moved = move_channels(at_stamps, velocity, SCHEDULE)
    # float64 sums of metres
    np.testing.assert_allclose(moved.tx_m, exact.tx_m, rtol=0, atol=1e-12)
    np.testing.assert_allclose(moved.rx_m, exact.rx_m, rtol=0, atol=1e-12)
    each = move_channels(at_stamps, np.tile(velocity, (96, 1)), SCHEDULE)
    np.testing.assert_array_equal(each.tx_m, moved.tx_m)


def test_poses_place_each_channel_at_its_own_time():
    # A platform that turns and accelerates: 20 rad/s is more than a drone does.
    def place(t):
        return np.stack([14 * t, 2 * np.sin(3 * t), 0.5 * t**2], axis=-1)

    track = PoseTrack(jump_m=1.0, jump_rad=1.0)
    for t in np.arange(-0.05, 0.1, 0.005):
        track.add(10**18 + round(t * 1e9), place(t), (0.0, 0.0, np.sin(t), np.cos(t)))
    _, block = _block((14.0, 0.0, 0.0))
    alignment = Alignment(LEVER_TX, LEVER_RX, time_offset_s=0.01, range_bias_m=0.3)
    located = locate_channels(dataclasses.replace(block, tx_m=None, rx_m=None), track, alignment,
                              SCHEDULE)
    t = PULSE_S * np.arange(96)[:, None] + SCHEDULE.offset_s + 0.01
    cos, sin = np.cos(2 * t), np.sin(2 * t)  # yaw 2 t
    for got, arm in ((located.tx_m, LEVER_TX), (located.rx_m, LEVER_RX)):
        turned = np.stack([cos * arm[:, 0] - sin * arm[:, 1], sin * arm[:, 0] + cos * arm[:, 1],
                           0 * t], axis=-1)
        # Interpolation between poses 5 ms apart: far below a micrometre.
        np.testing.assert_allclose(got, place(t) + turned, rtol=0, atol=1e-7)
    np.testing.assert_array_equal(located.stamp_ns, block.stamp_ns)
    assert located.radar.range_start_m == pytest.approx(-0.3)


@pytest.mark.parametrize(('speed', 'error_db', 'peak_share'), [
    # The second transmitter's echoes are turned by 4 pi v dt cos(45 degrees) / lambda against
    # the first's, at 1 m/s by 0.14 rad: sin(0.14 / 2), with the common delay -19 dB of error.
    (1.0, -19.4, 0.998), (5.0, -5.9, 0.942), (15.0, 1.0, 0.524)])
def test_ignoring_the_turns_costs(speed, error_db, peak_share):
    exact, at_stamps = _block((0.0, speed, 0.0), n_pulses=64, points=[(10.0, 10.0, 0.0)])
    exact, ignored = (RangeCompressor.for_block(b)(b) for b in (exact, at_stamps))
    grid = MapGrid((10.0, 10.0, 0.0), 25, 25, 0.2)
    reference = correlate(*band_spectrum(exact), exact.tx_m, exact.rx_m, grid.points())
    right, wrong = exact_image(grid, exact), exact_image(grid, ignored)
    scale = np.vdot(right, reference) / np.vdot(right, right)  # bins against samples

    def error(image):
        return 10 * np.log10(np.sum(np.abs(scale * image - reference) ** 2)
                             / np.sum(np.abs(reference) ** 2))

    # Correlation takes profiles with guards for a period; measured -55 to -57 dB.
    assert error(right) < -50.0
    assert abs(right[12, 12]) == pytest.approx(64 * 8, rel=1e-3)
    assert error(wrong) == pytest.approx(error_db, abs=0.5)
    assert abs(wrong[12, 12]) == pytest.approx(peak_share * 64 * 8, abs=5)


def test_what_does_not_fit_is_refused():
    _, block = _block((1.0, 0.0, 0.0), n_pulses=4)
    with pytest.raises(ValueError, match='8 channels, the schedule has 6'):
        move_channels(block, (1.0, 0.0, 0.0), TdmSchedule.in_turns(3, 2, 1e-4))
    with pytest.raises(ValueError, match=r'expected \(3,\) or \(4, 3\)'):
        move_channels(block, np.zeros((5, 3)), SCHEDULE)
    with pytest.raises(ValueError, match='use locate_channels'):
        move_channels(dataclasses.replace(block, tx_m=None, rx_m=None), np.zeros(3), SCHEDULE)
    with pytest.raises(ValueError, match='4 of 4 pulses have no pose'):
        locate_channels(block, PoseTrack(), Alignment(), SCHEDULE)
    for bad in ([], [np.nan], [[0.0]]):
        with pytest.raises(ValueError, match='one finite time per channel'):
            TdmSchedule(bad)
