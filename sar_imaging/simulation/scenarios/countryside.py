# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Scenario `countryside`: fields, a road, buildings, trees, parked and moving cars."""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike

from ...geometry.grids import MapGrid
from ...signal.radar import SPEED_OF_LIGHT, RadarParameters, Waveform
from ..movers import Mover
from ..noise import complex_gaussian
from ..scene import Clutter, Scatterer
from ..shadows import Box, Crown, transmission
from ..trajectory import Trajectory, Vibration
from .scenario import Scenario, receive_array

_SEED = 1959
_SCENE = 1 << 32  # streams of the scene; those below are the noise of pulses
_TRACK_M = (-866.0, 0.0, 500.0)  # middle of the aperture
# A lattice finer than the resolution: the expected power of homogeneous ground is the same in
# every pixel, and Gaussian amplitudes make its speckle fully developed.
_PITCH_M = 0.36
_GROUND_M = ((-76.0, 76.0), (-61.0, 61.0))  # the lit ground along x and y
_LOSS_DB_PER_M = 2.5  # of leaves, one way

_HALL = Box((30.0, 44.0), (19.0, 43.0), 8.0)
_HOUSE = Box((-11.0, -2.0), (33.0, 44.0), 6.0)
_CAR_PARK_M = ((21.0, 50.0), (-22.0, 9.0))
_REFLECTORS = (('reflector_meadow', -21.0, 17.0), ('reflector_west', -56.0, 12.0),
               ('reflector_furrows', -38.0, -37.0), ('reflector_car_park', 35.0, -6.5),
               ('reflector_stubble', 45.0, -43.0))
_REFLECTOR_DB = 32.0  # power over that of a scatterer of the meadow


def countryside() -> Scenario:
    """Aircraft over farmland: clutter, shadows, layover, cars, known reflectors."""
    sample_rate_hz, n_pulse = 500e6, 100
    pulse_length_s = n_pulse / sample_rate_hz
    radar = RadarParameters(
        carrier_hz=10e9, bandwidth_hz=400e6, sample_rate_hz=sample_rate_hz,
        # The lit ground lies between 936 and 1070 m.
        first_sample_delay_s=2 * 933.0 / SPEED_OF_LIGHT,
        pulse_length_s=pulse_length_s, chirp_rate_hz_per_s=400e6 / pulse_length_s,
        waveform=Waveform.LFM)
    track = Trajectory(
        centre_m=_TRACK_M, velocity_m_per_s=(0.0, 120.0, 0.0),
        polynomial=((0.8, 0.4, -0.6),),
        vibrations=(Vibration((0.03, 0.01, 0.05), 0.7, 0.2), Vibration((0.002, 0.0, 0.003), 11.0)),
        broadband_m=(0.0003, 0.0003, 0.0003), seed=_SEED)
    return Scenario(
        name='countryside',
        description='Aircraft at 500 m over farmland, slant range 1 km, 10 GHz, 400 MHz, 2 '
                    'channels, raw LFM pulses of clutter, buildings, trees, parked and moving '
                    'cars and five reflectors, noise, one aperture on a perturbed track',
        radar=radar, compressed=False, n_samples=560,
        # 0.12 m between pulses repeat a scatterer every 125 m in azimuth, beyond the lit ground;
        # the second channel passes where the first was a pulse ago.
        prf_hz=1000.0, n_pulses=288, pulses_per_aperture=288, trajectory=track,
        tx_offsets_m=((0.0, 0.0, 0.0),) * 2, rx_offsets_m=receive_array(2, 0.24),
        scatterers=tuple(Scatterer(name, (x, y, 0.0), 10 ** (_REFLECTOR_DB / 20))
                         for name, x, y in _REFLECTORS),
        grid=MapGrid.from_size((0.0, 0.0, 0.0), 140.0, 110.0, 0.2),
        cut_half_width_m=(2.0, 2.0), noise_std=25.0, seed=_SEED, resolution_bits=12,
        movers=_moving_cars(), clutter=clutter(),
        notes='Invented; looks along +x, flies along +y; shadows as seen from the middle of the '
              'aperture')


def clutter() -> Clutter:
    """Everything in the scene that has no name.

    Returns
    -------
    Clutter
        Of random phases; powers relative to a scatterer of the meadow.
    """
    cars, crowns = _parked_cars(), _trees()
    parts = [_ground(), *(_building(box) for box in (_HALL, _HOUSE)), *map(_car, cars),
             *(_leaves(crown) for crown in crowns), _lamp_posts()]
    points = np.concatenate([p for p, _ in parts])
    power_db = np.concatenate([level for _, level in parts])
    seen = transmission(points, _TRACK_M, [_HALL, _HOUSE, *cars], crowns, _LOSS_DB_PER_M)
    amplitudes = 10 ** (power_db / 20) * seen * complex_gaussian(_SEED, _SCENE, len(points))
    bright = seen > 0.01  # 40 dB
    return Clutter(points[bright], amplitudes[bright])


def _uniform(stream: int, n: int) -> np.ndarray:
    """``(n,)`` float64 numbers between 0 and 1: the power of Gaussian ones is exponential."""
    return np.exp(-np.abs(complex_gaussian(_SEED, _SCENE + stream, n)) ** 2)


# ---------------------------------------------------------------------------------- ground

def _ground() -> tuple[np.ndarray, np.ndarray]:
    """Lattice of the ground: points ``(S, 3)`` in metres and powers ``(S,)`` in dB."""
    (x0, x1), (y0, y1) = _GROUND_M
    x, y = (v.ravel() for v in np.meshgrid(np.arange(x0, x1, _PITCH_M),
                                           np.arange(y0, y1, _PITCH_M)))
    return np.stack([x, y, np.zeros_like(x)], axis=1), _ground_db(x, y)


def _ground_db(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Power of the ground by what grows on it, dB."""
    from_road = (x - _road_x(y)) * 0.944  # square to the road, whose slope is 0.35
    west = from_road < 0
    along, across = 0.35 * x + 0.94 * y, 0.94 * x - 0.35 * y
    furrows = -6.0 + 3.5 * np.cos(2 * np.pi * along / 2.2)
    tracks = np.abs(np.mod(across, 14.0) - 7.0)
    crop = np.where((tracks < 1.4) & (tracks > 0.6), -10.0, 1.0)
    level = np.where(west, np.where(y > _hedge_y(x), 0.0, furrows),
                     np.where(y < -26.0 - 0.1 * x, crop - 2.0, -5.0))
    pond = ((x + 46.0) / 13.0) ** 2 + ((y - 35.0) / 9.0) ** 2
    level = np.where(pond < 1 + 0.15 * np.sin(3 * np.arctan2(y - 35.0, x + 46.0)), -24.0, level)
    track = np.abs(y - 47.0 + 0.06 * x)  # of a farm, from the road to the west
    level = np.where(west & (track < 1.6), -10.0, level)
    (x0, x1), (y0, y1) = _CAR_PARK_M
    drive = (np.abs(y + 6.5) < 3.0) & (from_road > 0) & (x < x1)
    level = np.where((x > x0) & (x < x1) & (y > y0) & (y < y1) | drive, -13.0, level)
    return np.where(np.abs(from_road) < 3.5, -16.0, level)


_Place = TypeVar('_Place', float, np.ndarray)


def _road_x(y: _Place) -> _Place:
    return 4.0 + 0.35 * y


def _hedge_y(x: _Place) -> _Place:
    return 2.0 + 0.12 * x


# ---------------------------------------------------------------------- what stands on it

def _building(box: Box) -> tuple[np.ndarray, np.ndarray]:
    """Roof, the wall towards the radar and the double bounce in front of it."""
    y = np.arange(*box.y_m, _PITCH_M)
    parts = [_place(np.arange(*box.x_m, _PITCH_M), y, [box.height_m], -9.0),
             _place(box.x_m[:1], y, np.arange(0.3, box.height_m, _PITCH_M), -1.0),
             _place(box.x_m[:1], y, [box.height_m], 10.0),  # eaves
             _place(box.x_m[:1], y, [0.0], 17.0),
             _place(box.x_m[:1], np.arange(box.y_m[0] + 1.5, box.y_m[1] - 1.0, 3.0),
                    np.arange(1.5, box.height_m - 1.0, 2.8), 15.0)]  # windows
    return _joined(parts)


def _parked_cars() -> list[Box]:
    """Two rows with gaps, noses towards the radar."""
    taken = _uniform(1, 20).reshape(2, 10) < 0.75
    skew = 0.3 * _uniform(2, 20).reshape(2, 10)
    return [Box((x + skew[row, n], x + skew[row, n] + 4.4),
                (-21.0 + 3.0 * n, -21.0 + 3.0 * n + 1.8), 1.5)
            for row, x in enumerate((24.0, 40.0)) for n in range(10)
            if taken[row, n] and not -10.5 < -21.0 + 3.0 * n < -3.0]  # the drive


def _car(box: Box) -> tuple[np.ndarray, np.ndarray]:
    """Bonnet and bumper as double bounce, windscreen, roof and tail."""
    (x0, x1), y = box.x_m, np.arange(box.y_m[0], box.y_m[1], 0.45)
    parts = [_place([x0], y, [0.0], 15.0), _place([x0 + 1.3], y, [box.height_m], 9.0),
             _place([x1], y, [box.height_m - 0.5], 5.0),
             _place(np.arange(x0, x1, 0.45), y, [box.height_m], 0.0),
             _place(np.arange(x0, x1, 0.9), box.y_m, [0.7], 6.0)]
    return _joined(parts)


def _trees() -> list[Crown]:
    """A hedge between the fields, a wood in the east, trees by the road and in the fields."""
    x = np.arange(-74.0, -2.0, 1.5)
    size = 1.0 + 0.6 * _uniform(3, x.size)
    hedge = [Crown((a, _hedge_y(a) + 0.5 * s, 0.8 * s), s)
             for a, s in zip(x.tolist(), size.tolist(), strict=True)]
    u = _uniform(4, 120).reshape(3, 40)
    wood = [Crown((62.0 + 13.0 * a, 16.0 + 44.0 * b, 3.0 + 3.0 * c), 1.8 + 1.4 * c)
            for a, b, c in zip(*u.tolist(), strict=True)]
    size = _uniform(5, 9)
    lane = [Crown((_road_x(y) + 7.0, y, 2.5 + c), 1.8 + c)
            for y, c in zip(np.arange(-57.0, -24.0, 4.5).tolist(), size.tolist(), strict=False)]
    alone = [Crown((x, y, 3.6), 3.2) for x, y in ((-58.0, -18.0), (-24.0, -52.0), (-30.0, 39.5),
                                                  (27.0, 50.0), (64.0, -8.0))]
    return [*hedge, *wood, *lane, *alone]


def _leaves(crown: Crown) -> tuple[np.ndarray, np.ndarray]:
    """Lattice in the sphere; the leaves in front weaken those behind."""
    pitch_m, r = 0.6, crown.radius_m
    steps = np.arange(-r, r + pitch_m, pitch_m)
    points, level = _place(steps, steps, steps, 8.0)
    inside = (points**2).sum(axis=1) < r * r
    points = points[inside] + crown.centre_m
    above = points[:, 2] > 0
    return points[above], level[inside][above]


def _lamp_posts() -> tuple[np.ndarray, np.ndarray]:
    y = np.arange(-52.0, 60.0, 16.0)
    points = np.stack([_road_x(y) - 4.6, y, np.zeros_like(y)], axis=1)
    return points, np.full(len(y), 17.0)


def _joined(parts: list[tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, np.ndarray]:
    points, levels = zip(*parts, strict=True)
    return np.concatenate(points), np.concatenate(levels)


def _place(x: ArrayLike, y: ArrayLike, z: ArrayLike, level_db: float
           ) -> tuple[np.ndarray, np.ndarray]:
    """All combinations of the coordinates, of one power."""
    points = np.stack([v.ravel() for v in np.meshgrid(x, y, z, indexing='ij')], axis=1)
    return points.astype(float), np.full(len(points), level_db)


# --------------------------------------------------------------------------------- traffic

def _moving_cars() -> tuple[Mover, ...]:
    """Two cars on the road, seven points each."""
    along = np.array([0.35, 1.0]) / np.hypot(0.35, 1.0)
    return tuple(
        Mover(f'car_{car}_{i}', (*(np.array([_road_x(y) + lane, y]) + s * along), 0.5),
              (*(speed * along), 0.0), 10 ** (level / 20) * complex(phase))
        for car, (lane, y, speed, level) in enumerate(((1.7, 20.0, 7.0, 20.0),
                                                       (-1.7, 2.0, -5.5, 20.0)), 1)
        for i, (s, phase) in enumerate(zip(
            np.linspace(-2.1, 2.1, 7), np.exp(2j * np.pi * _uniform(5 + car, 7)), strict=True)))
