# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Image tiles around bright points, which autofocus focuses instead of the whole image.

The aperture is cut into sub-apertures. For each tile and sub-aperture a short piece of range
profile around the tile's centre is formed once, all pulses of the sub-aperture summed in phase:
an image of that sub-aperture as far as a tile needs one. Another geometry then only moves the
pieces along range and turns their phase; the tile's image is a sum over sub-apertures, not over
pulses.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..compilation import njit, numba
from ..geometry.grids import MapGrid
from ..planning.interpolators import design_interpolator
from ..signal import RadarParameters
from ..signal.pulses import PulseBlock
from .models import Geometry


@njit(parallel=True)
def cut_profiles(samples, weights, first, position, cycles, owner, step, out):
    """Pieces of the profiles around each point, summed over the rows of each sub-aperture.

    Parameters
    ----------
    samples : (R, N) complex64
        Profiles.
    weights : (4, 8) float32
        Weights of an `Interpolator`.
    first : int
        Offset of its first neighbour.
    position : (K, R) float64
        Position of the first sample of the piece in the profile, samples.
    cycles : (K, R) float64
        Phase that a row is turned by, cycles.
    owner : (R,) int64
        Sub-aperture of each row.
    step : float
        Spacing of the pieces, samples.
    out : (K, U, J) complex64
        Changed in place; zeros before.
    """
    n_rows, n_samples = samples.shape
    for k in numba.prange(out.shape[0]):
        for row in range(n_rows):
            angle = 2 * np.pi * (cycles[k, row] - np.floor(cycles[k, row]))
            turn = np.complex64(complex(np.cos(angle), np.sin(angle)))
            for j in range(out.shape[2]):
                place = position[k, row] + j * step
                cell = int(np.floor(place))
                if cell + first < 0 or cell + first + weights.shape[1] > n_samples:
                    continue
                t = np.float32(place - cell)
                total = np.complex64(0.0)
                for tap in range(weights.shape[1]):
                    w = weights[0, tap] + t * (weights[1, tap] + t * (
                        weights[2, tap] + t * weights[3, tap]))
                    total += w * samples[row, cell + first + tap]
                out[k, owner[row], j] += turn * total


@njit(parallel=True)
def plan_pixels(points, pixels, tx, rx, wavenumber, step_m, offset, real, imag):
    """Half path of each pixel less that of the tile's centre, and its carrier phasor.

    Parameters
    ----------
    points : (K, 3) float64
        Centres, metres.
    pixels : (K, X, 3) float64
        Pixels, metres.
    tx, rx : (U, 3) float64
        Phase centres of the sub-apertures, metres.
    wavenumber, step_m : float
        ``4 pi / lambda`` and the spacing of the pieces, metres.
    offset, real, imag : (K, X, U) float32
        Receive the difference in samples of the pieces, and the phasor.
    """
    n_x, n_u = offset.shape[1:]
    for k in numba.prange(len(points)):
        for u in range(n_u):
            centre = _half_path(points, k, tx, rx, u)
            for x in range(n_x):
                change = _half_path(pixels[k], x, tx, rx, u) - centre
                cycles = wavenumber / (2 * np.pi) * change
                angle = 2 * np.pi * (cycles - np.floor(cycles))
                offset[k, x, u] = change / step_m
                real[k, x, u] = np.cos(angle)
                imag[k, x, u] = np.sin(angle)


@njit(inline='always')
def _half_path(points, i, tx, rx, u):
    out = np.sqrt((points[i, 0] - tx[u, 0]) ** 2 + (points[i, 1] - tx[u, 1]) ** 2
                  + (points[i, 2] - tx[u, 2]) ** 2)
    out += np.sqrt((points[i, 0] - rx[u, 0]) ** 2 + (points[i, 1] - rx[u, 1]) ** 2
                   + (points[i, 2] - rx[u, 2]) ** 2)
    return 0.5 * out


@njit(parallel=True)
def focus_tiles(shape, cuts, pieces_re, pieces_im, shift, turn_re, turn_im, offset, real, imag,
                out_re, out_im):
    """Backproject the sub-apertures onto the pixels of every tile.

    All arrays are flat and in C order, which lets the compiler see that they do not overlap.

    Parameters
    ----------
    shape : (K, X, U, J)
        Tiles, pixels, sub-apertures, samples of a piece.
    cuts : (G + 1,) int64
        First sub-aperture of each coherent segment, and U.
    pieces_re, pieces_im : (K * U * J,) float32
        From `cut_profiles`.
    shift : (K * U,) float32
        Where the tile's centre is in the piece, samples of the piece; with `offset` added it
        must lie within.
    turn_re, turn_im : (K * U,) float32
        Phasor of each sub-aperture for the tile's centre.
    offset, real, imag : (K * X * U,) float32
        From `plan_pixels`.
    out_re, out_im : (K * X * G,) float32
        Images of the segments, changed in place.
    """
    n_k, n_x, n_u, n_j = shape
    n_g = len(cuts) - 1
    one, zero = np.uint64(1), np.float32(0.0)
    for k in numba.prange(n_k):
        for x in range(n_x):
            for g in range(n_g):
                total_re, total_im = zero, zero
                ku = np.uint64(k * n_u + cuts[g])
                xu = np.uint64((k * n_x + x) * n_u + cuts[g])
                for _ in range(cuts[g + 1] - cuts[g]):
                    place = shift[ku] + offset[xu]
                    cell = np.int32(place)
                    t = place - np.float32(cell)
                    j = ku * np.uint64(n_j) + np.uint64(cell)
                    a, b = pieces_re[j], pieces_im[j]
                    a += t * (pieces_re[j + one] - a)
                    b += t * (pieces_im[j + one] - b)
                    c = turn_re[ku] * real[xu] - turn_im[ku] * imag[xu]
                    d = turn_re[ku] * imag[xu] + turn_im[ku] * real[xu]
                    total_re += a * c - b * d
                    total_im += a * d + b * c
                    ku += one
                    xu += one
                out_re[(k * n_x + x) * n_g + g] = total_re
                out_im[(k * n_x + x) * n_g + g] = total_im


@njit(parallel=True)
def correlate_tiles(shape, cuts, pieces_re, pieces_im, shift, turn_re, turn_im, offset, real, imag,
                    weight_re, weight_im, along_re, along_im, slope_re, slope_im):
    """Adjoint of `focus_tiles`: what each sub-aperture contributes to weighted tiles.

    Parameters
    ----------
    shape, cuts, pieces_re, pieces_im, shift, turn_re, turn_im, offset, real, imag
        As for `focus_tiles`.
    weight_re, weight_im : (K * X * G,) float32
        Weights of the pixels.
    along_re, along_im : (K * U,) float64
        Receive ``sum_x conj(weight) contribution``; zeros before.
    slope_re, slope_im : (K * U,) float64
        The same for the contribution's derivative by `shift`, its phasor held.
    """
    n_k, n_x, n_u, n_j = shape
    n_g = len(cuts) - 1
    one = np.uint64(1)
    for k in numba.prange(n_k):
        for x in range(n_x):
            for g in range(n_g):
                w_re, w_im = weight_re[(k * n_x + x) * n_g + g], weight_im[(k * n_x + x) * n_g + g]
                ku = np.uint64(k * n_u + cuts[g])
                xu = np.uint64((k * n_x + x) * n_u + cuts[g])
                for _ in range(cuts[g + 1] - cuts[g]):
                    place = shift[ku] + offset[xu]
                    cell = np.int32(place)
                    t = place - np.float32(cell)
                    j = ku * np.uint64(n_j) + np.uint64(cell)
                    a, b = pieces_re[j], pieces_im[j]
                    step_re, step_im = pieces_re[j + one] - a, pieces_im[j + one] - b
                    a += t * step_re
                    b += t * step_im
                    c = turn_re[ku] * real[xu] - turn_im[ku] * imag[xu]
                    d = turn_re[ku] * imag[xu] + turn_im[ku] * real[xu]
                    e = w_re * c + w_im * d
                    f = w_re * d - w_im * c
                    along_re[ku] += a * e - b * f
                    along_im[ku] += a * f + b * e
                    slope_re[ku] += step_re * e - step_im * f
                    slope_im[ku] += step_re * f + step_im * e
                    ku += one
                    xu += one


PIECES_PER_RESOLUTION = 4  # samples of a piece; linear interpolation between them
PIXELS = 7, 21  # of a tile, along range and azimuth
_RANGE_STEP, _AZIMUTH_STEP = 0.7, 0.55  # their spacing in resolutions
_MARGIN = 3.0  # of the pieces beyond the tile for geometry to move, range resolutions


class Tiles:
    """Small image tiles, kept by sub-aperture, whose focus follows a change of the geometry.

    Parameters
    ----------
    block : PulseBlock
        Range profiles.
    geometry : Geometry
        Phase centres at which the pieces are formed.
    points : (K, 3) array_like
        Centres of the tiles, metres.
    n_subapertures : int
        Sub-apertures U to cut the aperture into.
    n_segments : int
        Coherent segments G; sub-apertures of different segments add in power only. Azimuth
        pixels are G times as wide as those of the whole aperture.
    pixels : (int, int)
        Pixels of a tile along range and azimuth, odd.

    Attributes
    ----------
    points : (K, 3) float64
        Centres of the tiles, metres.
    segment : (U,) int64
        Segment of each sub-aperture.
    wavenumber : float
        ``4 pi / lambda``, rad/m.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging.autofocus import Geometry
    >>> from sar_imaging.autofocus.tiles import Tiles
    >>> from sar_imaging.simulation import SCENARIOS
    >>> block = next(SCENARIOS['psf']().blocks(40))
    >>> geometry = Geometry(block.tx_m, block.rx_m)
    >>> tiles = Tiles(block, geometry, [[10_000.0, 0.0, 0.0]], n_subapertures=8)
    >>> images = tiles.focus(tiles.half_path_change(geometry))
    >>> images.shape, int(np.abs(images[0, :, 0]).argmax())  # brightest in the middle
    ((1, 147, 1), 73)
    """

    def __init__(self, block: PulseBlock, geometry: Geometry, points: ArrayLike,
                 n_subapertures: int, n_segments: int = 1, pixels: tuple[int, int] = PIXELS
                 ) -> None:
        radar = block.radar
        self.points = np.asarray(points, np.float64)
        self.wavenumber = radar.wavenumber_rad_per_m
        self.n_segments = n_segments
        self._owner = np.arange(block.n_pulses) * n_subapertures // block.n_pulses
        self.segment = np.arange(n_subapertures) * n_segments // n_subapertures
        self._cuts = np.searchsorted(self.segment, np.arange(n_segments + 1))
        self._step_m = radar.range_resolution_m / PIECES_PER_RESOLUTION
        self._start = self._half_paths(geometry)
        middles = self._middles(geometry)
        self._pixels = np.stack([self._tile(k, middles, radar, pixels)
                                 for k in range(len(self.points))])
        self._planned = self._plan_pixels(middles)
        reach = float(np.abs(self._planned[0]).max()) + _MARGIN * PIECES_PER_RESOLUTION
        self._centre = math.ceil(reach)
        pieces = self._cut(block, geometry, 2 * self._centre + 3)
        self._pieces = pieces.real.ravel(), pieces.imag.ravel()
        self._shape = (*self._pixels.shape[:2], *pieces.shape[1:])

    def half_path_change(self, geometry: Geometry) -> np.ndarray:
        """(K, U) float64 change of the half path to the tiles' centres, metres."""
        return self._half_paths(geometry) - self._start

    def focus(self, change_m: np.ndarray) -> np.ndarray:
        """Images of the segments.

        Parameters
        ----------
        change_m : (K, U) float64
            Change of the half paths, metres.

        Returns
        -------
        (K, X, G) complex64
        """
        shape = (*self._shape[:2], self.n_segments)
        out = np.empty((2, math.prod(shape)), np.float32)
        focus_tiles(*self._arguments(change_m), *out)
        return (out[0] + 1j * out[1]).reshape(shape)

    def correlate(self, change_m: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Adjoint of `focus`: what the sub-apertures contribute to weighted tiles.

        Parameters
        ----------
        change_m : (K, U) float64
            Change of the half paths, metres.
        weight : (K, X, G) complex64
            Weight of the pixels.

        Returns
        -------
        along : (K, U) complex128
            ``sum_x conj(weight) contribution``.
        slope : (K, U) complex128
            Derivative of the same by the change, 1/m.
        """
        out = np.zeros((4, change_m.size))
        correlate_tiles(*self._arguments(change_m), weight.real.ravel(),
                                weight.imag.ravel(), *out)
        along, slope = ((re + 1j * im).reshape(change_m.shape) for re, im in (out[:2], out[2:]))
        return along, slope / self._step_m + 1j * self.wavenumber * along

    def position(self, k: int, pixel: int) -> np.ndarray:
        """(3,) float64 position of a pixel of tile `k`, metres."""
        return self._pixels[k, pixel]

    def _arguments(self, change_m: np.ndarray) -> tuple[Any, ...]:
        reach = _MARGIN * PIECES_PER_RESOLUTION  # what moves further is out of the tile
        shift = self._centre + np.clip(change_m / self._step_m, -reach, reach)
        angle = np.remainder(self.wavenumber * change_m, 2 * np.pi)
        return (self._shape, self._cuts, *self._pieces,
                *(a.astype(np.float32).ravel() for a in (shift, np.cos(angle), np.sin(angle))),
                *self._planned)

    def _middles(self, geometry: Geometry) -> list[np.ndarray]:
        """Mean transmit and receive phase centre of each sub-aperture, (U, 3) each."""
        first = np.searchsorted(self._owner, np.arange(len(self.segment)))
        count = np.diff(first, append=len(self._owner))[:, None]
        return [np.add.reduceat(centres.mean(axis=1), first) / count
                for centres in geometry[:2]]

    def _half_paths(self, geometry: Geometry) -> np.ndarray:
        total: Any = 0.0
        for centre in self._middles(geometry):
            dx, dy, dz = (self.points[:, None, axis] - centre[:, axis] for axis in range(3))
            total = total + 0.5 * np.sqrt(dx * dx + dy * dy + dz * dz)
        return total + geometry.range_bias_m

    def _tile(self, k: int, middles: Sequence[np.ndarray], radar: RadarParameters,
              pixels: tuple[int, int]) -> np.ndarray:
        """(X, 3) pixels on the horizontal plane through a point, along range and azimuth."""
        look = 0.5 * sum((self.points[k] - c) / np.linalg.norm(self.points[k] - c, axis=-1,
                                                              keepdims=True) for c in middles)
        mean = look[:, :2].mean(axis=0)
        slope = float(np.linalg.norm(mean))
        along_range = mean / slope
        along_azimuth = np.array([-along_range[1], along_range[0]])
        swing = max(float(np.ptp(look[:, :2] @ along_azimuth)), 1e-6)
        range_step = _RANGE_STEP * radar.range_resolution_m / slope
        azimuth_step = _AZIMUTH_STEP * self.n_segments * radar.wavelength_m / 2 / swing
        r, a = ((np.arange(n) - n // 2) * step
                for n, step in zip(pixels, (range_step, azimuth_step), strict=True))
        flat = r[:, None, None] * along_range + a[:, None] * along_azimuth
        out = np.tile(self.points[k], (r.size * a.size, 1))
        out[:, :2] += flat.reshape(-1, 2)
        return out

    def _plan_pixels(self, middles: Sequence[np.ndarray]) -> tuple[np.ndarray, ...]:
        out = np.empty((3, *self._pixels.shape[:2], len(self.segment)), np.float32)
        plan_pixels(self.points, self._pixels, *middles, self.wavenumber,
                            self._step_m, *out)
        return tuple(part.reshape(-1) for part in out)

    def _cut(self, block: PulseBlock, geometry: Geometry, length: int) -> np.ndarray:
        radar = block.radar
        rows = np.ascontiguousarray(block.samples).reshape(-1, block.n_samples)
        path = 0.5 * sum(
            np.linalg.norm(self.points[:, None] - np.reshape(c, (-1, 3)), axis=-1)
            for c in geometry[:2])
        measured = path + geometry.range_bias_m
        step = self._step_m / radar.sample_spacing_m
        position = (measured - radar.range_start_m) / radar.sample_spacing_m - self._centre * step
        kernel = design_interpolator(radar.sample_rate_hz / radar.bandwidth_hz)
        pieces = np.zeros((len(path), len(self.segment), length), np.complex64)
        cut_profiles(rows, kernel.weights, kernel.first, position,
                             2 * measured / radar.wavelength_m,
                             np.repeat(self._owner, block.n_channels), step, pieces)
        return pieces


_APART = 4.0  # bright points stand so many range resolutions apart
_FAINTEST_DB = -30.0  # of a bright point, relative to the brightest


def bright_points(image: np.ndarray, grid: MapGrid, block: PulseBlock, n: int) -> np.ndarray:
    """Positions of the brightest pixels of an image, apart from each other.

    Parameters
    ----------
    image : (n_y, n_x) array
        Image.
    grid : MapGrid
        Its pixels.
    block : PulseBlock
        Its pulses; their bandwidth says how far points stand apart.
    n : int
        How many at most.

    Returns
    -------
    (K, 3) float64
        Brightest first, metres; none fainter than -30 dB of the brightest.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging import MapGrid
    >>> from sar_imaging.autofocus.tiles import bright_points
    >>> from sar_imaging.simulation import SCENARIOS
    >>> block = next(SCENARIOS['psf']().blocks(10))
    >>> grid = MapGrid((10_000.0, 0.0, 0.0), 40, 40, 0.5)
    >>> image = np.zeros(grid.shape)
    >>> image[10, 5], image[30, 20] = 2.0, 1.0
    >>> bright_points(image, grid, block, n=5).round(2).tolist()
    [[9992.75, 4.75, 0.0], [10000.25, -5.25, 0.0]]
    """
    power = np.square(np.abs(image), dtype=np.float64)
    faintest = power.max() * 10 ** (_FAINTEST_DB / 10)
    half = max(2, round(_APART * block.radar.range_resolution_m / grid.spacing_m))
    points: list[tuple[float, float, float]] = []
    while len(points) < n:
        row, column = np.unravel_index(power.argmax(), power.shape)
        if power[row, column] <= faintest:
            break
        points.append((float(grid.x_m[column]), float(grid.y_m[row]), grid.z_m))
        power[max(0, row - half):row + half + 1, max(0, column - half):column + half + 1] = 0.0
    return np.array(points).reshape(-1, 3)
