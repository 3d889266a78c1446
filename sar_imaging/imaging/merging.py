"""Sub-aperture polar images of one block, merged along direction.

A short part of the aperture makes an image that varies slowly with direction once the phase of its
middle is taken off, so a few lines suffice. Parts are backprojected onto such coarse lines and
interpolated to the lines of the common polar grid, which they share in range: the interpolation is
one-dimensional, its weights are constant along a line, and its error is known.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from ..compilation import njit, numba
from ..geometry.polar import PolarGrid
from .interpolation import Interpolator, design_interpolator

TAPS, DEGREE = 10, 5
# Time of a merged pixel and of one more part; a pixel and row of the kernel is 1 (measured)
_COST_PIXEL, _COST_PART = 0.6, 4e5
_LEAST_ROWS = 4  # in a part


@dataclasses.dataclass(frozen=True)
class AngularParts:
    """Cut of the rows of a block into parts, and the coarse lines on which they are imaged.

    Attributes
    ----------
    rows : tuple of slice
        Rows of each part.
    frequency : (n_parts,) float64
        Middle of the band of each part's image along direction, radians per unit of alpha.
    coarse, fine : PolarGrid
        Grids of the parts and of their sum; they differ in direction only.
    interpolator : Interpolator
        From coarse to fine lines.
    cost : float
        Relative time per pixel of the sum, the backprojection excluded.
    """

    rows: tuple[slice, ...]
    frequency: np.ndarray
    coarse: PolarGrid
    fine: PolarGrid
    interpolator: Interpolator
    cost: float


def angular_bands(slope, k_lo: float, k_hi: float, n_parts: int):
    """Band along direction of each part of the rows.

    Parameters
    ----------
    slope : (R, S) float64
        Derivative by alpha of the half path from each row to sampled points, metres.
    k_lo, k_hi : float
        Wavenumbers at the ends of the radar's band, rad/m.
    n_parts : int
        Number of parts.

    Returns
    -------
    rows : list of slice
        Rows of each part.
    middle, half_width : (n_parts,) float64
        Of the bands, radians per unit of alpha.
    """
    edges = np.linspace(0, len(slope), n_parts + 1).round().astype(int)
    lo = np.minimum.reduceat(slope.min(axis=1), edges[:-1])
    hi = np.maximum.reduceat(slope.max(axis=1), edges[:-1])
    lo, hi = np.minimum(k_lo * lo, k_hi * lo), np.maximum(k_lo * hi, k_hi * hi)
    rows = [slice(a, b) for a, b in zip(edges[:-1], edges[1:], strict=True)]
    return rows, 0.5 * (lo + hi), 0.5 * (hi - lo)


def plan_parts(fine: PolarGrid, slope, k_lo: float, k_hi: float, oversampling: float,
               row_cost: float) -> AngularParts | None:
    """Cut rows into as many parts as make the image quickest.

    Parameters
    ----------
    fine : PolarGrid
        Grid of the sum.
    slope, k_lo, k_hi :
        As for `angular_bands`.
    oversampling : float
        Of the coarse lines along direction.
    row_cost : float
        Relative time of backprojecting one row to one pixel.

    Returns
    -------
    AngularParts or None
        None where cutting gains nothing.
    """
    interpolator = design_interpolator(oversampling, taps=TAPS, degree=DEGREE)
    best, least = None, row_cost * len(slope)
    n_parts = 2
    while n_parts * _LEAST_ROWS <= len(slope):
        rows, middle, half = angular_bands(slope, k_lo, k_hi, n_parts)
        coarse = _coarse_grid(fine, math.pi / (half.max() * oversampling))
        if coarse is not None:
            merging = n_parts * (_COST_PIXEL + _COST_PART / (fine.n_alpha * fine.n_range))
            share = coarse.n_alpha / fine.n_alpha
            if merging + row_cost * len(slope) * share < least:
                least = merging + row_cost * len(slope) * share
                best = AngularParts(tuple(rows), middle, coarse, fine, interpolator, least)
        n_parts = math.ceil(n_parts * 1.4)
    return best


def _coarse_grid(fine: PolarGrid, spacing: float) -> PolarGrid | None:
    """Lines at a spacing that cover the fine ones and the interpolator's reach."""
    beyond = TAPS // 2
    n_alpha = math.ceil((fine.n_alpha - 1) * fine.alpha_spacing / spacing) + 2 * beyond + 1
    if n_alpha >= fine.n_alpha:
        return None
    try:
        return dataclasses.replace(fine, n_alpha=n_alpha, alpha_spacing=spacing,
                                   alpha_start=fine.alpha_start - beyond * spacing)
    except ValueError:
        return None


class AngularMerging:
    """Interpolate images of parts to the lines of their sum.

    Parameters
    ----------
    parts : AngularParts
        Plan.
    """

    def __init__(self, parts: AngularParts):
        coarse, fine, interpolator = parts.coarse, parts.fine, parts.interpolator
        v = (fine.alpha - coarse.alpha_start) / coarse.alpha_spacing
        floor = np.clip(np.floor(v), -interpolator.first,
                        coarse.n_alpha - TAPS - interpolator.first)
        self._start = floor.astype(np.int64) + interpolator.first
        powers = (v - floor)[:, None] ** np.arange(DEGREE + 1)
        self._weights = (powers @ interpolator.weights.astype(np.float64)).astype(np.float32)
        self._parts = parts

    def add(self, number: int, image, total) -> None:
        """Add the image of a part to the sum.

        Parameters
        ----------
        number : int
            Which part.
        image : (2, n_alpha_coarse, n_range) float32
            Real and imaginary part of its image; overwritten.
        total : (2, n_alpha, n_range) float32
            Sum; changed in place.
        """
        parts = self._parts
        frequency = parts.frequency[number]
        down, up = (np.exp(1j * np.fmod(sign * frequency * grid.alpha, 2 * np.pi)).astype(
            np.complex64) for sign, grid in ((-1, parts.coarse), (1, parts.fine)))
        _rotate_lines(image[0], image[1], down)
        _merge(image[0].reshape(-1), image[1].reshape(-1), parts.fine.n_range, self._start,
               self._weights.reshape(-1), up, total[0].reshape(-1), total[1].reshape(-1))


@njit(parallel=True)
def _rotate_lines(real, imag, phasor):
    for line in numba.prange(real.shape[0]):
        c, s = phasor[line].real, phasor[line].imag
        for i in range(real.shape[1]):
            re, im = real[line, i], imag[line, i]
            real[line, i] = re * c - im * s
            imag[line, i] = re * s + im * c


@njit(parallel=True)
def _merge(real, imag, n_range, start, weights, phasor, total_re, total_im):
    n = np.uint64(n_range)
    for line in numba.prange(len(start)):
        w = np.uint64(line * TAPS)
        w0, w1, w2, w3, w4 = (weights[w], weights[w + np.uint64(1)], weights[w + np.uint64(2)],
                              weights[w + np.uint64(3)], weights[w + np.uint64(4)])
        w5, w6, w7, w8, w9 = (weights[w + np.uint64(5)], weights[w + np.uint64(6)],
                              weights[w + np.uint64(7)], weights[w + np.uint64(8)],
                              weights[w + np.uint64(9)])
        c, s = phasor[line].real, phasor[line].imag
        p0 = np.uint64(start[line]) * n
        p1, p2, p3 = p0 + n, p0 + np.uint64(2) * n, p0 + np.uint64(3) * n
        p4, p5, p6 = p1 + np.uint64(3) * n, p2 + np.uint64(3) * n, p3 + np.uint64(3) * n
        p7, p8, p9 = p4 + np.uint64(3) * n, p5 + np.uint64(3) * n, p6 + np.uint64(3) * n
        to = np.uint64(line) * n
        for i in range(n):
            re = (w0 * real[p0 + i] + w1 * real[p1 + i] + w2 * real[p2 + i] + w3 * real[p3 + i]
                  + w4 * real[p4 + i] + w5 * real[p5 + i] + w6 * real[p6 + i]
                  + w7 * real[p7 + i] + w8 * real[p8 + i] + w9 * real[p9 + i])
            im = (w0 * imag[p0 + i] + w1 * imag[p1 + i] + w2 * imag[p2 + i] + w3 * imag[p3 + i]
                  + w4 * imag[p4 + i] + w5 * imag[p5 + i] + w6 * imag[p6 + i]
                  + w7 * imag[p7 + i] + w8 * imag[p8 + i] + w9 * imag[p9 + i])
            total_re[to + i] += re * c - im * s
            total_im[to + i] += re * s + im * c
