"""Scenarios `first_pass` and `second_pass`: the same ground from two tracks; a car moved."""

from __future__ import annotations

import numpy as np

from ...geometry.grids import MapGrid
from ...signal.radar import SPEED_OF_LIGHT, RadarParameters
from ..noise import complex_gaussian
from ..scene import Clutter, Scatterer
from ..trajectory import Trajectory
from .scenario import Scenario

_SEED = 1993
_SCENE = 1 << 32  # streams of the scene; those below are the noise of pulses
_PITCH_M = 0.3  # of the lattice of the ground, finer than the resolution of 0.5 m by 0.43 m
_GROUND_M = 26.0  # half of its sides
_CAR_DB = 20.0  # of each of its points, over one of the ground
_REFLECTOR_DB = 30.0

TERRACE_M = ((-10.0, 12.0), (4.0, 18.0))  # sides along x and y
TERRACE_HEIGHT_M = 1.5
CAR_M = {'first_pass': (-9.0, -8.0), 'second_pass': (8.0, -13.0)}
BASELINE_M = (0.3, 0.0, 1.4)  # from the first track to the second


def first_pass() -> Scenario:
    """The first of two passes over speckled ground with a terrace and a car."""
    return _pass('first_pass', 'First of two passes over speckled ground with a terrace of '
                 f'{TERRACE_HEIGHT_M:g} m and a car, slant range 1 km, 10 GHz, 300 MHz, range '
                 'compressed', (0.0, 0.0, 0.0), 1)


def second_pass() -> Scenario:
    """The second pass from a track beside the first, after the car has moved."""
    return _pass('second_pass', 'Second pass over the ground of first_pass, 1.4 m higher, after '
                 'the car has moved', BASELINE_M, 2)


def _pass(name: str, description: str, baseline_m, seed: int) -> Scenario:
    radar = RadarParameters(carrier_hz=10e9, bandwidth_hz=300e6, sample_rate_hz=400e6,
                            first_sample_delay_s=2 * 952.0 / SPEED_OF_LIGHT)
    return Scenario(
        name=name, description=description, radar=radar, compressed=True, n_samples=260,
        # 0.25 m between pulses repeat a scatterer every 60 m in azimuth, beyond the ground
        prf_hz=400.0, n_pulses=140, pulses_per_aperture=140,
        trajectory=Trajectory(tuple(np.add((-707.0, 0.0, 707.0), baseline_m)), (0.0, 100.0, 0.0)),
        tx_offsets_m=((0.0, 0.0, 0.0),), rx_offsets_m=((0.0, 0.0, 0.0),),
        scatterers=(Scatterer('reflector', (18.0, 0.0, 0.0), 10 ** (_REFLECTOR_DB / 20)),),
        grid=MapGrid.from_size((0.0, 0.0, 0.0), 48.0, 48.0, 0.25),
        cut_half_width_m=(4.0, 4.0), noise_std=2.0, seed=seed, clutter=_scene(CAR_M[name]),
        notes='Invented; looks along +x, flies along +y')


def _scene(car_m) -> Clutter:
    """Ground with its terrace, the same in both passes, and the car."""
    along = np.arange(-_GROUND_M, _GROUND_M, _PITCH_M)
    x, y = (v.ravel() for v in np.meshgrid(along, along))
    (x0, x1), (y0, y1) = TERRACE_M
    raised = (x > x0) & (x < x1) & (y > y0) & (y < y1)
    ground = np.stack([x, y, np.where(raised, TERRACE_HEIGHT_M, 0.0)], axis=1)
    car = np.stack([v.ravel() for v in np.meshgrid(
        np.linspace(-2.2, 2.2, 6), np.linspace(-0.9, 0.9, 4), [0.4, 1.3])], axis=1)
    return Clutter(
        np.concatenate([ground, car + (*car_m, 0.0)]),
        np.concatenate([complex_gaussian(_SEED, _SCENE, len(ground)), 10 ** (_CAR_DB / 20)
                        * complex_gaussian(_SEED, _SCENE + 1, len(car))]))
