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
from ..amplitude_spread import spread_frequencies, tail_error
from ..costs import costs
from ..interpolators import Interpolator, sufficient_interpolators
from ..polar_cover import PolarCover

TAPS, DEGREE = 10, 5
_LEAST_ECHOES = 4  # in a part
_WAVENUMBERS = 5  # of the band, at which errors are looked up


@dataclasses.dataclass(frozen=True)
class AzimuthParts:
    """Cut of the echoes of a block into parts, and the coarse lines on which they are imaged.

    Attributes
    ----------
    echoes : tuple of slice
        Echoes of each part.
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

    echoes: tuple[slice, ...]
    frequency: np.ndarray
    coarse: PolarGrid
    fine: PolarGrid
    interpolator: Interpolator
    error_db: float
    cost: float


def plan_parts(cover: PolarCover, wanted_db: float) -> AzimuthParts | None:
    """Cut echoes into as many parts as make a polar image quickest; None where that gains nothing.

    `wanted_db` is the error of the interpolation from the lines of the parts to those of the sum.
    """
    for interpolator in sufficient_interpolators(wanted_db, taps=TAPS, degree=DEGREE):
        best = _quickest_parts(cover, interpolator)
        if best is None:
            return None
        error_db = _interpolation_db(best, cover)
        # Much power may lie where bands end: parts have few echoes, or the platform stopped.
        if error_db <= wanted_db:
            return dataclasses.replace(best, error_db=error_db)
    return None


def _quickest_parts(cover: PolarCover, interpolator: Interpolator) -> AzimuthParts | None:
    fine, slope, echo_cost = cover.polar, cover.slope_alpha, cover.lattice.cost
    lowest, highest = cover.window.radar.wavenumbers_rad_per_m
    best, least = None, echo_cost * len(slope)
    n_parts = 2
    while n_parts * _LEAST_ECHOES <= len(slope):
        # Bands of the parts, radians per unit of alpha
        edges = np.linspace(0, len(slope), n_parts + 1).round().astype(int)
        lo = np.minimum.reduceat(slope.min(axis=1), edges[:-1])
        hi = np.maximum.reduceat(slope.max(axis=1), edges[:-1])
        lo, hi = np.minimum(lowest * lo, highest * lo), np.maximum(lowest * hi, highest * hi)
        lo, hi = lo - cover.spread.rms, hi + cover.spread.rms
        half = 0.5 * float((hi - lo).max())
        coarse = _coarse_grid(fine, math.pi / (half * interpolator.oversampling))
        if coarse is not None:
            merging = n_parts * (costs().upsampled_pixel
                                 + costs().upsampled_part / (fine.n_alpha * fine.n_range))
            cost = merging + echo_cost * len(slope) * (coarse.n_alpha / fine.n_alpha)
            if cost < least:
                least, best = cost, AzimuthParts(
                    tuple(map(slice, edges[:-1], edges[1:])), 0.5 * (lo + hi), coarse, fine,
                    interpolator, interpolator.error_db, cost)
        n_parts = math.ceil(n_parts * 1.4)
    return best


def _interpolation_db(parts: AzimuthParts, cover: PolarCover) -> float:
    """Mean error at the frequencies of the echoes, seen from the middle of their part's band."""
    middle = np.repeat(parts.frequency, [echoes.stop - echoes.start for echoes in parts.echoes])
    k = np.linspace(*cover.window.radar.wavenumbers_rad_per_m, _WAVENUMBERS)[:, None, None]
    per_radian = parts.coarse.alpha_spacing / (2 * math.pi)
    even = k * cover.slope_alpha - middle[:, None]
    error_db = parts.interpolator.mean_error_db(
        spread_frequencies(even, cover.spread.rms) * per_radian, cover.weight)
    tail = tail_error(cover.spread, even, lambda f: parts.interpolator.error_at(f * per_radian))
    return 10 * math.log10(10 ** (error_db / 10) + tail) if tail else error_db


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
