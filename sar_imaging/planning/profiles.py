# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""How range profiles are prepared for an image: cut to the ranges it needs, and resampled.

Backprojection reads range profiles on a range grid whose spacing is the half-path distance between
neighbouring pixels of an image line. The more the true distance differs from it, the further a
pixel drifts from its interval of the grid along a segment; this module takes the drift from the
exact geometry and chooses the quickest segment that keeps the predicted error. Pixels whose ranges
leave the profiles get nothing from a pulse, and imagers say so. Phase histories may stay as they
came: they are the band of a periodic range profile.
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, TypeVar, cast

import numpy as np
import scipy.fft

from ..geometry.grids import Grid
from ..geometry.half_paths import Paths, half_paths
from ..signal.radar import RadarParameters, Waveform
from ..signal.windows import window as window_weights
from .aliasing_error import cosine_fall, guard_taper
from .costs import costs
from .interpolators import LEAST_MARGIN, LINE_DEGREE, Interpolator, design_interpolator
from .plan import total_db
from .transform_lengths import cost_per_sample, smooth_lengths

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from ..geometry.illumination import Illumination

    _Powers = tuple[tuple[int, float], ...]  # of a segment's half length, and errors at 1

_Slope = TypeVar('_Slope', float, np.ndarray)


class BeyondPeriod(ValueError):
    """Phase histories have to be compressed, since an image reaches beyond their period."""


class PhaseHistory:
    """What `Profiles` needs of a phase history; stands where a `RangeGate` does for profiles.

    The range grid of the profiles is one inverse transform away from the frequencies of a pulse;
    range compression first and the range grid from its profiles take three. The profile repeats
    with the unambiguous range.

    Parameters
    ----------
    radar, n_samples : RadarParameters, int
        Of the pulses, stepped frequency, and their frequencies K.
    weighting : str
        Spectral weighting over the band, see `sar_imaging.signal.windows`.

    Attributes
    ----------
    radar : RadarParameters
        Radar parameters of the profiles: the carrier is the middle one of the frequencies (the
        upper one of the two where their number is even), so that it has a bin of its own.
    n_samples, zero : int
        Number of frequencies, and which of them is the carrier.
    range_start_m, phase_range_m : float
        Half path where the period around the reference delay starts, and at which the carrier
        phase of the profiles is zero, the reference; metres.
    period_m : float
        Unambiguous range, metres.

    Raises
    ------
    ValueError
        The waveform is another.
    """

    periodic = True

    def __init__(self, radar: RadarParameters, n_samples: int, weighting: str = 'none'):
        if radar.waveform != Waveform.STEPPED_FREQUENCY:
            raise ValueError(f'waveform {radar.waveform.name.lower()} cannot be imaged from raw '
                             'pulses; apply range compression (RangeCompressor) first')
        step_hz = radar.bandwidth_hz / n_samples
        self.n_samples, self.zero = int(n_samples), int(n_samples) // 2
        self.radar = dataclasses.replace(
            radar, sample_rate_hz=radar.bandwidth_hz,
            carrier_hz=radar.carrier_hz + (self.zero - (n_samples - 1) / 2) * step_hz)
        self.period_m = radar.propagation_speed_m_per_s / (2 * step_hz)
        self.phase_range_m = radar.range_start_m
        self.range_start_m = radar.range_start_m - self.period_m / 2
        weights = window_weights(weighting, n_samples)
        # The profile starts half a period before the reference: half a cycle from bin to bin.
        sign = 1 - 2 * ((np.arange(n_samples) - self.zero) % 2)
        self._gain = (sign * weights / weights.sum()).astype(np.float32)

    def end_error(self, range_m: ArrayLike, oversampling: float = math.inf) -> np.ndarray:
        """Zeros: what is periodic has no ends."""
        return np.zeros(np.shape(range_m))

    def predictable(self, range_m: ArrayLike, illuminated: np.ndarray | np.bool_ | bool = True
                    ) -> np.ndarray:
        """All half paths."""
        return np.ones(np.shape(range_m), bool)

    def mean_end_error_db(self, range_m: np.ndarray, n_axes: int = 2,
                          oversampling: float = math.inf, illuminated: np.ndarray | None = None
                          ) -> float:
        """-inf: what is periodic has no ends."""
        return -math.inf

    def check_period(self, range_m: tuple[float, float]) -> None:
        """Raise `BeyondPeriod` where half paths leave the period."""
        stop_m = self.range_start_m + self.period_m
        if range_m[0] < self.range_start_m or range_m[1] > stop_m:
            raise BeyondPeriod(f'half paths of {range_m[0]:.1f} to {range_m[1]:.1f} m leave the '
                               f'period of {self.range_start_m:.1f} to {stop_m:.1f} m, beyond '
                               'which profiles end')

    def gain(self, n_padded: int, oversampling: float = math.inf) -> np.ndarray:
        """(K,) float32 factor of each frequency; `n_padded` is K."""
        return self._gain


_PIXELS_PER_SIDE, _ECHOES = {2: 24, 3: 8}, 65  # at which ranges are looked at, by axes


def some_pixels(grid: Grid) -> np.ndarray:
    """(S, 3) float64 positions all over a grid, metres, its corners among them."""
    n = _PIXELS_PER_SIDE[len(grid.shape)]
    index = np.meshgrid(*(np.unique(np.linspace(0, size - 1, n).round().astype(int))
                          for size in grid.shape), indexing='ij')
    return grid.positions(*(i.ravel() for i in index))


def covered_ranges(radar: RadarParameters, n_samples: int) -> tuple[float, float]:
    """Half paths of the first and the last sample of a profile, metres."""
    start = radar.range_start_m
    return start, start + (n_samples - 1) * radar.sample_spacing_m


class OutOfReach(ValueError):
    """No profile reaches a grid."""


def check_reach(range_m: tuple[float, float], radar: RadarParameters, n_samples: int) -> None:
    """Raise ValueError where no profile reaches a grid whose half paths are `range_m`."""
    start, stop = covered_ranges(radar, n_samples)
    if range_m[1] < start or range_m[0] > stop:
        raise OutOfReach(
            f'the grid lies {range_m[0]:.1f} to {range_m[1]:.1f} m from the antenna, the '
            f'profiles cover {start:.1f} to {stop:.1f} m; move the grid or the range window')


def reach_warnings(points_m: np.ndarray, tx_m: np.ndarray, rx_m: np.ndarray,
                   radar: RadarParameters, n_samples: int, illumination: Illumination | None = None
                   ) -> tuple[str, ...]:
    """Say which share of the pixels lies beyond the profiles for some of the pulses.

    Nothing where all of them, (S, 3) all over the image, lie within the `n_samples` of the
    profiles for all phase centres, (..., 3), metres, that light them.
    """
    start, stop = covered_ranges(radar, n_samples)
    centres = [c.reshape(-1, 3) for c in (tx_m, rx_m)]
    echoes = np.linspace(0, len(centres[0]) - 1, min(len(centres[0]), _ECHOES)).round().astype(int)
    length = half_paths(*(c[echoes] for c in centres), points_m)[0]
    outside = (length < start) | (length > stop)
    if illumination is not None:
        outside &= illumination.select(echoes).amplitude(points_m) > 0
    if not outside.any():
        return ()
    return (f'the ranges of {_percent(outside.any(axis=0).mean())} of the pixels, '
            f'{length.min():.1f} to {length.max():.1f} m, leave the profiles, {start:.1f} to '
            f'{stop:.1f} m, for some of the pulses, which add nothing there: '
            f'{_percent(outside.mean())} of the image is missing; the predicted error is that '
            f'of pixels {end_samples(radar)} samples or more within the profiles; keep more of '
            'them, or make the grid smaller',)


def _percent(share: float) -> str:
    return f'{100 * share:.1f} %'


# Samples beyond the needed ranges, times 1 - bandwidth over sample rate. What the cut changes
# within them is below -94 dB of the profile there.
_REACH = 24.0
_TAPER_SHARE, _TAPER_SHAPE = 0.3, 4.0  # of these samples: longer tapers begin too near
_TONES, _LONGEST = 8, 2048  # in the band, and samples of a table of errors
_SERIES_SHARPNESS = math.asinh(10 ** (130 / 20)) / math.pi
_ECHOES_FOR_MEANS, _GOLDEN = 512, (math.sqrt(5) - 1) / 2
_ECHOES_NEAR_ENDS = 9
_WORTHWHILE = 0.9  # longer windows are not worth a copy


@dataclasses.dataclass(frozen=True)
class RangeGate:
    """Part of the range profiles that an image needs, with smooth ends where it cuts.

    Attributes
    ----------
    radar : RadarParameters
        Radar parameters of the profiles.
    first, n_samples : int
        First sample, negative where so many zeros come before it, and number of samples with
        these.
    range_start_m : float
        Half path of the first sample, metres.
    n_rise, n_fall : int
        Samples over which the window rises at its start and falls at its end; 0 where it ends
        with the profile.

    Examples
    --------
    >>> from sar_imaging import RadarParameters
    >>> from sar_imaging.planning.profiles import RangeGate
    >>> radar = RadarParameters(10e9, 300e6, 400e6, first_sample_delay_s=6e-7)
    >>> gate = RangeGate.around(radar, n_samples=1024, range_m=(150.0, 170.0))
    >>> print(f'{gate.n_samples} samples from {gate.range_start_m:.1f} m on')
    246 samples from 113.9 m on
    """

    radar: RadarParameters
    first: int
    n_samples: int
    range_start_m: float
    n_rise: int
    n_fall: int
    periodic = False
    phase_range_m = 0.0  # where the carrier phase of the profiles is zero
    zero = 0  # bin of the carrier in `spectrum`

    @classmethod
    def around(cls, radar: RadarParameters, n_samples: int, range_m: tuple[float, float],
               lead: int = 0) -> RangeGate:
        """Window for half paths, as far as the profile has them.

        Where these leave the profile it begins with so many zeros, `lead`, over which filtered
        profiles fade away.
        """
        beyond = math.ceil(_REACH / (1 - radar.bandwidth_hz / radar.sample_rate_hz))
        lo, hi = ((r - radar.range_start_m) / radar.sample_spacing_m for r in range_m)
        first = min(max(math.floor(lo) - beyond, 0), n_samples)
        stop = min(max(math.ceil(hi) + beyond, 0), n_samples)
        if not 2 * beyond <= stop - first <= _WORTHWHILE * n_samples:
            first, stop = 0, n_samples
        taper = int(_TAPER_SHARE * beyond)
        if first == 0 and (lo < 0 or hi > n_samples - 1):
            first = -lead
        return cls(radar, first, stop - first,
                   radar.range_start_m + first * radar.sample_spacing_m,
                   taper if first > 0 else 0, taper if stop < n_samples else 0)

    @classmethod
    def whole(cls, radar: RadarParameters, n_samples: int) -> RangeGate:
        """Window that takes all samples."""
        return cls(radar, 0, n_samples, radar.range_start_m, 0, 0)

    def end_error(self, range_m: ArrayLike, oversampling: float = math.inf) -> np.ndarray:
        """(...) mean squared error at half paths (...), metres, because the window ends.

        Relative to the power of the profile, which is taken to go on beyond its ends: 1 where
        nothing is read. The oversampling is that of the range grid that is read, see `gain`.
        """
        given = round(self.radar.sample_rate_hz / self.radar.bandwidth_hz, 2)
        after = (np.asarray(range_m) - self.range_start_m) / self.radar.sample_spacing_m
        error: float | np.ndarray = 0.0
        for distance, taper in ((after + min(self.first, 0), self.n_rise),
                                (self.n_samples - 1 - after, self.n_fall)):
            table = _end_errors(given, min(given, round(oversampling, 2)), taper)
            # NaN, where pixels have no position, stays NaN
            whole = np.fmin(np.fmax(distance, 0), len(table) - 1).astype(np.intp)
            here, beyond = table.take(whole), table.take(whole + 1, mode='clip')
            error = error + np.where(distance < 0, 1.0,
                                     here + (distance - whole) * (beyond - here))
        return np.minimum(error, 1.0)

    def predictable(self, range_m: ArrayLike, illuminated: np.ndarray | np.bool_ | bool = True
                    ) -> np.ndarray:
        """(...) half paths (...), metres, at which an error can be told.

        Where some of those that are `illuminated` leave the profile, these are not near its ends.
        """
        after = (np.asarray(range_m) - self.range_start_m) / self.radar.sample_spacing_m
        # a window that rises or falls ends within the profile, far enough away
        within = np.minimum(after + (np.inf if self.n_rise else min(self.first, 0)),
                            (np.inf if self.n_fall else self.n_samples - 1) - after)
        leaves = ((within < 0) & illuminated).any()
        return within >= (end_samples(self.radar) if leaves else -np.inf)

    def mean_end_error_db(self, range_m: np.ndarray, n_axes: int = 2,
                          oversampling: float = math.inf, illuminated: np.ndarray | None = None
                          ) -> float:
        """Mean of `end_error` where it is `predictable` for all echoes, dB; NaN for nowhere.

        Half paths are those from some echoes to a square or cube of positions, edge to edge:
        (R, n ** n_axes) float64, metres.
        Of these pairs, (R, n ** n_axes), only those that are `illuminated` count, where that is
        given.
        """
        lit = np.bool_(True) if illuminated is None or not illuminated.any() else illuminated
        side = np.ones(round(range_m.shape[1] ** (1 / n_axes)))
        side[[0, -1]] = 0.5  # they stand for half as much of the image
        weight = functools.reduce(np.multiply.outer, [side] * n_axes).ravel()
        known = self.predictable(range_m, lit) | ~lit
        weight = weight * lit * known.all(axis=0)
        some = echoes_for_means(len(range_m))
        return mean_db(self.end_error(range_m[some], oversampling),
                       weight if weight.ndim == 1 else weight[some])

    def gain(self, n_padded: int, oversampling: float = math.inf) -> np.ndarray:
        """(n_padded,) float32 factor of each bin of a spectrum on the way back to ranges.

        Without its taper outside the band the ends of a profile, where sidelobes are cut off,
        would ring far inside. It ends at the highest frequency of the samples, or of the ranges
        that they are resampled to, `oversampling` times the bandwidth, where that is coarser.
        """
        given = self.radar.sample_rate_hz / self.radar.bandwidth_hz
        return (_band_taper(n_padded, given, min(given, oversampling)) / n_padded
                ).astype(np.float32)


def error_near_ends_db(window: RangeGate | PhaseHistory, oversampling: float, tx_m: np.ndarray,
                       rx_m: np.ndarray, points_m: np.ndarray) -> float:
    """Mean error because a window ends near pixels, dB; NaN where nothing can be told.

    Few corners of an image make it: of a hundred pixels all over it, none or too many lie there.

    Parameters
    ----------
    window, oversampling :
        As of `RangeGate.end_error`.
    tx_m, rx_m : (R, 3) float64
        Phase centres, metres.
    points_m : (S, 3) float64
        Thousands of positions all over the image, metres.
    """
    some = np.linspace(0, len(tx_m) - 1, min(len(tx_m), _ECHOES_NEAR_ENDS)).round().astype(int)
    length = half_paths(tx_m[some], rx_m[some], points_m)[0]
    return mean_db(window.end_error(length, oversampling),
                   window.predictable(length).all(axis=0))


def end_warnings(error_db: float, target_db: float) -> tuple[str, ...]:
    """Say that profiles end so near the pixels that an image misses its target."""
    if not error_db > target_db:
        return ()
    return (f'the profiles end so near the pixels that the image errs by {error_db:.1f} dB, '
            f'{target_db:.0f} dB were asked for: at the edge, and the more the brighter it is '
            'there; keep more samples, or make the grid smaller',)


def echoes_for_means(n: int) -> np.ndarray:
    """Numbers of some of n echoes, evenly and in no step with channels, ascending int64.

    Multiples of the golden ratio fill an interval evenly, however many there are.
    """
    if n <= _ECHOES_FOR_MEANS:
        return np.arange(n)
    return np.unique((np.arange(_ECHOES_FOR_MEANS) * _GOLDEN % 1 * n).astype(np.int64))


def end_samples(radar: RadarParameters) -> int:
    """Samples on either side on which a value between two depends, to -130 dB (Knab 1979)."""
    return math.ceil(_SERIES_SHARPNESS / (1 - radar.bandwidth_hz / radar.sample_rate_hz))


def mean_db(error: ArrayLike, weight: ArrayLike) -> float:
    """Weighted mean of squared errors, (...), dB; NaN where no weight is positive."""
    error, weight = np.broadcast_arrays(error, weight)
    total = float(weight.sum())
    return 10 * math.log10(float((error * weight).sum()) / total + 1e-16) if total else math.nan


def _band_taper(n: int, oversampling: float, last: float) -> np.ndarray:
    """Fall from the edge of the band to the highest frequency of a sampling of `last`."""
    beyond = 2 * np.abs(scipy.fft.fftfreq(n)) * oversampling - 1
    return cosine_fall(beyond / (last - 1))


@functools.lru_cache(maxsize=64)
def _end_errors(oversampling: float, last: float, n_rise: int) -> np.ndarray:
    """Mean squared error of tones of the band by samples from the start of a window."""
    n = _LONGEST
    missing = np.concatenate([np.zeros(n // 2), -np.ones(n // 2), np.zeros(n)])
    missing[n // 2:3 * n // 4] *= guard_taper(n, n // 4, _TAPER_SHAPE)[:n // 4]  # far away
    missing[n:n + n_rise] = rise(n_rise) - 1 if n_rise else 0.0
    frequency, weight = np.polynomial.legendre.leggauss(_TONES)
    tones = np.exp(1j * np.pi / oversampling * np.outer(frequency, np.arange(2 * n)))
    filtered = scipy.fft.ifft(scipy.fft.fft(missing * tones)
                              * _band_taper(2 * n, oversampling, last))
    error = 0.5 * weight @ np.abs(filtered[:, n:n + n // 2]) ** 2
    return np.maximum.accumulate(error[::-1])[::-1]


@functools.lru_cache(maxsize=16)
def rise(n: int) -> np.ndarray:
    """(n,) float32 rise of a window from 0 to 1 where it cuts a profile."""
    return guard_taper(4 * n, 2 * n, _TAPER_SHAPE)[1:2 * n:2].astype(np.float32)


ECHOES_PER_PASS = 32  # echoes that share the reference for the phase along a segment
PASSES = ECHOES_PER_PASS, 8, 2  # fewer where phases of neighbours differ much along a segment
_SEGMENTS = (256, 128, 64, 32, 16, 8)
_MAX_PHASES = 8
_ECHOES_FOR_ERRORS = 1024  # few add most where pulses are far apart: a third left out hid 17 dB
DRIFT_SLACK = 0.02  # range steps that pixels may drift further than planned; none notices
MOST_DRIFT = 2.0  # range steps
_COARSEST = 1.25  # oversampling of a range grid, below which none is looked at
_CLOSER_DB = 10.0  # by which the worst drift may be worse than the mean one
_LONGER, _FINER, _FEW = 1.1, 1.03, 3  # padded length, cells, and cells around the best
#: Rms over -1 to 1 of what is left of a cube and of a fourth power that are economised.
EVEN_CUBIC, EVEN_QUARTIC = 1 / 4 / math.sqrt(2), 1 / 8 / math.sqrt(2)
_COST_TRANSFORM = 0.012  # of a pass of the transform, in shares of the whole


@dataclasses.dataclass(frozen=True)
class RangeResampling:
    """How profiles are resampled and read.

    Attributes
    ----------
    n_padded : int
        Length to which a profile is zero-padded before its Fourier transform.
    n_cells : int
        Cells of the range grid over the padded profile; a cell is one pixel of an image line.
    n_phases : int
        Positions of the range grid in a cell.
    segment : int
        Pixels that share one geometry expansion; 0 for the routine for arbitrary points.
    step_m : float
        Half-path distance between range positions, metres.
    spacing : float
        Pixel spacing along a line, in the unit of the planned paths.
    interpolator : Interpolator
        Weights for this oversampling and drift.
    predicted_error_db : float
        Predicted error of the image against time-domain correlation, dB.
    echoes_per_pass : int
        Most echoes that share the reference for the phase along a segment.
    """

    n_padded: int
    n_cells: int
    n_phases: int
    segment: int
    step_m: float
    spacing: float
    interpolator: Interpolator
    predicted_error_db: float
    echoes_per_pass: int = ECHOES_PER_PASS

    @property
    def cost(self) -> float:
        """Nanoseconds per pixel and echo."""
        model = costs()
        return ((model.line_pixel + model.line_segment / self.segment) * self._passes
                if self.segment else model.point_pixel)

    @property
    def _passes(self) -> float:
        """Times the work of usual passes: the end of one takes as long as an echo (measured)."""
        return 1 + 1 / self.echoes_per_pass - 1 / ECHOES_PER_PASS

    def oversampling(self, radar: RadarParameters) -> float:
        """Range positions to a range resolution cell, 1 / bandwidth, of a radar."""
        return radar.range_resolution_m / self.step_m

    @property
    def cell_m(self) -> float:
        """Half-path distance between the range positions of neighbouring pixels, metres."""
        return self.step_m * self.n_phases

    def operations(self, n_echoes: float, n_pixels: float) -> dict[str, float]:
        """How often adding echoes to an image does the operations of `CostModel`."""
        counts: dict[str, float] = {
            'profile_bin': self.n_padded, 'profile_cell': self.n_cells * self.n_phases}
        n_lines = n_pixels * self._passes
        counts |= ({'line_pixel': n_lines, 'line_segment': n_lines / self.segment}
                   if self.segment else {'point_pixel': n_pixels})
        return {name: n_echoes * n for name, n in counts.items()}


def least_cost(slopes: tuple[float, float], radar: RadarParameters) -> float:
    """Nanoseconds per pixel and echo that no lines are below.

    Half paths grow by `slopes`, least to largest, from pixel to pixel, metres: whatever the
    range grid, pixels of some echoes drift by half of the difference, and it is finer than for
    `_COARSEST`.
    """
    low, high = slopes
    if low <= 0:
        return math.inf
    longest = 4 * MOST_DRIFT * radar.range_resolution_m / (_COARSEST * max(high - low, 1e-12))
    segment = next((s for s in _SEGMENTS if s <= longest), 0)
    return costs().line_pixel + costs().line_segment / segment if segment else math.inf


def plan_resampling(paths: Paths, spacing: float, n_line: int, radar: RadarParameters,
                    n_samples: int, target_db: float, *, fit_spacing: bool = False,
                    periodic: bool = False, passes: Sequence[int] = (ECHOES_PER_PASS,)
                    ) -> RangeResampling | None:
    """Choose range grid, segment and interpolator for an error target of reading a profile, dB.

    None where range does not follow the lines closely enough.

    Parameters
    ----------
    radar, n_samples, target_db :
        Of the profiles, see `sar_imaging.planning`.
    paths : Paths
        Sampled over the image; derivatives by the same unit as `spacing`.
    spacing, n_line : float, int
        Pixel spacing along a line, and pixels of a line.
    fit_spacing : bool
        The image may take the pixel spacing that fits the range grid, near `spacing`.
    periodic : bool
        The samples are a period, which no zeros may extend.
    passes : sequence of int
        Echoes of a pass to choose from: the first with which segments suffice.
    """
    slope = paths.of_illuminated(paths.derivatives[0])
    if not slope.size or slope.min() <= 0:
        return None
    middle = 0.5 * float(slope.min() + slope.max())
    pitch, asked = spacing * middle, spacing
    echoes = _some_echoes(paths)
    slope = paths.derivatives[0][echoes]
    illuminated = paths.of_illuminated(slope, echoes)
    extremes = float(illuminated.min()), float(illuminated.max())
    longest = next((s for s in reversed(_SEGMENTS) if s >= n_line), _SEGMENTS[0])
    errors = functools.cache(lambda together: _expansion_errors(paths, echoes, radar, together))
    for together, phases in itertools.product(passes, range(1, _MAX_PHASES + 1)):
        n_padded, n_cells = _commensurate(n_samples, radar.sample_spacing_m, pitch, phases,
                                          finer=fit_spacing, periodic=periodic)
        cell = n_padded * radar.sample_spacing_m / n_cells
        spacing = cell / middle if fit_spacing else asked
        for segment in _SEGMENTS[_SEGMENTS.index(longest):]:  # the longer, the quicker
            resampling = _fitted(RangeResampling(n_padded, n_cells, phases, segment, cell / phases,
                                                 spacing, cast(Interpolator, None), math.inf,
                                                 together),
                                 extremes, errors(together), radar, target_db)
            if resampling is None:
                continue
            predicted = _predicted_db(resampling, _drifting_db(
                resampling, paths, echoes, _drift(resampling, slope)), errors(together))
            if predicted <= target_db:  # more phases only cost memory
                return dataclasses.replace(resampling, predicted_error_db=predicted)
    return None


def _fitted(resampling: RangeResampling, slopes: tuple[float, float], errors: _Powers,
            radar: RadarParameters, target_db: float) -> RangeResampling | None:
    """A range grid with the interpolator that it needs; None where the target is surely missed.

    `slopes` are the least and the greatest of the paths.
    """
    oversampling = resampling.oversampling(radar)
    furthest = max(_drift(resampling, slope) for slope in slopes)
    if oversampling <= _COARSEST or furthest > MOST_DRIFT:
        return None
    resampling = dataclasses.replace(resampling, interpolator=design_interpolator(
        oversampling, max(furthest, LEAST_MARGIN), degree=LINE_DEGREE))
    # With the worst drift everywhere first: most candidates need no closer look.
    at_worst = _predicted_db(resampling, resampling.interpolator.error_db, errors)
    return resampling if at_worst <= target_db + _CLOSER_DB else None


def resampling_error_db(resampling: RangeResampling, paths: Paths, radar: RadarParameters
                        ) -> float:
    """Predicted error of a range grid on other paths than it was planned for, dB.

    It is inf where pixels drift further than the range grid was made for.
    """
    echoes = _some_echoes(paths)
    drift = _drift(resampling, paths.derivatives[0][echoes])
    if paths.of_illuminated(drift, echoes).max() > resampling.interpolator.margin + DRIFT_SLACK:
        return math.inf
    drifting_db = _drifting_db(resampling, paths, echoes, drift)
    return _predicted_db(resampling, drifting_db, _expansion_errors(
        paths, echoes, radar, resampling.echoes_per_pass))


def _drift(resampling: RangeResampling, slope: _Slope) -> _Slope:
    """How far the pixels of some echoes drift over half a segment, range steps."""
    return (abs(slope * resampling.spacing - resampling.cell_m)
            * (resampling.segment / 2 / resampling.step_m))


def _drifting_db(resampling: RangeResampling, paths: Paths, echoes: np.ndarray, drift: np.ndarray
                 ) -> float:
    return 10 * math.log10(paths.mean(resampling.interpolator.error_with_drift(drift), echoes))


def _predicted_db(resampling: RangeResampling, interpolation_db: float, errors: _Powers) -> float:
    half = resampling.spacing * resampling.segment / 2
    return total_db(interpolation_db, *(20 * math.log10(error * half ** power + 1e-12)
                                        for power, error in errors))


def _some_echoes(paths: Paths) -> np.ndarray:
    """Numbers of echoes by which errors are told, which illuminate something."""
    echoes = np.arange(len(paths.length))
    if paths.illuminated is not None and paths.illuminated.any():
        echoes = np.flatnonzero(paths.illuminated.any(axis=1))
    n = len(echoes)
    return echoes[np.linspace(0, n - 1, min(n, _ECHOES_FOR_ERRORS)).round().astype(int)]


def middle_of_pass(echoes: np.ndarray, parts: Sequence[int], n: int,
                   together: int = ECHOES_PER_PASS) -> np.ndarray:
    """(K,) int64 middle of the pass of each echo, of n; `parts` are the first added by itself."""
    part = np.searchsorted(parts, echoes, 'right')
    first, stop = np.take(parts, part - 1), np.append(parts, n)[part]
    start = first + (echoes - first) // together * together
    return start + np.minimum(stop - start, together) // 2


def _expansion_errors(paths: Paths, echoes: np.ndarray, radar: RadarParameters, together: int
                      ) -> _Powers:
    """Rms errors over a segment of half length 1, and the powers of it that they grow with.

    d_n being the path's derivatives by f, -1 to 1, the envelope's place lacks d_3 f^3 / 6, the
    path that echoes share d_4 f^4 / 24, and what an echo differs by,
    ``exp(j (a f + b f^2 + c f^3))`` with ``a, b, c = k d_n / n!``, its terms in f^4 and f^5, and
    its own d_4. All but the last two are economised, so that they err evenly over the segment.
    """
    k = radar.wavenumber_rad_per_m
    middle = middle_of_pass(echoes, paths.parts, len(paths.length), together)
    a, b, c, d = (k * (d[echoes] - d[middle]) / math.factorial(n + 1)
                  for n, d in enumerate(paths.derivatives))
    a2, b2 = a * a, b * b
    quartic = (a2 * a2 / 24 - b2 / 2 - a * c) ** 2 + (a2 * b / 2) ** 2
    quintic = (a2 * a * b / 6) ** 2 + (a2 * a2 * a / 120 - a * b2 / 2 - a2 * c / 2) ** 2
    third, fourth = (paths.derivatives[n][echoes] ** 2 for n in (2, 3))
    band = radar.half_band_rad_per_m ** 2 / 3
    return tuple((power, math.sqrt(paths.mean(error, echoes))) for power, error in (
        (3, band * third * (EVEN_CUBIC / 6) ** 2),
        (4, (k * k * fourth / 24 ** 2 + quartic) * EVEN_QUARTIC ** 2 + d * d / 9),
        (5, quintic / 16)))


def plan_point_resampling(window: RangeGate | PhaseHistory, target_db: float) -> RangeResampling:
    """Range grid for the routine that needs no common direction of range and lines."""
    radar = window.radar
    oversampling = next(v for v in np.arange(1.6, 8.0, 0.2).tolist()
                        if design_interpolator(v, LEAST_MARGIN).error_db <= target_db - 3.0)
    pitch = radar.range_resolution_m / oversampling
    n_padded, n_cells = _commensurate(window.n_samples, radar.sample_spacing_m, pitch, 1,
                                      periodic=window.periodic)
    step = n_padded * radar.sample_spacing_m / n_cells
    interpolator = design_interpolator(radar.range_resolution_m / step, LEAST_MARGIN)
    return RangeResampling(n_padded, n_cells, 1, 0, step, pitch, interpolator,
                           total_db(interpolator.error_db))


def _commensurate(n_samples: int, spacing_m: float, pitch: float, phases: int, *,
                  finer: bool = False, periodic: bool = False) -> tuple[int, int]:
    """Padded length and number of cells, quick to transform, nearest to the pitch.

    N padded samples s apart make n cells of ``N s / n``. With `finer` these may be smaller than
    the pitch, not larger, which leaves room for lengths whose transform is quick. Periodic samples
    are not padded.
    """
    best = math.inf, 0, 0
    for length in [n_samples] if periodic else smooth_lengths(n_samples, _LONGER):
        ideal = length * spacing_m / pitch
        near = _FEW if periodic else 0  # one length has to do
        candidates: Sequence[int] = range(max(math.floor(ideal) - near, 1),
                                          math.ceil(ideal) + near + 1)
        if finer:
            candidates = [n // phases for n in smooth_lengths(
                math.ceil(ideal) * phases, _FINER) if n % phases == 0] or candidates
        for cells in candidates:
            cost = (abs(cells / ideal - 1) + 1e-3 * (length / n_samples - 1)
                    + (_COST_TRANSFORM if finer else 1e-4) * cost_per_sample(cells * phases))
            if cost < best[0]:
                best = cost, length, cells
    return best[1:]
