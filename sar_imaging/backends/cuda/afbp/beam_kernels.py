"""Beams of a sub-aperture: kernels that form them, and that read lines of an image from them."""

from __future__ import annotations

import math

import numpy as np

from ....planning.afbp.beam_gain import BEAM_TAPS, DEGREE
from ....planning.afbp.beams import CELL_TAPS
from ..arrays import cuda, function, kernel
from ..illumination import amplitude, in_axes
from ..phasors import fraction, phasor, short_fraction

THREADS, BEAMS = 128, 8  # bins of a block of threads, and beams of a thread
_ECHOES = 32  # whose numbers lie in shared memory
_ITEMS, _SUMS = _ECHOES * BEAMS, BEAMS
_BEAM_TAPS, _CELL_TAPS, _POWERS = BEAM_TAPS, CELL_TAPS, DEGREE + 1
_SAME = 1e-9  # radians by which phases differ that are taken for the same
_BEAM_WEIGHTS, _CELL_WEIGHTS = BEAM_TAPS * (DEGREE + 1), CELL_TAPS * (DEGREE + 1)


@kernel()
def form_beams(spectra, path, slope, cycles_per_m, numbers, table, per_step, beams):
    """Spectra of beams at cells; a grid of (bins, groups of `BEAMS` beams).

    `backends.reference.form_beams` has the formula. Phases are told from the carrier's, in
    float64, and by bin from there, some cycles, in float32.

    Parameters
    ----------
    spectra : (R, N) complex64
        Of the echoes, with what changes them by bin alone.
    path, slope : (M, R) float64
        Extra paths L of the echoes in each beam's direction, metres, and dL by beam.
    cycles_per_m : (2,) float64
        Of half path: at the carrier, and from bin to bin.
    numbers : (N,) int32
        Of each bin, counted from the carrier's.
    table, per_step : (T,) float32, float
        Gain by the magnitude of the frequency from beam to beam, and steps of it in a cycle.
    beams : (M, K) complex64
        Spectra of the beams by bin of their cells; others than those of the bins are left as
        they are.
    """
    carrier = cuda.shared.array(_ITEMS, np.float32)
    growth = cuda.shared.array(_ITEMS, np.float32)
    steps = cuda.shared.array(_ITEMS, np.float32)
    stretch = cuda.shared.array(_ITEMS, np.float32)
    real = cuda.local.array(_SUMS, np.float32)
    imag = cuda.local.array(_SUMS, np.float32)
    thread, first = cuda.threadIdx.x, cuda.blockIdx.y * BEAMS
    n_echoes, n_beams, n_cells = spectra.shape[0], beams.shape[0], beams.shape[1]
    bin_ = cuda.blockIdx.x * THREADS + thread
    known = bin_ < spectra.shape[1]
    number = numbers[bin_] if known else np.int32(0)
    known = known and -(n_cells // 2) <= number < (n_cells + 1) // 2
    n, last = np.float32(number), np.float32(table.size - 1)
    for b in range(_SUMS):
        real[b] = 0.0
        imag[b] = 0.0
    for start in range(0, n_echoes, _ECHOES):
        n_some = min(_ECHOES, n_echoes - start)
        cuda.syncthreads()
        for item in range(thread, n_some * BEAMS, THREADS):
            echo, beam = start + item // BEAMS, min(first + item % BEAMS, n_beams - 1)
            carrier[item] = np.float32(fraction(cycles_per_m[0] * path[beam, echo]))
            growth[item] = np.float32(cycles_per_m[1] * path[beam, echo])
            steps[item] = np.float32(cycles_per_m[0] * slope[beam, echo] * per_step)
            stretch[item] = np.float32(cycles_per_m[1] * slope[beam, echo] * per_step)
        cuda.syncthreads()
        for echo in range(n_some if known else 0):
            re, im = spectra[start + echo, bin_].real, spectra[start + echo, bin_].imag
            for b in range(BEAMS):
                item = np.uint64(echo * BEAMS + b)
                # the table is read linearly
                at = min(abs(steps[item] + n * stretch[item]), last)
                below = min(np.float32(math.floor(at)), last - np.float32(1.0))
                low, high = table[np.uint64(below)], table[np.uint64(below) + np.uint64(1)]
                gain = low + (at - below) * (high - low)
                cycles = carrier[item] + n * growth[item]
                cosine, sine = phasor(short_fraction(cycles))
                cosine, sine = gain * cosine, gain * sine
                real[b] += re * cosine
                real[b] -= im * sine
                imag[b] += re * sine
                imag[b] += im * cosine
    if known:
        cell = (number + n_cells) % n_cells
        for b in range(BEAMS):
            if first + b < n_beams:
                beams[first + b, cell] = complex(real[b], imag[b])


@kernel()
def interpolate_beams(beams, grid, middle, scale, between, along, first_between, first_along,
                      image):
    """Lines of a polar image at range baseband from beams; a grid of (ranges, lines).

    `backends.reference.interpolate_beams` has the formula; places and phases are float64.

    Parameters
    ----------
    beams : (M, K) complex64
        By direction and cell.
    grid : (10,) float64
        Of the image: first range and spacing, metres; first direction cosine and spacing; square
        of the height of its origin over the plane; track (x, y); side; and, of the origin less the
        middle of the sub-aperture, x and y, metres.
    middle : (4,) float64
        Of the sub-aperture: its height over the plane, metres; 1 over the distance whose curvature
        the beams have, 1/m; twice the weight of the second order, 1/m; half path at which the
        carrier phase of the image's first range is zero, metres.
    scale : (5,) float64
        First direction of the beams and spacing; half path of the first cell and spacing, metres;
        cycles of the carrier per metre.
    between, along, first_between, first_along :
        Weights of the interpolators between beams and along cells, by powers of the place between
        samples, and their first neighbours.
    image : (2, n_alpha, n_range) float32
        Real and imaginary part.
    """
    _interpolate(beams, grid, middle, scale, between, along, first_between, first_along, image,
                 None)


@kernel()
def interpolate_lit_beams(beams, grid, middle, scale, between, along, first_between, first_along,
                          image, parabolas, apart):
    """As `interpolate_beams`, of echoes whose amplitude is a parabola of their phase.

    Parameters
    ----------
    beams, grid, middle, scale, between, along, first_between, first_along, image :
        As of `interpolate_beams`.
    parabolas : (n_alpha, K, 3) float32
        Coefficients A, B and C, see `fit_parabolas`, at knots along range.
    apart : int
        Pixels between knots.
    """
    _interpolate(beams, grid, middle, scale, between, along, first_between, first_along, image,
                 (parabolas, apart))


@kernel()
def fit_parabolas(axes, table, place, positions, geometry, phase, parabolas):
    """Amplitude of a sub-aperture's echoes as a parabola through three; a thread for each knot.

    p is the phase of an echo from beam to beam at the carrier: the amplitude is
    ``A + B p + C p^2``.

    Parameters
    ----------
    axes, table, place :
        As of `illumination.Antennas`, of the three echoes.
    positions : (3, K) float64
        Of the knots, metres.
    geometry : (7,) float64
        Middle of the sub-aperture, metres; direction of the track (x, y); direction cosine of the
        first beam, and spacing.
    phase : (M, 3) float64
        p of the three echoes in the direction of each beam.
    parabolas : (K, 3) float32
        A, B and C.
    """
    knot = cuda.blockIdx.x * cuda.blockDim.x + cuda.threadIdx.x
    if knot >= parabolas.shape[0]:
        return
    px, py, pz = positions[0, knot], positions[1, knot], positions[2, knot]
    x, y, z = px - geometry[0], py - geometry[1], pz - geometry[2]
    direction = (x * geometry[3] + y * geometry[4]) / math.sqrt(x * x + y * y + z * z)
    beam = (direction - geometry[5]) / geometry[6]
    n = min(max(int(beam), 0), phase.shape[0] - 2)
    t = beam - n
    x0 = phase[n, 0] + t * (phase[n + 1, 0] - phase[n, 0])
    x1 = phase[n, 1] + t * (phase[n + 1, 1] - phase[n, 1])
    x2 = phase[n, 2] + t * (phase[n + 1, 2] - phase[n, 2])
    y0 = amplitude(table, place, *in_axes(axes, 0, px, py, pz))
    y1 = amplitude(table, place, *in_axes(axes, 1, px, py, pz))
    y2 = amplitude(table, place, *in_axes(axes, 2, px, py, pz))
    a, b, c = y1, 0.0, 0.0
    if abs(x2 - x0) > _SAME and x1 != x0 and x2 != x1:
        slope = (y1 - y0) / (x1 - x0)
        c = ((y2 - y1) / (x2 - x1) - slope) / (x2 - x0)
        b = slope - c * (x0 + x1)
        a = y0 - x0 * (b + c * x0)
    parabolas[knot, 0], parabolas[knot, 1], parabolas[knot, 2] = a, b, c


@function
def _interpolate(beams, grid, middle, scale, between, along, first_between, first_along, image,
                 light):
    """What both kernels do; `light` is None where echoes light all pixels alike."""
    beam_weights = cuda.shared.array(_BEAM_WEIGHTS, np.float32)
    cell_weights = cuda.shared.array(_CELL_WEIGHTS, np.float32)
    reading = cuda.local.array(_CELL_TAPS, np.float32)
    thread, line = cuda.threadIdx.x, cuda.blockIdx.y
    for k in range(thread, _BEAM_WEIGHTS, cuda.blockDim.x):
        beam_weights[k] = between[k // _BEAM_TAPS, k % _BEAM_TAPS]
    for k in range(thread, _CELL_WEIGHTS, cuda.blockDim.x):
        cell_weights[k] = along[k // _CELL_TAPS, k % _CELL_TAPS]
    cuda.syncthreads()
    i = cuda.blockIdx.x * cuda.blockDim.x + thread
    if i >= image.shape[2]:
        return
    r, alpha = grid[0] + i * grid[1], grid[2] + line * grid[3]
    ground = math.sqrt(r * r * (1.0 - alpha * alpha) - grid[4])
    # along the track u, and across it: side (-u_y, u_x)
    x = grid[8] + r * alpha * grid[5] - ground * grid[7] * grid[6]
    y = grid[9] + r * alpha * grid[6] + ground * grid[7] * grid[5]
    distance = math.sqrt(x * x + y * y + middle[0] * middle[0])
    direction = (x * grid[5] + y * grid[6]) / distance
    place = (direction - scale[0]) / scale[1]
    highest = float(beams.shape[0] - _BEAM_TAPS - first_between)
    place = min(max(place, float(-first_between)), highest + 1.0)
    n = min(math.floor(place), highest)
    t, beam = np.float32(place - n), int(n) + first_between
    place = (distance - scale[2]) / scale[3]
    highest = float(beams.shape[1] - _CELL_TAPS - first_along)
    place = min(max(place, float(-first_along)), highest + 1.0)
    n = min(math.floor(place), highest)
    s, cell = np.float32(place - n), int(n) + first_along
    bend = np.float32((1.0 - direction * direction) * (1.0 / distance - middle[1]) * middle[2])
    if light is not None:
        parabolas, apart = light
        knot = i // apart
        share = np.float32(i - knot * apart) / np.float32(apart)
        a, b, c = (_between(parabolas, line, knot, share, 0),
                   _between(parabolas, line, knot, share, 1),
                   _between(parabolas, line, knot, share, 2))
    for k in range(_CELL_TAPS):
        w = cell_weights[(_POWERS - 1) * _CELL_TAPS + k]
        for power in range(_POWERS - 2, -1, -1):
            w = cell_weights[power * _CELL_TAPS + k] + s * w
        reading[k] = w
    real, imag = np.float32(0.0), np.float32(0.0)
    for m in range(_BEAM_TAPS):
        re, im = np.float32(0.0), np.float32(0.0)
        for k in range(_CELL_TAPS):
            sample = beams[beam + m, cell + k]
            re += reading[k] * sample.real
            im += reading[k] * sample.imag
        w, second = np.float32(0.0), np.float32(0.0)
        for power in range(_POWERS - 1, -1, -1):
            w = beam_weights[power * _BEAM_TAPS + m] + t * w
        for power in range(_POWERS - 1, 1, -1):
            second = (np.float32(power * (power - 1)) * beam_weights[power * _BEAM_TAPS + m]
                      + t * second)
        turned = second * bend
        if light is not None:
            once = np.float32(0.0)
            for power in range(_POWERS - 1, 0, -1):
                once = np.float32(power) * beam_weights[power * _BEAM_TAPS + m] + t * once
            w, turned = a * w - c * second, a * turned - b * once
        real += w * re - turned * im
        imag += w * im + turned * re
    cosine, sine = phasor(np.float32(fraction(scale[4] * (distance - (r - grid[0])
                                                          - middle[3]))))
    image[0, line, i] = real * cosine - imag * sine
    image[1, line, i] = real * sine + imag * cosine


@function
def _between(parabolas, line, knot, share, order):
    """A coefficient between two knots of a line."""
    low, high = parabolas[line, knot, order], parabolas[line, knot + 1, order]
    return low + share * (high - low)
