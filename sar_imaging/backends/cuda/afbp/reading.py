"""Lines of sub-aperture images from their beams; launches are for several, see `forming`."""

from __future__ import annotations

import math

import numpy as np

from ....planning.afbp.beams import BEAM_TAPS, CELL_TAPS, DEGREE
from ....planning.afbp.lit_subapertures import NODES_APART
from ..arrays import cuda, function, kernel, load_pair
from ..illumination import amplitude, in_axes
from ..phasors import fraction, phasor
from .forming import BEND, CENTRE, HEIGHT, RANGE, SPACING, START

_BEAM_TAPS, _CELL_TAPS, _POWERS = BEAM_TAPS, CELL_TAPS, DEGREE + 1
_SAME = 1e-9  # radians by which phases differ that are taken for the same
_BEAM_WEIGHTS, _CELL_WEIGHTS = BEAM_TAPS * (DEGREE + 1), CELL_TAPS * (DEGREE + 1)


@kernel()
def interpolate_beams(beams, n_cells, most, rows, own, grid, between, along, first_between,
                      first_along, images):
    """Lines of a polar image at range baseband from beams; a grid of (ranges, lines, G).

    `backends.reference.interpolate_beams` has the formula; places and phases are float64.

    Parameters
    ----------
    beams, n_cells, most : pairs, int, int
        By direction and cell, (G, M, K) complex64; K and M.
    rows, own :
        Of the sub-apertures.
    grid : (14,) float64
        Of the images: first range and spacing, metres; first direction cosine and spacing; square
        of the height of its origin over the plane; track (x, y); side; origin (x, y), metres. Then
        half path of the first cell and spacing, metres; cycles of the carrier per metre; half path
        at which the carrier phase of the image's first range is zero, metres.
    between, along, first_between, first_along :
        Weights of the interpolators between beams and along cells, by powers of the place between
        samples, and their first neighbours.
    images : (G, 2, n_alpha, n_range) float32
        Real and imaginary part.
    """
    _interpolate(beams, n_cells, most, rows, own, grid, between, along, first_between,
                 first_along, images, None)


@kernel()
def interpolate_lit_beams(beams, n_cells, most, rows, own, grid, between, along, first_between,
                          first_along, images, parabolas, apart):
    """As `interpolate_beams`, of echoes whose amplitude is a parabola of their phase.

    Parameters
    ----------
    beams, n_cells, most, rows, own, grid, between, along, first_between, first_along, images :
        As of `interpolate_beams`.
    parabolas : (G, n_alpha, K, 3) float32
        Coefficients A, B and C, see `fit_parabolas`, at knots along range.
    apart : int
        Pixels between knots.
    """
    _interpolate(beams, n_cells, most, rows, own, grid, between, along, first_between,
                 first_along, images, (parabolas, apart))


@kernel()
def fit_parabolas(axes, table, place, positions, rows, own, grid, phase, parabolas):
    """Amplitude of a sub-aperture's echoes as a parabola through three; a grid of (knots, G).

    p is the phase of an echo from beam to beam at the carrier: the amplitude is
    ``A + B p + C p^2``.

    Parameters
    ----------
    axes, table, place :
        As of `illumination.Antennas`, of three echoes of each sub-aperture.
    positions : (3, K) float64
        Of the knots, metres.
    rows, own, grid :
        As of `interpolate_beams`.
    phase : (G, M, 3) float64
        p of the three echoes in the direction of each beam.
    parabolas : (G, K, 3) float32
        A, B and C.
    """
    knot, g = cuda.blockIdx.x * cuda.blockDim.x + cuda.threadIdx.x, cuda.blockIdx.y
    if knot >= parabolas.shape[1]:
        return
    px, py, pz = positions[0, knot], positions[1, knot], positions[2, knot]
    x, y, z = px - own[g, CENTRE], py - own[g, CENTRE + 1], pz - own[g, CENTRE + 2]
    direction = (x * grid[5] + y * grid[6]) / math.sqrt(x * x + y * y + z * z)
    beam = (direction - own[g, START]) / own[g, SPACING]
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
    parabolas[g, knot, 0], parabolas[g, knot, 1], parabolas[g, knot, 2] = a, b, c


@function
def _interpolate(beams, n_cells, most, rows, own, grid, between, along, first_between,
                 first_along, images, light):
    """What both kernels do; `light` is None where echoes light all pixels alike."""
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
    x = grid[8] - own[g, CENTRE] + r * alpha * grid[5] - ground * grid[7] * grid[6]
    y = grid[9] - own[g, CENTRE + 1] + r * alpha * grid[6] + ground * grid[7] * grid[5]
    distance = math.sqrt(x * x + y * y + own[g, HEIGHT] * own[g, HEIGHT])
    direction = (x * grid[5] + y * grid[6]) / distance
    place = (direction - own[g, START]) / own[g, SPACING]
    highest = float(rows[g, 2] - _BEAM_TAPS - first_between)
    place = min(max(place, float(-first_between)), highest + 1.0)
    n = min(math.floor(place), highest)
    t, beam = np.float32(place - n), int(n) + first_between
    place = (distance - grid[10]) / grid[11]
    highest = float(n_cells - _CELL_TAPS - first_along)
    place = min(max(place, float(-first_along)), highest + 1.0)
    n = min(math.floor(place), highest)
    s, cell = np.float32(place - n), int(n) + first_along
    bend = np.float32((1.0 - direction * direction) * (1.0 / distance - 1.0 / own[g, RANGE])
                      * own[g, BEND])
    if light is not None:
        parabolas, apart = light
        knot = i // apart
        share = np.float32(i - knot * apart) / np.float32(apart)
        a, b, c = (_between(parabolas, g, line, knot, share, 0),
                   _between(parabolas, g, line, knot, share, 1),
                   _between(parabolas, g, line, knot, share, 2))
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
        turned = second * bend
        if light is not None:
            once = np.float32(0.0)
            for power in range(_POWERS - 1, 0, -1):
                once = np.float32(power) * beam_weights[power * _BEAM_TAPS + m] + t * once
            w, turned = a * w - c * second, a * turned - b * once
        real += w * re - turned * im
        imag += w * im + turned * re
    cosine, sine = phasor(np.float32(fraction(grid[12] * (distance - (r - grid[0])
                                                         - grid[13]))))
    images[g, 0, line, i] = real * cosine - imag * sine
    images[g, 1, line, i] = real * sine + imag * cosine


@function
def _between(parabolas, g, line, knot, share, order):
    """A coefficient between two knots of a line."""
    low, high = parabolas[g, line, knot, order], parabolas[g, line, knot + 1, order]
    return low + share * (high - low)
