"""Polar images with beams: what interpolating them errs, and how finely they are sampled.

An echo's image is its phasor times its amplitude. Where the pattern ends, the amplitude has high
frequencies, and there its phasor has the highest ones as well: neither spectrum alone tells the
error. So the sum over the taps is compared with the value for random pairs.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable

import numpy as np

from ...geometry.grids import even_positions
from ...geometry.half_paths import pair_lengths
from ...geometry.illumination import Illumination
from ...geometry.polar import PolarGrid
from ...signal.radar import RadarParameters
from ..interpolators import Interpolator
from ..lit_pairs import LitPairs
from ..polar_cover import PolarCover
from ..profiles.range_resampling import RangeResampling
from .azimuth_upsampling import AzimuthParts, plan_parts
from .lit_lines import LitLines, plan_lit_segments
from .lit_phasors import Echoes, ImageLines

_TRIES = 4  # of finer and finer sampling
_CLOSE_DB = 0.5  # below what is wanted
_GAIN_TAPS, _THINNED = 96, 4  # over which deapodisation mixes lines; of fewer pairs


class LitPolar:
    """Plans the polar image of echoes with amplitudes: samples it as finely as these need.

    Parameters
    ----------
    illumination : Illumination
        Of the echoes.
    tx_m, rx_m : (R, 3) float64
        Phase centres of the echoes, metres.
    radar : RadarParameters
        Of their profiles.
    """

    def __init__(self, illumination: Illumination, tx_m, rx_m, radar: RadarParameters):
        self._illumination, self._radar = illumination, radar
        self._tx_m, self._rx_m, self._read = tx_m, rx_m, None

    def cover(self, cover_of: Callable, wanted_db: float) -> PolarCover | None:
        """Polar grid that is read well, or nearly, with the errors of reading it.

        ``cover_of(error_db)`` gives one as if amplitudes were even, or None; each pass of the
        interpolation to the map may err by `wanted_db`.
        """
        cover, asked_db = cover_of(wanted_db), wanted_db
        for _ in range(_TRIES):
            if cover is None:
                return None
            self._read = read = _PolarReading(cover, self._tx_m, self._rx_m, self._illumination)
            found = dataclasses.replace(
                cover, along_db=read.along_db(cover),
                between_db=read.between_db(cover.polar, cover.between, np.zeros(len(self._tx_m))),
                profile_db=cover.profile_db if cover.window.periodic else read.pairs.ends_db(
                    cover.window, cover.lattice.oversampling(cover.window.radar), self._tx_m,
                    self._rx_m))
            above_db = max(found.between_db, found.along_db) - wanted_db
            if above_db <= 0:
                break
            asked_db -= above_db + _CLOSE_DB
            cover = cover_of(asked_db)
        return found

    def parts(self, cover: PolarCover, wanted_db: float) -> AzimuthParts | None:
        """As `plan_parts`, with lines enough for the amplitudes."""
        asked_db = wanted_db
        for _ in range(_TRIES):
            parts = plan_parts(cover, asked_db)
            if parts is None:
                return None
            frequency = np.repeat(parts.frequency, [e.stop - e.start for e in parts.echoes])
            error_db = self._read.between_db(parts.coarse, parts.interpolator, frequency)
            if error_db <= wanted_db:
                return dataclasses.replace(parts, error_db=error_db)
            asked_db -= error_db - wanted_db + _CLOSE_DB
        return None

    def lines(self, polar: PolarGrid, lattice: RangeResampling, parts: AzimuthParts | None,
              profiles_db: float, lit_db: float
              ) -> tuple[RangeResampling | None, LitLines | None]:
        """How the lines of an image, or of images of its parts, read the profiles."""
        starts = (0,) if parts is None else tuple(e.start for e in parts.echoes)
        echoes = Echoes(self._tx_m, self._rx_m, starts, self._radar)
        return plan_lit_segments(self._illumination, ImageLines.of_polar(polar), echoes, lattice,
                                 profiles_db, lit_db)[:2]


class _PolarReading:
    """Pairs of an echo and a pixel of a map, read from a polar image.

    Parameters
    ----------
    cover : PolarCover
        Of the map.
    tx_m, rx_m : (R, 3) float64
        Phase centres of the echoes, metres.
    illumination : Illumination
        Of the echoes.
    """

    def __init__(self, cover: PolarCover, tx_m, rx_m, illumination: Illumination):
        grid, polar = cover.grid, cover.polar
        reach_m = max(cover.along.n_taps * polar.range_spacing_m,
                      cover.between.n_taps * polar.alpha_spacing * polar.range_m[-1]) / 2
        self.pairs = pairs = LitPairs.draw(
            illumination, functools.partial(even_positions, grid), grid.shape,
            (math.ceil(reach_m / grid.spacing_m),) * 2)
        if cover.between.deapodised:
            self.pairs = pairs = pairs.thinned(_THINNED)
        self._centres = tx_m[pairs.echoes], rx_m[pairs.echoes]
        self._length_m = pair_lengths(*self._centres, pairs.points_m)
        self._weight = cover.weight[0, pairs.echoes]
        low, high = cover.window.radar.wavenumbers_rad_per_m
        self._wavenumber = low + (high - low) * pairs.place
        self._range, self._alpha = polar.from_map(*pairs.points_m[:, :2].T)

    def between_db(self, polar: PolarGrid, interpolator: Interpolator, frequency) -> float:
        """Error of the interpolation between lines, dB.

        Images are taken to baseband along direction, by `frequency` of each echo, (R,) float64,
        radians per unit of it.
        """
        weights, alpha = _taps(interpolator, self._alpha, polar.alpha_start, polar.alpha_spacing)
        points = polar.at(self._range[:, None], alpha)
        turn = frequency[self.pairs.echoes][:, None] * (alpha - self._alpha[:, None])
        return self._error_db(weights, points, turn)

    def along_db(self, cover: PolarCover) -> float:
        """Error of the interpolation along the lines of the map, dB."""
        polar, axis = cover.polar, cover.axis
        weights, r = _taps(cover.along, self._range, polar.range_start_m, polar.range_spacing_m)
        offset = self.pairs.points_m - [*polar.origin_m[:2], polar.z_m]
        ahead = r ** 2 - (offset[:, 1 - axis] ** 2 + polar.height_m ** 2)[:, None]
        points = np.repeat(self.pairs.points_m[:, None], r.shape[1], axis=1)
        points[..., axis] = polar.origin_m[axis] + np.sign(offset[:, axis])[:, None] * np.sqrt(
            np.maximum(ahead, 0.0))
        turn = cover.window.radar.wavenumber_rad_per_m * (r - self._range[:, None])
        return self._error_db(weights, points, turn)

    def _error_db(self, weights, points, turn) -> float:
        """Error of weighted sums over taps (n, T) whose carriers have turned so far, dB."""
        phase = self._wavenumber[:, None] * (
            pair_lengths(*self._centres, points) - self._length_m[:, None]) - turn
        read = (weights * self.pairs.amplitude_at(points) * np.exp(1j * phase)).sum(axis=1)
        return self.pairs.error_db(np.abs(read - self.pairs.amplitude) ** 2, self._weight)


def _taps(interpolator: Interpolator, at, start: float, spacing: float
          ) -> tuple[np.ndarray, np.ndarray]:
    """Weights (n, T) with which places (n,) are read, and the places of the samples.

    The gain of spectra that are deapodised is a part of the weights.
    """
    number, t = np.divmod((at - start) / spacing, 1.0)
    weights = t[:, None] ** np.arange(len(interpolator.weights)) @ interpolator.weights
    first, n_taps = interpolator.first, interpolator.n_taps
    if interpolator.deapodised:
        kernel = np.fft.fftshift(np.fft.ifft(interpolator.gain(np.fft.fftfreq(_GAIN_TAPS))).real)
        mixed = np.zeros((n_taps, n_taps + _GAIN_TAPS - 1))
        for tap in range(n_taps):
            mixed[tap, tap:tap + _GAIN_TAPS] = kernel
        weights, first, n_taps = weights @ mixed, first - _GAIN_TAPS // 2, mixed.shape[1]
    taps = number[:, None] + first + np.arange(n_taps)
    return weights, start + spacing * taps
