# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Images of sub-apertures from their beams on the device, several in one launch of each kernel.

Kernels sum echoes to beams, and read the lines of images from these. What tells the sub-apertures
of a launch apart is in two arrays:

- `rows` (G, 3) int64: the first of its echoes, how many there are, and its beams;
- `geometry` (G, 10) float64: its middle, metres; that one's height above the plane, metres; the
  range at which paths are compared, metres; direction cosine of the first beam, and spacing;
  directions beyond which paths are continued straight; the weight of the second order between
  beams.

Phases are told from the carrier's, in float64, and by bin from there, some cycles, in float32.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from ...geometry.illumination import Illumination
from ...geometry.polar import PolarGrid
from ...planning.afbp.beams import BEAM_TAPS, CELL_TAPS, DEGREE, BeamGeometry, grid_edges
from ...planning.afbp.illumination import NODES_APART, AmplitudeNodes
from ...planning.afbp.subapertures import SubaperturePlan
from .arrays import cuda, function, kernel, launch, load_pair, pairs, store_pair, xp
from .illumination import Antennas, amplitude, in_axes
from .phasors import fraction, phasor, short_fraction
from .profiles import profile_spectra

if TYPE_CHECKING:
    _Geometry = tuple[BeamGeometry, int, tuple[float, ...]]

CENTRE, HEIGHT, RANGE, START, SPACING, LOW, HIGH, BEND = 0, 3, 4, 5, 6, 7, 8, 9  # of `geometry`
BEAMS = 8  # of a thread, which has one cell
_PAIRS = BEAMS // 2
_ECHOES = 32  # whose numbers lie in shared memory
_ITEMS, _PAIR_ITEMS = _ECHOES * BEAMS, _ECHOES * _PAIRS
_STEP = 1e-4  # of the direction cosine, for a derivative
_ONE = np.float32(1.0)


@function
def _leg(geometry, track, g, direction, x, y, z):
    """By how much a point in a direction is further from a phase centre than from the middle.

    See `BeamGeometry.extra_path`; x, y and z are the phase centre less the middle, metres.
    """
    height, range_m = geometry[g, HEIGHT], geometry[g, RANGE]
    square = range_m * range_m
    along = range_m * direction
    across = math.sqrt(max(square - along * along - height * height, 0.0))
    px, py = along * track[0] + across * track[2], along * track[1] + across * track[3]
    # beyond the plane's horizon points lie further away than they are taken to
    beyond = px * px + py * py + height * height - square
    longer = (x * x + y * y + z * z + 2.0 * height * z + beyond - 2.0 * (px * x + py * y))
    return longer / (math.sqrt(square + longer) + range_m)


@function
def _extra_path(geometry, track, g, direction, centres, row):
    """Mean of both legs of an echo, metres."""
    cx, cy, cz = geometry[g, CENTRE], geometry[g, CENTRE + 1], geometry[g, CENTRE + 2]
    return 0.5 * (_leg(geometry, track, g, direction, centres[row, 0] - cx, centres[row, 1] - cy,
                       centres[row, 2] - cz)
                  + _leg(geometry, track, g, direction, centres[row, 3] - cx, centres[row, 4] - cy,
                         centres[row, 5] - cz))


@kernel()
def beam_paths(centres, rows, geometry, track, path):
    """Extra paths of echoes in the directions of beams; a grid of (beams and echoes, G).

    Parameters
    ----------
    centres : (R, 6) float64
        Transmitter and receiver of each echo, metres.
    rows, geometry :
        Of the sub-apertures.
    track : (4,) float64
        Horizontal unit vectors along the track and across it.
    path : (G, M, E) float64
        Those of `BeamGeometry.beam_path`, metres; others than a sub-aperture's own are left.
    """
    at, g = cuda.blockIdx.x * cuda.blockDim.x + cuda.threadIdx.x, cuda.blockIdx.y
    beam, echo = at // path.shape[2], at % path.shape[2]
    if beam >= rows[g, 2] or echo >= rows[g, 1]:
        return
    row = rows[g, 0] + echo
    direction = geometry[g, START] + geometry[g, SPACING] * beam
    inside = min(max(direction, geometry[g, LOW]), geometry[g, HIGH])
    found = _extra_path(geometry, track, g, inside, centres, row)
    if direction != inside:
        found += (direction - inside) * (
            _extra_path(geometry, track, g, inside + _STEP, centres, row)
            - _extra_path(geometry, track, g, inside - _STEP, centres, row)) / (2.0 * _STEP)
    path[g, beam, echo] = found


@function
def _bin_of(cell, n_cells, n_bins):
    """Number of a cell's bin, counted from the carrier's, and whether there is that bin."""
    number = cell - n_cells if cell >= (n_cells + 1) // 2 else cell
    return number, cell < n_cells and -(n_bins // 2) <= number < (n_bins + 1) // 2


@function
def _gain_at(table, steps, last):
    """Gain of a frequency in steps of the table, read linearly."""
    at = min(abs(steps), last)
    below = min(np.float32(math.floor(at)), last - _ONE)
    low, high = table[np.uint64(below)], table[np.uint64(below) + np.uint64(1)]
    return low + (at - below) * (high - low)


@kernel()
def form_beams(spectra, weights, rows, path, cycles_per_m, table, per_step, gain, zero, beams):
    """Spectra of beams; a grid of (cells, groups of `BEAMS` beams, sub-apertures).

    `backends.reference.form_beams` has the formula. Of a group's beams, counted in pairs from the
    outermost inwards, both have the phase of the group's middle, and what lies between, one of
    them its conjugate: ``exp(j M) exp(+-j B)``. The gain is that of the middle.

    Parameters
    ----------
    spectra, weights : pairs, (R,) float32
        Spectra and weights of the echoes, (R, N) complex64, and their factors.
    rows, path :
        As of `beam_paths`.
    cycles_per_m : (2,) float64
        Cycles of half path: at the carrier, and from bin to bin.
    table, per_step : (T,) float32, float
        Gain by the magnitude of the frequency from beam to beam, and steps of it in a cycle.
    gain, zero : (N,) complex64, int
        Factor of each bin, and which is the carrier's.
    beams : pairs
        Spectra of the beams by bin of their cells, (G, M, K) complex64; 0 in others than those of
        the bins.
    """
    middle = cuda.shared.array((5, _ECHOES), np.float32)
    beside_cycles = cuda.shared.array(_PAIR_ITEMS, np.float32)
    growth = cuda.shared.array(_PAIR_ITEMS, np.float32)
    even_re = cuda.local.array(_PAIRS, np.float32)
    even_im = cuda.local.array(_PAIRS, np.float32)
    odd_re = cuda.local.array(_PAIRS, np.float32)
    odd_im = cuda.local.array(_PAIRS, np.float32)
    thread, first, g = cuda.threadIdx.x, cuda.blockIdx.y * BEAMS, cuda.blockIdx.z
    first_row, n_echoes, n_beams = rows[g, 0], rows[g, 1], rows[g, 2]
    if first >= n_beams:
        return
    n_bins, most = gain.size, path.shape[1]
    n_cells = beams.size // (rows.shape[0] * most)
    last = min(first + BEAMS, n_beams) - 1
    before, after = max(first - 1, 0), min(last + 1, n_beams - 1)
    cell = cuda.blockIdx.x * cuda.blockDim.x + thread
    number, known = _bin_of(cell, n_cells, n_bins)
    bin_ = (number + zero) % n_bins
    n, end = np.float32(number), np.float32(table.size - 1)
    for p in range(_PAIRS):
        even_re[p] = 0.0
        even_im[p] = 0.0
        odd_re[p] = 0.0
        odd_im[p] = 0.0
    for start in range(0, n_echoes, _ECHOES):
        n_some = min(_ECHOES, n_echoes - start)
        cuda.syncthreads()
        for item in range(thread, n_some * _PAIRS, cuda.blockDim.x):
            upper = min(first + item % _PAIRS, (first + last) // 2)
            echo, lower = start + item // _PAIRS, first + last - upper
            beside = 0.5 * (path[g, upper, echo] - path[g, lower, echo])
            beside_cycles[item] = np.float32(fraction(cycles_per_m[0] * beside))
            growth[item] = np.float32(cycles_per_m[1] * beside)
        for item in range(thread, n_some, cuda.blockDim.x):
            echo, mean = start + item, 0.0
            for p in range(_PAIRS):
                upper = min(first + p, (first + last) // 2)
                mean += path[g, upper, echo] + path[g, first + last - upper, echo]
            mean *= 0.5 / _PAIRS
            slope = per_step * (path[g, after, echo] - path[g, before, echo]) / (after - before)
            middle[0, item] = np.float32(fraction(cycles_per_m[0] * mean))
            middle[1, item] = np.float32(cycles_per_m[1] * mean)
            middle[2, item] = np.float32(cycles_per_m[0] * slope)
            middle[3, item] = np.float32(cycles_per_m[1] * slope)
            middle[4, item] = weights[first_row + echo]
        cuda.syncthreads()
        at = np.uint64((first_row + start) * n_bins + bin_)
        for echo in range(n_some if known else 0):
            re, im = load_pair(spectra, at)
            at += np.uint64(n_bins)
            weight = middle[4, echo] * _gain_at(table, middle[2, echo] + n * middle[3, echo], end)
            cosine, sine = phasor(short_fraction(middle[0, echo] + n * middle[1, echo]))
            cosine, sine = weight * cosine, weight * sine
            re, im = re * cosine - im * sine, re * sine + im * cosine
            for p in range(_PAIRS):
                item = np.uint64(echo * _PAIRS + p)
                cosine, sine = phasor(short_fraction(beside_cycles[item] + n * growth[item]))
                even_re[p] += re * cosine
                even_im[p] += im * cosine
                odd_re[p] += re * sine
                odd_im[p] += im * sine
    if cell < n_cells:
        factor = gain[bin_]
        cosine, sine = factor.real, factor.imag
        for p in range(_PAIRS):
            upper = min(first + p, (first + last) // 2)
            re, im = even_re[p] - odd_im[p], even_im[p] + odd_re[p]
            store_pair(beams, np.uint64((g * most + upper) * n_cells + cell),
                       re * cosine - im * sine, re * sine + im * cosine)
            re, im = even_re[p] + odd_im[p], even_im[p] - odd_re[p]
            store_pair(beams, np.uint64((g * most + first + last - upper) * n_cells + cell),
                       re * cosine - im * sine, re * sine + im * cosine)


@kernel()
def form_single_beams(spectra, weights, rows, path, cycles_per_m, table, per_step, gain, zero,
                      beams):
    """As `form_beams`, of beams that share neither phase nor gain.

    Parameters
    ----------
    spectra, weights, rows, path, cycles_per_m, table, per_step, gain, zero, beams :
        As of `form_beams`.
    """
    carrier = cuda.shared.array(_ITEMS, np.float32)
    growth = cuda.shared.array(_ITEMS, np.float32)
    steps = cuda.shared.array(_ITEMS, np.float32)
    stretch = cuda.shared.array(_ITEMS, np.float32)
    real = cuda.local.array(BEAMS, np.float32)
    imag = cuda.local.array(BEAMS, np.float32)
    thread, first, g = cuda.threadIdx.x, cuda.blockIdx.y * BEAMS, cuda.blockIdx.z
    first_row, n_echoes, n_beams = rows[g, 0], rows[g, 1], rows[g, 2]
    if first >= n_beams:
        return
    n_bins, most = gain.size, path.shape[1]
    n_cells = beams.size // (rows.shape[0] * most)
    cell = cuda.blockIdx.x * cuda.blockDim.x + thread
    number, known = _bin_of(cell, n_cells, n_bins)
    bin_ = (number + zero) % n_bins
    n, end = np.float32(number), np.float32(table.size - 1)
    for b in range(BEAMS):
        real[b] = 0.0
        imag[b] = 0.0
    for start in range(0, n_echoes, _ECHOES):
        n_some = min(_ECHOES, n_echoes - start)
        cuda.syncthreads()
        for item in range(thread, n_some * BEAMS, cuda.blockDim.x):
            echo, beam = start + item // BEAMS, min(first + item % BEAMS, n_beams - 1)
            before, after = max(beam - 1, 0), min(beam + 1, n_beams - 1)
            slope = per_step * (path[g, after, echo] - path[g, before, echo]) / (after - before)
            carrier[item] = np.float32(fraction(cycles_per_m[0] * path[g, beam, echo]))
            growth[item] = np.float32(cycles_per_m[1] * path[g, beam, echo])
            steps[item] = np.float32(cycles_per_m[0] * slope)
            stretch[item] = np.float32(cycles_per_m[1] * slope)
        cuda.syncthreads()
        at = np.uint64((first_row + start) * n_bins + bin_)
        for echo in range(n_some if known else 0):
            re, im = load_pair(spectra, at)
            at += np.uint64(n_bins)
            weight = weights[first_row + start + echo]
            re, im = weight * re, weight * im
            for b in range(BEAMS):
                item = np.uint64(echo * BEAMS + b)
                weight = _gain_at(table, steps[item] + n * stretch[item], end)
                cosine, sine = phasor(short_fraction(carrier[item] + n * growth[item]))
                cosine, sine = weight * cosine, weight * sine
                real[b] += re * cosine
                real[b] -= im * sine
                imag[b] += re * sine
                imag[b] += im * cosine
    if cell < n_cells:
        factor = gain[bin_]
        cosine, sine = factor.real, factor.imag
        for b in range(BEAMS):
            if first + b < n_beams:
                store_pair(beams, np.uint64((g * most + first + b) * n_cells + cell),
                           real[b] * cosine - imag[b] * sine, real[b] * sine + imag[b] * cosine)


_BEAM_TAPS, _CELL_TAPS, _POWERS = BEAM_TAPS, CELL_TAPS, DEGREE + 1
_SAME = 1e-9  # radians by which phases differ that are taken for the same
_BEAM_WEIGHTS, _CELL_WEIGHTS = BEAM_TAPS * (DEGREE + 1), CELL_TAPS * (DEGREE + 1)


@kernel()
def interpolate_beams(beams, n_cells, most, rows, geometry, grid, between, along, first_between,
                      first_along, images):
    """Lines of a polar image at range baseband from beams; a grid of (ranges, lines, G).

    `backends.reference.interpolate_beams` has the formula; places and phases are float64.

    Parameters
    ----------
    beams, n_cells, most : pairs, int, int
        By direction and cell, (G, M, K) complex64; K and M.
    rows, geometry :
        Of the sub-apertures.
    grid : (14,) float64
        Grid of the images: first range and spacing, metres; first direction cosine and spacing;
        square of the height of its origin over the plane; track (x, y); side; origin (x, y),
        metres. Then half path of the first cell and spacing, metres; cycles of the carrier per
        metre; half path at which the carrier phase of the image's first range is zero, metres.
    between, along, first_between, first_along :
        Weights of the interpolators between beams and along cells, by powers of the place between
        samples, and their first neighbours.
    images : (G, 2, n_alpha, n_range) float32
        Real and imaginary part.
    """
    _interpolate(beams, n_cells, most, rows, geometry, grid, between, along, first_between,
                 first_along, images, None)


@kernel()
def interpolate_weighted_beams(beams, n_cells, most, rows, geometry, grid, between, along,
                               first_between, first_along, images, parabolas, segment):
    """As `interpolate_beams`, of echoes whose amplitude is a parabola of their phase.

    Parameters
    ----------
    beams, n_cells, most, rows, geometry, grid, between, along :
        As of `interpolate_beams`.
    first_between, first_along, images :
        As of `interpolate_beams`.
    parabolas : (G, n_alpha, K, 3) float32
        Coefficients A, B and C, see `fit_parabolas`, at the ends of segments along range.
    segment : int
        Pixels of a segment.
    """
    _interpolate(beams, n_cells, most, rows, geometry, grid, between, along, first_between,
                 first_along, images, (parabolas, segment))


@kernel()
def fit_parabolas(axes, table, place, positions, rows, geometry, grid, phase, parabolas):
    """Amplitude of a sub-aperture's echoes as a parabola through three; a grid of (K, G).

    p is the phase of an echo from beam to beam at the carrier: the amplitude is
    ``A + B p + C p^2``.

    Parameters
    ----------
    axes, table, place :
        As of `illumination.Antennas`, of three echoes of each sub-aperture.
    positions : (3, K) float64
        Positions of the support points, metres.
    rows, geometry, grid :
        As of `interpolate_beams`.
    phase : (G, M, 3) float64
        p of the three echoes in the direction of each beam.
    parabolas : (G, K, 3) float32
        A, B and C.
    """
    support, g = cuda.blockIdx.x * cuda.blockDim.x + cuda.threadIdx.x, cuda.blockIdx.y
    if support >= parabolas.shape[1]:
        return
    px, py, pz = positions[0, support], positions[1, support], positions[2, support]
    x, y, z = px - geometry[g, CENTRE], py - geometry[g, CENTRE + 1], pz - geometry[g, CENTRE + 2]
    direction = (x * grid[5] + y * grid[6]) / math.sqrt(x * x + y * y + z * z)
    beam = (direction - geometry[g, START]) / geometry[g, SPACING]
    n = min(max(int(beam), 0), rows[g, 2] - 2)
    t = beam - n
    x0 = phase[g, n, 0] + t * (phase[g, n + 1, 0] - phase[g, n, 0])
    x1 = phase[g, n, 1] + t * (phase[g, n + 1, 1] - phase[g, n, 1])
    x2 = phase[g, n, 2] + t * (phase[g, n + 1, 2] - phase[g, n, 2])
    y0 = amplitude(table, place, *in_axes(axes, 3 * g + 0, px, py, pz))
    y1 = amplitude(table, place, *in_axes(axes, 3 * g + 1, px, py, pz))
    y2 = amplitude(table, place, *in_axes(axes, 3 * g + 2, px, py, pz))
    a, b, c = y1, 0.0, 0.0
    if abs(x2 - x0) > _SAME:
        least = NODES_APART * abs(x2 - x0)
        b = (y2 - y0) / (x2 - x0)
        if abs(x1 - x0) > least and abs(x2 - x1) > least:
            slope = (y1 - y0) / (x1 - x0)
            c = ((y2 - y1) / (x2 - x1) - slope) / (x2 - x0)
            b = slope - c * (x0 + x1)
        a = y0 - x0 * (b + c * x0)
    parabolas[g, support, 0], parabolas[g, support, 1], parabolas[g, support, 2] = a, b, c


@function
def _interpolate(beams, n_cells, most, rows, geometry, grid, between, along, first_between,
                 first_along, images, illumination):
    """What both kernels do; `illumination` is None where echoes illuminate all pixels alike."""
    beam_weights = cuda.shared.array(_BEAM_WEIGHTS, np.float32)
    cell_weights = cuda.shared.array(_CELL_WEIGHTS, np.float32)
    reading = cuda.local.array(_CELL_TAPS, np.float32)
    thread, line, g = cuda.threadIdx.x, cuda.blockIdx.y, cuda.blockIdx.z
    for k in range(thread, _BEAM_WEIGHTS, cuda.blockDim.x):
        beam_weights[k] = between[k // _BEAM_TAPS, k % _BEAM_TAPS]
    for k in range(thread, _CELL_WEIGHTS, cuda.blockDim.x):
        cell_weights[k] = along[k // _CELL_TAPS, k % _CELL_TAPS]
    cuda.syncthreads()
    i = cuda.blockIdx.x * cuda.blockDim.x + thread
    if i >= images.shape[3]:
        return
    r, alpha = grid[0] + i * grid[1], grid[2] + line * grid[3]
    ground = math.sqrt(r * r * (1.0 - alpha * alpha) - grid[4])
    # along the track u, and across it: side (-u_y, u_x)
    x = grid[8] - geometry[g, CENTRE] + r * alpha * grid[5] - ground * grid[7] * grid[6]
    y = grid[9] - geometry[g, CENTRE + 1] + r * alpha * grid[6] + ground * grid[7] * grid[5]
    distance = math.sqrt(x * x + y * y + geometry[g, HEIGHT] * geometry[g, HEIGHT])
    direction = (x * grid[5] + y * grid[6]) / distance
    place = (direction - geometry[g, START]) / geometry[g, SPACING]
    highest = float(rows[g, 2] - _BEAM_TAPS - first_between)
    place = min(max(place, float(-first_between)), highest + 1.0)
    n = min(math.floor(place), highest)
    t, beam = np.float32(place - n), int(n) + first_between
    place = (distance - grid[10]) / grid[11]
    highest = float(n_cells - _CELL_TAPS - first_along)
    place = min(max(place, float(-first_along)), highest + 1.0)
    n = min(math.floor(place), highest)
    s, cell = np.float32(place - n), int(n) + first_along
    bend = np.float32((1.0 - direction * direction) * (1.0 / distance - 1.0 / geometry[g, RANGE])
                      * geometry[g, BEND])
    if illumination is not None:
        parabolas, segment = illumination
        support = i // segment
        share = np.float32(i - support * segment) / np.float32(segment)
        a, b, c = (_between(parabolas, g, line, support, share, 0),
                   _between(parabolas, g, line, support, share, 1),
                   _between(parabolas, g, line, support, share, 2))
    for k in range(_CELL_TAPS):
        w = cell_weights[(_POWERS - 1) * _CELL_TAPS + k]
        for power in range(_POWERS - 2, -1, -1):
            w = cell_weights[power * _CELL_TAPS + k] + s * w
        reading[k] = w
    real, imag = np.float32(0.0), np.float32(0.0)
    at = np.uint64((g * most + beam) * n_cells + cell)
    for m in range(_BEAM_TAPS):
        re, im = np.float32(0.0), np.float32(0.0)
        for k in range(_CELL_TAPS):
            sample_re, sample_im = load_pair(beams, at + np.uint64(k))
            re += reading[k] * sample_re
            im += reading[k] * sample_im
        at += np.uint64(n_cells)
        w, second = np.float32(0.0), np.float32(0.0)
        for power in range(_POWERS - 1, -1, -1):
            w = beam_weights[power * _BEAM_TAPS + m] + t * w
        for power in range(_POWERS - 1, 1, -1):
            second = (np.float32(power * (power - 1)) * beam_weights[power * _BEAM_TAPS + m]
                      + t * second)
        quadrature = second * bend
        if illumination is not None:
            once = np.float32(0.0)
            for power in range(_POWERS - 1, 0, -1):
                once = np.float32(power) * beam_weights[power * _BEAM_TAPS + m] + t * once
            w, quadrature = a * w - c * second, a * quadrature - b * once
        real += w * re - quadrature * im
        imag += w * im + quadrature * re
    cosine, sine = phasor(np.float32(fraction(grid[12] * (distance - (r - grid[0])
                                                         - grid[13]))))
    images[g, 0, line, i] = real * cosine - imag * sine
    images[g, 1, line, i] = real * sine + imag * cosine


@function
def _between(parabolas, g, line, support, share, order):
    """A coefficient between two support points of a line."""
    low, high = parabolas[g, line, support, order], parabolas[g, line, support + 1, order]
    return low + share * (high - low)


_THREADS = 128
_KEPT = 1024  # sub-apertures whose geometry is kept for the next image


class Beams:
    """Lines of the coarse grid of a plan, read from the beams of sub-apertures."""

    def __init__(self, plan: SubaperturePlan):
        source, resampling, sampling, polar = plan.source, plan.resampling, plan.beams, plan.coarse
        self._plan, self._edges = plan, grid_edges(polar)
        self._geometries: dict[bytes, _Geometry] = {}
        n_bins, n_cells, cell_m = resampling.n_padded, resampling.n_cells, resampling.cell_m
        first = math.floor((plan.range_m[0] - source.range_start_m) / cell_m) - CELL_TAPS
        # beyond the profile's ends a period repeats, what was recorded does not
        self._known = (0, n_cells) if source.periodic else tuple(
            min(max(end, 0), n_cells) for end in (-first, n_cells - first))
        number = (np.arange(n_bins) - source.zero + n_bins // 2) % n_bins - n_bins // 2
        # each bin's share is changed beforehand by what reading the cells takes from it
        gain = sampling.range_gain(source.gain(n_bins), number, n_cells)
        shift = np.exp(2j * np.pi * np.fmod(number * (first / n_cells), 1.0))
        self._gain = xp.asarray((gain * shift).astype(np.complex64))
        self._cycles_per_m = 2 / source.radar.wavelength_m
        self._scales = xp.asarray(np.array([self._cycles_per_m, 1 / (n_cells * cell_m)]))
        self._track = xp.asarray(np.array([*polar.track, *polar.across]))
        self._grid = xp.asarray(np.array([
            polar.range_start_m, polar.range_spacing_m, polar.alpha_start, polar.alpha_spacing,
            polar.height_m ** 2, *polar.track, polar.side, *polar.origin_m[:2],
            source.range_start_m + first * cell_m, cell_m, self._cycles_per_m,
            source.phase_range_m]))
        self._table = xp.asarray(np.exp(sampling.between.log_gain).astype(np.float32))
        self._weights = [xp.asarray(v.weights) for v in (sampling.between.interpolator,
                                                         sampling.along)]
        self._amplitudes = plan.amplitudes and _AmplitudeParabolas(polar, sampling.segment)
        # neighbours that may share phases, as the processor's do
        self._form = form_beams if sampling.group >= BEAMS else form_single_beams

    @property
    def image_bytes(self) -> int:
        """Memory that a sub-aperture takes besides its echoes, with transforms."""
        plan, coarse = self._plan, self._plan.coarse
        n_beams = plan.beams.n_beams(coarse.n_alpha * coarse.alpha_spacing)
        return int(8 * (3 * n_beams * plan.resampling.n_cells + coarse.n_alpha * coarse.n_range))

    def images(self, samples: np.ndarray, weights: np.ndarray, pieces: Sequence[slice],
               tx_m: np.ndarray, rx_m: np.ndarray, nodes: Sequence[AmplitudeNodes | None]
               ) -> np.ndarray:
        """Images of some sub-apertures at range baseband.

        Parameters
        ----------
        samples : (R, N) complex64 array of the device
            Profiles, or phase histories.
        weights : (R,) float32 array of the device
            Window over the echoes.
        pieces : sequence of slice
            Echoes of each sub-aperture.
        tx_m, rx_m : (R, 3) float64
            Phase centres, metres.
        nodes : sequence of AmplitudeNodes or None
            Nodes of the amplitudes of each, where the plan has illumination.

        Returns
        -------
        (G, 2, n_alpha, n_range) float32 array of the device

        Raises
        ------
        ValueError
            The plane is too steep below the echoes for their directions to be told apart.
        """
        polar = self._plan.coarse
        found = [self._geometry(tx_m[piece], rx_m[piece]) for piece in pieces]
        rows = np.array([(piece.start, piece.stop - piece.start, n_beams)
                         for piece, (_, n_beams, _) in zip(pieces, found, strict=True)])
        geometry = xp.asarray(np.array([values for _, _, values in found]))
        most, there = int(rows[:, 2].max()), xp.asarray(rows)
        beams = self._beams(samples, weights, rows, there, geometry,
                            np.concatenate([tx_m, rx_m], axis=1))
        images = xp.empty((len(pieces), 2, *polar.shape), np.float32)
        parabolas = () if self._amplitudes is None else self._amplitudes.parabolas(
            nodes, found, (there, geometry, self._grid), self._cycles_per_m)
        between, along = self._plan.beams.between.interpolator, self._plan.beams.along
        launch(interpolate_weighted_beams if parabolas else interpolate_beams,
               (-(-polar.n_range // _THREADS), polar.n_alpha, len(pieces)), _THREADS, pairs(beams),
               self._plan.resampling.n_cells, most, there, geometry, self._grid, *self._weights,
               between.first, along.first, images, *parabolas)
        return images

    def _geometry(self, tx_m: np.ndarray, rx_m: np.ndarray) -> _Geometry:
        """Of a sub-aperture: also how many beams, and its row of `forming.OWN`."""
        key = tx_m.tobytes() + rx_m.tobytes()
        if key not in self._geometries:
            if len(self._geometries) == _KEPT:
                self._geometries.clear()
            polar, sampling = self._plan.coarse, self._plan.beams
            geometry = BeamGeometry.of(polar, self._edges, tx_m, rx_m)
            if geometry is None:
                raise ValueError(f'the imaging plane, {polar.z_m:g} m high, is too steep below '
                                 f'the phase centres around {tx_m.mean(axis=0).round(2)}; use '
                                 'exact backprojection')
            start, spacing, n_beams = sampling.directions(geometry, tx_m, rx_m)
            # of the formula's e, but for the distance's part; k = 2 pi cycles per metre
            bend = -1 / (2 * 2 * np.pi * self._cycles_per_m * spacing ** 2)
            centre = geometry.centre_m
            self._geometries[key] = geometry, n_beams, (
                *centre, centre[2] - polar.z_m, geometry.range_m, start, spacing, *geometry.known,
                bend)
        return self._geometries[key]

    def _beams(self, samples: np.ndarray, weights: np.ndarray, rows: np.ndarray, there: np.ndarray,
               geometry: np.ndarray, centres: np.ndarray) -> np.ndarray:
        """(G, M, n_cells) complex64 beams at range baseband; `there` is `rows` on the device."""
        plan = self._plan
        source, resampling, between = plan.source, plan.resampling, plan.beams.between
        spectra = xp.ascontiguousarray(profile_spectra(source, samples, resampling.n_padded))
        n, n_echoes, most = len(rows), int(rows[:, 1].max()), int(rows[:, 2].max())
        path = xp.empty((n, most, n_echoes), np.float64)
        launch(beam_paths, (-(-most * n_echoes // _THREADS), n), _THREADS, xp.asarray(centres),
               there, geometry, self._track, path)
        beams = xp.empty((n, most, resampling.n_cells), np.complex64)
        launch(self._form, (-(-resampling.n_cells // _THREADS), -(-most // BEAMS), n), _THREADS,
               pairs(spectra), weights, there, path, self._scales, self._table, 1 / between.step,
               self._gain, source.zero, pairs(beams))
        beams = xp.fft.ifft(beams, axis=-1, norm='forward').astype(np.complex64, copy=False)
        for unknown in (slice(0, self._known[0]), slice(self._known[1], resampling.n_cells)):
            if unknown.start < unknown.stop:
                beams[..., unknown] = 0.0
        return beams


class _AmplitudeParabolas:
    """Support points of the amplitudes at the ends of the segments of a coarse grid's lines."""

    def __init__(self, polar: PolarGrid, segment: int):
        self._segment, self._shape = segment, (polar.n_alpha, -(-polar.n_range // segment) + 1)
        positions = polar.locate(np.arange(self._shape[1]) * segment,
                                 np.arange(polar.n_alpha)[:, None])[0]
        self._positions = xp.asarray(np.ascontiguousarray(positions.reshape(-1, 3).T))

    def parabolas(self, nodes: Sequence[AmplitudeNodes], geometries: Sequence[_Geometry],
                  told: tuple[np.ndarray, np.ndarray, np.ndarray], cycles_per_m: float
                  ) -> tuple[np.ndarray, int]:
        """The last arguments of `interpolate_weighted_beams`.

        Parameters
        ----------
        nodes : sequence of AmplitudeNodes
            Nodes of the amplitudes of each sub-aperture.
        geometries : sequence of tuple
            From `Beams._geometry`.
        told : tuple
            The kernels' `rows`, `geometry` and `grid`.
        cycles_per_m : float
            Carrier phase per metre of half path, cycles.
        """
        most = max(n_beams for _, n_beams, _ in geometries)
        phase = np.zeros((len(nodes), most, 3))
        for number, (geometry, n_beams, numbers) in enumerate(geometries):
            spacing = numbers[SPACING]
            slope = geometry.slope(nodes[number].tx_m, nodes[number].rx_m,
                                   numbers[START] + spacing * np.arange(n_beams))
            phase[number, :n_beams] = 2 * math.pi * cycles_per_m * spacing * slope
        seen = [one.illumination for one in nodes]
        antennas = Antennas(Illumination(seen[0].pattern, *(np.concatenate(
            [getattr(one, name) for one in seen]) for name in ('centre_m', 'axes'))))
        found = xp.empty((len(seen), self._positions.shape[1], 3), np.float32)
        launch(fit_parabolas, (-(-found.shape[1] // _THREADS), len(found)), _THREADS,
               antennas.axes, antennas.table, antennas.place, self._positions, *told,
               xp.asarray(phase), found)
        return found.reshape(len(found), *self._shape, 3), self._segment
