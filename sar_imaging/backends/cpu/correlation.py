# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Time-domain correlation of spectra and of profiles, float64, many points side by side."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from ...compilation import kernel_part, njit, numba
from .illumination import Antennas, two_way_amplitude
from .memory import plain

if TYPE_CHECKING:
    from ...geometry.illumination import Illumination
    from ...signal.radar import RadarParameters

_LANES = 16  # points advanced together: enough independent sums to hide the latency of one


def correlate_spectra(cycles_per_m: tuple[float, float], spectra: np.ndarray, tx_m: np.ndarray,
                      rx_m: np.ndarray, points_m: np.ndarray,
                      illumination: Illumination | None = None) -> np.ndarray:
    """See `backends.protocol.Correlation`."""
    out = np.empty(len(points_m), np.complex128)
    _correlate(*cycles_per_m, np.ascontiguousarray(spectra.real),
               np.ascontiguousarray(spectra.imag), *plain(tx_m, rx_m, points_m),
               _antennas(illumination), out)
    return out


def correlate_profiles(radar: RadarParameters, samples: np.ndarray, tx_m: np.ndarray,
                       rx_m: np.ndarray, points_m: np.ndarray, half: int, sharpness: float,
                       illumination: Illumination | None = None) -> tuple[np.ndarray, np.ndarray]:
    """See `backends.protocol.Correlation`."""
    image = np.zeros(len(points_m), np.complex128)
    covered = np.ones(len(points_m), np.bool_)
    samples = samples[:]
    samples.flags.writeable = False  # as those of a message: one kernel for both
    _correlate_profiles(samples, *plain(tx_m, rx_m, points_m), radar.range_start_m,
                        radar.sample_spacing_m, 1 / radar.wavelength_m, half,
                        _taper(sharpness), _antennas(illumination), image, covered)
    return image, covered


def _taper(sharpness: float) -> np.ndarray:
    """(8 N,) float64 c of ``cosh(a sqrt(y)) / cosh(a) = sum_n c[n] y^n`` for y from 0 to 1.

    All terms are positive: the series is as exact as its functions, and takes a fraction of their
    time.
    """
    terms = [1 / math.cosh(sharpness)]
    while 2 * len(terms) < sharpness or terms[-1] > 1e-18 or len(terms) % 8:
        terms.append(terms[-1] * sharpness ** 2 / (2 * len(terms) * (2 * len(terms) - 1)))
    return np.array(terms)


def _antennas(illumination: Illumination | None) -> Antennas:
    return Antennas.everything() if illumination is None else Antennas.of(illumination)


@njit(inline='always')
def _weight(antennas, echo, point):
    """Two-way amplitude of an echo; 1 where all illuminate all points alike."""
    if len(antennas.centre) == 0:
        return 1.0
    return two_way_amplitude(antennas, echo, point[0], point[1], point[2])


@njit(inline='always')
def distance(a, b):
    """Between two positions (3,), in their unit."""
    return np.sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2)


@njit(inline='always')
def phasor(cycles):
    """``exp(j 2 pi cycles)``."""
    angle = 2 * np.pi * (cycles - np.floor(cycles))
    return complex(np.cos(angle), np.sin(angle))


@njit(parallel=True)
def _correlate(first, step, re, im, tx, rx, points, antennas, out):
    """Horner's rule in ``exp(j 2 pi step tau)``, `_LANES` points side by side.

    `first` and `step` are in cycles per metre of two-way path.
    """
    for group in numba.prange((len(points) + _LANES - 1) // _LANES):
        _correlate_group(np.int64(group), first, step, re, im, tx, rx, points, antennas, out)


@kernel_part
def _correlate_group(group, first, step, re, im, tx, rx, points, antennas, out):
    """`_LANES` points of `_correlate`."""
    n_pulses, n_channels, n_bins = re.shape
    lo = group * _LANES
    n = min(_LANES, len(points) - lo)
    total_re, total_im = np.zeros(_LANES), np.zeros(_LANES)
    acc_re, acc_im = np.empty(_LANES), np.empty(_LANES)
    z_re, z_im = np.empty(_LANES), np.empty(_LANES)
    path = np.zeros(_LANES)
    for m in range(n_pulses):
        for c in range(n_channels):
            for i in range(n):
                path[i] = (distance(points[lo + i], tx[m, c])
                           + distance(points[lo + i], rx[m, c]))
                cycles = step * path[i]
                angle = 2 * np.pi * (cycles - np.floor(cycles))
                z_re[i], z_im[i] = np.cos(angle), np.sin(angle)
            for i in range(_LANES):
                acc_re[i] = acc_im[i] = 0.0
            for k in range(n_bins - 1, -1, -1):
                a, b = re[m, c, k], im[m, c, k]
                for i in range(_LANES):
                    r = acc_re[i] * z_re[i] - acc_im[i] * z_im[i] + a
                    acc_im[i] = acc_re[i] * z_im[i] + acc_im[i] * z_re[i] + b
                    acc_re[i] = r
            for i in range(n):
                cycles = first * path[i]
                angle = 2 * np.pi * (cycles - np.floor(cycles))
                w_re, w_im = np.cos(angle), np.sin(angle)
                weight = _weight(antennas, m * n_channels + c, points[lo + i])
                w_re, w_im = weight * w_re, weight * w_im
                total_re[i] += acc_re[i] * w_re - acc_im[i] * w_im
                total_im[i] += acc_re[i] * w_im + acc_im[i] * w_re
    for i in range(n):
        out[lo + i] = total_re[i] + 1j * total_im[i]


@njit(parallel=True)
def _correlate_profiles(samples, tx, rx, points, start_m, spacing_m, cycles_per_m, half, taper,
                        antennas, image, covered):
    """Add all profiles at the delay of every point; `cycles_per_m` of two-way path."""
    for i in numba.prange(len(points)):
        _correlate_point(np.int64(i), samples, tx, rx, points, start_m, spacing_m, cycles_per_m,
                         half, taper, antennas, image, covered)


@kernel_part
def _correlate_point(i, samples, tx, rx, points, start_m, spacing_m, cycles_per_m, half, taper,
                     antennas, image, covered):
    """One point of `_correlate_profiles`."""
    n_pulses, n_channels, n_samples = samples.shape
    total, work = 0j, (np.empty(2 * half + 1), np.empty(2 * half + 1))
    for m in range(n_pulses):
        for c in range(n_channels):
            weight = _weight(antennas, m * n_channels + c, points[i])
            if weight == 0.0:
                continue
            path = distance(points[i], tx[m, c]) + distance(points[i], rx[m, c])
            place = (0.5 * path - start_m) / spacing_m
            if abs(place) < half or abs(place - (n_samples - 1)) < half:
                covered[i] = False
            total += (weight * _series(samples[m, c], place, half, taper, *work)
                      * phasor(cycles_per_m * path))
    image[i] = total


@kernel_part
def _series(profile, place, half, taper, y, weight):
    """Profile between its samples, by Knab's series; zero outside it. `_taper` tells its taper."""
    if place < 0 or place > len(profile) - 1:
        return 0j
    cell = int(np.rint(place))  # the nearest: its sine keeps all digits where x is tiny
    if place == cell:
        return complex(profile[cell])
    # Of 2 half + 1 samples one end may be as far as the series reaches.
    first = max(cell - half + (place - (cell - half) >= half), 0)
    n = min(cell + half + (cell + half - place < half), len(profile)) - first
    _weigh(taper, np.uint64(n), place - first, half, y, weight)
    # sin(pi (u - k)) has the same size for every k and another sign from one to the next.
    sine, re, im = np.sin(np.pi * (place - cell)) / np.pi, 0.0, 0.0
    if (cell - first) % 2:
        sine = -sine
    for i in range(np.uint64(n)):
        value = profile[np.uint64(first) + i]
        re += value.real * weight[i]
        im += value.imag * weight[i]
    return complex(re * sine, im * sine)


@kernel_part(distinct=True)
def _weigh(taper, n, place, half, y, weight):
    """Weights of n samples at a place, which is told from the first, but for the sine."""
    per_half = 1.0 / half
    for i in range(n):
        x = (place - i) * per_half
        y[i], weight[i] = 1.0 - x * x, 0.0
    for term in range(len(taper) - 1, 0, -8):  # a pass over all samples for eight terms
        a, b, c, d = taper[term], taper[term - 1], taper[term - 2], taper[term - 3]
        e, f, g, h = taper[term - 4], taper[term - 5], taper[term - 6], taper[term - 7]
        for i in range(n):
            v = y[i]
            w = (((weight[i] * v + a) * v + b) * v + c) * v + d
            weight[i] = (((w * v + e) * v + f) * v + g) * v + h
    for i in range(n):
        sign = 1.0 - 2.0 * (i % np.uint64(2))
        weight[i] *= sign / (place - i)
