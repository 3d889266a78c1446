# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""A small rail with an FMCW radar, right in every respect."""

import numpy as np
import pytest

from sar_imaging.geometry.grids import MapGrid
from sar_imaging.signal.dechirp import fmcw_parameters
from sar_imaging.signal.pulses import PulseBlock
from sar_imaging.simulation.echoes import EchoSimulator

GRID = MapGrid.from_size((0.5, 6.0, 0.0), 3.0, 3.0, 0.04)
RAMP = {'start_frequency_hz': 23.5e9, 'slope_hz_per_s': 10e12, 'sample_rate_hz': 2.5e6,
        'n_samples': 192, 'adc_start_s': 6e-6}


def make_rail(n_points=12, noise=1.0, falling=False):
    """Raw pulses over random points; -10 dB noise per sample against the brightest."""
    ramp = RAMP | ({'slope_hz_per_s': -10e12, 'start_frequency_hz': 24.5e9} if falling else {})
    rng = np.random.default_rng(1)
    n = 240
    time_s = np.arange(n) / 100.0
    u = time_s / time_s[-1]
    # Slow twice, never in the same way: clock offsets show.
    x = 1.6 * (u + 0.09 * np.sin(8.0 * u + 0.5) + 0.03 * np.sin(19.0 * u)) - 0.8
    track = np.c_[x, 0.004 * np.sin(8.2 * u + 0.4), 1.0 + 0.003 * np.cos(10.7 * u)][:, None]
    points = np.c_[GRID.centre_m[0] + rng.uniform(-1.3, 1.3, n_points),
                   GRID.centre_m[1] + rng.uniform(-1.3, 1.3, n_points), np.zeros(n_points)]
    amplitudes = rng.uniform(0.5, 2.0, n_points) * np.exp(6.3j * rng.random(n_points))
    radar = fmcw_parameters(**ramp)
    samples = EchoSimulator(radar, ramp['n_samples'], compressed=False, points_m=points,
                            amplitudes=amplitudes)(track, track) if n_points else 0.0
    shape = n, 1, ramp['n_samples']
    samples = samples + noise * (rng.standard_normal(shape) + 1j * rng.standard_normal(shape))
    stamps = 1_700_000_000 * 10**9 + np.rint(1e9 * time_s).astype(np.int64)
    return PulseBlock(radar, False, stamps, np.arange(n), samples, track, track)


@pytest.fixture(scope='session')
def grid():
    """Grid around the points."""
    return GRID


@pytest.fixture(scope='session')
def right():
    """Raw pulses."""
    return make_rail()


@pytest.fixture(scope='session')
def empty():
    """The same radar over nothing."""
    return make_rail(n_points=0)
