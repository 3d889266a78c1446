# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Time-domain correlation of spectra and of profiles, float64, many points side by side."""

from __future__ import annotations

import numpy as np

from ...compilation import kernel_part, njit, numba
from .illumination import Antennas, two_way_amplitude
from .memory import plain

_LANES = 16  # points advanced together: enough independent sums to hide the latency of one


def correlate_spectra(cycles_per_m, spectra, tx_m, rx_m, points_m, illumination=None
                      ) -> np.ndarray:
    """See `backends.protocol.Correlation`."""
    out = np.empty(len(points_m), np.complex128)
    _correlate(*cycles_per_m, np.ascontiguousarray(spectra.real),
               np.ascontiguousarray(spectra.imag), *plain(tx_m, rx_m, points_m),
               _antennas(illumination), out)
    return out


def correlate_profiles(radar, samples, tx_m, rx_m, points_m, half: int, sharpness: float,
                       illumination=None) -> tuple[np.ndarray, np.ndarray]:
    """See `backends.protocol.Correlation`."""
    image = np.zeros(len(points_m), np.complex128)
    covered = np.ones(len(points_m), np.bool_)
    samples = samples[:]
    samples.flags.writeable = False  # as those of a message: one kernel for both
    _correlate_profiles(samples, *plain(tx_m, rx_m, points_m), radar.range_start_m,
                        radar.sample_spacing_m, 1 / radar.wavelength_m, half, sharpness,
                        _antennas(illumination), image, covered)
    return image, covered


def _antennas(illumination) -> Antennas:
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
            acc_re[:], acc_im[:] = 0.0, 0.0
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
def _correlate_profiles(samples, tx, rx, points, start_m, spacing_m, cycles_per_m, half,
                        sharpness, antennas, image, covered):
    """Add all profiles at the delay of every point; `cycles_per_m` of two-way path."""
    for i in numba.prange(len(points)):
        _correlate_point(np.int64(i), samples, tx, rx, points, start_m, spacing_m, cycles_per_m,
                         half, sharpness, antennas, image, covered)


@kernel_part
def _correlate_point(i, samples, tx, rx, points, start_m, spacing_m, cycles_per_m, half,
                     sharpness, antennas, image, covered):
    """One point of `_correlate_profiles`."""
    n_pulses, n_channels, n_samples = samples.shape
    total = 0j
    for m in range(n_pulses):
        for c in range(n_channels):
            weight = _weight(antennas, m * n_channels + c, points[i])
            if weight == 0.0:
                continue
            path = distance(points[i], tx[m, c]) + distance(points[i], rx[m, c])
            place = (0.5 * path - start_m) / spacing_m
            if abs(place) < half or abs(place - (n_samples - 1)) < half:
                covered[i] = False
            total += (weight * _series(samples[m, c], place, half, sharpness)
                      * phasor(cycles_per_m * path))
    image[i] = total


@kernel_part
def _series(profile, place, half, sharpness):
    """Profile between its samples, by Knab's series; zero outside it."""
    if place < 0 or place > len(profile) - 1:
        return 0j
    cell = int(np.rint(place))  # the nearest: its sine keeps all digits where x is tiny
    if place == cell:
        return complex(profile[cell])
    total = 0j
    # sin(pi (u - k)) has the same size for every k and another sign from one to the next.
    sine = np.sin(np.pi * (place - cell)) / np.pi / np.cosh(sharpness)
    for k in range(max(cell - half, 0), min(cell + half + 1, len(profile))):
        x = place - k
        if abs(x) >= half:
            continue
        taper = np.cosh(sharpness * np.sqrt(1.0 - (x / half) ** 2))
        sign = 1.0 - 2.0 * (abs(cell - k) % 2)
        total += profile[k] * (sign * sine * taper / x)
    return total
