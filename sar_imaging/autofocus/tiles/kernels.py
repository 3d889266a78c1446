"""Compiled loops of autofocus: profiles around bright points, focused to tiles."""

from __future__ import annotations

import numpy as np

from ...compilation import njit, numba


@njit(parallel=True)
def cut_profiles(samples, weights, first, position, cycles, owner, step, out):
    """Pieces of the profiles around each point, summed over the rows of each sub-aperture.

    Parameters
    ----------
    samples : (R, N) complex64
        Profiles.
    weights : (4, 8) float32
        Of an `Interpolator`.
    first : int
        Offset of its first neighbour.
    position : (K, R) float64
        Of the first sample of the piece in the profile, samples.
    cycles : (K, R) float64
        Phase that a row is turned by, cycles.
    owner : (R,) int64
        Sub-aperture of each row.
    step : float
        Spacing of the pieces, samples.
    out : (K, U, J) complex64
        Changed in place; zeros before.
    """
    n_rows, n_samples = samples.shape
    for k in numba.prange(out.shape[0]):
        for row in range(n_rows):
            angle = 2 * np.pi * (cycles[k, row] - np.floor(cycles[k, row]))
            turn = np.complex64(complex(np.cos(angle), np.sin(angle)))
            for j in range(out.shape[2]):
                place = position[k, row] + j * step
                cell = int(np.floor(place))
                if cell + first < 0 or cell + first + weights.shape[1] > n_samples:
                    continue
                t = np.float32(place - cell)
                total = np.complex64(0.0)
                for tap in range(weights.shape[1]):
                    w = weights[0, tap] + t * (weights[1, tap] + t * (
                        weights[2, tap] + t * weights[3, tap]))
                    total += w * samples[row, cell + first + tap]
                out[k, owner[row], j] += turn * total


@njit(parallel=True)
def plan_pixels(points, pixels, tx, rx, wavenumber, step_m, offset, real, imag):
    """Half path of each pixel less that of the tile's centre, and its carrier phasor.

    Parameters
    ----------
    points : (K, 3) float64
        Centres, metres.
    pixels : (K, X, 3) float64
        Pixels, metres.
    tx, rx : (U, 3) float64
        Phase centres of the sub-apertures, metres.
    wavenumber, step_m : float
        ``4 pi / lambda`` and the spacing of the pieces, metres.
    offset, real, imag : (K, X, U) float32
        Receive the difference in samples of the pieces, and the phasor.
    """
    n_x, n_u = offset.shape[1:]
    for k in numba.prange(len(points)):
        for u in range(n_u):
            centre = _half_path(points, k, tx, rx, u)
            for x in range(n_x):
                change = _half_path(pixels[k], x, tx, rx, u) - centre
                cycles = wavenumber / (2 * np.pi) * change
                angle = 2 * np.pi * (cycles - np.floor(cycles))
                offset[k, x, u] = change / step_m
                real[k, x, u] = np.cos(angle)
                imag[k, x, u] = np.sin(angle)


@njit(inline='always')
def _half_path(points, i, tx, rx, u):
    out = np.sqrt((points[i, 0] - tx[u, 0]) ** 2 + (points[i, 1] - tx[u, 1]) ** 2
                  + (points[i, 2] - tx[u, 2]) ** 2)
    out += np.sqrt((points[i, 0] - rx[u, 0]) ** 2 + (points[i, 1] - rx[u, 1]) ** 2
                   + (points[i, 2] - rx[u, 2]) ** 2)
    return 0.5 * out


@njit(parallel=True)
def focus_tiles(shape, cuts, pieces_re, pieces_im, shift, turn_re, turn_im, offset, real, imag,
                out_re, out_im):
    """Backproject the sub-apertures onto the pixels of every tile.

    All arrays are flat and in C order, which lets the compiler see that they do not overlap.

    Parameters
    ----------
    shape : (K, X, U, J)
        Tiles, pixels, sub-apertures, samples of a piece.
    cuts : (G + 1,) int64
        First sub-aperture of each coherent segment, and U.
    pieces_re, pieces_im : (K * U * J,) float32
        From `cut_profiles`.
    shift : (K * U,) float32
        Where the tile's centre is in the piece, samples of the piece; with `offset` added it
        must lie within.
    turn_re, turn_im : (K * U,) float32
        Phasor of each sub-aperture for the tile's centre.
    offset, real, imag : (K * X * U,) float32
        From `plan_pixels`.
    out_re, out_im : (K * X * G,) float32
        Images of the segments, changed in place.
    """
    n_k, n_x, n_u, n_j = shape
    n_g = len(cuts) - 1
    one, zero = np.uint64(1), np.float32(0.0)
    for k in numba.prange(n_k):
        for x in range(n_x):
            for g in range(n_g):
                total_re, total_im = zero, zero
                ku = np.uint64(k * n_u + cuts[g])
                xu = np.uint64((k * n_x + x) * n_u + cuts[g])
                for _ in range(cuts[g + 1] - cuts[g]):
                    place = shift[ku] + offset[xu]
                    cell = np.int32(place)
                    t = place - np.float32(cell)
                    j = ku * np.uint64(n_j) + np.uint64(cell)
                    a, b = pieces_re[j], pieces_im[j]
                    a += t * (pieces_re[j + one] - a)
                    b += t * (pieces_im[j + one] - b)
                    c = turn_re[ku] * real[xu] - turn_im[ku] * imag[xu]
                    d = turn_re[ku] * imag[xu] + turn_im[ku] * real[xu]
                    total_re += a * c - b * d
                    total_im += a * d + b * c
                    ku += one
                    xu += one
                out_re[(k * n_x + x) * n_g + g] = total_re
                out_im[(k * n_x + x) * n_g + g] = total_im


@njit(parallel=True)
def correlate_tiles(shape, cuts, pieces_re, pieces_im, shift, turn_re, turn_im, offset, real,
                    imag, weight_re, weight_im, along_re, along_im, slope_re, slope_im):
    """Adjoint of `focus_tiles`: what each sub-aperture contributes to weighted tiles.

    Parameters
    ----------
    shape, cuts, pieces_re, pieces_im, shift, turn_re, turn_im, offset, real, imag
        As for `focus_tiles`.
    weight_re, weight_im : (K * X * G,) float32
        Weights of the pixels.
    along_re, along_im : (K * U,) float64
        Receive ``sum_x conj(weight) contribution``; zeros before.
    slope_re, slope_im : (K * U,) float64
        The same for the contribution's derivative by `shift`, its phasor held.
    """
    n_k, n_x, n_u, n_j = shape
    n_g = len(cuts) - 1
    one = np.uint64(1)
    for k in numba.prange(n_k):
        for x in range(n_x):
            for g in range(n_g):
                w_re, w_im = weight_re[(k * n_x + x) * n_g + g], weight_im[(k * n_x + x) * n_g + g]
                ku = np.uint64(k * n_u + cuts[g])
                xu = np.uint64((k * n_x + x) * n_u + cuts[g])
                for _ in range(cuts[g + 1] - cuts[g]):
                    place = shift[ku] + offset[xu]
                    cell = np.int32(place)
                    t = place - np.float32(cell)
                    j = ku * np.uint64(n_j) + np.uint64(cell)
                    a, b = pieces_re[j], pieces_im[j]
                    step_re, step_im = pieces_re[j + one] - a, pieces_im[j + one] - b
                    a += t * step_re
                    b += t * step_im
                    c = turn_re[ku] * real[xu] - turn_im[ku] * imag[xu]
                    d = turn_re[ku] * imag[xu] + turn_im[ku] * real[xu]
                    e = w_re * c + w_im * d
                    f = w_re * d - w_im * c
                    along_re[ku] += a * e - b * f
                    along_im[ku] += a * f + b * e
                    slope_re[ku] += step_re * e - step_im * f
                    slope_im[ku] += step_re * f + step_im * e
                    ku += one
                    xu += one
