"""Part of range profiles that an image needs: shorter profiles are prepared faster."""

from __future__ import annotations

import dataclasses
import functools
import math

import numpy as np
import scipy.fft

from ...signal.radar import RadarParameters
from ..guard_taper import cosine_fall, guard_taper

# Samples beyond the needed ranges, times 1 - bandwidth over sample rate. What the cut changes
# within them is below -94 dB of the profile there.
_REACH = 24.0
_TAPER_SHARE, _TAPER_SHAPE = 0.3, 4.0  # of these samples: longer tapers begin too near
_TONES, _LONGEST = 8, 2048  # in the band, and samples of a table of errors
_SERIES_SHARPNESS = math.asinh(10 ** (130 / 20)) / math.pi
_WORTHWHILE = 0.9  # longer windows are not worth a copy


@dataclasses.dataclass(frozen=True)
class RangeGate:
    """Part of the range profiles that an image needs, with smooth ends where it cuts.

    Attributes
    ----------
    radar : RadarParameters
        Of the profiles.
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
    >>> from sar_imaging.planning.profiles.range_gate import RangeGate
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

    def end_error(self, range_m, oversampling: float = math.inf) -> np.ndarray:
        """(...) mean squared error at half paths (...), metres, because the window ends.

        Relative to the power of the profile, which is taken to go on beyond its ends: 1 where
        nothing is read. The oversampling is that of the lattice that is read, see `gain`.
        """
        given = round(self.radar.sample_rate_hz / self.radar.bandwidth_hz, 2)
        after = (np.asarray(range_m) - self.range_start_m) / self.radar.sample_spacing_m
        error = 0.0
        for distance, taper in ((after + min(self.first, 0), self.n_rise),
                                (self.n_samples - 1 - after, self.n_fall)):
            table = _end_errors(given, min(given, round(oversampling, 2)), taper)
            error = error + np.interp(distance, np.arange(len(table)), table, left=1.0)
        return np.minimum(error, 1.0)

    def predictable(self, range_m, lit=True) -> np.ndarray:
        """(...) half paths (...), metres, at which an error can be told.

        Where some of those that are `lit` leave the profile, these are not near its ends.
        """
        after = (np.asarray(range_m) - self.range_start_m) / self.radar.sample_spacing_m
        # a window that rises or falls ends within the profile, far enough away
        within = np.minimum(after + (np.inf if self.n_rise else min(self.first, 0)),
                            (np.inf if self.n_fall else self.n_samples - 1) - after)
        leaves = ((within < 0) & lit).any()
        return within >= (end_samples(self.radar) if leaves else -np.inf)

    def mean_end_error_db(self, range_m, n_axes: int = 2,
                          oversampling: float = math.inf, lit=None) -> float:
        """Mean of `end_error` where it is `predictable` for all echoes, dB; NaN for nowhere.

        Half paths are those from some echoes to a square or cube of positions, edge to edge:
        (R, n ** n_axes) float64, metres.
        Of these pairs, (R, n ** n_axes), only those that are `lit` count, where that is given.
        """
        lit = np.bool_(True) if lit is None or not lit.any() else lit
        side = np.ones(round(range_m.shape[1] ** (1 / n_axes)))
        side[[0, -1]] = 0.5  # they stand for half as much of the image
        weight = functools.reduce(np.multiply.outer, [side] * n_axes).ravel()
        return mean_db(self.end_error(range_m, oversampling),
                       weight * lit * (self.predictable(range_m, lit) | ~lit).all(axis=0))

    def gain(self, n_padded: int, oversampling: float = math.inf) -> np.ndarray:
        """(n_padded,) float32 factor of each bin of a spectrum on the way back to ranges.

        Without its taper outside the band the ends of a profile, where sidelobes are cut off,
        would ring far inside. It ends at the highest frequency of the samples, or of the lattice
        that they are resampled to, `oversampling` times the bandwidth, where that is coarser.
        """
        given = self.radar.sample_rate_hz / self.radar.bandwidth_hz
        return (_band_taper(n_padded, given, min(given, oversampling)) / n_padded
                ).astype(np.float32)


def end_samples(radar: RadarParameters) -> int:
    """Samples on either side on which a value between two depends, to -130 dB (Knab 1979)."""
    return math.ceil(_SERIES_SHARPNESS / (1 - radar.bandwidth_hz / radar.sample_rate_hz))


def mean_db(error, weight) -> float:
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
