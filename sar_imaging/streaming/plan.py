"""Plan of an aperture from a track that is foreseen, for AFBP while the pulses arrive."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from ..backends import backend
from ..geometry.grids import MapGrid
from ..geometry.polar import PolarGrid
from ..planning.afbp.edge_brightness import EdgeBrightness
from ..planning.afbp.map_cover import cover_for_fusion, map_density
from ..planning.afbp.subapertures import plan_subapertures
from ..planning.error_budget import LIVE_SHARES, total_db
from ..planning.interpolators import Interpolator
from ..planning.local_spectrum import LocalSpectrum, local_spectrum
from ..planning.polar_to_map import DEAPODISED_TAPS, margin
from ..planning.profiles.profile_reach import reach_warnings, some_pixels
from ..signal.pulses import PulseBlock
from ..signal.radar import RadarParameters

_ROWS_FOR_COVER = 256
_WINDOWS, _WAVENUMBERS = 9, 5  # at which errors of a sliding aperture are looked up
_FUSION_MARGIN_DB = 3.0  # for tracks that are less smooth than foreseen
_EXTENSION = 0.05  # of the aperture at both ends, for what is foreseen too short


def extension(n_pulses: int, length: int, slack: float) -> tuple[int, int]:
    """Pulses by which to extend an aperture at its start and end, to whole sub-apertures.

    Parameters
    ----------
    n_pulses : int
        Of the aperture.
    length : int
        Of a sub-aperture.
    slack : float
        Times the usual extension.
    """
    least = math.ceil(slack * _EXTENSION * n_pulses)
    extra = math.ceil((n_pulses + 2 * least) / length) * length - n_pulses
    return extra // 2, extra - extra // 2


class LivePlan:
    """Backprojection of the sub-apertures of one aperture, planned before its pulses came.

    Parameters
    ----------
    grid : MapGrid
        Map that the fused image is wanted on.
    radar : RadarParameters
        Of the compressed profiles.
    n_samples : int
        Samples of a profile.
    tx_m, rx_m : (P, C, 3) float64
        Phase centres of the aperture as foreseen, metres, extended at both ends.
    target_db : float
        Wanted error of the fused image on the map against time-domain correlation, dB.
    length : int, optional
        Pulses of a sub-aperture; the quickest if left out.
    slack : float
        Times the usual margin for deviations from the track; 0 for a track that is known.
    n_window : int
        Pulses of an image, where that is of any part of the track; 0 for the whole of it.

    Attributes
    ----------
    fusion : UnifiedPolarGrids
        Of the sub-aperture images and the fused one.
    length : int
        Pulses of a sub-aperture.

    Raises
    ------
    ValueError
        The geometry does not allow the target.
    """

    def __init__(self, grid: MapGrid, radar: RadarParameters, n_samples: int, tx_m, rx_m, *,
                 target_db: float, length: int | None = None, slack: float = 1.0,
                 n_window: int = 0):
        self.grid, self._known = grid, slack == 0
        cover, self._target_db = cover_for_fusion(grid, tx_m, rx_m, radar, n_samples, target_db,
                                                  shares=LIVE_SHARES)
        self._map_db = total_db(cover.along_db, cover.profile_db)
        margin_db = min(slack, 2.0) * _FUSION_MARGIN_DB
        polar = cover.polar

        def stage(polar):
            return plan_subapertures(polar, radar, n_samples, tx_m, rx_m,
                                   target_db=self._target_db - margin_db,
                                   pulses_per_subaperture=length,
                                   oversampling=cover.oversampling, ratio=cover.ratio,
                                   coverage=map_density(polar, grid, cover))

        def windows(n_pulses):
            return _for_windows(polar, radar, tx_m, rx_m, n_pulses, cover.between.oversampling)

        plan = stage(windows(n_window) if n_window else polar)
        # Where another length was asked for, gaps of the foreseen track made these shorter.
        self.length = length or max(p.stop - p.start for p in plan.sampling.pulses)
        if n_window % self.length:  # windows are whole sub-apertures
            plan = stage(windows(-(-n_window // self.length) * self.length))
        between_db = cover.between_db
        if n_window:
            between_db = _windows_db(plan.polar, radar, tx_m, rx_m, n_window, cover.between)
        self._map_db = total_db(self._map_db, between_db)
        self._plan, self._stage = plan, backend().SubapertureImager(plan)
        self.fusion = plan.fusion_grid
        self.warnings = plan.warnings + reach_warnings(some_pixels(grid), tx_m, rx_m, radar,
                                                       n_samples)

    def __str__(self) -> str:
        polar, fusion = self.fusion.polar, self.fusion
        return (f'sub-apertures of {self.length} pulses on {fusion.n_coarse} x '
                f'{fusion.coarse.n_range} pixels, fused to {polar.n_alpha} x {polar.n_range}')

    def check(self, tx_m, rx_m) -> tuple[float, float] | None:
        """Band of a sub-aperture and its error on the map, from its real phase centres.

        Parameters
        ----------
        tx_m, rx_m : (P, C, 3) float64
            Phase centres, metres.

        Returns
        -------
        centre_m, predicted_error_db : float
            Middle of the band, metres, and error against time-domain correlation, dB.

        None where the track differs so much that the error may exceed the target; never where
        the track had been known.
        """
        try:
            centre_m, error_db, within = self._plan.check(tx_m, rx_m)
        except ValueError:
            return None
        if not self._known and not (within and error_db <= self._target_db):
            return None
        return centre_m, total_db(error_db, self._map_db)

    def image(self, block: PulseBlock) -> tuple[np.ndarray, float]:
        """Backproject a sub-aperture.

        Parameters
        ----------
        block : PulseBlock
            Its range profiles with phase centres.

        Returns
        -------
        image : (n_alpha, n_range) complex64
            On ``fusion.coarse``, at range baseband.
        uneven_db : float
            By how much its error exceeds the predicted one, because what lies right beyond the
            edges is brighter than the image, dB.

        Raises
        ------
        ValueError
            The block does not match the plan.
        """
        parts = self._stage.image(0, block)
        image = np.empty(parts.shape[1:], np.complex64)
        image.real, image.imag = parts
        brightness = EdgeBrightness(self.fusion, self._plan.sampling.coverage)
        brightness.add(parts)
        return image, brightness.uneven_db


def _for_windows(polar: PolarGrid, radar: RadarParameters, tx_m, rx_m, n_window: int,
                 oversampling: float) -> PolarGrid:
    """A polar grid with as many directions as images of windows of the track need.

    At baseband along direction their band is that of the window, wherever that lies.
    """
    bands, width = _bands_of_some(polar, radar, tx_m, rx_m, n_window)
    slope = bands.slope.reshape(-1, rx_m.shape[1] * bands.slope.shape[1])
    # Every window: where a track turns back, their bands differ much.
    low = minimum_filter1d(slope.min(axis=1), width, mode='nearest')
    high = maximum_filter1d(slope.max(axis=1), width, mode='nearest')
    # the carrier's phase is taken away, what the rest of the band has of it remains
    rest = 0.5 * np.ptp(bands.wavenumber) * np.abs(low + high) / 2
    half = float((bands.wavenumber[1] * 0.5 * (high - low) + rest).max())
    spacing = max(math.pi / (half * oversampling), polar.alpha_spacing)
    beyond = margin(DEAPODISED_TAPS)
    first = polar.alpha_start + beyond * polar.alpha_spacing
    extent = (polar.n_alpha - 2 * beyond) * polar.alpha_spacing
    return dataclasses.replace(
        polar, alpha_start=first - beyond * spacing, alpha_spacing=spacing,
        n_alpha=math.ceil(extent / spacing) + 2 * beyond)


def _windows_db(polar: PolarGrid, radar: RadarParameters, tx_m, rx_m, n_window: int,
                between: Interpolator) -> float:
    """Error of the interpolation between lines in the worst of some windows, dB."""
    bands, width = _bands_of_some(polar, radar, tx_m, rx_m, n_window)
    n_channels, worst = rx_m.shape[1], 0.0
    k = np.linspace(*bands.wavenumber, _WAVENUMBERS)[:, None, None]
    for first in np.unique(np.linspace(0, len(bands.slope) // n_channels - width,
                                       _WINDOWS).astype(int)):
        rows = slice(first * n_channels, (first + width) * n_channels)
        slope, weight = bands.slope[rows], bands.weight[rows]
        middle = 0.5 * (slope.min() + slope.max()) * radar.wavenumber_rad_per_m
        error = between.error_at((k * slope - middle) * (polar.alpha_spacing / (2 * math.pi)))
        worst = max(worst, float(error.mean(axis=(0, 2)) @ weight / weight.sum()))
    return 10 * math.log10(worst + 1e-16)


def _bands_of_some(polar, radar, tx_m, rx_m, n_window) -> tuple[LocalSpectrum, int]:
    """Local frequencies of some pulses of a track, and how many of these a window has."""
    step = max(1, len(tx_m) // _ROWS_FOR_COVER)
    tx_m, rx_m = tx_m[::step], rx_m[::step]
    return local_spectrum(polar, tx_m, rx_m, radar), min(n_window // step + 2, len(tx_m))
