# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Search for the offset of two clocks over seconds, by the sharpness of many quick images.

An offset of a clock is one number, so every value that matters can be tried. How fine the trials
must be follows from the geometry: from one to the next the phases of the scene change by about a
radian, apart from what only displaces the image. A trial is an image of few pixels, exact enough
to tell focus. At the right offset alone all parts of the scene and of the aperture become sharp
together; `offset_curve` says how that is told.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike

from ..backends import AUTO, optional_entry
from ..geometry.grids import MapGrid
from ..geometry.track import mean_centres
from ..quality.measures import contrast
from ..signal.pulses import PulseBlock
from .models import Geometry
from .offset_curve import PEAK_RAD, OffsetCurve, Trials

if TYPE_CHECKING:
    from ..backends.protocol import Backend

STEP_RAD = 1.2  # rms change of the visible phases from trial to trial
# So much the trials exceed the reach by, for surroundings to compare with and to judge by.
BEYOND_S, _BEYOND_RAD = 2.0, 24.0
_SAMPLES_PER_S, _FEWEST_SAMPLES = 25, 121  # of the range of offsets, to determine the step
_DIFFERENCE_S = 1e-3
_POINTS = 3  # of the scene along each axis, for the visible phases
_PIXEL = 0.7  # pixels of a trial, in resolutions
_LINES, _TILES = 12, 24  # lines of a tile at most, with fewer where that makes too few tiles
_MOST_TILES, _FEWEST_TILES = 100, 48  # of a trial; larger scenes are tried where they are bright
_TILE_TRIALS = 30_000  # above so many, fewer tiles are tried
# Every second, third ... pulse is tried alone, while from one to the next the scene's edge turns
# against its middle by less than this, and as many are left; what is faster folds at pi.
_PULSE_RAD, _FEWEST_PULSES, _LARGEST_STRIDE = 2.0, 128, 4
_FEWEST_TRIALS, _MOST_TRIALS = 16, 4000
_BLOCKS = 6  # of the scene along each axis, dealt out to its two halves
_SUBAPERTURES = 8  # dealt out to the halves of the aperture
_PARTS = ((0, 2), (1, 3), (4, 6), (5, 7))  # of them: early and late, each even and odd
_GLANCES = 5  # trials that choose the bright tiles
COVERED = 0.5  # of its pulses that a pixel needs
_COVERAGE_PULSES = 32
_REFINED, _FINER = 6, 4  # maxima around which so many more trials are made on each side
_WITHIN = 10  # trials on each side within the highest maximum


class OffsetSearch:
    """Trial images of one aperture for offsets of the clocks.

    Parameters
    ----------
    block : PulseBlock
        Range profiles.
    geometry : callable
        From an offset in seconds to the `Geometry` of the block; ValueError where it is not known.
    grid : MapGrid
        Grid of the image.
    reach_s : float
        Largest offset to try to both sides, seconds. Where the geometry is known, some more are
        tried, so that an offset at the end has surroundings like any other.
    backend : str or Backend
        What computes the trial images, as for `plan_image`.
    progress : callable, optional
        Called with the number of trials made and with their total, as they are made.

    Raises
    ------
    ValueError
        The geometry is not known without an offset.
    """

    def __init__(self, block: PulseBlock, geometry: Callable[[float], Geometry], grid: MapGrid,
                 reach_s: float, backend: str | Backend = AUTO,
                 progress: Callable[[int, int], None] | None = None) -> None:
        self._geometry, self._reach_s, self._progress = geometry, reach_s, progress
        self._radar, self._block = block.radar, block
        furthest_s = reach_s + BEYOND_S
        self._known = self._sample(np.linspace(-furthest_s, furthest_s, max(
            _FEWEST_SAMPLES, 2 * round(_SAMPLES_PER_S * furthest_s) + 1)))
        if not self._known:
            raise ValueError('no position is known for these pulses')
        x, y = (c + 0.35 * np.linspace(-1, 1, _POINTS) * n * grid.spacing_m for c, n in zip(
            grid.centre_m, (grid.n_x, grid.n_y), strict=False))
        self._points = np.stack(np.broadcast_arrays(x[:, None], y, grid.centre_m[2]),
                                axis=-1).reshape(-1, 3)
        pulses = np.arange(0, block.n_pulses, self._stride())
        number = np.arange(len(pulses)) * _SUBAPERTURES // len(pulses)
        self._parts = [pulses[np.isin(number, part)] for part in _PARTS]
        trials = optional_entry(backend, 'TrialImages')
        self._trials = [trials(block.radar, block.samples[part]) for part in self._parts]
        self._plan_tiles(grid)

    def _stride(self) -> int:
        """Every which pulse suffices, for nine in ten of them at most of the offsets."""
        turns = []
        for geometry in list(self._known.values())[::max(1, len(self._known) // _GLANCES)]:
            path = np.linalg.norm(self._points[:, None] - mean_centres(
                geometry.tx_m, geometry.rx_m), axis=-1)
            turns.append(np.quantile(np.abs(np.diff(path - path[len(path) // 2])), 0.9))
        rad = self._radar.wavenumber_rad_per_m * float(np.median(turns))
        return max(1, min(_LARGEST_STRIDE, self._block.n_pulses // _FEWEST_PULSES,
                          int(_PULSE_RAD / max(rad, 1e-9))))

    def _sample(self, offsets: np.ndarray) -> dict[float, Geometry]:
        known = {}
        for offset in offsets.tolist():
            try:
                known[offset] = self._geometry(offset)
            except ValueError:
                continue
        return known

    def _plan_tiles(self, grid: MapGrid) -> None:
        """Tiles of pieces of lines along range, and the half of the scene that each belongs to."""
        centre = np.array(grid.centre_m)
        known = [g for offset, g in self._known.items() if abs(offset) <= self._reach_s]
        looks = [centre - mean_centres(g.tx_m, g.rx_m) for g in known or self._known.values()]
        nominal = looks[len(looks) // 2].mean(axis=0)
        ground = np.hypot(*nominal[:2])
        along = np.array([*nominal[:2], 0.0]) / max(ground, 1e-9)
        across = np.array([-along[1], along[0], 0.0])
        spread = max(np.ptp(np.arctan2(look @ across, look @ along)) for look in looks)
        length = self._trials[0].length
        u_step = _PIXEL * self._radar.range_resolution_m * np.linalg.norm(nominal) / ground
        v_step = _PIXEL * self._radar.wavelength_m / 2 / max(spread, 1e-3)
        half = 0.5 * grid.spacing_m * np.array([grid.n_x, grid.n_y])
        u_half, v_half = (np.abs(axis[:2]) @ half for axis in (along, across))
        n_u, n_v = max(1, round(2 * u_half / u_step / length)), max(1, round(2 * v_half / v_step))
        lines = max(1, min(_LINES, n_u * n_v // _TILES))
        column, line = (k.ravel() for k in np.indices((n_u, n_v)))
        row = line // lines
        middle = ((column - (n_u - 1) / 2)[:, None] * length * u_step * along
                  + (line - (n_v - 1) / 2)[:, None] * v_step * across)
        inside = (np.abs(middle[:, :2]) <= half + 0.5 * length * u_step * np.abs(along[:2])
                  ).all(axis=1)
        n_rows = int(row.max()) + 1
        part = ((column * min(_BLOCKS, n_u) // n_u + row * min(_BLOCKS, n_rows) // n_rows) % 2)
        self._direction = u_step * along
        self._starts = centre + middle[inside] - 0.5 * length * self._direction
        _, first, self._tile = np.unique((column * n_rows + row)[inside], return_index=True,
                                         return_inverse=True)
        self._half = part[inside][first]

    def _keep_bright(self, n: int) -> None:
        """Leave out all but the brightest tiles, as some offsets show them."""
        n_tiles = len(self._half)
        if n_tiles <= n:
            return
        offsets = np.array(list(self._known))
        within = np.abs(offsets) <= max(self._reach_s, np.abs(offsets).min())
        power = np.zeros(n_tiles)
        for k in np.linspace(0, within.sum() - 1, _GLANCES).astype(int):
            power = np.maximum(power, self._means(self._images(
                self._known[offsets[within][k]]))[0])
        kept = np.zeros(n_tiles, bool)
        kept[np.argsort(-power)[:n]] = True
        there = kept[self._tile]
        self._starts, self._half = self._starts[there], self._half[kept]
        self._tile = np.unique(self._tile[there], return_inverse=True)[1]

    def _images(self, geometry: Geometry) -> list[np.ndarray]:
        """(K, L) complex pieces of each part of the pulses."""
        images = [trials.image(geometry.tx_m[part], geometry.rx_m[part], self._starts,
                               self._direction, geometry.range_bias_m)
                  for trials, part in zip(self._trials, self._parts, strict=True)]
        return [image[0] + 1j * image[1] for image in images]

    def _covered(self, geometry: Geometry) -> list[np.ndarray]:
        """(T,) shares of the pulses of each part whose profiles reach each tile."""
        middle = self._starts + 0.5 * self._trials[0].length * self._direction
        count = np.bincount(self._tile)
        place = np.stack([np.bincount(self._tile, x) / count for x in middle.T], axis=-1)
        return [coverage(self._block, geometry, place, part) for part in self._parts]

    def _measure(self, offset: float) -> np.ndarray:
        """(2, 5, T) means of tiles, see `Trials`: all pulses, early, late, even and odd ones."""
        geometry = self._geometry(offset)
        images, covered = self._images(geometry), self._covered(geometry)
        out = []
        for which in ((0, 1, 2, 3), (0, 1), (2, 3), (0, 2), (1, 3)):
            means = self._means([images[k] for k in which])
            means[:, np.mean([covered[k] for k in which], axis=0) < COVERED] = np.nan
            out.append(means)
        return np.stack(out, axis=1)

    def _try(self, offsets: Sequence[float] | np.ndarray, n_before: int = 0) -> np.ndarray:
        """(N, 2, 5, T) means of tiles at some offsets."""
        out = []
        for offset in offsets:
            out.append(self._measure(offset))
            if self._progress is not None:
                self._progress(n_before + len(out), n_before + len(offsets))
        return np.array(out)

    def _means(self, images: list[np.ndarray]) -> np.ndarray:
        """(2, T) means of intensity and squared intensity of the tiles."""
        intensity = np.square(np.abs(sum(images)), dtype=np.float64)
        return np.array([np.bincount(self._tile, power.mean(axis=1)) for power in (
            intensity, np.square(intensity))]) / np.bincount(self._tile)

    def _rates(self) -> tuple[np.ndarray, np.ndarray]:
        """Offsets whose geometry is known, and rms change of the visible phases, rad/s."""
        offsets, rates = [], []
        for offset, geometry in self._known.items():
            nearby = self._sample(np.array([offset + _DIFFERENCE_S, offset - _DIFFERENCE_S]))
            if nearby:
                [other, *_] = nearby
                offsets.append(offset)
                rates.append(visible_phase(geometry, nearby[other], self._points,
                                           self._radar.wavenumber_rad_per_m)
                             / abs(other - offset))
        return np.array(offsets), np.array(rates)

    def run(self) -> OffsetCurve:
        """Try all offsets, then those around the highest maxima more finely."""
        offsets, rates = self._rates()
        path = np.concatenate([[0.0], np.cumsum(0.5 * (rates[1:] + rates[:-1])
                                                * np.diff(offsets))])
        ends = np.interp([-self._reach_s, self._reach_s], offsets, path)
        there = ((path >= ends[0] - _BEYOND_RAD) & (path <= ends[1] + _BEYOND_RAD))
        offsets, rates, path = offsets[there], rates[there], path[there] - path[there][0]
        seen = float(path[-1])
        n = int(np.clip(math.ceil(seen / STEP_RAD), _FEWEST_TRIALS, _MOST_TRIALS))
        self._keep_bright(int(np.clip(_TILE_TRIALS // n, _FEWEST_TILES, _MOST_TILES)))
        # where nothing is seen, too, so that the sum ascends
        path += np.linspace(0.0, 1e-3 + 0.02 * seen, len(path))
        coarse = np.interp(np.linspace(0.0, path[-1], n + 1), path, offsets)
        trials = Trials(coarse, np.interp(coarse, offsets, path), self._try(coarse), self._half)
        finer = np.unique(np.concatenate([np.interp(
            k + np.linspace(-1.0, 1.0, 2 * _FINER + 1), np.arange(n + 1), coarse)
            for k in trials.maxima()[:_REFINED]]))
        finer = np.setdiff1d(finer, coarse)
        curve = trials.curve(
            finer, np.interp(finer, offsets, path), self._try(finer, len(coarse)),
            step=lambda best: STEP_RAD / max(float(np.interp(best, offsets, rates)), 1e-9),
            visible_range_rad=seen)
        return dataclasses.replace(curve, best_s=self._sharpest(curve))

    def _sharpest(self, curve: OffsetCurve) -> float:
        """Offset of the highest contrast within the maximum, seconds; ends stay ends."""
        if curve.best_s in curve.offset_s[[0, -1]]:
            return curve.best_s
        reach_s = PEAK_RAD / STEP_RAD * curve.step_s
        offsets = np.clip(curve.best_s + reach_s * np.linspace(-1.0, 1.0, 2 * _WITHIN + 1),
                          *curve.offset_s[[0, -1]])
        there = np.min([self._covered(self._geometry(t)) for t in offsets], axis=(0, 1)) >= COVERED
        if not there.any():
            return curve.best_s

        def contrast_at(offset_s: float) -> float:
            image: Any = sum(self._images(self._geometry(offset_s)))
            return contrast(image[there[self._tile]])

        return float(max(offsets, key=contrast_at))


def coverage(block: PulseBlock, geometry: Geometry, points_m: ArrayLike,
             pulses: slice | np.ndarray = slice(None)) -> np.ndarray:
    """Share of pulses whose profiles reach some points.

    Parameters
    ----------
    block : PulseBlock
        Range profiles.
    geometry : Geometry
        Their phase centres.
    points_m : (K, 3) array_like
        Points, metres.
    pulses : index
        Which pulses to look at; some of them, evenly.

    Returns
    -------
    (K,) float64
        0 to 1.
    """
    centres = [c[pulses].mean(axis=1) for c in geometry[:2]]
    every = slice(None, None, -(-len(centres[0]) // _COVERAGE_PULSES))
    path = geometry.range_bias_m + sum(
        0.5 * np.linalg.norm(np.asarray(points_m)[:, None] - c[every], axis=-1) for c in centres)
    first, spacing = block.radar.range_start_m, block.radar.sample_spacing_m
    return np.mean((path >= first) & (path <= first + (block.n_samples - 1) * spacing), axis=1)


def visible_phase(first: Geometry, second: Geometry, points: ArrayLike, wavenumber: float
                  ) -> float:
    """Rms difference of the phases of two geometries that an image shows, radians.

    What a displacement of each point in the plane or a constant phase explains is left out.

    Parameters
    ----------
    first, second : Geometry
        Of the same pulses, nearly alike.
    points : (K, 3) array_like
        Points of the scene, metres.
    wavenumber : float
        ``4 pi / lambda``, rad/m.
    """
    every = slice(None, None, max(1, len(first.tx_m) // 128))
    total = 0.0
    points = np.asarray(points)
    for point in points:
        paths, looks = [], np.zeros(3)
        for geometry in (first, second):
            away = [point - c[every].mean(axis=1) for c in geometry[:2]]
            length = [np.linalg.norm(a, axis=1) for a in away]
            paths.append(0.5 * sum(length))
            looks = looks + 0.5 * sum(a / d[:, None] for a, d in zip(away, length, strict=True))
        basis, _ = np.linalg.qr(np.column_stack([np.ones(len(looks)), looks[:, :2]]))
        change = wavenumber * (paths[1] - paths[0])
        total += np.mean(np.square(change - basis @ (basis.T @ change)))
    return math.sqrt(total / len(points))
