# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Apertures that are imaged by AFBP while the pulses arrive, and exact images of their pulses."""

import numpy as np
import pytest

from benchmarks.support.references import exact_image
from sar_imaging.streaming.subapertures import LiveSubapertures

LENGTH = 96  # pulses of an aperture
CUT = 16  # pulses of a sub-aperture, where a test needs to know it


def _arc(n_pulses, radius_m=400.0, step_m=0.3):
    """A circle flown at constant speed, tangent to the y axis in the middle."""
    angle = (np.arange(n_pulses) - (n_pulses - 1) / 2) * step_m / radius_m
    return np.c_[radius_m * (np.cos(angle) - 1), radius_m * np.sin(angle), 0 * angle]


def _shaken(n_pulses):
    """A straight track with a random walk of 4 mm per pulse and a vibration of 20 mm."""
    rng = np.random.default_rng(3)
    track = np.c_[0 * np.arange(n_pulses), (np.arange(n_pulses) - n_pulses / 2) * 0.3,
                  0 * np.arange(n_pulses)]
    track += np.cumsum(rng.normal(0, 0.004, (n_pulses, 3)), axis=0)
    return track + 0.02 * np.sin(np.arange(n_pulses) * 0.9)[:, None]


def _accelerating(n_pulses):
    u = np.linspace(-1, 1, n_pulses)
    return np.c_[0 * u, n_pulses * 0.15 * (u + 0.3 * u ** 2), 0 * u]


TRACKS = {
    'straight': {'aperture_m': 0.3 * 2 * LENGTH},
    'straight, 5 channels': {'aperture_m': 0.3 * 2 * LENGTH, 'channels': 5},
    'near': {'range_m': 100.0, 'aperture_m': 6.0},
    'bowed': {'aperture_m': 60.0, 'bend_m': 4.0},
    'circular': {'track_m': _arc(2 * LENGTH)},
    'shaken': {'track_m': _shaken(2 * LENGTH)},
    'accelerating': {'track_m': _accelerating(2 * LENGTH)},
}


@pytest.fixture(name='fly', scope='module')
def fly_fixture(make_case):
    made = {}

    def fly(name='straight', n_pulses=2 * LENGTH):
        if (name, n_pulses) not in made:
            made[name, n_pulses] = make_case(**{'range_m': 1e3} | {
                'n': 64, 'pulses': n_pulses, 'n_points': 20} | TRACKS[name])
        return made[name, n_pulses]

    return fly


def error_db(image, reference):
    """Mean squared difference over the mean square of the reference, dB."""
    return 10 * np.log10(np.sum(np.abs(image - reference) ** 2)
                         / np.sum(np.abs(reference) ** 2))


def exact_of(case, pulses, grid=None):
    """Exact backprojection of some pulses of a case."""
    grid = case.grid if grid is None else grid
    return exact_image(grid, case.block.select(pulses), target_db=-90.0)


def make_stage(case, **options):
    """First stage for the grid of a case."""
    return LiveSubapertures(case.grid, **{'pulses_per_aperture': LENGTH} | options)


def pieces_of(block, size=12):
    """The pulses as they arrive, so many at a time."""
    return [block.select(slice(i, i + size)) for i in range(0, block.n_pulses, size)]


def subapertures_of(stage, blocks):
    """All sub-aperture images that a stage makes of some blocks."""
    return [s for block in blocks for s in stage.add(block)] + stage.flush()


def fuse(fusion, subapertures):
    """All images that come of sub-aperture images."""
    return [image for s in subapertures for image in fusion.add(s)]


def events_of(stage, kind):
    """Texts of the events of one kind since they were asked for last."""
    return [e.text for e in stage.take_events() if e.kind == kind]


@pytest.fixture(name='sent', scope='module')
def sent_fixture(fly):
    return subapertures_of(make_stage(fly(), pulses_per_subaperture=CUT), pieces_of(fly().block))
