# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Measure the obstacle map over random scenes of the three shipped platforms.

Every scene is imaged from three apertures. The map after the first image and after all of them is
compared with the truth, and beside it the rule of release 0.1: cells 30 dB above the median
amplitude of the image are occupied. An obstacle is found when an occupied cell lies within two
resolution cells of it along range and azimuth; an occupied cell farther from every obstacle is
false. What stands above clutter by how much is told by the image of noise and clutter alone.

Run from the repository root: ``make obstacle-campaign``.
"""

from __future__ import annotations

import argparse
import json
import math
import pathlib
import time

import numpy as np
from scipy import ndimage
from tqdm import tqdm

from sar_imaging.exploitation.obstacles import ObstacleDetector
from sar_imaging.exploitation.obstacles.obstacle_map import FREE, OCCUPIED, UNKNOWN, ObstacleMap

from .support.machine import machine
from .support.obstacle_scenes import SIZES, ObstacleScene, Platform, random_scene

RESULTS = pathlib.Path(__file__).parent / 'results' / 'obstacles.json'
WITHIN_CELLS = 2.0
WANTED_DB = 10.0  # above clutter
_EDGES_DB = (-math.inf, 7.0, 10.0, 13.0, 16.0, 20.0, math.inf)
_OLD_DB = 30.0  # free_db + range_db of release 0.1
_LOCAL_PIXELS = 15  # of the mean power of noise and clutter around an obstacle


def former_map(image: np.ndarray) -> np.ndarray:
    """Occupied cells (n_y, n_x) bool by the rule of release 0.1, as Nav2 reads them."""
    amplitude = np.abs(image)
    return amplitude >= 10 ** (_OLD_DB / 20) * np.median(amplitude[amplitude > 0])


class Score:
    """Cells of a scene beside the truth, in resolution cells of one view."""

    def __init__(self, platform: Platform, scene: ObstacleScene):
        view, grid = platform.views[len(platform.views) // 2], platform.grid
        rho, s = view.polar(grid.points())
        truth_rho, truth_s = view.polar(scene.obstacles_m)
        self._distance = np.maximum(
            np.abs(rho[..., None] - truth_rho) / view.range_resolution_m,
            np.abs(s[..., None] - truth_s) / view.cosine_resolution)  # (n_y, n_x, N)
        self._view, self._truth = view, (truth_rho, truth_s)
        row, column = grid.to_pixels(scene.obstacles_m[:, 0], scene.obstacles_m[:, 1])
        self._pixels = np.rint(row).astype(int), np.rint(column).astype(int)
        self._platform, self._scene = platform, scene
        self._received, self._behind = [], []

    def add_background(self, aperture: int, background: np.ndarray) -> None:
        """Measure noise and clutter around the obstacles in the image of an aperture."""
        power = ndimage.uniform_filter(np.abs(background) ** 2, _LOCAL_PIXELS)
        self._behind.append(power[self._pixels])
        rho, _ = self._platform.views[aperture].polar(self._scene.obstacles_m)
        self._received.append(10 ** (self._scene.rcs_dbsm / 10)
                              * (self._platform.range_m / rho) ** 4)

    @property
    def above_db(self) -> np.ndarray:
        """(N,) power of the obstacles above noise and clutter, mean of the apertures, dB."""
        return 10 * np.log10(np.mean(self._received, axis=0)
                             / np.maximum(np.mean(self._behind, axis=0), 1e-12))

    def found(self, occupied: np.ndarray) -> np.ndarray:
        """(N,) bool: obstacles with an occupied cell nearby."""
        return (self._distance[occupied] <= WITHIN_CELLS).any(axis=0)

    def false_cells(self, occupied: np.ndarray) -> int:
        """Occupied cells with no obstacle nearby."""
        return int((self._distance[occupied] > WITHIN_CELLS).all(axis=1).sum())

    def errors_cells(self, positions_m: np.ndarray) -> np.ndarray:
        """(N,) distance to the nearest detection in resolution cells, NaN beyond two."""
        rho, s = self._view.polar(positions_m.reshape(-1, 3))
        distance = np.hypot(
            (rho[:, None] - self._truth[0]) / self._view.range_resolution_m,
            (s[:, None] - self._truth[1]) / self._view.cosine_resolution)
        nearest = distance.min(axis=0, initial=math.inf)
        return np.where(nearest <= WITHIN_CELLS, nearest, np.nan)


def measure(platform: Platform, seed: int, *, texture_shape: float | None = None) -> dict:
    """One scene: what was found and what was false, by rule, and how far off.

    Returns
    -------
    dict
        ``above_db`` of every obstacle; for ``former``, ``first`` and ``all`` (images) lists of
        ``found`` and numbers of ``false`` cells; ``error_cells`` of the detections of ``all``;
        shares of free and unknown cells; seconds of detection per image.
    """
    scene = random_scene(platform, seed, texture_shape=texture_shape)
    accumulated, seconds, score = ObstacleMap(), 0.0, Score(platform, scene)
    for i, view in enumerate(platform.views):
        image, background = scene.images(platform, i)
        started = time.perf_counter()
        evidence = ObstacleDetector(platform.grid, view)(image)
        accumulated.add(evidence, round(i * platform.aperture_s * 1e9))
        seconds += time.perf_counter() - started
        score.add_background(i, background)
        if i == 0:
            occupied = {'former': former_map(image), 'first': accumulated.states() == OCCUPIED}
    states = accumulated.states()
    occupied['all'] = states == OCCUPIED
    positions = np.array([o.position_m for o in accumulated.obstacles()], float)
    return {'seed': seed, 'above_db': score.above_db.tolist(),
            'error_cells': score.errors_cells(positions).tolist(),
            'free': float(np.mean(states == FREE)), 'unknown': float(np.mean(states == UNKNOWN)),
            'seconds': seconds / len(platform.views),
            **{rule: {'found': score.found(cells).tolist(), 'false': score.false_cells(cells)}
               for rule, cells in occupied.items()}}


def summary(platform: Platform, scenes: list[dict]) -> dict:
    """Detection probability by strength, false cells and errors over scenes."""
    above = np.concatenate([s['above_db'] for s in scenes])
    error = np.concatenate([s['error_cells'] for s in scenes])
    wanted = above >= WANTED_DB
    middle = platform.views[len(platform.views) // 2]
    cells = middle.resolution_m(platform.grid.centre_m)
    out = {'scenes': len(scenes), 'obstacles': len(above),
           'obstacles_above_10_db': int(wanted.sum()), 'resolution_m': np.round(cells, 4).tolist(),
           'pixels': platform.grid.n_x * platform.grid.n_y,
           'error_cells_median': round(float(np.nanmedian(error[wanted])), 3),
           'error_cells_95_percent': round(float(np.nanpercentile(error[wanted], 95)), 3),
           'free': round(float(np.mean([s['free'] for s in scenes])), 3),
           'unknown': round(float(np.mean([s['unknown'] for s in scenes])), 3),
           'seconds': round(float(np.median([s['seconds'] for s in scenes])), 3)}
    for rule in ('former', 'first', 'all'):
        found = np.concatenate([s[rule]['found'] for s in scenes]).astype(bool)
        false = [s[rule]['false'] for s in scenes]
        out[rule] = {
            'detection_probability': round(float(found[wanted].mean()), 4),
            'by_strength': {
                f'{low:g} to {high:g} dB': [int(found[part].sum()), int(part.sum())]
                for low, high in zip(_EDGES_DB, _EDGES_DB[1:], strict=False)
                for part in [(above >= low) & (above < high)]},
            'false_cells_mean': round(float(np.mean(false)), 3), 'false_cells_max': max(false),
            'scenes_with_false_cells': int(np.count_nonzero(false))}
    return out


def main() -> None:
    """Run the campaign and write `RESULTS`."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--scenes', type=int, default=100, help='scenes of each platform')
    parser.add_argument('--first', type=int, default=2000, help='seed of the first')
    parser.add_argument('--platforms', nargs='+', default=sorted(SIZES), choices=sorted(SIZES))
    parser.add_argument('--texture', type=float, help='shape of the clutter of all scenes')
    parser.add_argument('--results', type=pathlib.Path, default=RESULTS)
    arguments = parser.parse_args()
    started, results = time.time(), {'machine': machine(), 'platforms': {}}
    for name in arguments.platforms:
        platform = Platform(name)
        seeds = range(arguments.first, arguments.first + arguments.scenes)
        scenes = [measure(platform, seed, texture_shape=arguments.texture)
                  for seed in tqdm(seeds, desc=name, mininterval=10)]
        results['platforms'][name] = summary(platform, scenes)
        results['platforms'][name]['seeds'] = [seeds[0], seeds[-1]]
        worst = sorted(scenes, key=lambda s: -s['all']['false'])[:5]
        results['platforms'][name]['worst'] = [[s['seed'], s['all']['false']] for s in worst]
    results['minutes'] = round((time.time() - started) / 60, 1)
    arguments.results.write_text(json.dumps(results, indent=1) + '\n')
    print(json.dumps(results, indent=1))


if __name__ == '__main__':
    main()
