# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Measure whether cells that an obstacle map calls free were seen: shadows, hidden points, walls.

Echoes and images are plain NumPy in float64, apart from the package: scatterers with the range
and phase of every pulse, ground that walls hide from each pulse by itself, and backprojection of
range profiles. Three apertures pass by; the map is that of all of them, or of the first. A fifth
as many scenes have a wall across the whole map.

Run from the repository root: ``make obstacle-shadows``.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import math
import pathlib
import time

import numpy as np
from tqdm import tqdm

from sar_imaging.exploitation.obstacles import ApertureView, ObstacleDetector, ObstacleMap
from sar_imaging.geometry.grids import MapGrid
from sar_imaging.signal.radar import RadarParameters

from .support.machine import machine

RESULTS = pathlib.Path(__file__).parent / 'results' / 'obstacle_shadows.json'
_LIGHT = 299_792_458.0
_CARRIER_HZ, _PULSES, _APERTURES = 10e9, 96, 3
_SIZE_M, _SHADOW_DB = 28.0, -15.0
_PER_CELL = 2.0  # scatterers of the ground in a resolution cell
_WALL_STEP_M = 0.1
_SPLIT = 12  # of the phase over frequency: a product of two short ones
_OVERSAMPLING = 16  # of range profiles, so that straight lines between samples suffice


@dataclasses.dataclass
class Scene:
    """One wall before the ground, points beside it and elsewhere; a seed decides all.

    The track is parallel to y, at x = 0; power 1 is that of the ground in the middle of the map.
    """

    seed: int
    WALL_M, DEPTHS_M = 10.0, (5.0, 9.0)

    def __post_init__(self):
        rng = self.rng = np.random.default_rng([36, self.seed])
        self.bandwidth_hz = rng.choice([300e6, 400e6])
        self.range_m, self.height_m = rng.uniform(60.0, 110.0), rng.uniform(3.0, 25.0)
        self.cell_m = _LIGHT / 2 / self.bandwidth_hz
        self.length_m = _LIGHT / _CARRIER_HZ * self.range_m / (2 * self.cell_m)
        self.wall_db = (10.0, 15.0, 25.0, 35.0)[self.seed % 4]
        self.window = np.hamming if self.seed % 8 < 4 else np.ones
        n = int(_SIZE_M / (0.5 * self.cell_m))
        self.grid = MapGrid((self.range_m, 0.0, 0.0), n, n, 0.5 * self.cell_m)
        self.depth_m = rng.uniform(*self.DEPTHS_M)
        turn = math.radians(rng.uniform(-20, 20))
        middle = np.array([self.range_m + rng.uniform(-6, 0), rng.uniform(-5, 5)])
        along = np.array([math.sin(turn), math.cos(turn)])
        self.wall_m = middle + np.outer(np.arange(-0.5, 0.5, _WALL_STEP_M / self.WALL_M), along
                                        ) * self.WALL_M
        self.ends_m = self.wall_m[[0, -1]]
        # Some shadows are as dark as the noise, others have weak echoes of their own.
        self.noise_db, self.shadow = ((_SHADOW_DB, 0.0) if rng.random() < 0.5 else
                                      (_SHADOW_DB - 10, 10 ** (_SHADOW_DB / 20)))
        pitch = self.cell_m / math.sqrt(_PER_CELL)
        n = int((_SIZE_M + 4 * self.cell_m) / pitch)
        # One in every square of a lattice: speckle is fully developed.
        self.ground_m = middle_of(self.grid) + pitch * (
            np.stack(np.meshgrid(*2 * [np.arange(n) - n / 2]), axis=-1)
            + rng.random((n, n, 2))).reshape(-1, 2)
        self.texture = (rng.gamma(10.0, 0.1, len(self.ground_m)) if self.seed % 2
                        else np.ones(len(self.ground_m)))
        self._place_points(rng)

    def _place_points(self, rng) -> None:
        """Weak points beside the wall, in front of it or past its ends, and strong ones apart."""
        tries = middle_of(self.grid) + rng.uniform(-0.46, 0.46, (4000, 2)) * _SIZE_M
        apart = np.linalg.norm(tries[:, None] - self.wall_m, axis=-1).min(axis=1)
        seen = ~self.hidden(tries, grow_m=2 * self.cell_m)
        beside = tries[seen & (apart > 1.0) & (apart < 4.0)]
        elsewhere = tries[seen & (apart > 6.0)]
        self.beside_m = spaced(beside, 3, 4 * self.cell_m)
        self.elsewhere_m = spaced(elsewhere, 5, 8 * self.cell_m)
        self.beside_db = rng.uniform(10, 15, len(self.beside_m))
        self.elsewhere_db = rng.uniform(10, 30, len(self.elsewhere_m))

    def track(self, aperture: int) -> np.ndarray:
        """(P, 3) places of the antenna."""
        y = ((np.arange(_PULSES) - (_PULSES - 1) / 2) / _PULSES
             + aperture - (_APERTURES - 1) / 2) * self.length_m
        return np.stack([np.zeros(_PULSES), y, np.full(_PULSES, self.height_m)], axis=-1)

    def hidden(self, points_m, antennas_m=None, grow_m: float = 0.0) -> np.ndarray:
        """(N,) bool: places (N, 2) in the shadow, from every one of some antennas."""
        if antennas_m is None:
            antennas_m = np.concatenate([self.track(i)[::24] for i in range(_APERTURES)])
        (a, b), out = self.ends_m, np.ones(len(points_m), bool)
        stretch = grow_m / np.linalg.norm(b - a) * (b - a)
        a, wall = a - stretch, b - a + 2 * stretch
        for antenna in antennas_m[:, :2]:
            ray = points_m - antenna
            cross = ray[:, 0] * wall[1] - ray[:, 1] * wall[0]
            to_wall = a - antenna
            share = (to_wall[0] * wall[1] - to_wall[1] * wall[0]) / cross  # of the ray
            place = (to_wall[0] * ray[:, 1] - to_wall[1] * ray[:, 0]) / cross  # of the wall
            behind_m = (1 - share) * np.linalg.norm(ray, axis=1)
            out &= ((place >= 0) & (place <= 1) & (behind_m > -grow_m)
                    & (behind_m < self.depth_m + grow_m))
        return out

    def image(self, aperture: int) -> np.ndarray:
        """(n_y, n_x) complex128 image of an aperture."""
        rng = np.random.default_rng([self.seed, aperture])
        still = np.random.default_rng([self.seed, 99])  # the ground is the same each time
        n = 2 * math.ceil(1.2 * _SIZE_M / self.cell_m) | 1
        weights = self.window(n) / self.window(n).sum()
        # A window makes cells wider, which then hold more of the ground.
        ground = np.sqrt(self.texture / (2 * _PER_CELL * n * np.sum(weights**2))) * (
            still.standard_normal((2, len(self.ground_m))).T @ (1, 1j))
        # A rough wall: what a resolution cell of it returns has the wall's level on average.
        wall = math.sqrt(10 ** (self.wall_db / 10) * _WALL_STEP_M / self.cell_m / 2) * (
            still.standard_normal((2, len(self.wall_m))).T @ (1, 1j))
        points_m = np.concatenate([self.beside_m, self.elsewhere_m])
        points = 10 ** (np.concatenate([self.beside_db, self.elsewhere_db]) / 20) * np.exp(
            2j * np.pi * rng.random(len(points_m)))
        places = np.concatenate([self.ground_m, self.wall_m, points_m])
        amplitudes = np.concatenate([ground, wall, points])
        frequency = (np.arange(n) - n // 2) / n * self.bandwidth_hz
        noise = math.sqrt(10 ** (self.noise_db / 10) * _PULSES / np.sum(weights**2) / 2)
        image, rho = np.zeros(self.grid.shape, complex), self.grid.points()
        for antenna in self.track(aperture):
            lit = np.ones(len(places))
            lit[:len(ground)][self.hidden(self.ground_m, antenna[None])] = self.shadow
            d = np.hypot(np.linalg.norm(places - antenna[:2], axis=1), antenna[2])
            z = amplitudes * lit * (self.range_m / d)**2 * np.exp(
                -4j * np.pi / _LIGHT * _CARRIER_HZ * d)
            spectrum = band(z, 4 * np.pi / _LIGHT * (d - self.range_m),
                            self.bandwidth_hz / n, n)
            spectrum += noise * (rng.standard_normal((2, n)).T @ (1, 1j))
            image += backprojected(spectrum * weights, frequency, np.linalg.norm(
                rho - antenna, axis=-1), self.range_m)
        return image / _PULSES

    def view(self, aperture: int) -> ApertureView:
        """What the detector knows of an aperture."""
        return ApertureView.of_positions(self.track(aperture), RadarParameters(
            _CARRIER_HZ, self.bandwidth_hz, self.bandwidth_hz, first_sample_delay_s=1e-7))


class LongWall(Scene):
    """A wall across the whole map, and nothing but its shadow behind it."""

    WALL_M, DEPTHS_M = 50.0, (50.0, 50.0)


def middle_of(grid: MapGrid) -> np.ndarray:
    """(2,) middle of a map."""
    return np.array(grid.centre_m[:2])


def spaced(places_m: np.ndarray, n: int, apart_m: float) -> np.ndarray:
    """The first n of some places that keep their distance."""
    chosen: list[np.ndarray] = []
    for place in places_m:
        if len(chosen) < n and all(np.linalg.norm(place - c) > apart_m for c in chosen):
            chosen.append(place)
    return np.array(chosen).reshape(-1, 2)


def band(z: np.ndarray, slope: np.ndarray, step_hz: float, n: int) -> np.ndarray:
    """(n,) sums of ``z exp(-1j slope f)`` over n frequencies around 0, a step apart."""
    many = -(-n // _SPLIT)
    short = _turning(z, np.exp(-1j * step_hz * slope), _SPLIT)
    long = _turning(np.exp(1j * (n // 2 * step_hz) * slope),
                    np.exp(-1j * (_SPLIT * step_hz) * slope), many)
    return (long @ short.T).ravel()[:n]


def _turning(first: np.ndarray, onwards: np.ndarray, n: int) -> np.ndarray:
    """(n, N) phasors that turn evenly, by products, which err by less than -250 dB."""
    out = np.empty((n, len(first)), complex)
    out[0] = first
    for k in range(1, n):
        np.multiply(out[k - 1], onwards, out=out[k])
    return out


def backprojected(spectrum, frequency, distance_m, middle_m) -> np.ndarray:
    """What one pulse adds to pixels at these distances."""
    n, m = len(spectrum), _OVERSAMPLING * len(spectrum)
    padded = np.zeros(m, complex)
    padded[(np.arange(n) - n // 2) % m] = spectrum
    profile = np.fft.ifft(padded) * m
    step_m = _LIGHT / 2 / (m * (frequency[1] - frequency[0]))
    place = (distance_m - middle_m) / step_m
    index = np.floor(place).astype(int)
    share = place - index
    samples = (1 - share) * profile[index % m] + share * profile[(index + 1) % m]
    return samples * np.exp(4j * np.pi / _LIGHT * _CARRIER_HZ * distance_m)


def measure(seed: int, kind: type[Scene] = Scene) -> dict:
    """One scene: shares of states where the ground is hidden, dark or open, and what is found."""
    scene, found = kind(seed), ObstacleMap()
    out = {'seed': seed, 'wall_db': scene.wall_db, 'noise_db': scene.noise_db, 'seconds': 0.0}
    for i in range(_APERTURES):
        image = scene.image(i).astype(np.complex64)
        started = time.thread_time()
        found.add(ObstacleDetector(scene.grid, scene.view(i))(image), i * 10**9)
        states = found.states()
        out['seconds'] += (time.thread_time() - started) / _APERTURES
        if i in (0, _APERTURES - 1):
            out['first' if i == 0 else 'all'] = score(scene, states)
    return out


def score(scene: Scene, states: np.ndarray) -> dict:
    """Numbers of cells and points by what the map says of them."""
    places = scene.grid.points()[..., :2]
    flat = places.reshape(-1, 2)
    shadow = scene.hidden(flat).reshape(states.shape)
    things = np.concatenate([scene.wall_m, scene.beside_m, scene.elsewhere_m])
    apart = np.min([np.maximum(*np.abs(places - p).T).T for p in things], axis=0)
    near = apart <= 2 * scene.cell_m
    to_wall = np.min([np.linalg.norm(places - p, axis=-1) for p in scene.wall_m], axis=0)
    edge = scene.hidden(flat, grow_m=2 * scene.cell_m).reshape(states.shape)
    around, away = (~near & ~edge & part for part in (to_wall < 4.0, to_wall >= 4.0))
    out = {name: {'cells': int(part.sum()), 'free': int((states[part] == 0).sum()),
                  'unknown': int((states[part] < 0).sum())}
           for name, part in (('shadow', shadow & ~near), ('around', around), ('away', away))}
    out['false'] = int(((states == 100) & ~near).sum())
    occupied = places[states == 100]
    for name, points_m, level in (('beside', scene.beside_m, scene.beside_db),
                                  ('elsewhere', scene.elsewhere_m, scene.elsewhere_db)):
        row, column = (np.rint(v).astype(int) for v in scene.grid.to_pixels(*points_m.T))
        out[name] = {'db': level.round(1).tolist(),
                     'found': hit(points_m, occupied, 2 * scene.cell_m).tolist(),
                     'free': (states[row, column] == 0).tolist()}
    out['wall'] = hit(scene.wall_m, occupied, scene.cell_m).tolist()
    return out


def hit(points_m: np.ndarray, occupied_m: np.ndarray, within_m: float) -> np.ndarray:
    """(N,) bool: places with an occupied cell so near along x and y."""
    return np.array([bool((np.abs(occupied_m - p).max(axis=1) <= within_m).any())
                     for p in points_m], bool)


def summary(scenes: list[dict]) -> dict:
    """Shares over all scenes, for the first image and for all."""
    out = {'scenes': len(scenes),
           'milliseconds': round(1e3 * float(np.median([s['seconds'] for s in scenes])), 1)}
    for when in ('first', 'all'):
        mine = out[when] = {}
        for name in ('shadow', 'around', 'away'):
            n = sum(s[when][name]['cells'] for s in scenes)
            mine[name] = {state: round(sum(s[when][name][state] for s in scenes) / n, 4)
                          for state in ('free', 'unknown')}
        strong = [s for s in scenes if s['wall_db'] == 35.0]
        mine['shadow_unknown_by_wall_db'] = {
            f'{db:g}': round(sum(s[when]['shadow']['unknown'] for s in some)
                             / sum(s[when]['shadow']['cells'] for s in some), 4)
            for db in sorted({s['wall_db'] for s in scenes})
            for some in [[s for s in scenes if s['wall_db'] == db]]}
        for name, some in (('beside_35_db', strong), ('beside', scenes)):
            parts = [s[when]['beside'] for s in some]
            found, free = (sum((p[key] for p in parts), []) for key in ('found', 'free'))
            mine[name] = {'points': len(found), 'found': sum(found), 'missed_and_free': sum(
                a and not b for a, b in zip(free, found, strict=True))}
        levels, found = (np.array(sum((s[when]['elsewhere'][key] for s in scenes), []))
                         for key in ('db', 'found'))
        mine['elsewhere'] = {f'{low} to {high} dB': [int(found[part].sum()), int(part.sum())]
                             for low, high in ((10, 13), (13, 16), (16, 30))
                             for part in [(levels >= low) & (levels < high)]}
        mine['wall_hit'] = {
            f'{db:g}': round(float(np.mean(np.concatenate(
                [s[when]['wall'] for s in scenes if s['wall_db'] == db]))), 3)
            for db in sorted({s['wall_db'] for s in scenes})}
        mine['false_cells'] = round(float(np.mean([s[when]['false'] for s in scenes])), 2)
    return out


def main() -> None:
    """Run the campaign and write `RESULTS`."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--scenes', type=int, default=100)
    parser.add_argument('--first', type=int, default=0, help='seed of the first')
    parser.add_argument('--results', type=pathlib.Path, default=RESULTS)
    arguments = parser.parse_args()
    seeds = range(arguments.first, arguments.first + arguments.scenes)
    results = {'machine': machine(), 'seeds': [seeds[0], seeds[-1]],
               **summary([measure(seed) for seed in tqdm(seeds, mininterval=10)])}
    long = summary([measure(seed, LongWall) for seed in tqdm(seeds[::5], mininterval=10)])
    results['long_walls'] = {'scenes': long['scenes'], **{
        when: {name: long[when][name] for name in ('shadow', 'around', 'away')}
        for when in ('first', 'all')}}
    arguments.results.write_text(json.dumps(results, indent=1) + '\n')
    print(json.dumps(results, indent=1))


if __name__ == '__main__':
    main()
