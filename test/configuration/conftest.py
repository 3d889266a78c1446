# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""A configuration in which nothing is wrong, and ways to vary it."""

import dataclasses

import pytest
from hypothesis import strategies as st

from sar_imaging.configuration import Acquisition, Imaging, Machine
from sar_imaging.geometry.grids import MapGrid
from sar_imaging.signal.radar import SPEED_OF_LIGHT, RadarParameters

MACHINE = Machine(1e9, 'given', 8_000_000_000)


def make_acquisition(**changes) -> Acquisition:
    """A broadside X band radar at 1 km; fields of its radar parameters may be among `changes`."""
    radar = {'carrier_hz': 10e9, 'bandwidth_hz': 300e6, 'sample_rate_hz': 400e6,
             'first_sample_delay_s': 2 * 850.0 / SPEED_OF_LIGHT, 'pulse_length_s': 1e-6,
             'chirp_rate_hz_per_s': 300e6 / 1e-6}
    radar |= {name: changes.pop(name) for name in list(changes) if name in radar
              or name == 'waveform'}
    fields = {'radar': RadarParameters(**radar), 'compressed': False, 'n_samples': 1200,
              'n_channels': 2, 'prf_hz': 200.0, 'centre_m': (-800.0, 0.0, 600.0),
              'velocity_m_per_s': (0.0, 50.0, 0.0), 'channel_spacing_m': 0.1}
    return Acquisition(**(fields | changes))


def make_imaging(**changes) -> Imaging:
    """50 m by 50 m at its resolution from 256 pulses."""
    fields = {'grid': MapGrid.from_size((0.0, 0.0, 0.0), 50.0, 50.0, 0.1),
              'pulses_per_aperture': 256, 'pulses_per_block': 32}
    return Imaging(**(fields | changes))


@pytest.fixture
def acquisition():
    return make_acquisition()


@pytest.fixture
def imaging():
    return make_imaging()


@pytest.fixture
def machine():
    return MACHINE


def numbers(low, high):
    return st.floats(low, high, allow_nan=False)


@st.composite
def profile_setups(draw):
    """Any radar of range profiles on any straight, moving track over any grid."""
    bandwidth = draw(numbers(1e6, 4e9))
    start = draw(numbers(0.0, 1e4))
    acquisition = make_acquisition(
        compressed=True, carrier_hz=bandwidth * draw(numbers(1.0, 100.0)),
        bandwidth_hz=bandwidth, sample_rate_hz=bandwidth * draw(numbers(1.0, 4.0)),
        first_sample_delay_s=2 * start / SPEED_OF_LIGHT,
        n_samples=draw(st.integers(2, 4096)), n_channels=draw(st.integers(1, 16)),
        prf_hz=draw(numbers(1.0, 1e5)),
        centre_m=tuple(draw(st.tuples(*[numbers(-1e4, 1e4)] * 3))),
        velocity_m_per_s=draw(st.tuples(*[numbers(-300.0, 300.0)] * 3).filter(
            lambda v: max(map(abs, v)) > 0.01)),
        channel_spacing_m=draw(numbers(0.0, 1.0)), beamwidth_rad=draw(numbers(0.0, 3.1)))
    centre = draw(st.tuples(*[numbers(-1e4, 1e4)] * 3))
    grid = MapGrid(centre, draw(st.integers(1, 2000)), draw(st.integers(1, 2000)),
                   draw(numbers(0.001, 10.0)))
    return acquisition, make_imaging(grid=grid, pulses_per_aperture=draw(st.integers(1, 8192)),
                                     oversampling=draw(numbers(1.0, 4.0)))


def replace_radar(acquisition, **changes):
    return dataclasses.replace(acquisition,
                               radar=dataclasses.replace(acquisition.radar, **changes))
