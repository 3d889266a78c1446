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

from ...geometry.polar import PolarGrid
from ..costs import costs
from ..interpolators import Interpolator, coarsest_interpolator, finer_interpolator

TAPS, DEGREE = 10, 5
_LEAST_ROWS = 4  # in a part
_WAVENUMBERS = 5  # of the band, at which errors are looked up


@dataclasses.dataclass(frozen=True)
class AzimuthParts:
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
    error_db : float
        Of the interpolation, dB.
    cost : float
        Nanoseconds per pixel of the sum.
    """

    rows: tuple[slice, ...]
    frequency: np.ndarray
    coarse: PolarGrid
    fine: PolarGrid
    interpolator: Interpolator
    error_db: float
    cost: float


def angular_bands(slope, k_lo: float, k_hi: float, n_parts: int):
    """Cut rows into parts: their slices, and middle and half width of each one's band.

    Parameters
    ----------
    slope : (R, S) float64
        Derivative by alpha of the half path from each row to sampled points, metres.
    k_lo, k_hi : float
        Wavenumbers at the ends of the radar's band, rad/m.
    n_parts : int
        Parts, about equally many rows in each.

    Returns
    -------
    rows, middle, half_width
        Bands, (n_parts,) float64, along direction, radians per unit of alpha.
    """
    edges = np.linspace(0, len(slope), n_parts + 1).round().astype(int)
    lo = np.minimum.reduceat(slope.min(axis=1), edges[:-1])
    hi = np.maximum.reduceat(slope.max(axis=1), edges[:-1])
    lo, hi = np.minimum(k_lo * lo, k_hi * lo), np.maximum(k_lo * hi, k_hi * hi)
    rows = [slice(a, b) for a, b in zip(edges[:-1], edges[1:], strict=True)]
    return rows, 0.5 * (lo + hi), 0.5 * (hi - lo)


def plan_parts(fine: PolarGrid, slope, weight, k_lo: float, k_hi: float, interpolation_db: float,
               row_cost: float) -> AzimuthParts | None:
    """Cut rows into as many parts as make the image quickest; None where that gains nothing.

    Parameters
    ----------
    fine : PolarGrid
        Grid of the sum.
    slope, k_lo, k_hi :
        As for `angular_bands`.
    weight : (R,) float64
        Share of each row in the power of the image.
    interpolation_db : float
        Wanted error of the interpolation to the lines of the sum, dB.
    row_cost : float
        Nanoseconds of backprojecting one row to one pixel.
    """
    interpolator = coarsest_interpolator(interpolation_db, taps=TAPS, degree=DEGREE)
    while interpolator is not None:
        best = _quickest_parts(fine, slope, k_lo, k_hi, interpolator, row_cost)
        if best is None:
            return None
        error_db = _interpolation_db(best, slope, weight, np.linspace(k_lo, k_hi, _WAVENUMBERS))
        if error_db <= interpolation_db:
            return dataclasses.replace(best, error_db=error_db)
        # Much of the power lies where bands end: parts have few rows, or the platform stopped.
        interpolator = finer_interpolator(interpolator)
    return None


def _quickest_parts(fine, slope, k_lo, k_hi, interpolator, row_cost) -> AzimuthParts | None:
    best, least = None, row_cost * len(slope)
    n_parts = 2
    while n_parts * _LEAST_ROWS <= len(slope):
        rows, middle, half = angular_bands(slope, k_lo, k_hi, n_parts)
        coarse = _coarse_grid(fine, math.pi / (half.max() * interpolator.oversampling))
        if coarse is not None:
            merging = n_parts * (costs().upsampled_pixel
                                 + costs().upsampled_part / (fine.n_alpha * fine.n_range))
            share = coarse.n_alpha / fine.n_alpha
            if merging + row_cost * len(slope) * share < least:
                least = merging + row_cost * len(slope) * share
                best = AzimuthParts(tuple(rows), middle, coarse, fine, interpolator,
                                    interpolator.error_db, least)
        n_parts = math.ceil(n_parts * 1.4)
    return best


def _interpolation_db(parts: AzimuthParts, slope, weight, wavenumber) -> float:
    """Mean error at the frequencies of the rows, seen from the middle of their part's band."""
    middle = np.repeat(parts.frequency, [rows.stop - rows.start for rows in parts.rows])
    frequency = wavenumber[:, None, None] * slope - middle[:, None]
    error = parts.interpolator.error_at(
        frequency * (parts.coarse.alpha_spacing / (2 * math.pi))).mean(axis=(0, 2))
    return 10 * math.log10(float(error @ weight / weight.sum()) + 1e-16)


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
