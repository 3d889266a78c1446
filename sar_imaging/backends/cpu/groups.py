# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Maps from groups of echoes: lines of their parts, sums of these, and the way to the map.

Formulas are those of `planning.exact.group_geometry`. A line of a part is read from polynomials of
the profiles in segments, as `lines` does it, but the geometry of an echo, a line and a segment is
one square root. Lines are at range baseband, and less the middle frequency of their part along
direction. They lie block by block, (blocks, parts, lines, 2, LANES) float32, so that a block of
ranges of all parts, which all lines of the sum read, stays in the second cache.

Functions written as instructions take addresses as int64; tuples are as long as what is known when
code is written.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from llvmlite import ir
from numba.core import types

from ...compilation import kernel_part, njit, numba
from ...planning.exact.backprojection import BackprojectionPlan
from ...planning.exact.groups import QUAD, GroupedMap
from ...planning.exact.points import ImagePoints
from .instructions import (
    DOUBLE,
    FLOAT,
    INT,
    INT32,
    LANES,
    Vector,
    instructions,
    job_counter,
    take_job,
)
from .memory import WorkSpace
from .phasors import COSINES, SINES
from .polar_to_map import _polynomial, group_to_map
from .profiles import Profiles

if TYPE_CHECKING:
    from ...planning.profiles import PhaseHistory, RangeGate

LINES = 16  # of a part whose geometry is computed together
_CHUNK_BYTES = 3 << 20  # coefficients of the echoes that are added together, on each thread
_BLOCK_BYTES = 8 * LANES
_FLOATS = ir.VectorType(FLOAT, LANES)
_i, _d = types.int64, types.float64


@instructions(_i, _i, None, _i, _i, _i, _i, _i)
def add_echo(b, planes, plane_bytes, degrees, coefficients, work, behind, n_vectors, numbers):
    """Add an echo to a segment of a line, LANES ranges at a time.

    `planes` is the address of the first real coefficient, `degrees` a tuple as long as their
    degree, `coefficients` the first of eleven, LINES float32 apart: of the position, a parabola,
    and of the phasor, cubics. `work` is the real part of the segment, `behind` bytes after which
    lies the imaginary one; `numbers` counts the ranges from the middle.
    """
    degree = degrees.type.count
    k = [b.spread(b.load(b.pointer(coefficients, FLOAT, 4 * LINES * n)), LANES) for n in range(11)]
    rows = [planes]
    for _ in range(2 * degree + 1):
        rows.append(b.add(rows[-1], plane_bytes))
    before, loop, end = b.block, b.append_basic_block(), b.append_basic_block()
    b.branch(loop)
    b.position_at_end(loop)
    index = b.phi(INT)
    shift = b.mul(index, INT(4 * LANES))

    def load(address):
        return Vector(b, b.load(b.pointer(b.add(address, shift), _FLOATS), align=4))

    f = load(numbers)
    t = (k[2] * f + k[1]) * f + k[0]
    cosine = ((k[9] * f + k[7]) * f + k[5]) * f + k[3]
    sine = ((k[10] * f + k[8]) * f + k[6]) * f + k[4]
    parts = []
    for part in (0, 1):
        first = part * (degree + 1)
        value = load(rows[first + degree])
        for n in range(degree - 1, -1, -1):
            value = value * t + load(rows[first + n])
        parts.append(value)
    re, im = parts
    to = b.add(work, shift)
    for place, value in ((to, re * cosine - im * sine),
                         (b.add(to, behind), re * sine + im * cosine)):
        place = b.pointer(place, _FLOATS)
        b.store((Vector(b, b.load(place, align=4)) + value).value, place, align=4)
    following = b.add(index, INT(1))
    index.add_incoming(INT(0), before)
    index.add_incoming(following, loop)
    b.cbranch(b.icmp_signed('<', following, n_vectors), loop, end)
    b.position_at_end(end)


@instructions(_i, _i, _i, _i, _d, _d, _d, _d, _i, _i)
def store_line(b, work, behind, n_vectors, numbers, constant, first, second, third, to, step):
    """Store a segment of a line times a phasor, LANES ranges at a time, `step` bytes apart.

    The phasor's cycles are a cubic in `numbers`; other arguments are those of `add_echo`.
    """
    cycles = [b.spread(v, LANES).rounded() for v in (third, second, first, constant)]
    before, loop, end = b.block, b.append_basic_block(), b.append_basic_block()
    b.branch(loop)
    b.position_at_end(loop)
    index, place = b.phi(INT), b.phi(INT)
    shift = b.mul(index, INT(4 * LANES))
    f, re, im = (Vector(b, b.load(b.pointer(b.add(address, shift), _FLOATS), align=4))
                 for address in (numbers, work, b.add(work, behind)))
    g = _polynomial(cycles, f)
    g = g - g.call('rint')
    sine, cosine = g * _polynomial(SINES, g * g), _polynomial(COSINES, g * g)
    for part, value in enumerate((re * cosine - im * sine, re * sine + im * cosine)):
        b.store(value.value, b.pointer(place, _FLOATS, part * 4 * LANES), align=4)
    following = b.add(index, INT(1))
    for phi, start, later in ((index, INT(0), following), (place, to, b.add(place, step))):
        phi.add_incoming(start, before)
        phi.add_incoming(later, loop)
    b.cbranch(b.icmp_signed('<', following, n_vectors), loop, end)
    b.position_at_end(end)


@instructions(_i, _i, _i, _i, None, _i, _i, _i)
def sum_parts(b, source, part_bytes, n_parts, weights, taps, phasors, target, target_bytes):
    """Weighted sums of lines of all parts, each times its part's phasor, as four lines.

    Of each part, `part_bytes` apart, as many lines from `source` on as the tuple `taps` is long;
    weights are (taps, 4) float32, phasors (parts, 4, 2). The real part of the first line is stored
    at `target`, its imaginary part `target_bytes` behind it, and so on.
    """
    before, loop, end = b.block, b.append_basic_block(), b.append_basic_block()
    b.branch(loop)
    b.position_at_end(loop)
    index, place, turn = b.phi(INT), b.phi(INT), b.phi(INT)
    totals, sums = [b.phi(_FLOATS) for _ in range(2 * QUAD)], [None] * (2 * QUAD)
    for k in range(taps.type.count):
        values = [Vector(b, b.load(b.pointer(place, _FLOATS, k * _BLOCK_BYTES + part * 4 * LANES),
                                   align=4)) for part in (0, 1)]
        for n in range(2 * QUAD):
            w = b.spread(b.load(b.pointer(weights, FLOAT, 4 * (QUAD * k + n // 2))), LANES)
            term = w * values[n % 2]
            sums[n] = term if sums[n] is None else sums[n] + term
    results = []
    for line in range(QUAD):
        c, s = (b.spread(b.load(b.pointer(turn, FLOAT, 8 * line + 4 * i)), LANES) for i in (0, 1))
        re, im = sums[2 * line], sums[2 * line + 1]
        results += [Vector(b, totals[2 * line]) + re * c - im * s,
                    Vector(b, totals[2 * line + 1]) + re * s + im * c]
    following = b.add(index, INT(1))
    steps = b.add(place, part_bytes), b.add(turn, INT(8 * QUAD))
    for phi, first, later in (
            (index, INT(0), following), (place, source, steps[0]), (turn, phasors, steps[1]),
            *((t, _FLOATS([0.0] * LANES), r.value) for t, r in zip(totals, results, strict=True))):
        phi.add_incoming(first, before)
        phi.add_incoming(later, b.block)
    b.cbranch(b.icmp_signed('<', following, n_parts), loop, end)
    b.position_at_end(end)
    for n, result in enumerate(results):
        to = b.add(target, b.mul(target_bytes, INT(n)))
        b.store(result.value, b.pointer(to, _FLOATS), align=4)


class Cells(NamedTuple):
    """Profiles of some echoes as the compiled loop over parts takes them.

    Parameters
    ----------
    planes : int
        Address of the coefficients of `Profiles.planes`.
    first : int
        First of the echoes.
    n_phases, n_planes, n_cells : int
        Their shape but for the echoes.
    step_m, cycles_per_m : float
        Half path from position to position, and cycles of the carrier.
    constants : (7,) float64
        As `expand_echo` takes them: half path at the first cell after as many of padding as a
        segment has, metres; positions in a metre; cycles of the carrier from position to position,
        and at that cell; 1 over `n_phases`; the last cell that a segment may begin with its middle
        at; and coefficients of a phase.
    """

    planes: int
    first: int
    n_phases: int
    n_planes: int
    n_cells: int
    step_m: float
    cycles_per_m: float
    constants: np.ndarray


class PartLines(NamedTuple):
    """Lines of the parts of a group, and where they go.

    Parameters
    ----------
    alpha : (J,) float64
        Directions of the lines, in whole blocks of `LINES`.
    n_lines, n_parts, n_range : int
        Lines of a part, parts, ranges.
    range_m, spacing_m : float
        First range and spacing.
    middles : (S,) float64
        Ranges in the middle of segments, metres.
    geometry : (S, J / LINES, 7, LINES) float64
        What `line_geometry` gives.
    images : (K,) float32
        The lines, see the module's text.
    """

    alpha: np.ndarray
    n_lines: int
    n_parts: int
    n_range: int
    range_m: float
    spacing_m: float
    middles: np.ndarray
    geometry: np.ndarray
    images: np.ndarray


class PartWork(NamedTuple):
    """Arrays that the tasks of the compiled loop work in; `numbers` counts from the middle."""

    sums: np.ndarray
    coefficients: np.ndarray
    paths: np.ndarray
    drifts: np.ndarray
    places: np.ndarray
    numbers: np.ndarray


@njit(inline='always')
def _forward(r, alpha, height, least):
    """How far ahead a place lies, continued beside the map, see `group_geometry`."""
    s = 1.0 - alpha * alpha - (height / r) ** 2
    q = least * least
    if s >= q:
        return r * np.sqrt(s)
    d = (s - q) / q
    return r * least * (1.0 + d * (0.5 + d * (-0.125 + d * 0.0625)))


@njit(distinct=True, error_model='numpy')
def line_geometry(middles, alpha, height, least, reach, out):
    """Of each segment's middle and line alpha r, r^2, alpha, and f with three derivatives by r.

    These are of the cubic through four ranges of the segment, which reaches `reach` to either
    side; `out` is (S, J / LINES, 7, LINES).
    """
    u = 0.75 * reach
    for s in range(len(middles)):
        for j in range(len(alpha)):
            a, r = alpha[j], middles[s]
            f0, f3 = _forward(r - u, a, height, least), _forward(r + u, a, height, least)
            f1 = _forward(r - u / 3.0, a, height, least)
            f2 = _forward(r + u / 3.0, a, height, least)
            even, odd, inner = 0.5 * (f3 + f0), 0.5 * (f3 - f0), 0.5 * (f2 - f1)
            second = (even - 0.5 * (f2 + f1)) * 9.0 / 8.0
            third = (odd - 3.0 * inner) * 9.0 / 8.0
            b, i = j // LINES, j % LINES
            out[s, b, 0, i], out[s, b, 1, i], out[s, b, 2, i] = a * r, r * r, a
            out[s, b, 3, i] = even - second
            out[s, b, 4, i] = (odd - third) / u
            out[s, b, 5, i] = 2.0 * second / (u * u)
            out[s, b, 6, i] = 6.0 * third / (u * u * u)


@instructions(_i, _d, _i, _i)
def find_paths(b, geometry, r, centre, paths):
    """Distances of a segment's middle from a phase centre and three derivatives by r.

    `geometry` is the address of those of `line_geometry` for LINES lines, `centre` that of X, Y
    and c; what is found is (4, LINES) float64 at `paths`.
    """
    ar, rr, alpha, f, f1, f2, f3 = (_row(b, geometry, n) for n in range(7))
    x, y, c = (b.spread(b.load(b.pointer(centre, DOUBLE, 8 * n)), LINES) for n in range(3))
    square = rr - (x + x) * ar + c - (y + y) * f
    d = square.call('sqrt')
    inverse = Vector(b, b.fdiv(square.value.type([1.0] * LINES), d.value))
    d1 = (b.spread(r, LINES) - x * alpha - y * f1) * inverse
    d2 = (-(y * f2) - d1 * d1 + 1.0) * inverse
    d3 = (-(y * f3) - d1 * d2 * 3.0) * inverse
    for n, value in enumerate((d, d1, d2, d3)):
        _put(b, value, paths, n)


@instructions(_i, _i, _d, _d, _d, _i)
def find_drifts(b, paths, others, per_cell, spacing, n_phases, drifts):
    """First to third order of segments' drifts over ranges, (3, LINES) float64 at `drifts`.

    In positions per range; `paths` and `others` are the addresses of what `find_paths` found of
    transmitter and receiver.
    """
    for n, drift in enumerate(_drifts(b, paths, others, per_cell, spacing, n_phases)):
        _put(b, drift, drifts, n)


@instructions(_i, _i, _d, _d, _d, _i, _i, _d, _i, _i)
def expand_echo(b, paths, others, per_cell, spacing, n_phases, drifts, constants, half,
                coefficients, places):
    """Coefficients for `add_echo` of LINES lines, and from which cells on they read.

    The phasor is less what the echoes of a part share, whose `drifts` are as of `find_drifts`.
    Its quartic term is folded into the constant and the quadratic one (Chebyshev economisation),
    which leaves an eighth of it. `constants` is the address of `Cells.constants`, `half` that of
    a segment; places are int32.
    """
    zero, inverse_step, cycles_per_step, cycles, inverse_phases, last, per_phase = (
        b.spread(b.load(b.pointer(constants, DOUBLE, 8 * n)), LINES) for n in range(7))
    v = ((_row(b, paths, 0) + _row(b, others, 0)) * 0.5 - zero) * inverse_step
    n = v.call('floor')
    cell = ((n + 0.5) * inverse_phases).call('floor')
    phases, half = b.spread(n_phases, LINES), b.spread(half, LINES)
    phase = n - cell * phases
    # A segment outside the profile reads padding only.
    cell = cell.where('>', -half, cell, -half)
    cell = cell.where('<', last, cell, last)
    place = b.fptosi((phase * per_phase + cell + half).value, ir.VectorType(INT32, LINES))
    b.store(place, b.pointer(places, place.type), align=4)
    t = v - n
    drift = _drifts(b, paths, others, per_cell, spacing, n_phases)
    turns = n * cycles_per_step + cycles
    turns = turns - turns.call('rint') + t * cycles_per_step
    g = (turns - turns.call('rint')).rounded()
    sine, cosine = g * _polynomial(SINES, g * g), _polynomial(COSINES, g * g)
    a, second, third = (((one - _row(b, drifts, n)) * cycles_per_step * (2 * np.pi)).rounded()
                        for n, one in enumerate(drift))
    aa, square = a * a, (half * half).rounded()
    # exp(j (a f + b f^2 + c f^3)) = 1 + j a f + (j b - a^2/2) f^2 + ...
    r4 = aa * aa * (1 / 24) - second * second * 0.5 - a * third
    i4 = -(aa * second * 0.5)
    r3, i3 = -(a * second), third - aa * a * (1 / 6)
    r2, i2 = square * r4 - aa * 0.5, square * i4 + second
    fourth = square * square * (-1 / 8)
    r0, i0 = fourth * r4 + 1.0, fourth * i4
    for n, value in enumerate((
            t.rounded(), drift[0].rounded(), drift[1].rounded(),
            cosine * r0 - sine * i0, cosine * i0 + sine * r0, -(sine * a), cosine * a,
            cosine * r2 - sine * i2, cosine * i2 + sine * r2,
            cosine * r3 - sine * i3, cosine * i3 + sine * r3)):
        _put(b, value, coefficients, n)


def _drifts(b, paths, others, per_cell, spacing, n_phases):
    scale, spacing = b.spread(per_cell, LINES) * 0.5, b.spread(spacing, LINES)
    first, second, third = (_row(b, paths, n) + _row(b, others, n) for n in (1, 2, 3))
    twice = scale * spacing * 0.5
    return (first * scale - b.spread(n_phases, LINES), second * twice,
            third * twice * spacing * (1 / 3))


def _row(b, address, number) -> Vector:
    kind = ir.VectorType(DOUBLE, LINES)
    return Vector(b, b.load(b.pointer(address, kind, number * 8 * LINES), align=8))


def _put(b, vector, address, number) -> None:
    kind = vector.value.type
    size = 8 if kind.element == DOUBLE else 4
    b.store(vector.value, b.pointer(address, kind, number * size * LINES), align=size)


@njit(parallel=True, error_model='numpy')
def form_parts(cells, degrees, tx, rx, repeats, parts, frequency, lines, work, counter):
    """Lines of some parts of a group, stored.

    Parameters
    ----------
    cells : Cells
        Profiles of their echoes.
    degrees : tuple
        As long as their degree.
    tx, rx : (E, 3) float64
        X, Y and c of all echoes.
    repeats : (E, 2) uint8
        1 where a transmitter is that of the echo before, and a receiver its transmitter.
    parts : (P, 3) int64
        First echo, end, and number of each part in the group.
    frequency : (P',) float64
        Cycles per unit of direction to be taken off, by the number of a part.
    lines : PartLines
        The lines.
    work : PartWork
        For each task.
    counter : int
        Address of a `job_counter`.
    """
    n_blocks = len(lines.alpha) // LINES
    n_jobs = len(parts) * n_blocks
    for task in numba.prange(len(work.sums)):
        job = take_job(counter)
        while job < n_jobs:
            part, block = parts[job // n_blocks], job % n_blocks
            for s in range(len(lines.middles)):
                # the loop runs with an unsigned task; Numba would compile for a signed one, too
                _form_segment(cells, degrees, tx, rx, repeats, part, frequency[part[2]], lines,
                              work, np.uint64(task), block, s)
            job = take_job(counter)


@kernel_part(error_model='numpy')
def _form_segment(cells, degrees, tx, rx, repeats, part, frequency, lines, work, task, block, s):
    """A segment of LINES lines of a part."""
    begin, end = part[0], part[1]
    segment = len(work.numbers)
    n_some = min(LINES, lines.n_lines - block * LINES)
    n_vectors = min(segment, lines.n_range - s * segment) // LANES
    r, dr, n_phases = lines.middles[s], lines.spacing_m, 1.0 * cells.n_phases
    per_cell = dr / cells.step_m
    per_echo = cells.n_phases * cells.n_planes * cells.n_cells
    geometry = lines.geometry.ctypes.data + 8 * (s * (len(lines.alpha) // LINES) + block) * (
        7 * LINES)
    sums = work.sums.ctypes.data + 8 * task * LINES * segment
    coefficients = work.coefficients.ctypes.data + 4 * task * 11 * LINES
    paths = work.paths.ctypes.data + 8 * task * 8 * LINES
    drifts = work.drifts.ctypes.data + 8 * task * 3 * LINES
    constants, numbers = cells.constants.ctypes.data, work.numbers.ctypes.data
    at_tx, at_rx = tx.ctypes.data, rx.ctypes.data
    for i in range(2 * LINES * segment):
        work.sums[task, i] = 0.0
    middle = (begin + end) // 2
    others = paths + 8 * 4 * LINES
    find_paths(geometry, r, at_tx + 24 * middle, paths)
    find_paths(geometry, r, at_rx + 24 * middle, others)
    find_drifts(paths, others, per_cell, dr, n_phases, drifts)
    for echo in range(begin, end):
        if repeats[echo, 0] == 0 or echo == begin:
            find_paths(geometry, r, at_tx + 24 * echo, paths)
        others = paths
        if repeats[echo, 1] == 0:
            others = paths + 8 * 4 * LINES
            find_paths(geometry, r, at_rx + 24 * echo, others)
        expand_echo(paths, others, per_cell, dr, n_phases, drifts, constants, 0.5 * segment,
                    coefficients, work.places.ctypes.data + 4 * task * LINES)
        planes = cells.planes + 4 * (echo - cells.first) * per_echo
        for j in range(n_some):
            add_echo(planes + 4 * np.int64(work.places[task, j]), 4 * cells.n_cells, degrees,
                     coefficients + 4 * j, sums + 8 * j * segment, 4 * segment, n_vectors,
                     numbers)
    # at range baseband, with the phasor that the echoes of the part share
    step, scale = lines.n_parts * lines.n_lines, cells.cycles_per_m * cells.step_m
    for j in range(n_some):
        line = block * LINES + j
        c = -cells.cycles_per_m * (r - lines.range_m) - frequency * lines.alpha[line]
        first = scale * (work.drifts[task, 0, j] + n_phases) - cells.cycles_per_m * dr
        place = (s * (segment // LANES) * lines.n_parts + part[2]) * lines.n_lines + line
        store_line(sums + 8 * j * segment, 4 * segment, n_vectors, numbers, c - np.rint(c), first,
                   scale * work.drifts[task, 1, j], scale * work.drifts[task, 2, j],
                   lines.images.ctypes.data + place * _BLOCK_BYTES, step * _BLOCK_BYTES)


def quad_width(n_taps: int, spacing: float, coarse_spacing: float) -> int:
    """Lines of a part that four lines of a group read: few numbers, for each is compiled."""
    apart = math.ceil((QUAD - 1) * spacing / coarse_spacing + 1e-9)
    return n_taps + (1 if apart == 1 else max(apart, QUAD))


@njit(error_model='numpy')
def part_weights(group, frequency, first, interpolator, starts, weights, phasors):
    """How lines of parts become the lines of their group, four at a time.

    Parameters
    ----------
    group : GROUP
        The group.
    frequency : (P,) float64
        Cycles per unit of direction of each part.
    first, interpolator : int, (degree + 1, taps) float64
        Of the interpolator between lines of parts.
    starts, weights, phasors : (Q,) int64, (Q, `quad_width`, 4), (Q, P, 4, 2) float32
        First line of the parts that four lines read, weights, and phasors of the parts; filled.
    """
    n_taps, latest = interpolator.shape[1], np.int64(group.n_coarse) - weights.shape[1]
    weights[:] = 0.0
    for quad in range(len(starts)):
        for line in range(QUAD):
            alpha = group.alpha + group.alpha_spacing * (QUAD * quad + line)
            v = (alpha - group.coarse) / group.coarse_spacing
            low = np.floor(v)
            if line == 0:  # what all four read lies within the lines of a part
                starts[quad] = min(np.int64(low) + first, latest)
            shift, t = np.int64(low) + first - starts[quad], v - low
            for tap in range(n_taps):
                w = 0.0
                for power in range(len(interpolator) - 1, -1, -1):
                    w = w * t + interpolator[power, tap]
                weights[quad, shift + tap, line] = w
            for part in range(len(frequency)):
                c = alpha * frequency[part]
                c = 2.0 * np.pi * (c - np.rint(c))
                phasors[quad, part, line, 0] = np.cos(c)
                phasors[quad, part, line, 1] = np.sin(c)


@njit(parallel=True)
def merge(images, n_lines, starts, weights, taps, phasors, total, n_range):
    """Sum the lines of all parts; arrays but `starts` are addresses, `phasors` have a shape.

    `phasors` is (address, parts), `total` (lines, 2, n_range) float32.
    """
    place, n_parts = phasors
    for block in numba.prange(n_range // LANES):
        for quad in range(len(starts)):
            sum_parts(images + (block * n_parts * n_lines + starts[quad]) * _BLOCK_BYTES,
                      n_lines * _BLOCK_BYTES, n_parts, weights + quad * len(taps) * QUAD * 4, taps,
                      place + quad * n_parts * QUAD * 8,
                      total + 4 * (quad * QUAD * 2 * n_range + block * LANES), n_range * 4)


class GroupImages:
    """Adds echoes to a map by a plan of groups.

    Parameters
    ----------
    plan : BackprojectionPlan
        By a `GroupPlan`.
    memory : WorkSpace
        Shared with other plans whose echoes are added in turn.
    """

    def __init__(self, plan: BackprojectionPlan, memory: WorkSpace):
        route, cycles_per_m = plan.route, 2 / plan.radar.wavelength_m
        self._points, self._memory = route.points, memory
        self._maps = [_Map(one, route.window, cycles_per_m, memory) for one in route.maps]
        self._rest = [(corner, ImagePoints.of_grid(grid)) for corner, grid in route.rest]

    def add(self, samples: np.ndarray, tx_m: np.ndarray, rx_m: np.ndarray, image: np.ndarray
            ) -> None:
        """Add echoes to an image, see `backends.protocol.Backprojection`."""
        for one in self._maps:
            one.add(samples, _part_of(image, one.plan.corner, one.plan.grid.shape))
        if self._rest:
            from .points import project_points  # few maps have parts that no group suits

        for corner, points in self._rest:
            part = np.zeros(points.shape, np.complex64)
            project_points(self._points, [points], samples, tx_m, rx_m,
                           part.reshape(-1).view(np.float32), self._memory)
            onto = _part_of(image, corner, points.shape)
            onto += part


def _part_of(image: np.ndarray, corner: tuple[int, int], shape: tuple[int, int]) -> np.ndarray:
    row, column = corner
    return image[row:row + shape[0], column:column + shape[1]]


class _Map:
    """A map, or a part of one, from groups."""

    def __init__(self, plan: GroupedMap, window: RangeGate | PhaseHistory, cycles_per_m: float,
                 memory: WorkSpace):
        self.plan, self._memory, self._cycles_per_m = plan, memory, cycles_per_m
        self._profiles = Profiles(window, plan.resampling, plan.range_m, memory)
        self._phase_range_m = window.phase_range_m
        self._repeats = np.zeros((len(plan.tx), 2), np.uint8)
        self._repeats[1:, 0] = (plan.tx[1:] == plan.tx[:-1]).all(axis=1)
        self._repeats[:, 1] = plan.tx is plan.rx or (plan.tx == plan.rx).all(axis=1)
        self._cycles = plan.frequency / (2 * np.pi)
        self._weights = plan.parts.weights.astype(np.float64)
        self._axes = plan.grid.x_m, plan.grid.y_m
        number, first, end = np.arange(plan.n_parts + 1), *(
            plan.groups[name][:, None] for name in ('first', 'end'))
        self._edges = first + number * (end - first) // plan.n_parts
        self._parts = np.stack([self._edges[:, :-1], self._edges[:, 1:], np.broadcast_to(
            number[:-1], self.plan.frequency.shape)], axis=-1)

    def add(self, samples: np.ndarray, image: np.ndarray) -> None:
        done, cells, work = 0, None, self._work()
        for number, group in enumerate(self.plan.groups):
            lines, edges = self._lines(group), self._edges[number]
            part = 0
            while part < len(edges) - 1:
                if edges[part] >= done:
                    done = self._until(number, edges, part)
                    cells = self._cells(samples, int(edges[part]), done)
                end = int(np.searchsorted(edges, done, 'right')) - 1
                counter = job_counter()
                form_parts(cells, (0,) * (cells.n_planes // 2 - 1), self.plan.tx, self.plan.rx,
                           self._repeats, self._parts[number, part:end], self._cycles[number],
                           lines, work, counter.ctypes.data)
                part = end
            total = self._merged(number, lines)
            group_to_map(total, group, self._axes, self.plan, self._cycles_per_m, image)

    def _until(self, number: int, edges: np.ndarray, part: int) -> int:
        """End of the echoes that are resampled together: whole groups, or whole parts of one."""
        per_echo = 4 * self.plan.resampling.interpolator.n_planes * (
            self.plan.resampling.n_phases * self._profiles.n_cells)
        most = edges[part] + max(1, numba.get_num_threads() * _CHUNK_BYTES // per_echo)
        ends = self.plan.groups['end'][number:]
        if part == 0 and ends[0] <= most:
            return int(ends[ends <= most][-1])
        return int(max(edges[part + 1], edges[edges <= most][-1]))

    def _cells(self, samples: np.ndarray, first: int, end: int) -> Cells:
        profiles, resampling = self._profiles, self.plan.resampling
        planes = self._planes = profiles.planes(samples[first:end])
        _, n_phases, n_planes, n_cells = planes.shape
        zero_m, segment = profiles.range_at(resampling.segment), resampling.segment
        cycles = self._cycles_per_m * (zero_m - self._phase_range_m)
        return Cells(planes.ctypes.data, first, n_phases, n_planes, n_cells, resampling.step_m,
                     self._cycles_per_m, np.array([
                         zero_m, 1 / resampling.step_m, self._cycles_per_m * resampling.step_m,
                         math.fmod(cycles, 1.0), 1 / n_phases, n_cells - 1.5 * segment,
                         n_planes * n_cells]))

    def _work(self) -> PartWork:
        n_tasks, segment = numba.get_num_threads(), self.plan.resampling.segment
        return PartWork(self._memory('sums', (n_tasks, 2 * LINES * segment), np.float32),
                        self._memory('coefficients', (n_tasks, 11, LINES), np.float32),
                        self._memory('paths', (n_tasks, 8, LINES), np.float64),
                        self._memory('drifts', (n_tasks, 3, LINES), np.float64),
                        self._memory('places', (n_tasks, LINES), np.int32),
                        np.arange(segment, dtype=np.float32) - segment // 2)

    def _lines(self, group: np.void) -> PartLines:
        plan, segment, dr = self.plan, self.plan.resampling.segment, self.plan.resampling.spacing
        n_range, n_lines = int(group['n_range']), int(group['n_coarse'])
        range_m, n_blocks = float(group['range_m']), -(-n_lines // LINES)
        middles = range_m + dr * (segment // 2 + segment * np.arange(-(-n_range // segment)))
        alpha = group['coarse'] + group['coarse_spacing'] * np.arange(n_blocks * LINES)
        geometry = self._memory('geometry', (len(middles), n_blocks, 7, LINES), np.float64)
        line_geometry(middles, alpha, group['height_m'], group['least'], 0.5 * dr * segment,
                      geometry)
        images = self._memory('parts', (2 * n_range * n_lines * plan.n_parts,), np.float32)
        return PartLines(alpha, n_lines, plan.n_parts, n_range, range_m, dr, middles, geometry,
                         images)

    def _merged(self, number: int, lines: PartLines) -> np.ndarray:
        """(n_alpha, 2, n_range) float32 sum of the parts, at baseband."""
        plan, group = self.plan, self.plan.groups[number]
        n_quads = int(group['n_alpha']) // QUAD
        width = quad_width(plan.parts.n_taps, group['alpha_spacing'], group['coarse_spacing'])
        starts = np.empty(n_quads, np.int64)
        weights = np.empty((n_quads, width, QUAD), np.float32)
        phasors = np.empty((n_quads, plan.n_parts, QUAD, 2), np.float32)
        part_weights(group, self._cycles[number], plan.parts.first, self._weights, starts, weights,
                     phasors)
        total = self._memory('polar image', (n_quads * QUAD, 2, lines.n_range), np.float32)
        merge(lines.images.ctypes.data, lines.n_lines, starts, weights.ctypes.data, (0,) * width,
              (phasors.ctypes.data, plan.n_parts), total.ctypes.data, lines.n_range)
        return total
