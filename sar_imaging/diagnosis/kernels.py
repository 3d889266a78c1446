"""Compiled loop of the diagnosis: sums at points of an image, over all pulses and per group."""

from __future__ import annotations

import numpy as np

from ..compilation import njit, numba


@njit(parallel=True)
def sum_groups(points, tx, rx, monostatic, group, profiles, start_m, spacing_m, per_metre,
               cosine, sine, total, power, covered):
    """Backproject onto points; linear interpolation between samples.

    Parameters
    ----------
    points : (K, 3) float64
        Positions, metres.
    tx, rx : (R, 3) float64
        Phase centres of the rows, metres.
    monostatic : bool
        Both are the same.
    group : (R,) int64
        Group of each row, ascending.
    profiles : (R, N) complex64
        Oversampled at least four times.
    start_m, spacing_m : float
        Half path of the first sample and between samples, metres.
    per_metre : float
        Cycles of the carrier per metre of half path, 2 / lambda.
    cosine, sine : (T,) float32
        Of a cycle in T steps.
    total : (K,) complex64
        Receives the sum over all rows.
    power : (K,) float32
        Receives the sum of the squared magnitudes of the groups' sums.
    covered : (K,) int64
        Receives the number of rows whose profile reaches the point.
    """
    n_rows, n_samples = profiles.shape
    per_sample = 1.0 / spacing_m
    n_steps = len(cosine)
    for k in numba.prange(len(points)):
        x, y, z = points[k, 0], points[k, 1], points[k, 2]
        all_re = all_im = re = im = strength = np.float32(0.0)
        n = 0
        for row in range(n_rows):
            if row and group[row] != group[row - 1]:
                all_re += re
                all_im += im
                strength += re * re + im * im
                re = im = np.float32(0.0)
            d = np.sqrt((x - tx[row, 0]) ** 2 + (y - tx[row, 1]) ** 2 + (z - tx[row, 2]) ** 2)
            if not monostatic:
                d = 0.5 * (d + np.sqrt((x - rx[row, 0]) ** 2 + (y - rx[row, 1]) ** 2
                                       + (z - rx[row, 2]) ** 2))
            place = (d - start_m) * per_sample
            if not 0.0 <= place < n_samples - 1:
                continue
            n += 1
            cell = int(place)
            t = np.float32(place - cell)
            a, b = profiles[row, cell], profiles[row, cell + 1]
            v_re = a.real + t * (b.real - a.real)
            v_im = a.imag + t * (b.imag - a.imag)
            cycles = d * per_metre
            step = int((cycles - np.floor(cycles)) * n_steps)
            c, s = cosine[step], sine[step]
            re += v_re * c - v_im * s
            im += v_re * s + v_im * c
        total[k] = complex(all_re + re, all_im + im)
        power[k] = strength + re * re + im * im
        covered[k] = n
