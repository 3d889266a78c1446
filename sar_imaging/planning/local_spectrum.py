"""Local frequencies of sub-aperture images.

The derivatives of the half paths times the wavenumber are the frequencies of the image.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from ..geometry.half_paths import half_paths
from ..geometry.illumination import NO_SPREAD, AmplitudeSpread, Illumination
from ..geometry.polar import PolarGrid
from ..signal.radar import RadarParameters
from .aliasing_error import usual_guard
from .echo_power import echo_powers

SAMPLES_PER_SIDE = 5  # grid positions at which the geometry is bounded
_SAMPLING_SLACK = 0.02  # of what is bounded


@dataclasses.dataclass(frozen=True)
class LocalSpectrum:
    """Local frequencies of a grid's sub-aperture images.

    Attributes
    ----------
    slope : (R, S) float64
        Derivative of the half path by direction, over that by range, metres, from each echo to
        points direction by direction. Times the wavenumber it is the frequency along direction.
    position : (S,) float64
        Where the points lie along direction, 0 to 1.
    wavenumber : (2,) floats
        Lowest and highest of the band, rad/m.
    half_range : float
        Largest frequency along range, relative to the carrier's, rad/m.
    by_range : (float, float)
        Smallest and largest derivative of the half paths by range.
    weight : (W, R) float64
        Shares of the echoes in the power of an image, see `echo_powers`.
    spread : AmplitudeSpread
        Frequencies along direction of the echoes' amplitude, radians per unit of it.
    """

    slope: np.ndarray
    position: np.ndarray
    wavenumber: tuple[float, float]
    half_range: float
    range_m: tuple[float, float]
    by_range: tuple[float, float]
    weight: np.ndarray
    spread: AmplitudeSpread = NO_SPREAD


@dataclasses.dataclass(frozen=True)
class Limits:
    """Extremes of the geometry between phase centres and a polar grid.

    Attributes
    ----------
    slope : (float, float)
        Of the half paths by range.
    slope_m : float
        Largest magnitude of their slope by direction over that by range, metres.
    half_range : float
        Largest frequency of the images along range, relative to the carrier's, rad/m.
    """

    range_m: tuple[float, float]
    slope: tuple[float, float]
    slope_m: float
    half_range: float

    @classmethod
    def of(cls, bands: LocalSpectrum) -> Limits:
        """Extremes of half paths, of their derivatives and of local frequencies."""
        steepest = float(max(bands.slope.max(), -bands.slope.min()))
        return cls(bands.range_m, bands.by_range, steepest, bands.half_range)

    def contain(self, other: Limits, slope_slack: float = 0.0) -> bool:
        """True when what was planned for these limits holds for those of other phase centres.

        Slopes of the half paths by range may exceed those planned for by `slope_slack`.
        """
        def within(a, b, least=0.0):
            # The extremes of samples miss the true ones by less than this.
            slack = max(_SAMPLING_SLACK * (b[1] - b[0]), least)
            return b[0] - slack <= a[0] and a[1] <= b[1] + slack

        return (within(other.range_m, self.range_m)
                and within(other.slope, self.slope, slope_slack)
                and within((0.0, other.slope_m), (0.0, self.slope_m))
                and within((0.0, other.half_range), (0.0, self.half_range)))


def local_spectrum(polar: PolarGrid, tx_m, rx_m, radar: RadarParameters,
                   illumination: Illumination | None = None, wanted: float = 1.0
                   ) -> LocalSpectrum:
    """Local frequencies of backprojected images at samples of a polar grid and its guards.

    `illumination` tells the amplitudes of the P C echoes, `wanted` the share of the ranges whose
    power counts.

    Raises
    ------
    ValueError
        Range does not grow along the lines of the grid.
    """
    # Frequencies in the guards count, too: the nearer, the more they change with direction.
    guard = usual_guard(polar.n_range)
    before = min(guard, max(0, ranges_before(polar, 0.0)) // 2)
    wider = dataclasses.replace(
        polar, range_start_m=polar.range_start_m - before * polar.range_spacing_m,
        n_range=before + polar.n_range + guard)
    r, alpha = wider.sampled(SAMPLES_PER_SIDE, SAMPLES_PER_SIDE)
    share = np.repeat(np.linspace(0, 1, SAMPLES_PER_SIDE), SAMPLES_PER_SIDE)
    position, along_range = polar.lines(r, alpha)[:2]
    along_alpha = polar.by_direction(r, alpha)
    tx_m, rx_m = tx_m.reshape(-1, 3), rx_m.reshape(-1, 3)
    length, by_range, slope = half_paths(tx_m, rx_m, position, along_range, along_alpha)
    # Corners of a cell that is lit in part count: the scene may end within it.
    lit = illumination and illumination.may_light(position, (SAMPLES_PER_SIDE,) * 2)
    some = by_range if lit is None else by_range[lit]
    extremes = float(some.min()), float(some.max())
    if extremes[0] <= 0.1:
        raise ValueError('range does not grow along the lines of the polar grid; it lies beside '
                         'or behind the track, use exact backprojection')
    slope /= by_range
    if lit is not None:
        slope = _of_lit_points(slope, lit)
    half_range = (radar.half_band_rad_per_m * extremes[1] + radar.wavenumbers_rad_per_m[1]
                  * max(1 - extremes[0], extremes[1] - 1))
    middle = len(position) // 2
    sides = (wanted * polar.n_range * polar.range_spacing_m * along_range[middle],
             polar.n_alpha * polar.alpha_spacing * along_alpha[middle])
    weight = echo_powers(tx_m, rx_m, position[middle], sides, radar)
    if illumination is not None:  # what lights nothing of the scene adds no power either
        amplitude = illumination.amplitude(position)
        bright = np.einsum('rs,rs->r', amplitude, amplitude)
        if (weight @ bright).min() > 0:
            weight = weight * bright / (weight * bright).mean(axis=1, keepdims=True)
    return LocalSpectrum(slope, share, radar.wavenumbers_rad_per_m, half_range,
                         (float(length.min()), float(length.max())), extremes, weight,
                         NO_SPREAD if illumination is None else
                         illumination.spread(position, along_alpha))


def _of_lit_points(slope, lit) -> np.ndarray:
    """Slopes (R, S) in which the mean of the points that an echo lights stands for the others."""
    count = lit.sum(axis=1, keepdims=True)
    mean = (slope * lit).sum(axis=1, keepdims=True) / np.maximum(count, 1)
    return np.where(lit | (count == 0), slope, mean)


def ranges_before(polar: PolarGrid, beyond: float) -> int:
    """Ranges on the plane before the first one, in all directions up to so far beyond the grid."""
    last = polar.alpha_start + (polar.n_alpha - 1) * polar.alpha_spacing
    steepest = max(abs(polar.alpha_start), abs(last)) + beyond
    if steepest >= 1:
        return -1
    nearest = abs(polar.height_m) / math.sqrt(1 - steepest ** 2)
    return math.floor((polar.range_start_m - nearest) / polar.range_spacing_m)
