# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Backprojection along image lines on the device: their geometry, and the kernel.

It computes what `backends.reference.project_lines` says, by the expansions of the processor's
kernel: paths in float64, once for each segment of a line and echo, samples and sums in float32.

A block of threads computes a segment of some lines. A thread has `PIXELS` pixels of the segment in
each of `LINES` neighbouring lines, whose sums stay in its registers. Neighbouring lines mostly
read the same cells of a profile, so that a cell's polynomials are loaded once for several lines:
arithmetic, 20 multiply-adds for a pixel and echo, is the bound that is left. All threads together
compute the geometry of some echoes into shared memory, then each adds these echoes to its pixels.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ...geometry.illumination import Illumination
from ...geometry.polar import PolarGrid
from ...planning.exact.illumination import LINES as NODE_LINES, LineAmplitudes, node_positions
from ...planning.profiles import PhaseHistory, RangeGate, RangeResampling
from .arrays import cuda, function, kernel, launch, load_pair, pairs, xp
from .illumination import Antennas
from .phasors import fraction, phasor, short_fraction
from .profiles import Profiles
from .transfers import in_pieces

if TYPE_CHECKING:  # of pixels and lines to positions and their derivatives
    _Locate = Callable[[np.ndarray, np.ndarray], Sequence[np.ndarray]]

THREADS, LINES, PIXELS = 128, 8, 2
ECHOES = 32  # most echoes that share the reference for the phase: `ECHOES_PER_PASS` of plans
_ITEMS = 512  # echoes times lines of a block whose geometry lies in shared memory
_LINES_TOGETHER = LINES * THREADS * PIXELS // 8  # of a block, for the shortest segments
FOLD = 5  # cells of a block, 32, whose coefficients of one power stand together
_BLOCK, _BLOCK_PAIRS = 1 << FOLD, np.uint64(5 << FOLD)  # cells, and coefficients: of degree 4
_FOLD, _IN_BLOCK = np.uint32(FOLD), np.uint32(_BLOCK - 1)
_REGISTERS = 168  # that three blocks may run at once, and nearly nothing is spilled
_DARK = np.int32(-1)  # in place of the first cell of a line that an echo does not illuminate
_SUMS, _CELLS = LINES * PIXELS, 5 * PIXELS  # registers of a thread
_PLACE, _PHASOR = 3, 8  # numbers of an item
_DRIFT, _CYCLES = 3, 4  # numbers of a line of the shared reference
_R2, _R6, _R8, _R24 = (np.float32(1 / v) for v in (2, 6, 8, 24))
_ONE = np.float32(1.0)


def block_lines(segment: int) -> int:
    """Lines of a block of threads, for segments of a power of 2 pixels from 8 to 256."""
    return LINES * THREADS * PIXELS // segment


@function
def distances(lines, number, line, x, y, z):
    """Distance of a segment's middle from a phase centre, and its derivatives by the pixel.

    Leibniz' rule for ``d^2 = |o|^2``. `lines` holds position and first to third derivative.
    """
    x, y, z = lines[number, 0, line] - x, lines[number, 1, line] - y, lines[number, 2, line] - z
    ex, ey, ez = lines[number, 3, line], lines[number, 4, line], lines[number, 5, line]
    gx, gy, gz = lines[number, 6, line], lines[number, 7, line], lines[number, 8, line]
    hx, hy, hz = lines[number, 9, line], lines[number, 10, line], lines[number, 11, line]
    d = math.sqrt(x * x + y * y + z * z)
    inverse = 1.0 / d
    d1 = (x * ex + y * ey + z * ez) * inverse
    d2 = (ex * ex + ey * ey + ez * ez + x * gx + y * gy + z * gz - d1 * d1) * inverse
    d3 = (3.0 * (ex * gx + ey * gy + ez * gz) + x * hx + y * hy + z * hz
          - 3.0 * d1 * d2) * inverse
    return d, d1, d2, d3


@function
def fourth_derivative(lines, number, line, x, y, z):
    """Fourth derivative of what `distances` gives."""
    d, d1, d2, d3 = distances(lines, number, line, x, y, z)
    centre, fourth = (x, y, z), -4.0 * d1 * d3 - 3.0 * d2 * d2
    for axis in range(3):
        second = lines[number, 6 + axis, line]
        fourth += (3.0 * second * second
                   + 4.0 * lines[number, 3 + axis, line] * lines[number, 9 + axis, line]
                   + (lines[number, axis, line] - centre[axis]) * lines[number, 12 + axis, line])
    return fourth / d


@function
def half_path(lines, number, line, centres, echo):
    """Half path to a segment's middle and its derivatives; `centres` are tx and rx, (R, 6)."""
    a, a1, a2, a3 = distances(lines, number, line, centres[echo, 0], centres[echo, 1],
                              centres[echo, 2])
    if (centres[echo, 0] == centres[echo, 3] and centres[echo, 1] == centres[echo, 4]
            and centres[echo, 2] == centres[echo, 5]):  # one antenna
        return a, a1, a2, a3
    b, b1, b2, b3 = distances(lines, number, line, centres[echo, 3], centres[echo, 4],
                              centres[echo, 5])
    return 0.5 * (a + b), 0.5 * (a1 + b1), 0.5 * (a2 + b2), 0.5 * (a3 + b3)


@function
def expand_phasor(cycles, a, b, c, half, out, item):
    """Expand ``exp(j (2 pi cycles + a f + b f^2 + c f^3))`` as a cubic in the pixel number f.

    `cycles` is a fraction. The quartic term is folded into the constant and the quadratic one
    (Chebyshev economisation), which leaves an eighth of it. The coefficients go to `out`, real and
    imaginary ones in turn.
    """
    cosine, sine = phasor(cycles)
    aa, square = a * a, half * half
    r4, i4 = aa * aa * _R24 - _R2 * b * b - a * c, -_R2 * aa * b
    r3, i3 = -a * b, c - aa * a * _R6
    r2, i2 = square * r4 - _R2 * aa, square * i4 + b
    r0, i0 = _ONE - square * square * _R8 * r4, -square * square * _R8 * i4
    out[0, item], out[1, item] = cosine * r0 - sine * i0, cosine * i0 + sine * r0
    out[2, item], out[3, item] = -sine * a, cosine * a
    out[4, item], out[5, item] = cosine * r2 - sine * i2, cosine * i2 + sine * r2
    out[6, item], out[7, item] = cosine * r3 - sine * i3, cosine * i3 + sine * r3


@function
def weigh_phasor(out, item, half, begin, middle, end):
    """Multiply the phasor of a segment by an amplitude, a parabola through three values.

    Of the product the cubic is kept, and its quartic term economised as that of the phasor is.
    """
    square = half * half
    w1, w2 = _R2 * (end - begin) / half, (_R2 * (end + begin) - middle) / square
    for part in range(2):
        c0, c1, c2, c3 = out[part, item], out[2 + part, item], out[4 + part, item], (
            out[6 + part, item])
        c4 = c3 * w1 + c2 * w2
        out[part, item] = c0 * middle - square * square * _R8 * c4
        out[2 + part, item] = c1 * middle + c0 * w1
        out[4 + part, item] = c2 * middle + c1 * w1 + c0 * w2 + square * c4
        out[6 + part, item] = c3 * middle + c2 * w1 + c1 * w2


@kernel(registers=_REGISTERS)
def add_lines(planes, profile, segment, centres, lines, ramp, image, layout):
    """Add echoes to lines; a grid of (segments, groups of `block_lines` lines), `THREADS` each.

    Parameters
    ----------
    planes : pairs
        Polynomials of each echo, phase of the range grid, and cell, (R, U, n / 32, 5, 32)
        complex64 (`Profiles.planes`).
    profile : tuple
        Phases U and cells n; half path at cell `segment`, metres a position, cycles of
        the carrier a position, and at cell `segment`.
    segment : int
        Pixels of a segment.
    centres : (R, 6) float64
        Transmitter and receiver of each echo, metres.
    lines : (S, 15, n_lines) float64
        Position in the middle of each segment, and its first to fourth derivative by the pixel.
    ramp : (n_pixels,) complex64
        Factor of each pixel of a line.
    image : (K,) float32
        Added to.
    layout : (5,) int64
        Number of lines; first pixel's real part; steps to the next line, to the next pixel, and
        to the imaginary part.
    """
    _add(planes, profile, segment, centres, lines, ramp, image, layout, None)


@kernel(registers=_REGISTERS)
def add_weighted_lines(planes, profile, segment, centres, lines, ramp, image, layout, amplitude,
                  between, apart, first):
    """As `add_lines`, of echoes that illuminate pixels by an amplitude; what is dark is left out.

    Parameters
    ----------
    planes, profile, segment, centres, lines, ramp, image, layout :
        As of `add_lines`.
    amplitude : (K, R) float32
        At the nodes of `planning.exact.illumination.node_positions`: groups of lines, places,
        nodes; those of the group that the first line is in come first.
    between : (n_lines,) float32
        How far a line lies from the node before it to the next.
    apart, first : int
        Lines between nodes, and number of the first line in its group.
    """
    _add(planes, profile, segment, centres, lines, ramp, image, layout,
         (amplitude, between, apart, first))


@function
def _choose_illuminated(amplitude, apart, number, n_segments, lowest, highest, start, stop,
                        chosen):
    """How many echoes illuminate a part of some lines' segment; `chosen` holds their numbers.

    `lowest` and `highest` are the first line and the last, counted from the first group's first;
    all threads of the block take part.
    """
    illuminated = cuda.shared.array(ECHOES, np.int32)
    thread = cuda.threadIdx.x
    if thread < ECHOES:
        illuminated[thread] = 0
    cuda.syncthreads()
    echo, n_nodes = start + thread % ECHOES, 3 * (NODE_LINES // apart + 1)  # of a tile
    first_group = lowest // NODE_LINES
    n_all = (highest // NODE_LINES - first_group + 1) * n_nodes
    for k in range(thread // ECHOES, n_all if echo < stop else 0, THREADS // ECHOES):
        group = first_group + k // n_nodes
        node = ((group * (2 * n_segments + 1) + 2 * number) * (n_nodes // 3)) + k % n_nodes
        if amplitude[node, echo] > np.float32(0.0):
            illuminated[thread % ECHOES] = 1
    cuda.syncthreads()
    n_illuminated = 0
    for k in range(stop - start):
        if illuminated[k]:
            if thread == 0:
                chosen[n_illuminated] = start + k
            n_illuminated += 1
    cuda.syncthreads()
    return n_illuminated


@function
def _amplitude_at(amplitude, place, between, node, echo):
    """Amplitude of an echo on a line between two nodes, at a place of a segment."""
    low, high = amplitude[node + place, echo], amplitude[node + place + 1, echo]
    return low + between * (high - low)


@function
def _share_phase(lines, number, line, centres, echo, inverse_step, n_phases, cycles_per_step,
                 square, drift, phase, item):
    """What the phases of echoes near `echo` have in common, along the middle of a segment.

    `drift`, steps by the pixel number, is taken off those of each echo as float32 has it; `phase`
    is the same in cycles, with the quartic term economised. Powers of pixel numbers are whole, and
    so whole cycles can be left out of each coefficient.
    """
    _, d1, d2, d3 = half_path(lines, number, line, centres, echo)
    drift[0, item] = d1 * inverse_step - n_phases
    drift[1, item] = 0.5 * inverse_step * d2
    drift[2, item] = (1.0 / 6.0) * inverse_step * d3
    fourth = (fourth_derivative(lines, number, line, centres[echo, 0], centres[echo, 1],
                                centres[echo, 2])
              + fourth_derivative(lines, number, line, centres[echo, 3], centres[echo, 4],
                                  centres[echo, 5]))
    quartic = cycles_per_step * inverse_step * (1.0 / 48.0) * fourth
    phase[0, item] = fraction(-0.125 * square * square * quartic)
    # Numba's simulator would multiply in float32 what the device multiplies in float64.
    phase[1, item] = fraction(cycles_per_step * np.float64(drift[0, item]))
    phase[2, item] = fraction(cycles_per_step * np.float64(drift[1, item]) + square * quartic)
    phase[3, item] = fraction(cycles_per_step * np.float64(drift[2, item]))


@function
def _add(planes, profile, segment, centres, lines, ramp, image, layout, illumination):
    """What both kernels do; `illumination` is None where echoes illuminate all pixels alike."""
    n_phases, n_cells, range_zero, step, cycles_per_step, cycles_zero = profile
    place = cuda.shared.array((_PLACE, _ITEMS), np.float32)
    phasors = cuda.shared.array((_PHASOR, _ITEMS), np.float32)
    base = cuda.shared.array(_ITEMS, np.int32)
    shared_drift = cuda.shared.array((_DRIFT, _LINES_TOGETHER), np.float32)
    shared_phase = cuda.shared.array((_CYCLES, _LINES_TOGETHER), np.float32)
    real = cuda.local.array(_SUMS, np.float32)
    imag = cuda.local.array(_SUMS, np.float32)
    cell_re = cuda.local.array(_CELLS, np.float32)
    cell_im = cuda.local.array(_CELLS, np.float32)

    thread, segment_number = cuda.threadIdx.x, cuda.blockIdx.x
    lanes = segment // PIXELS
    lane, group = thread % lanes, thread // lanes
    n_together = THREADS // lanes * LINES  # lines of the block
    top = cuda.blockIdx.y * n_together
    n_lines, n_all, half = layout[0], centres.shape[0], segment // 2
    n_some = min(n_lines - top, n_together)
    inverse_step, square, short_half = 1.0 / step, 1.0 * half * half, np.float32(half)
    radians = 2.0 * np.pi * cycles_per_step
    shared_cycles = (segment_number * segment + half) * float(n_phases)
    most = max(_ITEMS // n_together, 1)
    n_needed = -(-n_some // LINES) * LINES  # the last thread's lines may end beyond the image
    mine = group * LINES < n_some

    for start in range(0, n_all, ECHOES):
        stop = min(start + ECHOES, n_all)
        begin, end = start, stop
        if illumination is not None:
            chosen = cuda.shared.array(ECHOES, np.int32)
            amplitude, between, apart, offset = illumination
            begin, end = 0, _choose_illuminated(
                amplitude, apart, segment_number, lines.shape[0], top + offset,
                top + offset + n_some - 1, start, stop, chosen)
            if end == 0:
                continue
        # Echoes are near each other: what their phases have in common comes last.
        cuda.syncthreads()
        for item in range(thread, n_needed, THREADS):
            _share_phase(lines, segment_number, min(top + item, n_lines - 1), centres,
                         start + (stop - start) // 2, inverse_step, n_phases, cycles_per_step,
                         square, shared_drift, shared_phase, item)
        for k in range(_SUMS):
            real[k] = 0.0
            imag[k] = 0.0
        for first in range(begin, end, most):
            n_echoes = min(most, end - first)
            cuda.syncthreads()
            for item in range(thread, n_echoes * n_together, THREADS):
                echo, j = first + item // n_together, item % n_together
                if illumination is not None:
                    echo = chosen[echo]
                if j < n_needed:
                    line = min(top + j, n_lines - 1)
                    d, d1, d2, d3 = half_path(lines, segment_number, line, centres, echo)
                    v = (d - range_zero) * inverse_step
                    n = math.floor(v)
                    cell = math.floor((n + 0.5) / n_phases)
                    phase = n - cell * n_phases
                    k1, k2 = d1 * inverse_step - n_phases, 0.5 * inverse_step * d2
                    k3 = (1.0 / 6.0) * inverse_step * d3
                    # an economised cubic
                    place[0, item], place[1, item] = v - n, k1 + 0.75 * square * k3
                    place[2, item] = k2
                    cycles = fraction(cycles_per_step * (v - shared_cycles) + cycles_zero)
                    expand_phasor(np.float32(cycles),
                                  np.float32(radians * (k1 - shared_drift[0, j])),
                                  np.float32(radians * (k2 - shared_drift[1, j])),
                                  np.float32(radians * (k3 - shared_drift[2, j])), short_half,
                                  phasors, item)
                    # a segment outside the profile reads padding only
                    cell = min(max(cell, -1.0 * half), n_cells - 2.0 * segment + half)
                    base[item] = np.int32((echo * n_phases + phase) * n_cells + cell + half)
                    if illumination is not None:
                        n_nodes, at = NODE_LINES // apart + 1, line + offset
                        node = ((at // NODE_LINES * (2 * lines.shape[0] + 1) + 2 * segment_number)
                                * n_nodes + at % NODE_LINES // apart)
                        low, middle, high = (
                            _amplitude_at(amplitude, 0, between[line], node, echo),
                            _amplitude_at(amplitude, n_nodes, between[line], node, echo),
                            _amplitude_at(amplitude, 2 * n_nodes, between[line], node, echo))
                        weigh_phasor(phasors, item, short_half, low, middle, high)
                        if low + middle + high == np.float32(0.0):
                            base[item] = _DARK
            cuda.syncthreads()
            for echo in range(n_echoes if mine else 0):
                loaded, at = _DARK, np.uint64(echo * n_together + group * LINES)
                for j in range(LINES):
                    item = at + np.uint64(j)
                    if illumination is not None:
                        if base[item] == _DARK:
                            continue
                    if base[item] != loaded:
                        loaded = base[item]
                        for p in range(PIXELS):
                            # steps from power to power are constants of the instructions
                            number = np.uint32(loaded + lane + p * lanes)
                            cell = (np.uint64(number >> _FOLD) * _BLOCK_PAIRS
                                    + np.uint64(number & _IN_BLOCK))
                            for q in range(5):
                                re, im = load_pair(planes, cell + np.uint64(q * _BLOCK))
                                cell_re[5 * p + q], cell_im[5 * p + q] = re, im
                    for p in range(PIXELS):
                        f = np.float32(lane + p * lanes - half)
                        t = place[0, item] + f * (place[1, item] + f * place[2, item])
                        cosine = phasors[0, item] + f * (phasors[2, item] + f * (
                            phasors[4, item] + f * phasors[6, item]))
                        sine = phasors[1, item] + f * (phasors[3, item] + f * (
                            phasors[5, item] + f * phasors[7, item]))
                        re, im = cell_re[5 * p + 4], cell_im[5 * p + 4]
                        for q in range(3, -1, -1):
                            re = cell_re[5 * p + q] + t * re
                            im = cell_im[5 * p + q] + t * im
                        # one product at a time: each is fused with its sum
                        real[PIXELS * j + p] += re * cosine
                        real[PIXELS * j + p] -= im * sine
                        imag[PIXELS * j + p] += re * sine
                        imag[PIXELS * j + p] += im * cosine
        for j in range(LINES):
            line = group * LINES + j
            for p in range(PIXELS):
                i = segment_number * segment + lane + p * lanes
                if line < n_some and i < ramp.size:
                    f = np.float32(lane + p * lanes - half)
                    cosine, sine = phasor(short_fraction(shared_phase[0, line] + f * (
                        shared_phase[1, line] + f * (shared_phase[2, line]
                                                     + f * shared_phase[3, line]))))
                    re, im = real[PIXELS * j + p], imag[PIXELS * j + p]
                    re, im = re * cosine - im * sine, re * sine + im * cosine
                    cosine, sine = ramp[i].real, ramp[i].imag
                    pixel = layout[1] + (top + line) * layout[2] + i * layout[3]
                    image[pixel] += re * cosine - im * sine
                    image[pixel + layout[4]] += re * sine + im * cosine


class Lines:
    """Lines of one size along which range grows, prepared for adding any number of echoes.

    Parameters
    ----------
    profiles : Profiles
        That they read, with segments, in blocks of `FOLD`.
    layers : sequence of (callable, (5,) int64)
        What tells positions, ``locate(pixel, line)``: position and first to fourth derivative by
        the pixel number, each (..., 3) float64, metres, for broadcast numbers. Where the lines
        lie in the image: their number, the first pixel's real part, the steps to the next line,
        to the next pixel, and to the imaginary part.
    n_pixels : int
        Number of pixels of a line.
    ramp : (n_pixels,) complex64
        Factor of each pixel of a line: the carrier phase that all lines share.
    nodes : LineAmplitudes, optional
        Nodes of the echoes' amplitudes.
    rows : slice, optional
        Which lines they are, of so many as `locate` knows, if not all; and these.
    n_lines : int
    """

    def __init__(self, profiles: Profiles,
                 layers: Sequence[tuple[_Locate, Sequence[int] | np.ndarray]], n_pixels: int,
                 ramp: np.ndarray, nodes: LineAmplitudes | None = None, rows: slice | None = None,
                 n_lines: int = 0):
        self.profiles, segment = profiles, profiles.resampling.segment
        self._n_lines, self._ramp = int(layers[0][1][0]), xp.asarray(ramp)
        rows, n_lines = rows or slice(0, self._n_lines), n_lines or self._n_lines
        self._layers = [(xp.asarray(segment_middles(locate, rows, n_pixels, segment)),
                         xp.asarray(np.asarray(layout, np.int64))) for locate, layout in layers]
        self._nodes = [None if nodes is None else _Nodes(locate, rows, n_lines, n_pixels, segment,
                                                      nodes.apart) for locate, _ in layers]

    def add(self, samples: np.ndarray, tx_m: np.ndarray, rx_m: np.ndarray, image: np.ndarray,
            illumination: Illumination | None = None) -> None:
        """Add echoes to an image.

        Parameters
        ----------
        samples : (R, N) complex64 or (R, N, 2) integer
            Profiles of the echoes, of the host or of the device.
        tx_m, rx_m : (R, 3) float64
            Their phase centres, metres.
        image : (K,) float32 array of the device
            Real and imaginary parts of the image to add to.
        illumination : Illumination, optional
            Illumination of the echoes, where lines are illuminated.
        """
        profiles, resampling = self.profiles, self.profiles.resampling
        segment = resampling.segment
        blocks = -(-len(self._ramp) // segment), -(-self._n_lines // block_lines(segment))
        centres = xp.asarray(np.concatenate([tx_m, rx_m], axis=1))
        antennas = illumination and Antennas(illumination)
        n_bytes = max(0 if nodes is None else nodes.echo_bytes for nodes in self._nodes)
        together, n_echoes = resampling.echoes_per_pass, len(samples)
        chunks = profiles.chunks(n_echoes, ECHOES, n_bytes) if together >= ECHOES else (
            slice(first, min(first + together, n_echoes))
            for first in range(0, n_echoes, together))
        for echoes, some in in_pieces(samples, chunks):
            planes = profiles.planes(some)
            for (lines, layout), nodes in zip(self._layers, self._nodes, strict=True):
                profile = (resampling.n_phases, profiles.n_cells, profiles.range_at(segment),
                           resampling.step_m, profiles.cycles_per_step,
                           profiles.cycles_at(segment))
                given = (pairs(planes), profile, segment, centres[echoes], lines, self._ramp,
                         image, layout)
                if nodes is None:
                    launch(add_lines, blocks, THREADS, *given)
                else:
                    launch(add_weighted_lines, blocks, THREADS, *given,
                           antennas.at_nodes(nodes.positions, echoes), *nodes.places)


class _Nodes:
    """Where amplitudes of echoes are found over some lines of a layer.

    Arguments are as of `Lines` and `node_positions`.

    Attributes
    ----------
    positions : (3, K) float64 array of the device
        Metres.
    places : tuple
        The last arguments of `add_weighted_lines`.
    echo_bytes : int
        Memory that the amplitudes of an echo take.
    """

    def __init__(self, locate: _Locate, rows: slice, n_lines: int, n_pixels: int, segment: int,
                 apart: int):
        positions, _, between = node_positions(locate, n_lines, n_pixels, segment, apart)
        group = rows.start // NODE_LINES
        self.positions = xp.asarray(np.ascontiguousarray(
            positions[:, group:-(-rows.stop // NODE_LINES)]).reshape(3, -1))
        self.places = (xp.asarray(between.reshape(-1)[rows].copy()), apart,
                       rows.start - group * NODE_LINES)
        self.echo_bytes = 4 * self.positions.shape[1]


def segment_middles(locate: _Locate, rows: slice, n_pixels: int, segment: int) -> np.ndarray:
    """(S, 15, n_lines) float64 positions and derivatives in the middle of the segments of lines.

    `locate` and `rows` are as of `Lines`.
    """
    middle = np.arange(-(-n_pixels // segment)) * segment + segment // 2
    found = np.concatenate(locate(middle[:, None], np.arange(rows.start, rows.stop)), axis=-1)
    return np.ascontiguousarray(found.transpose(0, 2, 1))


def line_profiles(source: RangeGate | PhaseHistory, resampling: RangeResampling,
                  range_m: tuple[float, float]) -> Profiles:
    """Profiles as lines read them, see `Profiles`."""
    return Profiles(source, resampling, range_m, FOLD)


def polar_lines(polar: PolarGrid, profiles: Profiles, rows: slice | None = None,
                nodes: LineAmplitudes | None = None) -> Lines:
    """Lines of a polar image at range baseband, (2, n, n_range) float32, or n `rows` of them.

    Their sum is that of `backends.reference.project_lines`.
    """
    rows = rows or slice(0, polar.n_alpha)
    n_lines, width = rows.stop - rows.start, polar.n_range
    cycles = 2 * (profiles.resampling.cell_m - polar.range_spacing_m) / profiles.wavelength_m
    layout = n_lines, 0, width, 1, n_lines * width
    return Lines(profiles, [(polar.locate, layout)], width, ramp(cycles, width), nodes, rows,
                 polar.n_alpha)


def ramp(cycles: float, n: int) -> np.ndarray:
    """(n,) complex64 phasor that turns by so many cycles from pixel to pixel."""
    return np.exp(2j * np.pi * np.fmod(cycles * np.arange(n), 1.0)).astype(np.complex64)
