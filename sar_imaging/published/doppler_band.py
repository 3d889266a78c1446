"""Doppler band of a scene beside a straight track, and the slow-time transform that holds it."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import scipy.fft

from ..geometry.straight_track import StraightTrack

#: Largest sine of the angle from broadside.
LARGEST_SINE = 0.98
#: Width of the guard either side of the grid's own Doppler band, in Fresnel lengths.
GUARD_FRESNEL_LENGTHS = 4.0
#: Share of the guard, next to the grid's own band, in which the spectrum does not fall yet.
GUARD_FLAT = 0.2
#: A guard narrower than this is reported.
LEAST_GUARD_FRESNEL_LENGTHS = 2.0
# Error of an image by the width of its narrower guard, dB (measured against correlation). Without
# one the spectrum rings as it is cut.
_GUARDS, _GUARD_ERRORS_DB = (0.0, 2.0, 3.0, 4.0, 6.0), (-24.0, -61.0, -76.0, -81.0, -89.0)


@dataclasses.dataclass(frozen=True)
class Scene:
    """Edge of the grid in the slant plane: position along the track and distance from it."""

    track: StraightTrack
    along_m: np.ndarray
    distance_m: np.ndarray

    @property
    def centre_m(self) -> tuple[float, float]:
        """Middle ``(Y_c, X_c)`` of the grid along and across the track, metres."""
        return tuple(0.5 * (float(a.min()) + float(a.max()))
                     for a in (self.along_m, self.distance_m))

    @property
    def aperture_m(self) -> tuple[float, float]:
        """First and last phase centre along the track, metres."""
        u = self.track.along_m
        return float(u.min()), float(u.max())

    def sines(self) -> tuple[float, float]:
        """Least and largest sine of the angle from broadside over grid and aperture."""
        lo, hi = (self.along_m - u for u in self.aperture_m[::-1])
        return (float((lo / np.hypot(lo, self.distance_m)).min()),
                float((hi / np.hypot(hi, self.distance_m)).max()))

    def ranges(self) -> tuple[float, float]:
        """Least and largest distance of a pixel from a phase centre, metres."""
        lo, hi = self.aperture_m
        beyond = np.maximum(np.maximum(lo - self.along_m, self.along_m - hi), 0.0)
        farthest = np.maximum(self.along_m - lo, hi - self.along_m)
        return (float(np.hypot(self.distance_m, beyond).min()),
                float(np.hypot(self.distance_m, farthest).max()))

    def period_for(self, sine_lo: float, sine_hi: float) -> float:
        """Least period along the track at which no echo between the sines wraps into the grid."""
        tan_lo, tan_hi = (s / math.sqrt(1 - s * s) for s in (sine_lo, sine_hi))
        u_lo, u_hi = self.aperture_m
        return float(max((self.distance_m * tan_hi - self.along_m + u_hi).max(),
                         (self.along_m - u_lo - self.distance_m * tan_lo).max()))

    def sines_for(self, period_m: float) -> tuple[float, float]:
        """Widest band of sines from which no echo wraps into the grid with this period."""
        u_lo, u_hi = self.aperture_m
        lo, hi = self.along_m - u_lo - period_m, self.along_m - u_hi + period_m
        return (float((lo / np.hypot(lo, self.distance_m)).max()),
                float((hi / np.hypot(hi, self.distance_m)).min()))


@dataclasses.dataclass(frozen=True)
class DopplerBand:
    """Slow-time transform and the part of its spectrum that is used.

    The band is bounded by sines of the angle from broadside, ``k_u / k``: weight 1 between the
    `passed` ones, 0 outside the `stopped` ones.
    """

    n_fft: int
    step: float  # of k_u, radians per metre
    passed: tuple[float, float]
    stopped: tuple[float, float]
    error_db: float  # of an image that ends there
    warning: str | None

    def weight(self, sine) -> np.ndarray:
        """Weight of the spectrum at sines of the angle from broadside."""
        out = ((sine >= self.stopped[0]) & (sine <= self.stopped[1])).astype(float)
        for passed, stopped in zip(self.passed, self.stopped, strict=True):
            if passed != stopped:
                t = np.clip((sine - stopped) / (passed - stopped), 0.0, 1.0)
                out *= t * t * t * (10 - 15 * t + 6 * t * t)  # smooth to the second derivative
        return out

    def wavenumbers(self, k) -> np.ndarray:
        """(I,) int64 numbers of the k_u that hold the band at every k, ascending."""
        ends = np.multiply.outer(self.stopped, k[[0, -1]]) / self.step
        return np.arange(math.floor(ends.min()), math.ceil(ends.max()) + 1)

    def range_wavenumbers(self, k) -> tuple[float, float]:
        """Least and largest k_x of the band."""
        lo, hi = self.stopped
        nearest = 0.0 if lo < 0 < hi else min(abs(lo), abs(hi))
        farthest = max(abs(lo), abs(hi))
        return k[0] * math.sqrt(1 - farthest ** 2), k[-1] * math.sqrt(1 - nearest ** 2)


def choose_band(scene: Scene, k_max: float, azimuth_padding) -> DopplerBand:
    """Choose the length of the slow-time transform and the Doppler band.

    The grid's own band is extended by a guard on either side, over which the spectrum falls
    smoothly: cut sharply, it would ring. What the guard images lies outside the grid; the
    transform must be long enough that it does not wrap around into the grid. If the length asked
    for is too short even without a guard, the whole band between half the pulse rate is used, as
    the paper does, and wraps.
    """
    spacing, sines = scene.track.spacing_m, scene.sines()
    fresnel = _fresnel_length(scene, sines, k_max)
    room, warning = _room_for_guards(spacing, sines, fresnel, k_max)
    whole = (max(sines[0] - room, -LARGEST_SINE), min(sines[1] + room, LARGEST_SINE))
    if azimuth_padding is None:
        guard = GUARD_FRESNEL_LENGTHS * fresnel
        period = scene.period_for(max(sines[0] - guard, whole[0]), min(sines[1] + guard, whole[1]))
        n_fft = max(scene.track.n_pulses, math.ceil(period / spacing))
    else:
        n_fft = round(azimuth_padding * scene.track.n_pulses)
    n_fft = scipy.fft.next_fast_len(n_fft)
    step = 2 * np.pi / (n_fft * spacing)
    free = scene.sines_for(n_fft * spacing)
    if free[0] >= sines[0] or free[1] <= sines[1]:
        return DopplerBand(n_fft, step, whole, whole, _GUARD_ERRORS_DB[0], warning)
    stopped = (max(free[0], whole[0]), min(free[1], whole[1]))
    passed = tuple(s + GUARD_FLAT * (t - s) for s, t in zip(sines, stopped, strict=True))
    guard = min(abs(s - t) for s, t in zip(sines, stopped, strict=True)) / fresnel
    return DopplerBand(n_fft, step, passed, stopped,
                       float(np.interp(guard, _GUARDS, _GUARD_ERRORS_DB)), warning)


def _fresnel_length(scene: Scene, sines, k_max: float) -> float:
    """Part of the aperture over which the phase to a pixel turns by pi, as a sine."""
    nearest = 0.0 if sines[0] < 0 < sines[1] else min(map(abs, sines))
    return math.sqrt(2 * np.pi / k_max * (1 - nearest ** 2) ** 1.5 / scene.distance_m.min())


def _room_for_guards(spacing_m: float, sines, fresnel: float, k_max: float
                     ) -> tuple[float, str | None]:
    """Width left for a guard on either side of the grid's own band, as a sine, and a warning.

    Raises if the pulses undersample the grid's band, warns if they leave hardly any room.
    """
    available, needed = 2 * np.pi / spacing_m, (sines[1] - sines[0]) * k_max
    room = 0.5 * (available - needed) / k_max
    what = f'pulses every {spacing_m:.4g} m sample a Doppler band of {available:.4g} rad/m'
    if room <= 0:
        raise ValueError(
            f'{what} but the grid spans {needed:.4g} rad/m; shrink the grid along the track or '
            f'the aperture, or send the pulses at most every {2 * np.pi / needed:.4g} m')
    least = LEAST_GUARD_FRESNEL_LENGTHS * fresnel
    if room >= least:
        return room, None
    wanted = needed + 2 * least * k_max
    return room, (
        f'{what}, hardly more than the {needed:.4g} rad/m that the grid spans; expect errors '
        f'above -50 dB towards the ends of the grid along the track. Pulses at most every '
        f'{2 * np.pi / wanted:.4g} m or a smaller grid avoid them')
