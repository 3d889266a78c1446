# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Coherence of an aperture: how well its pulses add up in phase, whatever the scene.

An image that is not focused still has bright and dark ranges, so its own contrast says little.
Here each pixel's sum over the aperture is compared with the sums of G groups of pulses at the same
pixel, ``q = |sum_g f_g|^2 / sum_g |f_g|^2``: G where all groups agree, 1 on average where they do
not. For groups of independent phase, noise as well as echoes out of focus, ``q / G`` has the
distribution Beta(1, G - 1) (Goodman, Statistical Optics: a random direction in G complex
dimensions), whose standard deviation over its mean is ``sqrt((G - 1) / (G + 1))``, just below 1.
The focus figure is that ratio, each pixel weighted with its squared power: 1 in noise and out of
focus, 2 to 6 in images with scatterers that are focused.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import ArrayLike

from ..compilation import kernel_part, njit, numba
from ..geometry.grids import MapGrid
from ..signal.pulses import PulseBlock
from ..signal.radar import RadarParameters
from ..signal.range_compression import RangeCompressor

OVERSAMPLING = 4.0  # of the profiles: linear interpolation is then good to -30 dB
_GROUPS = 64
# Of an aperture, however many channels: where channels agree over the whole map, as those above
# each other do, n parts reach a contrast of (n - 1) / (2 sqrt(n)) at the most.
_FEWEST_PARTS = 32
_MOST_ROWS = 1024
_STEPS = 4096  # of a cycle; good to -60 dB
_POINTS = 64  # computed side by side
_1, _2, _3, _4, _5, _PARTS = (np.uint64(i) for i in range(1, 7))  # of what is taken for a point
_OUTSIDE = -1  # of a profile: instead of a cell
_CYCLE = np.exp(2j * np.pi * np.arange(_STEPS) / _STEPS).astype(np.complex64)
_TILE = 4  # pixels along each side: power of few pulses is wide across range, and narrow along it
_FEWEST_POINTS = 256
_MOST_PIXELS = 1500  # along a side of a finer grid
_FEWEST_ROWS = 12  # that tell where power is
_WAYPOINTS = 256  # of a track: noise of more would count as way
BUDGET = 6_000_000  # points times rows of one figure
NOISE = 2.0  # agreement of noise
FOCUSED = 3.0  # contrast from which on nothing is tried live
_SQUARES = 0.13  # of the grid's longer side: squares of the halves of a map


@dataclasses.dataclass(frozen=True)
class Coherence:
    """How well groups of pulses agree over an image.

    Parameters
    ----------
    contrast : float
        Standard deviation of q over its mean: about 1 where nothing is focused.
    mean : float
        Mean of q: above 1 where neighbouring groups agree over wide parts of the scene, as the
        channels of a short array do, or pulses from one place.
    coverage : float
        Share of the pixels and pulses whose profile reaches them, 0 to 1.
    """

    contrast: float
    mean: float
    coverage: float

    @property
    def figure(self) -> float:
        """Contrast; 1 at most where groups agree no more than those of noise, unless it is sharp.

        Of the full array of a raster all but the scatterers themselves cancels.
        """
        plain = self.agreement > NOISE or self.contrast >= FOCUSED
        return self.contrast if plain else min(self.contrast, 1.0)

    @property
    def agreement(self) -> float:
        """Mean square of q: how many groups agree where they do, 2 in noise."""
        return self.mean**2 * (1 + self.contrast**2)

    @property
    def spread(self) -> float:
        """Variance of q: what stands out, 1 in noise, whatever agrees over wide parts."""
        return (self.mean * self.contrast)**2


def gain_of(changed: Coherence, as_it_is: Coherence) -> float:
    """How much more stands out after a change than before, and than in noise at the least."""
    return changed.spread / max(as_it_is.spread, 1.0)


def profiles_of(block: PulseBlock, window: str) -> PulseBlock:
    """Range profiles of raw or compressed pulses, sampled as a `CoherenceProbe` needs them.

    Parameters
    ----------
    block : PulseBlock
        Profiles keep the window that they have.
    window : str
        Window of the range compression of raw pulses.

    Returns
    -------
    PulseBlock

    Raises
    ------
    ValueError
        The samples cannot be compressed.
    """
    return RangeCompressor.for_block(block, window='none' if block.compressed else window,
                                     oversampling=OVERSAMPLING)(block)


class CoherenceProbe:
    """The pixels of a grid at which apertures are compared.

    Parameters
    ----------
    grid : MapGrid
        Grid of the image.
    budget : int
        Most points times rows of one figure; of larger images the brightest tiles are taken.
    """

    def __init__(self, grid: MapGrid, budget: int = BUDGET):
        self.grid = grid
        self._budget = budget
        self._places: np.ndarray | None = None

    def __call__(self, profiles: PulseBlock) -> Coherence:
        """Coherence of range profiles that are sampled `OVERSAMPLING` times their bandwidth.

        Parameters
        ----------
        profiles : PulseBlock
            Range profiles with phase centres.

        Returns
        -------
        Coherence
            Contrast 0 where the profiles do not reach the grid.
        """
        rows = _Rows.of(profiles, self.grid.centre_m)
        return _judge(*rows.sums(self._points(rows)))

    def halves(self, profiles: PulseBlock) -> list[Coherence]:
        """Coherence of two halves of the map, squares that take turns like those of a chessboard.

        Parameters
        ----------
        profiles : PulseBlock
            As those of a whole.

        Returns
        -------
        list of Coherence
            Contrast 0 where a half holds too few pixels.
        """
        rows = _Rows.of(profiles, self.grid.centre_m)
        points = self._points(rows)
        side_m = _SQUARES * self.grid.spacing_m * max(self.grid.n_x, self.grid.n_y)
        square = np.floor((points[:, :2] - self.grid.centre_m[:2]) / side_m).astype(int)
        dark = square.sum(axis=1) % 2 == 1
        sums = rows.sums(points)
        return [_judge(*(values[half] for values in sums)) for half in (dark, ~dark)]

    def sums(self, profiles: PulseBlock) -> np.ndarray:
        """(K,) complex64 sums of all pulses and channels at the pixels."""
        rows = _Rows.of(profiles, self.grid.centre_m)
        return rows.sums(self._points(rows))[0]

    @property
    def points(self) -> np.ndarray:
        """(K, 3) pixels of a probe that `fixed` made, metres."""
        assert self._places is not None  # of another probe they depend on the profiles
        return self._places

    def fixed(self, profiles: PulseBlock) -> CoherenceProbe:
        """A probe of the pixels that this one chooses for some profiles, whatever is asked."""
        probe = CoherenceProbe(self.grid, self._budget)
        probe._places = self._points(_Rows.of(profiles, self.grid.centre_m))
        return probe

    def _points(self, rows: _Rows) -> np.ndarray:
        """(K, 3) positions within the budget: all, or those of the tiles with most power."""
        if self._places is not None:
            return self._places
        grid, n_rows = self.grid, len(rows.tx_m)
        n_points = max(_FEWEST_POINTS, self._budget // max(n_rows, 1))
        if grid.n_x * grid.n_y <= n_points:
            return grid.points().reshape(-1, 3)
        # Sums of a few pulses are wide: a few of their pixels tell where power is.
        columns, n_tiles = -(-grid.n_x // _TILE), -(-grid.n_x // _TILE) * -(-grid.n_y // _TILE)
        step = max(1, math.ceil(n_rows / 128), math.ceil(n_rows * n_tiles / self._budget / 2))
        step = min(step, max(1, n_rows // _FEWEST_ROWS))
        few = rows.thinned(step)
        stride = max(2, math.ceil(math.sqrt(grid.n_x * grid.n_y * len(few.tx_m) / self._budget)))
        stride = min(stride, _TILE)
        y, x = (np.arange(stride // 2, n, stride) for n in grid.shape)
        coarse = np.stack(np.broadcast_arrays(grid.x_m[x], grid.y_m[y][:, None], grid.z_m), -1)
        _, power, _ = few.sums(coarse.reshape(-1, 3))
        tile = (y[:, None] // _TILE * columns + x // _TILE).ravel()
        mean = (np.bincount(tile, np.square(power, dtype=float), n_tiles)
                / np.maximum(np.bincount(tile, minlength=n_tiles), 1))
        return self._of_tiles(np.argsort(-mean)[:max(1, n_points // _TILE**2)], columns)

    def _of_tiles(self, tiles: np.ndarray, columns: int) -> np.ndarray:
        grid = self.grid
        side = np.arange(_TILE)
        y = (tiles // columns * _TILE)[:, None, None] + side[:, None]
        x = (tiles % columns * _TILE)[:, None, None] + side
        y, x = np.broadcast_arrays(y, x)
        inside = (y < grid.n_y) & (x < grid.n_x)
        x_m, y_m = grid.x_m[x[inside]], grid.y_m[y[inside]]
        return np.stack([x_m, y_m, np.full(len(x_m), grid.z_m)], axis=-1)


class GroupSums:
    """Sums of each group of pulses at few points.

    Parameters
    ----------
    profiles : PulseBlock
        Range profiles with phase centres; samples of other profiles of the same pulses may be
        summed, too.
    """

    def __init__(self, profiles: PulseBlock):
        self._profiles = profiles

    def __call__(self, points: np.ndarray, samples: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Sums of the groups at points (K, 3) of samples (P, C, N).

        Returns
        -------
        (K, G) complex128
            Sums over the pulses of each group.
        (K, G) float64
            Mean half path to the pulses of each group, metres.
        """
        rows = _Rows.of(dataclasses.replace(self._profiles, samples=samples), points.mean(axis=0))
        values, half_path = rows.values(points)
        starts = np.flatnonzero(np.r_[True, np.diff(rows.group) != 0])
        sizes = np.diff(np.r_[starts, len(rows.group)])
        return (np.add.reduceat(values, starts, axis=1),
                np.add.reduceat(half_path, starts, axis=1) / sizes)


@dataclasses.dataclass(frozen=True)
class _Rows:
    """Profiles with one row per pulse and channel, rows of a group next to each other."""

    radar: RadarParameters
    samples: np.ndarray
    tx_m: np.ndarray
    rx_m: np.ndarray
    group: np.ndarray

    @classmethod
    def of(cls, block: PulseBlock, towards_m: ArrayLike) -> _Rows:
        """Rows of a block; groups see a place (3,) from directions next to each other."""
        channels = np.unique(np.linspace(0, block.n_channels - 1,
                                         min(block.n_channels, _GROUPS // 4)).astype(int))
        most = max(_GROUPS, _MOST_ROWS // len(channels))
        pulses, (tx_m, rx_m) = _along_the_way(block, most), block.centres_m
        if len(channels) == 1:  # of many, errors show only between groups of their own
            sight = _directions(tx_m[pulses], rx_m[pulses], towards_m)
            pulses = pulses[np.argsort(sight, kind='stable')]
        parts = min(len(pulses), max(_FEWEST_PARTS, _GROUPS // len(channels)))
        # One group is a channel's pulses in a part of the aperture.
        part = np.arange(len(pulses)) * parts // len(pulses)
        group = (np.arange(len(channels))[:, None] * parts + part).ravel()

        def rows(a: np.ndarray) -> np.ndarray:
            return a[pulses, channels[:, None]].reshape(len(group), *a.shape[2:])

        return cls(block.radar, rows(block.samples), rows(tx_m), rows(rx_m), group)

    def thinned(self, step: int) -> _Rows:
        return _Rows(self.radar, *(np.ascontiguousarray(a[::step]) for a in (
            self.samples, self.tx_m, self.rx_m, self.group)))

    def values(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Terms of the sums at points (K, 3), (K, R) complex128, and half paths, metres."""
        radar = self.radar
        half_path = sum(np.linalg.norm(points[:, None] - centres, axis=-1)
                        for centres in (self.tx_m, self.rx_m)) / 2
        place = (half_path - radar.range_start_m) / radar.sample_spacing_m
        inside = (place >= 0) & (place < self.samples.shape[1] - 1)
        cell = np.where(inside, place, 0).astype(int)
        t = np.where(inside, place - cell, 0)
        row = np.arange(len(self.group))
        values = (1 - t) * self.samples[row, cell] + t * self.samples[row, cell + 1]
        return values * inside * np.exp(4j * np.pi / radar.wavelength_m * half_path), half_path

    def sums(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Coherent sum, power of the groups and share of rows at each point."""
        sums = np.zeros((5, len(points)), np.float32)
        covered = np.zeros(len(points), np.int32)
        radar = self.radar
        _sum_groups(np.ascontiguousarray(np.transpose(points)), self.tx_m, self.rx_m,
                    np.array_equal(self.tx_m, self.rx_m), self.group, self.samples,
                    (radar.range_start_m, 1 / radar.sample_spacing_m, 2 / radar.wavelength_m),
                    _CYCLE, sums, covered)
        return sums[0] + 1j * sums[1], sums[2], covered / max(len(self.tx_m), 1)


def _along_the_way(block: PulseBlock, most: int) -> np.ndarray:
    """Numbers of at most so many pulses, evenly spaced along the way of the platform.

    Those of a platform that stands or hovers agree over the whole scene and tell nothing of it.
    """
    n = block.n_pulses
    centres = block.phase_centre_m[::-(-n // _WAYPOINTS)]
    way = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(centres, axis=0), axis=1))]
    if way[-1] <= 0.0:
        return np.arange(0, n, -(-n // most))
    way = np.interp(np.arange(n), np.linspace(0, n - 1, len(way)), way / way[-1])
    return np.unique(np.searchsorted(way, np.linspace(0, 1, min(n, most)))).clip(0, n - 1)


def _directions(tx_m: np.ndarray, rx_m: np.ndarray, towards_m: ArrayLike) -> np.ndarray:
    """(P,) directions along the map from which pulses see a place, on the axis they differ most.

    The rows of a raster see a map from above and below alike, and agree over all of it.
    """
    sight = sum((c - towards_m) / np.maximum(np.linalg.norm(c - towards_m, axis=-1)[..., None],
                                             1e-9) for c in (tx_m, rx_m))
    level = sight[:, 0, :2] - sight[:, 0, :2].mean(axis=0)
    return level @ np.linalg.eigh(level.T @ level)[1][:, -1]


def _judge(total: np.ndarray, power: np.ndarray, covered: np.ndarray) -> Coherence:
    coverage = float(covered.mean()) if len(covered) else 0.0
    known = (covered > 0.5) & (power > 0)
    if np.count_nonzero(known) < 16:
        return Coherence(0.0, 0.0, coverage)
    weight = power[known].astype(np.float64)
    intensity = np.square(np.abs(total[known]), dtype=np.float64)
    q = intensity / weight
    weight = np.square(weight)  # what is bright decides
    weight /= weight.sum()
    mean = float(weight @ q)
    spread = float(weight @ np.square(q - mean))
    return Coherence(math.sqrt(spread) / max(mean, 1e-12), mean, coverage)


def resolved(grid: MapGrid, block: PulseBlock) -> MapGrid:
    """Grid of the same area, at least two pixels to a cell of resolution.

    Parameters
    ----------
    grid : MapGrid
        Whose pixels may lie farther apart than what they are to show.
    block : PulseBlock
        Pulses with phase centres.

    Returns
    -------
    MapGrid
        Of `_MOST_PIXELS` pixels at the most along each side.
    """
    sight = np.asarray(grid.centre_m) - block.phase_centre_m
    sight /= np.maximum(np.linalg.norm(sight, axis=1, keepdims=True), 1e-9)
    angle = float(np.linalg.norm(np.ptp(sight, axis=0)))
    cell = min(block.radar.range_resolution_m, block.radar.wavelength_m / max(2 * angle, 1e-9))
    size_x, size_y = ((n - 1) * grid.spacing_m for n in (grid.n_x, grid.n_y))
    spacing = max(cell / 2, max(size_x, size_y) / _MOST_PIXELS)
    if spacing >= grid.spacing_m:
        return grid
    return MapGrid.from_size(grid.centre_m, size_x, size_y, spacing)


@njit(parallel=True)
def _sum_groups(points, tx, rx, monostatic, group, profiles, sampling, cycle, sums, covered):
    """Backproject onto points; linear interpolation between samples.

    Parameters
    ----------
    points : (3, K) float64
        Positions, metres.
    tx, rx : (R, 3) float64
        Phase centres of the rows, metres.
    monostatic : bool
        Both are the same.
    group : (R,) int64
        Group of each row, ascending.
    profiles : (R, N) complex64
        Oversampled at least four times.
    sampling : (float, float, float)
        Half path of the first sample, metres; samples, and cycles of the carrier, per metre of
        half path.
    cycle : (T,) complex64
        Phasors of a cycle in T steps.
    sums : (5, K) float32
        Receive the sum over all rows, real and imaginary part, the sum of the squared magnitudes
        of the groups' sums, and the sum of the last group, all added to what they hold.
    covered : (K,) int32
        Receives the number of rows whose profile reaches the point, added likewise.
    """
    n = len(covered)
    for block in numba.prange((n + _POINTS - 1) // _POINTS):
        first = np.uint64(block * _POINTS)
        count = np.uint64(min(_POINTS, n - block * _POINTS))
        work = (np.empty(_POINTS), np.empty(_POINTS, np.int32), np.empty(_POINTS, np.int32),
                np.empty(3 * _POINTS, np.complex64))
        _add_rows(first, count, points, tx, rx, monostatic, group, profiles.reshape(-1),
                  sampling, cycle, work, sums[:3], sums[3], sums[4], covered)


@kernel_part(distinct=True, error_model='numpy')
def _add_rows(first, count, points, tx, rx, monostatic, group, profiles, sampling, cycle, work,
              sums, re, im, covered):
    """Add all rows to some points, which are computed side by side."""
    start_m, per_sample, per_metre = sampling
    half_path, cell, step, taken = work
    x, y, z, parts = points[0], points[1], points[2], taken.view(np.float32)
    n_samples = len(profiles) // len(group)
    n_steps, last = len(cycle), n_samples - 1.0
    for row in range(len(group)):
        if row and group[row] != group[row - 1]:
            _end_group(first, count, sums, re, im)
        for j in range(count):
            k = first + j
            half_path[j] = np.sqrt((x[k] - tx[row, 0]) ** 2 + (y[k] - tx[row, 1]) ** 2
                                   + (z[k] - tx[row, 2]) ** 2)
        if not monostatic:
            for j in range(count):
                k = first + j
                half_path[j] = 0.5 * (half_path[j] + np.sqrt(
                    (x[k] - rx[row, 0]) ** 2 + (y[k] - rx[row, 1]) ** 2
                    + (z[k] - rx[row, 2]) ** 2))
        for j in range(count):
            place, cycles = (half_path[j] - start_m) * per_sample, half_path[j] * per_metre
            inside = (place >= 0.0) & (place < last)
            cell[j] = np.int32(place if inside else _OUTSIDE)
            step[j] = np.int32((cycles - np.floor(cycles)) * n_steps)
        _take(count, cell, step, profiles, np.uint64(row * n_samples), cycle, taken)
        for j in range(count):
            k, at, inside = first + j, _PARTS * j, cell[j] >= 0
            t, weight = (np.float32((half_path[j] - start_m) * per_sample - cell[j]),
                         np.float32(inside))
            v_re = parts[at] + t * (parts[at + _2] - parts[at])
            v_im = parts[at + _1] + t * (parts[at + _3] - parts[at + _1])
            c, s = weight * parts[at + _4], weight * parts[at + _5]
            re[k] += v_re * c - v_im * s
            im[k] += v_re * s + v_im * c
            covered[k] += np.int32(inside)
    _end_group(first, count, sums, re, im)


@njit(inline='always')
def _take(count, cell, step, profiles, begin, cycle, taken):
    """Two samples and a phasor for each point.

    One after the other: this takes half the time of gathers into vectors, which a compiler makes
    of such a loop unless it may end early.
    """
    for j in range(count):
        if cell[j] < _OUTSIDE:
            break
        sample, to = begin + np.uint64(np.uint32(max(cell[j], 0))), _3 * j
        taken[to], taken[to + _1] = profiles[sample], profiles[sample + _1]
        taken[to + _2] = cycle[np.uint64(np.uint32(step[j]))]


@njit(inline='always')
def _end_group(first, count, sums, re, im):
    for j in range(count):
        k = first + j
        sums[0, k] += re[k]
        sums[1, k] += im[k]
        sums[2, k] += re[k] * re[k] + im[k] * im[k]
        re[k] = im[k] = np.float32(0.0)


def compile_kernels() -> None:
    """Compile the loop, or load it from the cache, before the first image is judged."""
    radar = RadarParameters(10e9, 100e6, 800e6, 0.0)
    centres = np.zeros((16, 1, 3))
    block = PulseBlock(radar, True, np.arange(16), np.arange(16), np.zeros((16, 1, 64)), centres,
                       centres)
    CoherenceProbe(MapGrid((5.0, 0.0, 0.0), 4, 4, 0.5))(block)
