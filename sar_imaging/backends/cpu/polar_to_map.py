# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Polar image to map, in two passes of one-dimensional interpolation.

`backends.reference.polar_to_map` has the formulas. Some pixels of `LANES` map rows are done at a
time: what is between the two passes stays in cache. The carrier is put back from float64.
Positions are found for many vectors before the first of them is interpolated, which keeps a
processor from waiting for one result after the other.

`LANES` neighbours are interpolated together from samples that begin at different places, without
gathers: two places in a row take their turn at once, each lane selecting its own samples.
Functions written as instructions take addresses as int64; `taps` is a tuple as long as there are
neighbours to interpolate from, since that much of it is known when code is written.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from llvmlite import ir
from numba.core import cgutils, types

from ...compilation import DETERMINISTIC, kernel_part, njit, numba
from ...geometry.grids import MapGrid
from ...geometry.polar import PolarGrid
from ...planning.interpolators import Interpolator
from .instructions import (
    BLOCK,
    DOUBLE,
    FLOAT,
    GROUP_BYTES,
    INT,
    INT32,
    LANES,
    SAMPLE_BYTES,
    VECTOR_BYTES,
    Vector,
    instructions,
    integer_at,
    job_counter,
    order,
    take_job,
    transpose,
)
from .memory import aligned_empty
from .phasors import COSINES, SINES

if TYPE_CHECKING:
    from ...planning.exact.groups import GroupedMap

POSITION_BYTES = 5 * VECTOR_BYTES
# of a position: the first of the starts, and of each lane what it is from the middle between two
# samples, its start relative to the first, and the phasor of its carrier
FIRST, _T, _START, _COSINE, _SINE = range(0, POSITION_BYTES, VECTOR_BYTES)

_FLOATS, _DOUBLES = ir.VectorType(FLOAT, LANES), ir.VectorType(DOUBLE, LANES)
_SAMPLES = ir.VectorType(FLOAT, 2 * LANES)
_i, _d = types.int64, types.float64


@instructions(_i, _i, _d, _d, _d, _d, _d, _i)
def locate_directions(b, squares, inverses, beside2, scale, along, zero, last, to):
    """Where LANES ranges meet a row: ``(scale sqrt(r^2 - beside2) + along) / r - zero``.

    Positions are stored at `to` for `interpolate`; ``r^2`` and ``1 / r`` are float64 at
    addresses, and starts lie between 1 and `last`.
    """
    beside2, scale, along, zero, last = (b.spread(v, LANES) for v in (
        beside2, scale, along, zero, last))
    ahead2 = _load(b, squares, _DOUBLES) - beside2
    ahead = ahead2.where('>', 0.0, ahead2, 0.0).call('sqrt')
    v = (ahead * scale + along) * _load(b, inverses, _DOUBLES) - zero
    _store_positions(b, v, 1.0, last, to)


@instructions(_d, _i, _i, _d, _d, _d, _d, _i)
def locate_ranges(b, ahead2, beside2, shifts, start, inverse, cycles_per_m, last, to):
    """Where LANES rows have a pixel: ``(r - start) inverse + shift``, r^2 = ahead2 + beside2.

    Positions and the phasors of the carrier are stored at `to` for `interpolate`; `beside2` and
    `shifts` are float64 at addresses, and starts lie between 0 and `last`.
    """
    ahead2, start, inverse, cycles_per_m, last = (b.spread(v, LANES) for v in (
        ahead2, start, inverse, cycles_per_m, last))
    r = (_load(b, beside2, _DOUBLES) + ahead2).call('sqrt') - start
    _store_positions(b, r * inverse + _load(b, shifts, _DOUBLES), 0.0, last, to)
    cycles = r * cycles_per_m
    c = (cycles - cycles.call('rint')).rounded()
    _store(b, _polynomial(COSINES, c * c), to, _COSINE)
    _store(b, c * _polynomial(SINES, c * c), to, _SINE)


@instructions(_i, _i, _i, _i, None, _i, _i, _i)
def interpolate(b, real, imag, step, weights, taps, positions, to_real, to_imag):
    """Interpolate LANES samples; `step` is the bytes from a tap's samples to the next one's.

    `weights` are `Interpolator.centred`.
    """
    _interpolate_vector(b, (real, imag), step, weights, taps.type.count, positions,
                        (to_real, to_imag))


@instructions(_i, _i, _i, _i, None, _i, _i)
def interpolate_carrier(b, real, imag, step, weights, taps, positions, to):
    """As `interpolate`, times the phasors; real and imaginary parts are stored in turn."""
    cosine, sine = (_load(b, positions, _FLOATS, part) for part in (_COSINE, _SINE))
    parts = to, b.add(to, INT(VECTOR_BYTES))
    _interpolate_vector(b, (real, imag), step, weights, taps.type.count, positions, parts)
    re, im = (_load(b, part, _FLOATS) for part in parts)
    samples = b.interleaved(re * cosine - im * sine, re * sine + im * cosine)
    b.store(samples, b.pointer(to, _SAMPLES), align=4)


@instructions(_i, _i)
def transpose_floats(b, source, target):
    """Transpose LANES x LANES float32 that lie side by side."""
    rows = [_load(b, source, _FLOATS, i * VECTOR_BYTES).value for i in range(LANES)]
    for i, row in enumerate(b.transposed(rows)):
        _store(b, Vector(b, row), target, i * VECTOR_BYTES)


@instructions(_i, _i, _i)
def fetch_lines(b, place, step, number):
    """Bring a line of the cache from each of some lines of an image into the second cache."""
    with cgutils.for_range(b, number) as loop:
        line = b.add(place, b.mul(step, loop.index))
        b.fetch_line(b.pointer(line, ir.IntType(8)), locality=2)


@instructions(_i, _i, _i, _i)
def put_samples(b, source, target, number, add):
    """Store `number` complex64, or add them if `add` is not 0; quickest for LANES."""
    add = b.icmp_signed('!=', add, INT(0))

    def put(kind, shift):
        places = [b.pointer(b.add(place, shift), kind) for place in (source, target)]
        sample = b.load(places[0], align=4)
        with b.if_else(add) as (added, stored):
            with added:
                b.store(b.fadd(sample, b.load(places[1], align=4)), places[1], align=4)
            with stored:
                b.store(sample, places[1], align=4)

    with b.if_else(b.icmp_signed('==', number, INT(LANES))) as (whole, part):
        with whole:
            put(_SAMPLES, INT(0))
        with part, cgutils.for_range(b, b.mul(number, INT(2))) as loop:
            put(FLOAT, b.mul(loop.index, INT(4)))


def _store_positions(b, v, least, last, to):
    """Lowest start, and relative to it the starts of all lanes and what is left."""
    v = v.where('>', least, v, least)
    v = v.where('<', last, v, last)
    low, lanes = v, LANES
    while lanes > 1:
        lanes //= 2
        halves = [Vector(b, b.shuffle_vector(low.value, low.value, order(
            range(begin, begin + lanes)))) for begin in (0, lanes)]
        low = halves[0].where('<', halves[1], *halves)
    first = b.extract_element(low.call('floor').value, INT32(0))
    low = b.spread(first, LANES)
    v = (v - low).rounded()
    start = v.call('floor')
    _store(b, v - start - 0.5, to, _T)
    _store(b, start, to, _START)
    b.store(b.fptosi(first, INT), b.pointer(to, INT, FIRST))


def _interpolate_vector(b, sources, step, weights, taps, positions, targets):
    """Two starts at a time, until no lane starts later; most simply where all start alike.

    Targets change with each iteration, so that LLVM does not keep all weights from one to the
    next: there are more than registers, and most vectors need one iteration.
    """
    def sums(place, later):
        t = _load(b, positions, _FLOATS, _T)
        return _weighted_sums(b, [b.add(source, place) for source in sources], step, weights,
                              taps, t, later)

    def branch(iteration, where_any, where_none):
        reached = b.bitcast(b.fcmp_ordered('>=', start.value, iteration.value), ir.IntType(LANES))
        b.cbranch(b.icmp_unsigned('!=', reached, ir.IntType(LANES)(0)), where_any, where_none)

    first = b.mul(b.load(b.pointer(positions, INT, FIRST)), step)
    start = _load(b, positions, _FLOATS, _START)
    before, (alike, loop, end) = b.block, (b.append_basic_block() for _ in range(3))
    branch(Vector(b, _FLOATS([1.0] * LANES)), loop, alike)
    b.position_at_end(alike)
    for total, to in zip(sums(first, None), targets, strict=True):
        _store(b, total, to)
    b.branch(end)
    b.position_at_end(loop)
    place, iteration = b.phi(INT), Vector(b, b.phi(_FLOATS))
    later = b.fcmp_ordered('>', start.value, iteration.value)
    for total, to in zip(sums(place, later), targets, strict=True):
        _store(b, start.where('>=', iteration, total, _load(b, to, _FLOATS)), to)
    following = iteration + 2.0
    place.add_incoming(first, before)
    place.add_incoming(b.add(place, b.mul(step, INT(2))), b.block)
    iteration.value.add_incoming(_FLOATS([0.0] * LANES), before)
    iteration.value.add_incoming(following.value, b.block)
    branch(following, loop, end)
    b.position_at_end(end)


def _weighted_sums(b, places, step, weights, taps, t, later):
    """Of the samples from a place on, or of those from the next on where `later`, if given."""
    def sample(place, k):
        here = _load(b, b.add(place, b.mul(step, INT(k))), _FLOATS)
        if later is None:
            return here
        following = _load(b, b.add(place, b.mul(step, INT(k + 1))), _FLOATS)
        return Vector(b, b.select(later, following.value, here.value))

    def weight(k, power):
        return b.spread(b.load(b.pointer(weights, FLOAT, 4 * (power * taps + k))), LANES)

    t2, half, sums = t * t, taps // 2, [None] * len(places)
    for k in range(half):
        even, odd = (weight(k, i) + t2 * (weight(k, i + 2) + t2 * weight(k, i + 4))
                     for i in range(2))
        pair = even + t * odd, even - t * odd
        for i, place in enumerate(places):
            for n, w in zip((k, taps - 1 - k), pair, strict=True):
                term = w * sample(place, n)
                sums[i] = term if sums[i] is None else sums[i] + term
    return sums


def _polynomial(coefficients: Sequence[np.float32], x: Vector) -> Vector:
    value = x * coefficients[0] + coefficients[1]
    for coefficient in coefficients[2:]:
        value = value * x + coefficient
    return value


def _load(b, address, kind, shift=0):
    return Vector(b, b.load(b.pointer(address, kind, shift), align=4))


def _store(b, vector, address, shift=0):
    b.store(vector.value, b.pointer(address, vector.value.type, shift), align=4)


FLOAT_BYTES, DOUBLE_BYTES = 4, 8
_WORK_BYTES = LANES * (POSITION_BYTES + 2 * GROUP_BYTES)
_MOST_LINES = 64  # fetched before they are needed
_PIXELS = 512  # of a row between two passes: what is between them stays in cache
_MOST_STRIPS = 16  # of a job: neighbours share lines of the polar image
_JOBS_PER_THREAD = 4  # at least
_ROUND_ROWS = 16  # or a multiple: whole vectors on all processors
_ROUND_BYTES = 8 << 20  # written by a round on average: tasks wait for each other at its end


def polar_to_map(lines: np.ndarray, polar: PolarGrid, grid: MapGrid, *, axis: int,
                 wavelength_m: float, between: Interpolator, along: Interpolator,
                 onto: np.ndarray | None = None, overwrite: bool = False) -> np.ndarray:
    """Interpolate a polar image at range baseband to a map image.

    Parameters
    ----------
    lines : (2, n_alpha, n_range) float32
        Real and imaginary part. Lines are contiguous and equally far apart in both.
    polar, grid, axis, wavelength_m, between, along :
        As for `backends.reference.polar_to_map`: the polar grid must reach `margin` pixels beyond
        the map on all sides and have `LANES` ranges or more; interpolators are of degree `DEGREE`.
    onto : (n_y, n_x) complex64, optional
        Map to add to, contiguous in C order.
    overwrite : bool
        The map may be written over the polar image, from its first line on, and is where
        `overwriting_rounds` finds few rounds and a line's imaginary part lies behind its real
        part, the next line behind that. Elsewhere it gets memory of its own.

    Returns
    -------
    (n_y, n_x) complex64
    """
    whole, rounds = lines.swapaxes(0, 1), None
    if overwrite and whole.flags.c_contiguous and whole.flags.writeable:
        rounds = overwriting_rounds(polar, grid, axis=axis, between=between, along=along)
    most = 1 + grid.n_y * grid.n_x * SAMPLE_BYTES // _ROUND_BYTES
    if rounds is None or len(rounds) - 1 > most:
        image = np.empty(grid.shape, np.complex64) if onto is None else onto
        rounds = [0, grid.shape[axis]]
    else:
        whole = whole.reshape(-1).view(np.complex64)
        image = whole[:grid.n_y * grid.n_x].reshape(grid.shape)
    line, rows, direction = _positions(polar, grid, axis, between)
    _interpolate(*lines, _Lines(line, rows, direction, polar.height_m, polar.range_start_m,
                                polar.range_spacing_m, polar.n_range, polar.n_alpha),
                 image, rounds, onto is not None, axis, 2 / wavelength_m, between, along)
    return image


def group_to_map(lines: np.ndarray, group: np.void, axes_m: tuple[np.ndarray, np.ndarray],
                 plan: GroupedMap, cycles_per_m: float, image: np.ndarray) -> None:
    """Add the polar image of a group of echoes to a map, whose rows may lie in a larger one.

    Parameters
    ----------
    lines : (n_alpha, 2, n_range) float32
        At range baseband.
    group : GROUP
        The group, of `plan`.
    axes_m : ((n_x,), (n_y,)) float64
        Coordinates of the columns and rows of the map, metres.
    plan : GroupedMap
        With the interpolators.
    cycles_per_m : float
        Of the carrier, by the half path.
    image : (n_y, n_x) complex64
        Map to add to.
    """
    axis = int(group['axis'])
    origin, track = (group['x_m'], group['y_m']), (group['track_x'], group['track_y'])
    line, rows = axes_m[axis] - origin[axis], axes_m[1 - axis] - origin[1 - axis]
    spacing = group['alpha_spacing']
    ahead = math.copysign(track[axis], track[axis] * (line[0] + line[-1]))
    _interpolate(lines[:, 0], lines[:, 1], _Lines(
        line, rows, (float(ahead / spacing), float(track[1 - axis] / spacing),
                     float(group['alpha'] / spacing - plan.between.first)),
        float(group['height_m']), float(group['range_m']), plan.resampling.spacing,
        int(group['n_range']), int(group['n_alpha'])), image, [0, len(rows)], True, axis,
        cycles_per_m, plan.between, plan.along)


def overwriting_rounds(polar: PolarGrid, grid: MapGrid, *, axis: int, between: Interpolator,
                       along: Interpolator) -> list[int] | None:
    """First rows of the rounds in which a map can be written over its polar image, and their end.

    Row q of the map takes the memory of lines ``q n_x / n_range`` to ``(q + 1) n_x / n_range``.
    Rows from q on read no line before ``L(q) = min_{p >= q} first(p)``. So a round that begins
    with row q may reach up to row ``L(q) n_range / n_x``, where the next one begins.

    None where lines become free too late: they must ascend with the rows of the map, whose pixels
    must not be much finer, and where rows of the second pass are columns of the map, its first
    row needs all of them. Arguments are those of `polar_to_map`.
    """
    if axis != 0:
        return None
    first = _first_lines(polar, grid, between, along)
    free = np.minimum.accumulate(first[::-1])[::-1]  # lines before those that it and later read
    fit = free * polar.n_range // grid.n_x
    rounds = [0]
    while rounds[-1] < grid.n_y:
        end = int(fit[rounds[-1]])
        end = grid.n_y if end >= grid.n_y else end - end % _ROUND_ROWS
        if end <= rounds[-1]:
            return None
        rounds.append(end)
    return rounds


def _positions(polar: PolarGrid, grid: MapGrid, axis: int, between: Interpolator
               ) -> tuple[np.ndarray, np.ndarray, tuple[float, float, float]]:
    """Pixels ahead of and rows beside the origin, and how directions are told as lines.

    The last is (ahead, beside, zero): a row meets range r in line ``(ahead sqrt(r^2 - row^2 -
    height^2) + beside row) / r - zero``, the first that is interpolated from.
    """
    line = (grid.x_m, grid.y_m)[axis] - polar.origin_m[axis]
    rows = (grid.y_m, grid.x_m)[axis] - polar.origin_m[1 - axis]
    # side of the origin on which the pixels of a line lie
    sign = 1.0 if line.mean() > 0 else -1.0
    return line, rows, (sign * polar.track[axis] / polar.alpha_spacing,
                        polar.track[1 - axis] / polar.alpha_spacing,
                        polar.alpha_start / polar.alpha_spacing - between.first)


def _first_lines(polar: PolarGrid, grid: MapGrid, between: Interpolator, along: Interpolator
                 ) -> np.ndarray:
    """(n_y,) int64 first line that each row of a map is interpolated from, or one before it."""
    line, rows, (ahead, beside, zero) = _positions(polar, grid, 0, between)
    beside2, along_track = rows ** 2 + polar.height_m ** 2, beside * rows
    # ranges that the pixels at the ends of a row are interpolated from
    near, far = (np.sqrt(ahead2 + beside2) + number * polar.range_spacing_m for ahead2, number in (
        ((line ** 2).min(), along.first - 1), ((line ** 2).max(), along.first + along.n_taps)))
    # between which directions have an extreme at most where their derivative by r is 0
    with np.errstate(over='ignore'):
        extremum = np.divide(ahead * beside2, along_track, out=np.zeros_like(rows),
                         where=along_track != 0)
    r = np.clip([near, np.sqrt(beside2), np.hypot(extremum, np.sqrt(beside2)), far], near, far)
    v = (ahead * np.sqrt(np.maximum(r ** 2 - beside2, 0.0)) + along_track) / r - zero
    # as the kernel bounds them, less what may be rounded otherwise
    v = np.clip(v.min(axis=0), 1.0, polar.n_alpha - between.n_taps - 2.0)
    return np.floor(v).astype(np.int64) - 1


class _Lines(NamedTuple):
    """Lines of a polar image, and pixels that they are interpolated to.

    `line`, `rows` and `direction` are as of `_positions`.
    """

    line: np.ndarray
    rows: np.ndarray
    direction: tuple[float, float, float]
    height_m: float
    range_m: float
    spacing_m: float
    n_range: int
    n_alpha: int


def _interpolate(real: np.ndarray, imag: np.ndarray, lines: _Lines, image: np.ndarray,
                 rounds: Sequence[int], add: bool, axis: int, cycles_per_m: float,
                 between: Interpolator, along: Interpolator) -> None:
    """Rows from one of `rounds` to the next, one round after the other; added or stored."""
    line, rows, direction, height_m, start, step, n_range, n_alpha = lines
    steps = image.strides if axis == 0 else image.strides[::-1]
    pixel = abs(line[-1] - line[0]) / max(len(line) - 1, 1)
    # ranges that _PIXELS pixels read, begun and ended by whole vectors
    length = LANES * (3 + math.ceil((_PIXELS * pixel / step + along.n_taps) / LANES))
    by_range = np.empty((2, n_range + 3 * LANES))
    n_tasks = numba.get_num_threads()
    tables = np.empty((n_tasks, 3, LANES))
    work = aligned_empty((n_tasks, _WORK_BYTES + 2 * length * VECTOR_BYTES), np.uint8)
    for begin, end in itertools.pairwise(rounds):
        n_strips = -(-(end - begin) // LANES)
        job = max(1, min(_MOST_STRIPS, n_strips // (_JOBS_PER_THREAD * n_tasks)))  # its strips
        counter = job_counter()
        _resample((real.ctypes.data, imag.ctypes.data, real.strides[0], n_range,
                   n_alpha - between.n_taps - 2.0),
                  (rows[begin:end], line, direction, height_m ** 2),
                  (by_range, start, step, cycles_per_m),
                  (between.centred.ctypes.data, (0,) * between.n_taps),
                  (along.centred.ctypes.data, (0,) * along.n_taps, along.first),
                  (image.ctypes.data + begin * steps[0], steps, int(add)), tables,
                  (work.ctypes.data, work.strides[0], length * VECTOR_BYTES),
                  (n_strips, job, counter.ctypes.data))


@njit(parallel=True, fastmath=DETERMINISTIC)
def _resample(polar, grid, reach, between, along, target, tables, memory, share):
    """Strip by strip of `LANES` rows, some of their pixels at a time, in both passes.

    `polar` is the addresses of real and imaginary part, bytes between lines, ranges, and the last
    line to interpolate from; `grid` the rows q and pixels p, metres, how directions are told
    (`_positions`), and the square of the height; `reach` an array for r^2 and 1/r by range, from
    `LANES` before the first one on, the first range, their spacing, and cycles of the carrier per
    metre. `between` and `along` are the address of the centred weights and a tuple as
    long as the taps, `along` also the first neighbour. `target` is the address of the first row,
    its steps from row to row and from pixel to pixel, bytes, and 1 to add instead of storing;
    `memory` the address of work space, bytes of a task, and of the real part of a strip; `share`
    the strips, how many are a job, and the address of a `job_counter`.
    """
    real, imag, apart, n_range, last = polar
    rows, line, direction, height2 = grid
    by_range, start, step, cycles_per_m = reach
    ranges = start, 1.0 / step, cycles_per_m
    for i in range(by_range.shape[1]):
        r = max(start + step * (i - LANES), 0.5 * start)
        by_range[0, i], by_range[1, i] = r * r, 1.0 / r
    squares = by_range.ctypes.data
    inverses = squares + DOUBLE_BYTES * by_range.shape[1]
    weights_between, taps_between = between
    weights, taps, first = along
    image, steps, add = target
    work, work_bytes, strip_bytes = memory
    n_strips, job, counter = share
    n_pixels = len(line)
    for task in numba.prange(len(tables)):
        panel = work + task * work_bytes
        strip = panel + _WORK_BYTES
        begin = take_job(counter) * job
        while begin < n_strips:
            for pixel in range(0, n_pixels, _PIXELS):
                n_some = min(_PIXELS, n_pixels - pixel)
                # strips of the same pixels one after the other share lines of the polar image
                for number in range(begin, min(begin + job, n_strips)):
                    for j in range(LANES):
                        beside = rows[min(number * LANES + j, len(rows) - 1)]
                        tables[task, 0, j] = beside
                        tables[task, 1, j] = beside * beside + height2
                    low, middle = line[pixel], line[pixel + n_some // 2]
                    high = line[pixel + n_some - 1]
                    n_chunks = _set_off(tables[task], low * low, middle * middle, high * high,
                                        ranges, first, len(taps))
                    _to_ranges(real, imag, apart, n_range, last, squares, inverses, direction,
                               weights_between, taps_between, tables[task], first, n_chunks,
                               panel, strip, strip_bytes)
                    _to_pixels(line, pixel, n_some, ranges, weights, taps, tables[task],
                               LANES * n_chunks - len(taps) - 1.0, panel, strip, strip_bytes,
                               image + number * LANES * steps[0], steps, add,
                               min(LANES, len(rows) - number * LANES))
            begin = take_job(counter) * job


@kernel_part(fastmath=DETERMINISTIC)
def _set_off(table, from2, middle2, to2, ranges, first, n_taps):
    """Ranges by which each row of a strip is set off, as shifts of its positions in the strip.

    With them the pixels of a column read nearly the same place, and vectors of rows that are not
    set off are aligned. Returns how many times LANES places of the strip are read.
    """
    start, inverse, _ = ranges
    most = -np.inf
    for j in range(LANES):
        table[2, j] = np.floor(np.sqrt(middle2 + table[1, j]) * inverse)
        most = max(most, table[2, j])
    low, high = np.inf, -np.inf
    for j in range(LANES):
        table[2, j] = most - table[2, j]
        for ahead2 in (from2, to2):
            v = (np.sqrt(ahead2 + table[1, j]) - start) * inverse + table[2, j]
            low, high = min(low, v), max(high, v)
    low = np.floor((low + first) / LANES) * LANES
    for j in range(LANES):
        table[2, j] += first - low
    return np.int64(high + first - low + n_taps + 2 + LANES - 1) // LANES


@kernel_part(fastmath=DETERMINISTIC)
def _to_ranges(real, imag, apart, n_range, last, squares, inverses, direction, weights, taps,
               table, first, n_chunks, positions, strip, strip_bytes):
    """Lines of the polar image to where its ranges meet the rows of a strip."""
    ahead, along, zero = direction
    panel = positions + LANES * POSITION_BYTES
    for chunk in range(n_chunks):
        for j in range(LANES):
            place = (LANES + _first_range(chunk, first, table[2, j], n_range)) * DOUBLE_BYTES
            locate_directions(squares + place, inverses + place, table[1, j], ahead,
                              along * table[0, j], zero, last, positions + j * POSITION_BYTES)
        for j in range(LANES):
            shift = _first_range(chunk, first, table[2, j], n_range) * FLOAT_BYTES
            to = panel + j * VECTOR_BYTES
            interpolate(real + shift, imag + shift, apart, weights, taps,
                        positions + j * POSITION_BYTES, to, to + LANES * VECTOR_BYTES)
        first_line = integer_at(positions + FIRST)
        last_line = integer_at(positions + (LANES - 1) * POSITION_BYTES + FIRST)
        place, number = _following_lines(first_line, last_line, len(taps))
        place = place * apart + _first_range(chunk, first, table[2, 0], n_range) * FLOAT_BYTES
        fetch_lines(real + place, apart, number)
        fetch_lines(imag + place, apart, number)
        for part in range(2):
            transpose_floats(panel + part * LANES * VECTOR_BYTES,
                             strip + part * strip_bytes + chunk * LANES * VECTOR_BYTES)


@njit(inline='always')
def _following_lines(first_row, last_row, n_taps):
    """First and number of the lines that the next strip begins to read, by two rows' firsts."""
    number = min((abs(last_row - first_row) * LANES + LANES - 2) // (LANES - 1) + 1, _MOST_LINES)
    return (last_row + n_taps if last_row >= first_row else last_row - number), number


@njit(inline='always')
def _first_range(chunk, first, shift, n_range):
    """Range at a place of a strip; none that is needed where it is far outside the lines."""
    return min(max(chunk * LANES + first - np.int64(shift), -LANES), n_range)


@kernel_part(fastmath=DETERMINISTIC)
def _to_pixels(line, pixel, n_pixels, ranges, weights, taps, table, last, positions, strip,
               strip_bytes, image, steps, add, n_rows):
    """Ranges of a strip to pixels of its rows."""
    start, inverse, cycles_per_m = ranges
    places = table.ctypes.data
    group = positions + LANES * POSITION_BYTES
    rows = group + LANES * GROUP_BYTES
    for begin in range(0, n_pixels, LANES):
        n_some = min(LANES, n_pixels - begin)
        for p in range(n_some):
            ahead = line[pixel + begin + p]
            locate_ranges(ahead * ahead, places + LANES * DOUBLE_BYTES,
                          places + 2 * LANES * DOUBLE_BYTES, start, inverse, cycles_per_m, last,
                          positions + p * POSITION_BYTES)
        for p in range(n_some):
            interpolate_carrier(strip, strip + strip_bytes, VECTOR_BYTES, weights, taps,
                                positions + p * POSITION_BYTES, group + p * GROUP_BYTES)
        to = image + (pixel + begin) * steps[1]
        if steps[0] == SAMPLE_BYTES:  # neighbours of a column lie side by side in the map
            for p in range(n_some):
                put_samples(group + p * GROUP_BYTES, to + p * steps[1], n_rows, add)
            continue
        for part in range(0, LANES * LANES, LANES * BLOCK):
            for side in range(0, LANES, BLOCK):
                transpose(group + (part + side) * SAMPLE_BYTES, GROUP_BYTES,
                          rows + (side * LANES + part // LANES) * SAMPLE_BYTES, GROUP_BYTES)
        for j in range(n_rows):
            put_samples(rows + j * GROUP_BYTES, to + j * steps[0], n_some, add)
