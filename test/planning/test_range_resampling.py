# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Grids of range along image lines: none where range does not grow."""

import numpy as np
import pytest

from sar_imaging.geometry.half_paths import Paths
from sar_imaging.planning.profiles import plan_resampling
from sar_imaging.signal.radar import RadarParameters

RADAR = RadarParameters(carrier_hz=10e9, bandwidth_hz=300e6, sample_rate_hz=400e6,
                        first_sample_delay_s=6e-6)


@pytest.mark.parametrize(('grows', 'planned'), [(-0.01, False), (0.0, False), (0.95, True)])
def test_range_has_to_grow_along_a_line(grows, planned):
    """Half paths of 1 km, which grow by this from metre to metre."""
    slope = np.full((2, 5), grows)
    flat = np.zeros_like(slope)
    paths = Paths(np.full_like(slope, 1000.0), (slope, flat, flat, flat))
    resampling = plan_resampling(paths, 0.25, 400, RADAR, 1024, -50.0)
    assert (resampling is not None) is planned
