# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Two-way amplitude of echoes towards points, and which tiles they illuminate; compiled.

`geometry.illumination` says what is computed. Neighbouring tiles of points share the nodes between
them. Offsets from the phase centres are float64, what follows from them float32.

A tile of image lines is a segment of `planning.exact.illumination.LINES` of them. Most tiles are
dark for most echoes of a stripmap; they are told by the corners of larger blocks. The directions
beyond one end of a pattern, behind the antenna among them, form a convex cone: where all corners
of a flat block lie in the same cone, so does the block.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ...compilation import DETERMINISTIC, kernel_part, njit, numba
from ...planning.exact.points import ImagePoints

if TYPE_CHECKING:
    from ...geometry.illumination import Illumination
    from ...planning.exact.illumination import PointAmplitudes


class Antennas(NamedTuple):
    """An `Illumination` as compiled loops take it.

    Parameters
    ----------
    centre : (R, 3) float64
        Where echoes are seen from, metres.
    axes : (R, 3, 3) float64
        The antenna's right, boresight and up at each, as rows.
    azimuth, elevation : (K,) float64
        Two-way amplitude by the sine of the angle.
    place : (4,) float64
        Sine at the first point, and points per unit of it, of azimuth and of elevation.
    """

    centre: np.ndarray
    axes: np.ndarray
    azimuth: np.ndarray
    elevation: np.ndarray
    place: np.ndarray

    @classmethod
    def of(cls, illumination: Illumination) -> Antennas:
        """Arrays of an illumination."""
        azimuth, elevation = illumination.pattern.azimuth, illumination.pattern.elevation
        return cls(np.ascontiguousarray(illumination.centre_m),
                   np.ascontiguousarray(illumination.axes), azimuth.amplitude,
                   elevation.amplitude, np.array([azimuth.start, 1 / azimuth.step,
                                                  elevation.start, 1 / elevation.step]))

    @property
    def ends(self) -> np.ndarray:
        """(6,) float64 sines of azimuth, last and first; cosine and sine of both elevations."""
        first, per_sine, low, per_low = self.place
        last = first + (len(self.azimuth) - 1) / per_sine
        low, high = max(low, -1.0), min(low + (len(self.elevation) - 1) / per_low, 1.0)
        return np.array([last, first, math.sqrt(1 - high * high), high,
                         math.sqrt(1 - low * low), low])

    @classmethod
    def everything(cls) -> Antennas:
        """For echoes that illuminate all points alike: no arrays, which loops do not read."""
        one = np.ones(1)
        return cls(np.zeros((0, 3)), np.zeros((0, 3, 3)), one, one, np.zeros(4))


@njit(inline='always')
def two_way_amplitude(antennas, echo, x, y, z):
    """Amplitude of an echo towards a point, metres."""
    centre, axes = antennas.centre, antennas.axes
    x, y, z = x - centre[echo, 0], y - centre[echo, 1], z - centre[echo, 2]
    right = x * axes[echo, 0, 0] + y * axes[echo, 0, 1] + z * axes[echo, 0, 2]
    ahead = x * axes[echo, 1, 0] + y * axes[echo, 1, 1] + z * axes[echo, 1, 2]
    up = x * axes[echo, 2, 0] + y * axes[echo, 2, 1] + z * axes[echo, 2, 2]
    return _in_axes(antennas.azimuth, antennas.elevation, antennas.place, right, ahead, up)


@njit(fastmath=DETERMINISTIC, error_model='numpy')
def two_way_amplitudes(antennas, echo, positions, out):
    """Amplitudes of an echo towards points (3, N), metres, into `out`, (N,)."""
    # What does not change is read beforehand: what is written might be the same memory.
    centre_x, centre_y, centre_z = antennas.centre[echo]
    (rx, ry, rz), (bx, by, bz), (ux, uy, uz) = antennas.axes[echo]
    azimuth, elevation = antennas.azimuth, antennas.elevation
    start, per_sine, low, per_low = antennas.place
    place = start, per_sine, low, per_low
    for i in range(len(out)):
        x, y, z = (positions[0, i] - centre_x, positions[1, i] - centre_y,
                   positions[2, i] - centre_z)
        out[i] = _in_axes(azimuth, elevation, place, x * rx + y * ry + z * rz,
                          x * bx + y * by + z * bz, x * ux + y * uy + z * uz)


@njit(inline='always')
def _in_axes(azimuth, elevation, place, right, ahead, up):
    """Amplitude towards an offset in the antenna's axes, metres."""
    within = ahead * ahead + up * up
    # Without branches, for the compiler's vectors; NaN, of no position, is not ahead either.
    inside = 1.0 if ahead > 0.0 else 0.0
    across = _at_sine(azimuth, place[0], place[1], right / np.sqrt(right * right + within))
    above = _at_sine(elevation, place[2], place[3], up / np.sqrt(within))
    return inside * across * above if inside > 0.0 else 0.0


@njit(inline='always')
def _at_sine(table, start, per_sine, sine):
    last = len(table) - 1.0
    sine = sine if sine < 1.0 else 1.0
    place = ((sine if sine > -1.0 else -1.0) - start) * per_sine
    inside = 1.0 if place >= 0.0 else 0.0
    inside = inside if place <= last else 0.0
    place = place if place > 0.0 else 0.0
    place = place if place < last else last
    before = place if place < last - 1.0 else last - 1.0
    point = np.int64(before)
    low, high = table[np.uint64(point)], table[np.uint64(point + 1)]
    return inside * (low + (place - point) * (high - low))


_ZERO, _ONE = np.float32(0), np.float32(1)


class PointAntennas(NamedTuple):
    """An `Illumination` as loops over echoes take it: each number of all R echoes in turn.

    Parameters
    ----------
    centre : (3 R,) float64
        Where echoes are seen from, metres.
    axes : (9 R,) float32
        The antenna's right, boresight and up at each.
    table : (K,) float32
        Two-way amplitude by the sine of the azimuth, then by that of the elevation.
    place : (6,) float32
        Sine at the first point, points per unit of it and number of the last, of azimuth and of
        elevation.
    """

    centre: np.ndarray
    axes: np.ndarray
    table: np.ndarray
    place: np.ndarray

    @classmethod
    def of(cls, illumination: Illumination) -> PointAntennas:
        """Arrays of an illumination."""
        cuts = illumination.pattern.azimuth, illumination.pattern.elevation
        return cls(np.ascontiguousarray(illumination.centre_m.T).reshape(-1),
                   illumination.axes.transpose(1, 2, 0).astype(np.float32).reshape(-1),
                   np.concatenate([cut.amplitude for cut in cuts]).astype(np.float32),
                   np.array([[cut.start, 1 / cut.step, len(cut.amplitude) - 1] for cut in cuts],
                            np.float32).reshape(-1))


class TileNodes:
    """Nodes of the tiles of some points.

    Parameters
    ----------
    points : ImagePoints
        One part of an image.
    tile : (int, int)
        Rows and columns of a tile.
    interpolation : PointAmplitudes
        Where nodes lie.

    Attributes
    ----------
    line : int
        Nodes of a row.
    unknown : (K,) uint8
        1 where one has no position.
    """

    def __init__(self, points: ImagePoints, tile: tuple[int, int], interpolation: PointAmplitudes):
        rows, columns = interpolation.nodes(points.size, tile)
        self._positions = points.positions(rows[:, None], columns).reshape(-1)
        self.line = len(columns)
        self.unknown = np.isnan(self._positions.reshape(-1, 3)).any(axis=1).view(np.uint8)

    def amplitudes(self, echoes: PointAntennas) -> np.ndarray:
        """(K R,) float32 amplitudes at each node of each echo in turn."""
        out = np.empty(len(self.unknown) * (len(echoes.centre) // 3), np.float32)
        _fill_nodes(*echoes, self._positions, out)
        return out


@njit(inline='always')
def amplitude_of(centre, axes, table, place, echo, x, y, z):
    """Two-way amplitude of an echo towards a point, metres; without branches, for vectors."""
    right, ahead, up = _point_in_axes(centre, axes, echo, x, y, z)
    within = ahead * ahead + up * up
    azimuth = _node_at_sine(table, np.int32(0), place[0], place[1], place[2],
                            right / np.sqrt(right * right + within))
    elevation = _node_at_sine(table, np.int32(place[2]) + np.int32(1), place[3], place[4],
                              place[5], up / np.sqrt(within))
    return azimuth * elevation if ahead > _ZERO else _ZERO


@njit(inline='always')
def dark_sphere(centre, axes, ends, echo, x, y, z, radius):
    """1 where an echo illuminates nothing within a radius of a position, metres.

    How far a point lies beyond an end of the pattern, ``d a - sine |d|`` in azimuth, changes by at
    most ``1 + sine`` times the radius. `ends` are those of `Antennas`.
    """
    right, ahead, up = _point_in_axes(centre, axes, echo, x, y, z)
    distance = np.sqrt(right * right + ahead * ahead + up * up)
    if (right - ends[0] * distance > (1.0 + abs(ends[0])) * radius
            or ends[1] * distance - right > (1.0 + abs(ends[1])) * radius
            or up * ends[2] - ahead * ends[3] > radius
            or ahead * ends[5] - up * ends[4] > radius or ahead < -radius):
        return 1
    return 0


@njit(inline='always')
def _point_in_axes(centre, axes, echo, x, y, z):
    """What of a point, metres, lies to the right, ahead and up."""
    n, two, three = np.uint64(len(centre) // 3), np.uint64(2), np.uint64(3)
    dx, dy, dz = (np.float32(x - centre[echo]), np.float32(y - centre[n + echo]),
                  np.float32(z - centre[two * n + echo]))
    a, b = three * n + echo, np.uint64(6) * n + echo
    return (dx * axes[echo] + dy * axes[n + echo] + dz * axes[two * n + echo],
            dx * axes[a] + dy * axes[n + a] + dz * axes[two * n + a],
            dx * axes[b] + dy * axes[n + b] + dz * axes[two * n + b])


@njit(inline='always')
def _node_at_sine(table, first, start, per_sine, last, sine):
    place = (sine - start) * per_sine
    inside = _ONE if place >= _ZERO else _ZERO
    inside = inside if place <= last else _ZERO
    place = place if place > _ZERO else _ZERO
    place = place if place < last else last
    before = place if place < last - _ONE else last - _ONE
    point = np.int32(before)
    low, high = table[np.uint64(first + point)], table[np.uint64(first + point + np.int32(1))]
    return inside * (low + (place - np.float32(point)) * (high - low))


@njit(parallel=True, error_model='numpy')
def _fill_nodes(centre, axes, table, place, positions, out):
    """Numba knows that arrays do not overlap only where they are no parts of a tuple."""
    n_echoes = np.uint64(len(centre) // 3)
    for node in numba.prange(len(positions) // 3):
        x, y, z = positions[3 * node], positions[3 * node + 1], positions[3 * node + 2]
        to = np.uint64(node) * n_echoes
        for echo in range(n_echoes):
            out[to + echo] = amplitude_of(centre, axes, table, place, echo, x, y, z)


_BLOCK = 8  # segments that are looked at together
_AZIMUTH_ABOVE, _AZIMUTH_BELOW, _ELEVATION_ABOVE, _ELEVATION_BELOW, _BEHIND = 1, 2, 4, 8, 16


class TileAmplitudes:
    """Amplitudes of some echoes over the tiles of a layer of lines.

    Parameters
    ----------
    echoes : Antennas
        All echoes that are added.
    positions : (3, G, 2 S + 1, K) float64
        Positions of the nodes, see `planning.exact.illumination.node_positions`.
    node, between : (G, LINES) int64, float32
        Knot before each line of a group, and the share of the next.
    """

    def __init__(self, echoes: Antennas, positions: np.ndarray, node: np.ndarray,
                 between: np.ndarray):
        self._echoes, self._positions = echoes, positions
        self._node, self._between, self._ends = node, between, _cones(echoes)

    def amplitudes(self, echoes: slice) -> tuple[np.ndarray, ...]:
        """What the compiled loop over the lines needs for some of the echoes.

        Returns
        -------
        illuminated : (R, G, S) uint8
            1 where an echo illuminates a part of a tile.
        any_illuminated : (G, S) uint8
            1 where one of them does.
        amplitude : (R, G, 2 S + 1, K) float32
            At the nodes, of illuminated tiles alone.
        node, between :
            As given.
        """
        numbers = np.arange(*echoes.indices(len(self._echoes.centre)))
        _, n_groups, n_places, n_nodes = self._positions.shape
        illuminated = np.zeros((len(numbers), n_groups, n_places // 2), np.uint8)
        amplitude = np.empty((len(numbers), n_groups, n_places, n_nodes), np.float32)
        _fill_tiles(self._echoes, self._ends, self._positions, numbers, illuminated, amplitude)
        return (illuminated, illuminated.any(axis=0).view(np.uint8), amplitude, self._node,
                self._between)


def _cones(echoes: Antennas) -> np.ndarray:
    """Ends of the pattern, none where the cone beyond it would not be convex."""
    ends = echoes.ends
    ends[0] = ends[0] if ends[0] >= 0 else 2.0
    ends[1] = ends[1] if ends[1] <= 0 else -2.0
    return ends


@njit(inline='always')
def dark_cones(antennas, ends, echo, x, y, z):
    """In which of the cones beyond the ends of a pattern a position lies, bit by bit."""
    centre, axes = antennas.centre, antennas.axes
    x, y, z = x - centre[echo, 0], y - centre[echo, 1], z - centre[echo, 2]
    right = x * axes[echo, 0, 0] + y * axes[echo, 0, 1] + z * axes[echo, 0, 2]
    ahead = x * axes[echo, 1, 0] + y * axes[echo, 1, 1] + z * axes[echo, 1, 2]
    up = x * axes[echo, 2, 0] + y * axes[echo, 2, 1] + z * axes[echo, 2, 2]
    distance = np.sqrt(right * right + ahead * ahead + up * up)
    found = 0
    if right > ends[0] * distance:
        found |= _AZIMUTH_ABOVE
    if right < ends[1] * distance:
        found |= _AZIMUTH_BELOW
    if up * ends[2] - ahead * ends[3] > 0.0:
        found |= _ELEVATION_ABOVE
    if up * ends[4] - ahead * ends[5] < 0.0:
        found |= _ELEVATION_BELOW
    if ahead <= 0.0:
        found |= _BEHIND
    return found


@njit(parallel=True, error_model='numpy')
def _fill_tiles(echoes, ends, positions, wanted, illuminated, amplitude):
    for group in numba.prange(positions.shape[1]):
        _fill_group(np.int64(group), echoes, ends, positions, wanted, illuminated, amplitude)


@kernel_part(error_model='numpy')
def _fill_group(group, echoes, ends, positions, wanted, illuminated, amplitude):
    """One group of lines of `_fill_tiles`."""
    n_places, n_nodes = positions.shape[2:]
    n_segments = n_places // 2
    for number in range(len(wanted)):
        echo = wanted[number]
        for start in range(0, n_segments, _BLOCK):
            stop = min(start + _BLOCK, n_segments)
            dark = 31
            for p in range(2 * start, 2 * stop + 1, 2 * (stop - start)):
                for k in range(0, n_nodes, n_nodes - 1):
                    dark &= dark_cones(echoes, ends, echo, positions[0, group, p, k],
                                       positions[1, group, p, k], positions[2, group, p, k])
            if dark != 0:
                continue
            for p in range(2 * start, 2 * stop + 1):
                for k in range(n_nodes):
                    amplitude[number, group, p, k] = two_way_amplitude(
                        echoes, echo, positions[0, group, p, k], positions[1, group, p, k],
                        positions[2, group, p, k])
            for segment in range(start, stop):
                brightest = np.float32(0.0)
                for p in range(2 * segment, 2 * segment + 3):
                    for k in range(n_nodes):
                        brightest = max(brightest, amplitude[number, group, p, k])
                if brightest > 0.0:
                    illuminated[number, group, segment] = 1
