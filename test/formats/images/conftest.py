# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Simulated flights past a few reflectors, and their images."""

import dataclasses
import functools
import resource

import numpy as np
import pytest

from sar_imaging.formats import Acquisition, sicd_grid
from sar_imaging.geometry import Datum
from sar_imaging.imaging.imager import plan_image
from sar_imaging.signal import SPEED_OF_LIGHT, PulseBlock, RadarParameters
from sar_imaging.simulation import EchoSimulator

REFLECTORS = ((0.0, 0.0, 0.0), (8.3, 5.1, 0.0), (-7.2, 9.4, 0.0), (5.5, -11.3, 0.0))
START_NS = 1_700_000_000_123_456_789


@dataclasses.dataclass(frozen=True)
class Flight:
    """Pulses of a radar that flies past the origin, and what they are images of."""

    block: PulseBlock
    points_m: np.ndarray
    datum: Datum

    @property
    def acquisition(self):
        return Acquisition.of(self.block, polarisation='V:H', collector='test radar')

    def image(self, grid):
        return plan_image(grid, self.block.radar, self.block.n_samples, target_db=-80.0)(
            self.block)

    def sicd_image(self, plane='ground', size_m=36.0):
        return self.image(sicd_grid(self.acquisition, (0.0, 0.0, 0.0), size_m, size_m,
                                    plane=plane))


@functools.lru_cache
def fly(*, left=True, heading_deg=0.0, squint_m=0.0, datum=(47.0, 8.0, 400.0, 30.0), apart_m=0.0,
        reflectors=REFLECTORS, n_pulses=96, carrier_hz=9.6e9,
        ground_range_m=3000.0, height_m=1500.0):
    """A slightly bent pass 3 km beside the origin, 0.35 m by 0.3 m of resolution.

    `apart_m` is how far the receiver flies ahead of the transmitter.
    """
    points = np.array(reflectors)
    heading = np.radians(heading_deg)
    ahead = np.array([np.sin(heading), np.cos(heading), 0.0])
    beside = np.array([-ahead[1], ahead[0], 0.0]) * (-1 if left else 1)
    along = np.linspace(-70.0, 70.0, n_pulses)[:, None]
    track = (ground_range_m * beside + (along - squint_m) * ahead
             + (height_m + 1e-4 * along**2) * np.array([0, 0, 1.0]))
    tx, rx = track[:, None], track[:, None] + apart_m * ahead
    path = 0.5 * (np.linalg.norm(tx, axis=-1) + np.linalg.norm(rx, axis=-1)).min()
    radar = RadarParameters(carrier_hz, 400e6, 500e6, 2 * (path - 60) / SPEED_OF_LIGHT)
    profiles = EchoSimulator(radar, 1024, compressed=True, points_m=points,
                             amplitudes=np.ones(len(points)))
    stamps = START_NS + np.round(np.linspace(0, 1.4e9, n_pulses)).astype(np.int64)
    return Flight(PulseBlock(radar, True, stamps, np.arange(n_pulses), profiles(tx, rx), tx, rx),
                  points, Datum(*datum))


@pytest.fixture(scope='session')
def flight():
    """Function that simulates a flight, once for all tests of the same one."""
    return fly


def find_peaks(samples, near):
    """(S, 2) fractional row and column of the maxima next to some pixels.

    The Fourier series is read every eighth of a pixel, and a parabola goes through the highest
    values.

    Parameters
    ----------
    samples : (rows, columns) complex
        At baseband.
    near : (S, 2) array_like
        Where to look, within three pixels.
    """
    spectrum, steps = np.fft.fft2(samples) / samples.size, np.arange(-25, 26) / 8
    out = []
    for middle in np.round(8 * np.asarray(near)) / 8:
        down, across = (np.exp(2j * np.pi * np.outer(place + steps, np.fft.fftfreq(n)))
                        for place, n in zip(middle, samples.shape, strict=True))
        power = np.abs(down @ spectrum @ across.T)**2
        inside = power[1:-1, 1:-1]
        i, j = np.add(np.unravel_index(inside.argmax(), inside.shape), 1)
        shift = [(p[2] - p[0]) / (2 * (2 * p[1] - p[0] - p[2]))
                 for p in (power[i - 1:i + 2, j], power[i, j - 1:j + 2])]
        out.append(middle + steps[[i, j]] + np.divide(shift, 8))
    return np.array(out)


@pytest.fixture(scope='session')
def peaks():
    """Function that finds the maxima of an image."""
    return find_peaks


@pytest.fixture
def little_memory():
    """A file of some kilobytes needs no gigabyte; asking for one fails."""
    limits = resource.getrlimit(resource.RLIMIT_AS)
    with open('/proc/self/statm') as file:
        used = int(file.read().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + 2**28, limits[1]))
    yield
    resource.setrlimit(resource.RLIMIT_AS, limits)
