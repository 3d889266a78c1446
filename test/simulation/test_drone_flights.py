# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Simulated flights of drones whose radar and poses have clocks of their own."""

import numpy as np
import pytest

from benchmarks.support.drone_flights import MOTIONS, RADARS, drone_flight
from benchmarks.support.references import exact_image
from sar_imaging.quality import contrast
from sar_imaging.signal.positioning import locate
from sar_imaging.signal.range_compression import RangeCompressor


# Few of the scatterers of flight 4 lie in so small an image where its motion is along legs.
@pytest.mark.parametrize(('motion', 'seed'), list(zip(MOTIONS, (4, 4, 5), strict=True)))
@pytest.mark.parametrize('radar_kind', RADARS)
def test_a_flight_focuses_with_its_true_alignment_alone(motion, seed, radar_kind):
    flight = drone_flight(seed, motion=motion, radar_kind=radar_kind, n_pixels=60, n_pulses=128)
    assert not flight.block.has_positions and not flight.block.compressed
    sharpness = []
    for offset_s in (0.0, 0.5):
        located = locate(flight.block, flight.track(), flight.misaligned(offset_s))
        profiles = RangeCompressor.for_block(located)(located)
        sharpness.append(contrast(exact_image(flight.grid, profiles)))
    assert sharpness[0] > 1.5 * sharpness[1]


@pytest.mark.parametrize('seed', range(4))
def test_the_scene_is_seen_over_the_angle_that_is_told(seed):
    flight = drone_flight(seed, n_pixels=16, n_pulses=64)
    centres = locate(flight.block, flight.track(), flight.alignment).phase_centre_m
    seen = np.ptp(np.degrees(np.arctan2(centres[:, 0], -centres[:, 1])))
    # 0.1 m of lever arm that sways by 0.1 rad, 7 m away, and 64 pulses for 400 samples
    assert seen == pytest.approx(flight.angle_deg, abs=0.5)
    assert 5.0 <= flight.angle_deg <= 30.0


def test_a_seed_is_a_flight():
    first, second = (drone_flight(7, n_pixels=16, n_pulses=64) for _ in range(2))
    np.testing.assert_array_equal(first.block.samples, second.block.samples)
    np.testing.assert_array_equal(first.position_m, second.position_m)


def test_all_scatterers_are_within_the_record():
    # seed 50078 drifts so far back that some were not
    assert drone_flight(50_078, radar_kind='uwb', n_pixels=16, n_pulses=64).block.samples.any()


def test_unknown_kinds_are_refused():
    with pytest.raises(ValueError, match="motion='loop', .*use one of hover, turn"):
        drone_flight(0, motion='loop')
