# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Backprojection along image lines: their geometry, and the compiled loop that adds the echoes.

It sums, for every pixel, ``s_mn(D) exp(+j k_c D)`` over echoes, one of each pulse and channel;
D is half the two-way path. Geometry is float64, samples and sums float32. A range profile arrives
as a polynomial of degree 4 in each interval of its resampled positions (`profiles`); a position is
``v = (D - R0) / step = n + t`` with an integer n, and the carrier phase there is
``cycles_per_step * v`` plus a constant, of which only the fraction of a cycle is kept, in float64,
before it becomes float32.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from ...compilation import kernel_part, njit, numba
from ...geometry.polar import PolarGrid
from ...planning.interpolators import LINE_DEGREE
from .memory import WorkSpace, plain
from .phasors import cos_cycles, fraction, sin_cycles
from .profiles import Profiles

if TYPE_CHECKING:
    from ...geometry.illumination import Illumination
    from ...planning.exact.backprojection import BackprojectionPlan
    from ...planning.exact.illumination import LineAmplitudes
    from .illumination import TileAmplitudes

LINES = 32  # image lines whose geometry is computed together
_VECTOR = 32  # pixels that are added together, at most
_PLANES = 2 * (LINE_DEGREE + 1)
_TASKS_PER_THREAD = 8

_R1, _R2, _R6, _R8, _R24 = (np.float32(1 / v) for v in (1, 2, 6, 8, 24))


def project_lines(profiles: Profiles, samples: np.ndarray, tx_m: np.ndarray, rx_m: np.ndarray,
                  layers: Sequence[tuple[np.ndarray, np.ndarray]], ramp: np.ndarray,
                  image: np.ndarray, tiles: Sequence[TileAmplitudes] | None = None) -> None:
    """Add echoes to an image whose lines follow range.

    Neighbouring pixels of a line lie one cell of the resampled profiles apart (up to a small
    drift), so that a segment of a line reads contiguous polynomials.

    Parameters
    ----------
    profiles : Profiles
        How profiles are resampled; with segments.
    samples : (R, N) complex64
        Profiles of the echoes.
    tx_m, rx_m : (R, 3) float64
        Their phase centres, metres.
    layers : sequence of ((G, S, 15, LINES) float64, (5,) int64)
        Position in the middle of each of the S segments of each line (G groups of them), then its
        first to fourth derivative by the pixel number, metres; and where the lines lie in the
        image: their number; the first pixel's real part; the steps to the next line, to the next
        pixel of a line, and to the imaginary part. All layers are of one size.
    ramp : (n_pixels,) complex64
        Factor of each pixel of a line. The sum leaves ``exp(j 2 pi cycles_per_step U i)`` out,
        with U positions in a cell: the carrier phase that all lines share.
    image : (K,) float32
        Real and imaginary parts of the image to add to.
    tiles : sequence of TileAmplitudes, optional
        Illumination of each layer: with what amplitude the echoes illuminate the pixels.
    """
    resampling, (tx_m, rx_m) = profiles.resampling, plain(tx_m, rx_m)
    segment = resampling.segment
    groups, segments = layers[0][0].shape[:2]
    tasks = min(groups * segments, _TASKS_PER_THREAD * numba.get_num_threads())
    work = LineWork(*np.empty((2, tasks * LINES * segment), np.float32),
                    np.empty((tasks, 13, LINES)),
                    np.empty((tasks, 11 if tiles is None else 15, LINES), np.float32),
                    np.empty((tasks, LINES), np.int64))
    index = np.arange(segment, dtype=np.float32) - segment // 2
    ramp = np.concatenate([ramp.real, ramp.imag])
    for echoes in profiles.chunks(len(samples)):
        tx, rx = tx_m[echoes], rx_m[echoes]
        repeats = np.zeros((len(tx), 2), np.uint8)
        repeats[1:, 0] = (tx[1:] == tx[:-1]).all(axis=1)
        repeats[:, 1] = (tx == rx).all(axis=1)
        planes = profiles.planes(samples[echoes])
        n_echoes, n_phases, _, n_cells = planes.shape
        some = LineProfiles(planes.reshape(-1), n_echoes, n_phases, n_cells,
                            profiles.range_at(segment),
                            resampling.step_m, profiles.cycles_per_step,
                            profiles.cycles_at(segment))
        for number, (lines, layout) in enumerate(layers):
            _project_lines(some, tx, rx, repeats, lines, ramp, image, layout, index, work,
                           None if tiles is None else tiles[number].amplitudes(echoes))


class LineProfiles(NamedTuple):
    """Profiles of some echoes as the compiled loop over lines takes them.

    Parameters
    ----------
    planes : (R * D * 10 * n,) float32
        Coefficients of `Profiles.planes`.
    n_echoes, n_phases, n_cells : int
        Echoes R, places D of positions within a cell, and cells n.
    range_zero_m, step_m : float
        Half path at the first position after a segment of zeros, and from position to position.
    cycles_per_step, cycles_zero : float
        Phase of the carrier from position to position, and at that first one.
    """

    planes: np.ndarray
    n_echoes: int
    n_phases: int
    n_cells: int
    range_zero_m: float
    step_m: float
    cycles_per_step: float
    cycles_zero: float


class LineWork(NamedTuple):
    """Arrays that the tasks of the compiled loop work in."""

    real: np.ndarray
    imag: np.ndarray
    paths: np.ndarray
    coefficients: np.ndarray
    base: np.ndarray


@kernel_part(distinct=True)
def _line_paths(lines, group, number, centres, echo, paths, task, first):
    """Distance of a segment's middle from a phase centre and three derivatives, line by line."""
    cx, cy, cz = centres[echo, 0], centres[echo, 1], centres[echo, 2]
    for j in range(LINES):
        x = lines[group, number, 0, j] - cx
        y = lines[group, number, 1, j] - cy
        z = lines[group, number, 2, j] - cz
        ex, ey, ez = (lines[group, number, 3, j], lines[group, number, 4, j],
                      lines[group, number, 5, j])
        gx, gy, gz = (lines[group, number, 6, j], lines[group, number, 7, j],
                      lines[group, number, 8, j])
        hx, hy, hz = (lines[group, number, 9, j], lines[group, number, 10, j],
                      lines[group, number, 11, j])
        # Leibniz' rule for the square of the distance
        d = np.sqrt(x * x + y * y + z * z)
        inverse = 1.0 / d
        d1 = (x * ex + y * ey + z * ez) * inverse
        d2 = (ex * ex + ey * ey + ez * ez + x * gx + y * gy + z * gz - d1 * d1) * inverse
        d3 = (3.0 * (ex * gx + ey * gy + ez * gz) + x * hx + y * hy + z * hz
              - 3.0 * d1 * d2) * inverse
        paths[task, first, j] = d
        paths[task, first + 1, j] = d1
        paths[task, first + 2, j] = d2
        paths[task, first + 3, j] = d3


@kernel_part(distinct=True)
def _line_fourths(lines, group, number, centres, echo, paths, task, first, to):
    """Fourth derivatives of the distances whose others are in `first` and the rows behind it."""
    cx, cy, cz = centres[echo, 0], centres[echo, 1], centres[echo, 2]
    for j in range(LINES):
        gx, gy, gz = (lines[group, number, 6, j], lines[group, number, 7, j],
                      lines[group, number, 8, j])
        d2 = paths[task, first + 2, j]
        fourth = (3.0 * (gx * gx + gy * gy + gz * gz)
                  + 4.0 * (lines[group, number, 3, j] * lines[group, number, 9, j]
                           + lines[group, number, 4, j] * lines[group, number, 10, j]
                           + lines[group, number, 5, j] * lines[group, number, 11, j])
                  + (lines[group, number, 0, j] - cx) * lines[group, number, 12, j]
                  + (lines[group, number, 1, j] - cy) * lines[group, number, 13, j]
                  + (lines[group, number, 2, j] - cz) * lines[group, number, 14, j])
        paths[task, to, j] = (fourth - 4.0 * paths[task, first + 1, j] * paths[task, first + 3, j]
                              - 3.0 * d2 * d2) / paths[task, first, j]


@njit(parallel=True)
def _project_lines(profiles, tx, rx, repeats, lines, ramp, image, layout, index, work,
                   illumination):
    """Tasks take segments of `LINES` lines.

    `repeats` is 1 where an echo's transmitter is that of the echo before, and where its receiver
    is its transmitter. `index` counts the pixels of a segment from its middle. `illumination` is
    what `TileAmplitudes.amplitudes` gives, or None where all pixels are illuminated alike.

    What the loop does is a function of its own, which Numba compiles once: it would treat the
    body of a parallel loop twice.
    """
    for task in numba.prange(len(work.base)):
        _add_task(np.int64(task), profiles, tx, rx, repeats, lines, ramp, image, layout, index,
                  work, illumination)


@kernel_part(distinct=True)
def _add_task(task, profiles, tx, rx, repeats, lines, ramp, image, layout, index, work,
              illumination):
    """Add the echoes to the segments of one task; arguments as of `_project_lines`."""
    planes, n_echoes, n_phases, n_cells, range_zero, step, cycles_per_step, cycles_zero = profiles
    work_re, work_im, paths, coefficients, base = work
    if illumination is not None:
        illuminated, any_illuminated, amplitude, node, between = illumination
    segment = len(index)
    n_lines, n_pixels, after = layout[0], len(ramp) // 2, np.uint64(len(ramp) // 2)
    half, middle = segment // 2, n_echoes // 2
    # Unsigned indices spare the compiler the test for negative ones, which stops vectorisation.
    p = np.uint64(n_cells)
    inverse_step, inverse_phases = 1.0 / step, 1.0 / n_phases
    # Rows of paths; a function is compiled for each literal number, but once for all others.
    of_tx, of_rx = np.int64(0), np.int64(4)
    n_groups = lines.shape[0]
    n_pieces = n_groups * lines.shape[1]
    # Neighbouring groups of lines read the same part of the profiles, so they come in turn.
    for piece in range(task * n_pieces // len(base), (task + 1) * n_pieces // len(base)):
        number, group = piece // n_groups, piece % n_groups
        latest = -1
        if illumination is not None:
            if any_illuminated[piece % n_groups, piece // n_groups] == 0:
                continue
        count = min(LINES, n_lines - group * LINES)
        some = np.uint64(min(segment, n_pixels - number * segment))
        # whole vectors: what is left of one would be added pixel by pixel
        length = np.uint64(min(segment, (np.int64(some) + _VECTOR - 1) // _VECTOR * _VECTOR))
        for i in range(task * LINES * segment, (task + 1) * LINES * segment):
            work_re[i] = 0.0
            work_im[i] = 0.0
        shared = (number * segment + half) * float(n_phases)
        # Echoes are near each other: what their phases have in common comes last.
        _line_paths(lines, group, number, tx, middle, paths, task, of_tx)
        _line_paths(lines, group, number, rx, middle, paths, task, of_rx)
        _line_fourths(lines, group, number, tx, middle, paths, task, of_tx, of_tx + 11)
        _line_fourths(lines, group, number, rx, middle, paths, task, of_rx, of_tx + 12)
        for j in range(LINES):
            k1, k2, k3 = _drift(paths, task, j, 4, inverse_step, n_phases)
            paths[task, 8, j], paths[task, 9, j], paths[task, 10, j] = k1, k2, k3
        for echo in range(n_echoes):
            # Channels often share their transmitter, and radars with one antenna both.
            same = repeats[echo, 0]
            if illumination is not None:
                if illuminated[echo, group, number] == 0:
                    continue
                if latest != echo - 1:
                    same = 0
                latest = echo
            if same == 0:
                _line_paths(lines, group, number, tx, echo, paths, task, of_tx)
            other = 0
            if repeats[echo, 1] == 0:
                other = 4
                _line_paths(lines, group, number, rx, echo, paths, task, of_rx)
            for j in range(LINES):
                v = (0.5 * (paths[task, 0, j] + paths[task, other, j])
                     - range_zero) * inverse_step
                n = np.floor(v)
                cell = np.floor((n + 0.5) * inverse_phases)
                phase = n - cell * n_phases
                coefficients[task, 0, j] = v - n
                k1, k2, k3 = _drift(paths, task, j, other, inverse_step, n_phases)
                _store_drift(coefficients, paths, task, j, half, cycles_per_step, k1, k2, k3)
                coefficients[task, 4, j] = fraction(
                    cycles_per_step * (v - shared) + cycles_zero)
                # A segment outside the profile reads padding only.
                cell = min(max(cell, -1.0 * half), n_cells - 2.0 * segment + half)
                base[task, j] = np.int64(phase * (1.0 * _PLANES) * n_cells + cell + half)
            for j in range(LINES):
                _expand_phasor(coefficients, task, j, half)
            if illumination is not None:
                _weigh_phasors(coefficients, task, half, amplitude, echo, group, number, node,
                               between)
            offset = echo * n_phases * _PLANES * n_cells
            for j in range(count):
                if illumination is not None:
                    if coefficients[task, 14, j] == 0.0:
                        continue
                k0, k1 = coefficients[task, 0, j], coefficients[task, 1, j]
                k2, k3 = coefficients[task, 2, j], coefficients[task, 3, j]
                k4, k5 = coefficients[task, 4, j], coefficients[task, 5, j]
                k6, k7 = coefficients[task, 6, j], coefficients[task, 7, j]
                k8, k9 = coefficients[task, 8, j], coefficients[task, 9, j]
                k10 = coefficients[task, 10, j]
                r0 = np.uint64(base[task, j] + offset)
                r1 = r0 + p
                r2 = r1 + p
                r3 = r2 + p
                r4 = r3 + p
                i0 = r4 + p
                i1 = i0 + p
                i2 = i1 + p
                i3 = i2 + p
                i4 = i3 + p
                w = np.uint64((task * LINES + j) * segment)
                for i in range(length):
                    f = index[i]
                    t = k0 + f * (k1 + f * k2)
                    cosine = k3 + f * (k5 + f * (k7 + f * k9))
                    sine = k4 + f * (k6 + f * (k8 + f * k10))
                    re = planes[r0 + i] + t * (planes[r1 + i] + t * (
                        planes[r2 + i] + t * (planes[r3 + i] + t * planes[r4 + i])))
                    im = planes[i0 + i] + t * (planes[i1 + i] + t * (
                        planes[i2 + i] + t * (planes[i3 + i] + t * planes[i4 + i])))
                    work_re[w + i] += re * cosine - im * sine
                    work_im[w + i] += re * sine + im * cosine
        for j in range(count):
            w = np.uint64((task * LINES + j) * segment)
            b0, b1, b2, b3 = _shared_cycles(paths, task, j, half, cycles_per_step,
                                            inverse_step)
            first = np.uint64(number * segment)
            for i in range(some):
                f = index[i]
                c = fraction(b0 + f * (b1 + f * (b2 + f * b3)))
                sine, cosine = sin_cycles(c, c * c), cos_cycles(c * c)
                re, im = work_re[w + i], work_im[w + i]
                re, im = re * cosine - im * sine, re * sine + im * cosine
                cosine, sine = ramp[first + i], ramp[after + first + i]
                work_re[w + i] = re * cosine - im * sine
                work_im[w + i] = re * sine + im * cosine
            pixel = (layout[1] + (group * LINES + j) * layout[2]
                     + number * segment * layout[3])
            if layout[3] == 1:
                r0, i0 = np.uint64(pixel), np.uint64(pixel + layout[4])
                for i in range(some):
                    image[r0 + i] += work_re[w + i]
                    image[i0 + i] += work_im[w + i]
            else:
                for i in range(np.int64(some)):
                    image[pixel + i * layout[3]] += work_re[w + np.uint64(i)]
                    image[pixel + i * layout[3] + layout[4]] += work_im[w + np.uint64(i)]


@njit(inline='always')
def _drift(paths, task, j, other, inverse_step, n_phases):
    """First to third order of a segment's drift over the range grid, in steps per pixel number."""
    return (0.5 * inverse_step * (paths[task, 1, j] + paths[task, other + 1, j]) - n_phases,
            0.25 * inverse_step * (paths[task, 2, j] + paths[task, other + 2, j]),
            (1.0 / 12.0) * inverse_step * (paths[task, 3, j] + paths[task, other + 3, j]))


@njit(inline='always')
def _store_drift(coefficients, paths, task, j, half, cycles_per_step, k1, k2, k3):
    """Store where a segment reads, a parabola, and its phase less what its echoes share.

    The parabola has the cubic term in its slope (Chebyshev economisation): a quarter of it is
    left, evenly over the segment. A position may have thousands of cycles: only what is left
    of a phase in the end is small enough for float32.
    """
    radians = 2.0 * np.pi * cycles_per_step
    coefficients[task, 1, j] = k1 + 0.75 * half * half * k3
    coefficients[task, 2, j] = k2
    coefficients[task, 5, j] = radians * (k1 - paths[task, 8, j])
    coefficients[task, 6, j] = radians * (k2 - paths[task, 9, j])
    coefficients[task, 7, j] = radians * (k3 - paths[task, 10, j])


@njit(inline='always')
def _shared_cycles(paths, task, j, half, cycles_per_step, inverse_step):
    """Cubic, in cycles, of the phase that the echoes of a segment share, float32.

    The quartic term is folded into the constant and the quadratic one, an eighth of it is left.
    Powers of pixel numbers are whole, and so whole cycles can be left out of each coefficient.
    """
    square = 1.0 * half * half
    quartic = cycles_per_step * inverse_step * (1.0 / 48.0) * (
        paths[task, 11, j] + paths[task, 12, j])
    return (np.float32(fraction(-0.125 * square * square * quartic)),
            np.float32(fraction(cycles_per_step * paths[task, 8, j])),
            np.float32(fraction(cycles_per_step * paths[task, 9, j] + square * quartic)),
            np.float32(fraction(cycles_per_step * paths[task, 10, j])))


@njit(inline='always')
def _expand_phasor(coefficients, task, j, half):
    """Expand the phasor of a segment, less what its echoes share, as a cubic in the pixel number.

    The quartic term is folded into the constant and the quadratic one, which leaves an eighth of
    it.
    """
    g = coefficients[task, 4, j]
    a, b, c = coefficients[task, 5, j], coefficients[task, 6, j], coefficients[task, 7, j]
    sine, cosine = sin_cycles(g, g * g), cos_cycles(g * g)
    aa = a * a
    square = np.float32(half * half)
    # exp(j (a f + b f^2 + c f^3)) = 1 + j a f + (j b - a^2/2) f^2 + ...
    r4, i4 = aa * aa * _R24 - _R2 * b * b - a * c, -_R2 * aa * b
    r3, i3 = -a * b, c - aa * a * _R6
    r2, i2 = square * r4 - _R2 * aa, square * i4 + b
    r0, i0 = _R1 - square * square * _R8 * r4, -square * square * _R8 * i4
    coefficients[task, 3, j] = cosine * r0 - sine * i0
    coefficients[task, 4, j] = cosine * i0 + sine * r0
    coefficients[task, 5, j] = -sine * a
    coefficients[task, 6, j] = cosine * a
    coefficients[task, 7, j] = cosine * r2 - sine * i2
    coefficients[task, 8, j] = cosine * i2 + sine * r2
    coefficients[task, 9, j] = cosine * r3 - sine * i3
    coefficients[task, 10, j] = cosine * i3 + sine * r3


@njit(inline='always')
def _weigh_phasors(coefficients, task, half, amplitude, echo, group, number, node, between):
    """Multiply the phasors of a segment's lines by an echo's amplitude, a parabola.

    Of the product the cubic is kept, and its quartic term economised as that of the phasor is.
    """
    square = np.float32(half * half)
    k = 2 * number
    for j in range(LINES):
        n, t = node[group, j], between[group, j]
        a, b, c = (amplitude[echo, group, k, n], amplitude[echo, group, k + 1, n],
                   amplitude[echo, group, k + 2, n])
        a += t * (amplitude[echo, group, k, n + 1] - a)
        b += t * (amplitude[echo, group, k + 1, n + 1] - b)
        c += t * (amplitude[echo, group, k + 2, n + 1] - c)
        coefficients[task, 11, j] = b
        coefficients[task, 12, j] = _R2 * (c - a) / np.float32(half)
        coefficients[task, 13, j] = (_R2 * (c + a) - b) / square
        coefficients[task, 14, j] = a + b + c
    for part in range(2):
        for j in range(LINES):
            w0, w1, w2 = (coefficients[task, 11, j], coefficients[task, 12, j],
                          coefficients[task, 13, j])
            c0, c1 = coefficients[task, 3 + part, j], coefficients[task, 5 + part, j]
            c2, c3 = coefficients[task, 7 + part, j], coefficients[task, 9 + part, j]
            c4 = c3 * w1 + c2 * w2
            coefficients[task, 3 + part, j] = c0 * w0 - square * square * _R8 * c4
            coefficients[task, 5 + part, j] = c1 * w0 + c0 * w1
            coefficients[task, 7 + part, j] = c2 * w0 + c1 * w1 + c0 * w2 + square * c4
            coefficients[task, 9 + part, j] = c3 * w0 + c2 * w1 + c1 * w2


def line_middles(locate: Callable[[np.ndarray, np.ndarray], Sequence[np.ndarray]], n_lines: int,
                 n_pixels: int, segment: int) -> np.ndarray:
    """Geometry of image lines as `project_lines` wants it.

    Parameters
    ----------
    locate : callable
        ``locate(pixel, line)`` gives position and its first to fourth derivative by the pixel
        number, each (..., 3) float64, metres, for broadcast numbers.
    n_lines, n_pixels : int
        Size of the image.
    segment : int
        Pixels of a segment.

    Returns
    -------
    (G, S, 15, LINES) float64
    """
    line = np.minimum(np.arange(-(-n_lines // LINES) * LINES), n_lines - 1)
    middles = segment_middles(locate, line, n_pixels, segment)
    middles = middles.reshape(len(middles), -1, LINES, 15)
    return np.ascontiguousarray(middles.transpose(1, 0, 3, 2))


def segment_middles(locate: Callable[[np.ndarray, np.ndarray], Sequence[np.ndarray]],
                    line: np.ndarray, n_pixels: int, segment: int) -> np.ndarray:
    """(S, n, 15) float64 positions and derivatives in the middle of the segments of n lines."""
    middle = np.arange(-(-n_pixels // segment)) * segment + segment // 2
    return np.concatenate(locate(middle[:, None], line), axis=-1)


class GridLineImages:
    """Adds echoes to an image along the lines of its grid, see `Backprojection`."""

    def __init__(self, plan: BackprojectionPlan, memory: WorkSpace):
        route, lines = plan.route, plan.route.lines
        segment = route.resampling.segment
        self._profiles = Profiles(route.window, route.resampling, lines.range_m, memory)
        self._layers = [(line_middles(lines.locate(layer), lines.n_lines, lines.n_pixels, segment),
                         layout) for layer, layout in enumerate(lines.layouts)]
        # carrier phase that all lines of the image share
        self._ramp = _phasor(self._profiles.cycles_per_step * route.resampling.n_phases
                             * np.arange(lines.n_pixels))
        self._tiles = None
        if route.amplitudes is not None:
            self._tiles = _amplitudes(plan.illumination, [route.amplitudes.nodes(
                lines.locate(layer), lines.n_lines, lines.n_pixels, segment)
                for layer in range(len(lines.layouts))])

    def add(self, samples: np.ndarray, tx_m: np.ndarray, rx_m: np.ndarray, image: np.ndarray
            ) -> None:
        """Add echoes to an image, see `backends.protocol.Backprojection`."""
        project_lines(self._profiles, samples, tx_m, rx_m, self._layers, self._ramp,
                      image.reshape(-1).view(np.float32), self._tiles)


class PolarLines:
    """Lines of a polar grid, prepared for adding any number of echoes.

    Cells of the profiles are about as long as the range spacing of the grid.
    """

    def __init__(self, polar: PolarGrid, profiles: Profiles, nodes: LineAmplitudes | None = None):
        resampling = profiles.resampling
        self._polar, self._profiles = polar, profiles
        size = polar.n_alpha, polar.n_range, resampling.segment
        self._lines = line_middles(polar.locate, *size)
        self._nodes = nodes and nodes.nodes(polar.locate, *size)
        # from the phase that the kernel leaves to range baseband
        cycles = 2 * (resampling.cell_m - polar.range_spacing_m) / profiles.radar.wavelength_m
        self._ramp = _phasor(cycles * np.arange(polar.n_range))

    def add(self, samples: np.ndarray, tx_m: np.ndarray, rx_m: np.ndarray, image: np.ndarray,
            illumination: Illumination | None = None) -> None:
        """Add echoes to an image at range baseband.

        Parameters
        ----------
        samples, tx_m, rx_m :
            As for `project_lines`.
        image : (2, n_alpha, n_range or more) float32
            Real and imaginary part of the image times ``exp(-j 4 pi (r - r_0) / lambda)``, r_0
            the first range; changed in place, contiguous. Lines may end in padding.
        illumination : Illumination, optional
            Illumination of the echoes, where lines are illuminated.
        """
        polar = self._polar
        layout = np.array([polar.n_alpha, 0, image.shape[-1], 1, image[0].size])
        project_lines(self._profiles, samples, tx_m, rx_m, [(self._lines, layout)], self._ramp,
                      image.reshape(-1), self._nodes and _amplitudes(illumination, [self._nodes]))

    def fill(self, samples: np.ndarray, tx_m: np.ndarray, rx_m: np.ndarray, image: np.ndarray,
             weights: np.ndarray | None = None, illumination: Illumination | None = None) -> None:
        """Image of echoes with weights, (R,) float32; otherwise as `add`."""
        image[:] = 0.0
        if weights is not None:
            samples = samples * weights[:, None]
        self.add(samples, tx_m, rx_m, image, illumination)


def _amplitudes(illumination: Illumination | None, nodes: Sequence[tuple[np.ndarray, ...]]
                ) -> list[TileAmplitudes]:
    """Amplitudes of echoes over the tiles of each layer, from its nodes."""
    from .illumination import Antennas, TileAmplitudes  # few images have a pattern

    echoes = Antennas.of(illumination)
    return [TileAmplitudes(echoes, *one) for one in nodes]


def _phasor(cycles: np.ndarray) -> np.ndarray:
    return np.exp(2j * np.pi * np.fmod(cycles, 1.0)).astype(np.complex64)
