"""Beams of sub-apertures: paths of their echoes, and the sums over echoes that they are.

A launch is for several sub-apertures. What tells them apart is in two arrays:

- `rows` (G, 3) int64: the first of its echoes, how many there are, and its beams;
- `own` (G, 10) float64: its middle, metres; that one's height above the plane, metres; the range
  at which paths are compared, metres; direction cosine of the first beam, and spacing; directions
  beyond which paths are continued straight; the weight of the second order between beams.

Phases are told from the carrier's, in float64, and by bin from there, some cycles, in float32.
"""

from __future__ import annotations

import math

import numpy as np

from ..arrays import cuda, function, kernel, load_pair, store_pair
from ..phasors import fraction, phasor, short_fraction

CENTRE, HEIGHT, RANGE, START, SPACING, LOW, HIGH, BEND = 0, 3, 4, 5, 6, 7, 8, 9  # of `own`
BEAMS = 8  # of a thread, which has one cell
_PAIRS = BEAMS // 2
_ECHOES = 32  # whose numbers lie in shared memory
_ITEMS, _PAIR_ITEMS = _ECHOES * BEAMS, _ECHOES * _PAIRS
_STEP = 1e-4  # of the direction cosine, for a derivative
_ONE = np.float32(1.0)


@function
def _leg(own, track, g, direction, x, y, z):
    """By how much a point in a direction is further from a phase centre than from the middle.

    See `BeamGeometry.extra_path`; x, y and z are the phase centre less the middle, metres.
    """
    height, range_m = own[g, HEIGHT], own[g, RANGE]
    square = range_m * range_m
    along = range_m * direction
    across = math.sqrt(max(square - along * along - height * height, 0.0))
    px, py = along * track[0] + across * track[2], along * track[1] + across * track[3]
    # beyond the plane's horizon points lie further away than they are taken to
    beyond = px * px + py * py + height * height - square
    longer = (x * x + y * y + z * z + 2.0 * height * z + beyond - 2.0 * (px * x + py * y))
    return longer / (math.sqrt(square + longer) + range_m)


@function
def _extra_path(own, track, g, direction, centres, row):
    """Mean of both legs of an echo, metres."""
    cx, cy, cz = own[g, CENTRE], own[g, CENTRE + 1], own[g, CENTRE + 2]
    return 0.5 * (_leg(own, track, g, direction, centres[row, 0] - cx, centres[row, 1] - cy,
                       centres[row, 2] - cz)
                  + _leg(own, track, g, direction, centres[row, 3] - cx, centres[row, 4] - cy,
                         centres[row, 5] - cz))


@kernel()
def beam_paths(centres, rows, own, track, path):
    """Extra paths of echoes in the directions of beams; a grid of (beams and echoes, G).

    Parameters
    ----------
    centres : (R, 6) float64
        Transmitter and receiver of each echo, metres.
    rows, own :
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
    direction = own[g, START] + own[g, SPACING] * beam
    inside = min(max(direction, own[g, LOW]), own[g, HIGH])
    found = _extra_path(own, track, g, inside, centres, row)
    if direction != inside:
        found += (direction - inside) * (
            _extra_path(own, track, g, inside + _STEP, centres, row)
            - _extra_path(own, track, g, inside - _STEP, centres, row)) / (2.0 * _STEP)
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
        Of the echoes, (R, N) complex64, and their factors.
    rows, path :
        As of `beam_paths`.
    cycles_per_m : (2,) float64
        Of half path: at the carrier, and from bin to bin.
    table, per_step : (T,) float32, float
        Gain by the magnitude of the frequency from beam to beam, and steps of it in a cycle.
    gain, zero : (N,) complex64, int
        Factor of each bin, and which is the carrier's.
    beams : pairs
        Spectra of the beams by bin of their cells, (G, M, K) complex64; 0 in others than those of
        the bins.
    """
    middle = cuda.shared.array((5, _ECHOES), np.float32)
    turn = cuda.shared.array(_PAIR_ITEMS, np.float32)
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
            turn[item] = np.float32(fraction(cycles_per_m[0] * beside))
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
                cosine, sine = phasor(short_fraction(turn[item] + n * growth[item]))
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
