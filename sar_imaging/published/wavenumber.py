# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Wavenumber imaging: L. Rosenberg, D. Gray, Multichannel SAR Imaging with Backprojection.

Spatial matched-filter interpolation (omega-k with Stolt), equations 9 to 12, for any number of
channels: a Fourier transform over slow time, the inner product of the channels with the reference
of the scene centre, the change of variables from (omega, k_u) to (k_x, k_y) by a Hamming-windowed
sinc, and a two-dimensional inverse Fourier transform.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Mapping

import numpy as np
import scipy.fft

from ..compilation import njit, numba
from ..geometry.grids import MapGrid
from ..geometry.track import StraightTrack, check_straight, fit_straight_track, path_errors
from ..imaging.image import Report
from ..memory import IMAGE_BYTES
from ..planning.exact.pulse_power import PulsePower
from ..planning.plan import with_chance
from ..signal.pulses import PulseBlock
from ..signal.radar import RadarParameters
from ..signal.spectra import band_frequencies, band_spectrum, beyond_band
from .judged import JudgedMethod, JudgedPlan, may_err_db

#: Largest error of the two-way path that the straight track may cause, wavelengths (11 degrees).
PATH_TOLERANCE_WAVELENGTHS = 1 / 32
#: The grid must be this many wavelengths from the track for the method of stationary phase.
NEAREST_WAVELENGTHS = 20.0
_TAPS, _TAPS_SHARE_DB = (8, 16, 32, 64, 128, 256), 1.0  # to choose from, for most of a target
_READ_ERROR_DB = -100.0  # of the kernel that reads the image between its samples
_PLACES, _SHARES = 61, 89  # between samples, and over the scene, of the Stolt kernel
_SAMPLE_BYTES, _DOUBLE_BYTES = 8, 16  # complex64, complex128
_SPECTRA = 3  # of all channels, of one, and that of the latest echoes
_LEAST = 1e-20  # mean squared error
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
_CHANCE_DB = 0.5  # by which images of a few dozen scatterers err more
_ROWS_PER_PASS = 256
_READ_TAPS = 6  # of the kernel that reads the image between the samples of the FFT
_SHAPE = 2.3 * _READ_TAPS
_NODES, _BY_NODE = np.polynomial.legendre.leggauss(64)  # of the integral over the kernel


class Wavenumber(JudgedMethod):
    """Imaging in the wavenumber domain: maps beside a straight, evenly sampled track.

    The cost grows with the sum of samples and pixels, not with pixels times pulses as that of
    backprojection. The track may run in any direction and at any height. For the options see
    `plan_wavenumber`.
    """

    NAME = 'wavenumber'
    OWN = {'taps': None, 'range_padding': 2.0, 'azimuth_padding': None}

    def plan(self, tx_m: np.ndarray, rx_m: np.ndarray) -> Report:
        """See `Method`."""
        return self.planned(plan_wavenumber(self.grid, self.radar, self.n_samples, tx_m, rx_m,
                                            target_db=self.options.target_db, **self.own))

    def form(self, block: PulseBlock) -> np.ndarray:
        """See `Method`."""
        return image_wavenumber(self.report.plan, block)

    def errors_of(self, echoes: np.ndarray, at_pixels: PulsePower) -> dict[str, float]:
        """See `JudgedMethod`; what profiles hold beyond the band is left out.

        Where they end among echoes, or are cut short, that is some of each echo.
        """
        some, number = at_pixels.without_repetition
        few = dataclasses.replace(at_pixels, echoes=number)
        return {'beyond the band': few.of(beyond_band(echoes[some], self.radar))[0]}


@dataclasses.dataclass(frozen=True, eq=False)
class WavenumberPlan(JudgedPlan):
    """How pulses of a straight track are imaged in the wavenumber domain.

    Attributes
    ----------
    grid : MapGrid
        Where the pixels are.
    radar : RadarParameters
        Describes the compressed profiles.
    n_samples : int
        Samples of each profile.
    tx_m, rx_m : (P, C, 3) float64
        Phase centres that it is for, metres.
    track : StraightTrack
        Fitted to the phase centres.
    frequencies_hz : (K,) float64
        Frequencies in the profiles' band, absolute, ascending, hertz.
    centre_m : (float, float)
        Middle of the scene along the track and distance from it, metres.
    band : DopplerBand
        Slow-time transform, and what of it is used.
    taps : int
        Samples over which the Stolt interpolation spreads a value.
    first, step : float
        k_x of the first sample of the interpolated spectrum and spacing, rad/m.
    n_x : int
        Samples of it along k_x.
    errors_db : mapping of str to float
        Predicted error against time-domain correlation by cause, dB.
    warnings : tuple of str
        What makes the image worse than it could be.
    """

    grid: MapGrid
    radar: RadarParameters
    n_samples: int
    tx_m: np.ndarray
    rx_m: np.ndarray
    track: StraightTrack
    frequencies_hz: np.ndarray
    centre_m: tuple[float, float]
    band: DopplerBand
    taps: int
    first: float
    step: float
    n_x: int
    errors_db: Mapping[str, float]
    warnings: tuple[str, ...]

    @property
    def wavenumbers(self) -> np.ndarray:
        """(K,) float64 two-way wavenumbers k of the frequencies, rad/m."""
        return 4 * np.pi * self.frequencies_hz / self.radar.propagation_speed_m_per_s

    @property
    def n_bytes(self) -> int:
        """Memory that forming the image takes, bytes."""
        n_u, n_k = len(self.band.wavenumbers(self.wavenumbers)), len(self.frequencies_hz)
        spectra = _DOUBLE_BYTES * n_k * (_SPECTRA * n_u + self.band.n_fft)
        # the interpolated spectrum, zero-padded to twice the size, and its transform
        slant = _SAMPLE_BYTES * n_u * self.n_x * (1 + 2 * 4)
        return spectra + slant + IMAGE_BYTES * math.prod(self.grid.shape)

    def __str__(self) -> str:
        n_u = len(self.band.wavenumbers(self.wavenumbers))
        return (f'{n_u} x {len(self.frequencies_hz)} wavenumbers, interpolated over {self.taps} '
                f'samples to {n_u} x {self.n_x}')


def plan_wavenumber(grid: MapGrid, radar: RadarParameters, n_samples: int, tx_m: np.ndarray,
                    rx_m: np.ndarray, *, target_db: float = -60.0, taps: int | None = None,
                    range_padding: float = 2.0, azimuth_padding: float | None = None
                    ) -> WavenumberPlan:
    """Plan the image of an aperture.

    The track may run in any direction and at any height, the grid may lie anywhere beside it:
    the transform images distance from the line of flight against position along it (the slant
    plane of the paper), and each pixel of the horizontal map grid is read at its own exact
    distance and position. The reference is that of the middle of the grid, and the Doppler band
    is taken around the grid's own, so squint and off-centre scenes need nothing special.

    Parameters
    ----------
    grid : MapGrid
        Where the pixels are.
    radar : RadarParameters
        Describes the compressed profiles.
    n_samples : int
        Samples of each profile.
    tx_m, rx_m : (P, C, 3) float64
        Phase centres of all pulses, in order, metres.
    target_db : float
        Wanted error against time-domain correlation, dB.
    taps : int, optional
        Samples over which the Hamming-windowed sinc of the Stolt interpolation spreads, even. By
        default the fewest that the target allows, or the most that are sensible.
    range_padding : float
        Period of the image in range over the extent of the grid in range, at least 1. Sets the
        spacing in k_x and with it the pass band of the interpolation. With 1, as published,
        scatterers near the near and far edge of the grid lose up to half their magnitude and
        appear at the opposite edge as well (6 dB lost and a ghost of equal strength at the
        very edge).
    azimuth_padding : float, optional
        Length of the slow-time transform over the number of pulses, at least 1; 1 as published,
        which wraps around. By default as long as it takes to keep the grid free of that.

    Returns
    -------
    WavenumberPlan

    Raises
    ------
    ValueError
        An option is out of range; the track is not straight and even; the pulses are too far
        apart for the Doppler band of the grid; the grid touches the track, is seen along it, or
        lies outside the profiles.
    """
    if not isinstance(grid, MapGrid):
        raise ValueError(f'grid is a {type(grid).__name__}; the wavenumber imager images a '
                         'MapGrid: use exact backprojection')
    _check_paddings(range_padding=range_padding, azimuth_padding=azimuth_padding)
    chance_db = may_err_db(grid, tx_m, rx_m, radar, _CHANCE_DB)
    taps = fewest_taps(target_db - chance_db, range_padding) if taps is None else taps
    if taps < 2 or taps % 2:
        raise ValueError(f'taps={taps}; expected an even number, at least 2')
    corners, outline = _outline(grid)
    track = fit_straight_track(tx_m, rx_m)
    check_straight(track, tx_m, rx_m, corners, wavelength_m=radar.wavelength_m,
                   tolerance_wavelengths=PATH_TOLERANCE_WAVELENGTHS)
    scene = SlantScene(track, *track.coordinates(outline))
    frequencies = band_frequencies(radar, n_samples, compressed=True)
    k = 4 * np.pi * frequencies / radar.propagation_speed_m_per_s
    _check_place(scene, radar, frequencies)
    band = choose_band(scene, k[-1], azimuth_padding)
    span = max(np.ptp(scene.distance_m), grid.spacing_m)
    step = 2 * np.pi / (range_padding * span)
    k_x_ends = band.range_wavenumbers(k)
    first = k_x_ends[0] - step * (taps // 2)
    n_x = math.ceil((k_x_ends[1] - first) / step) + taps // 2 + 1
    phase_errors = 2 * np.pi * path_errors(track, tx_m, rx_m, corners) / radar.wavelength_m
    errors = {'Stolt interpolation': _stolt_error(taps, range_padding),
              'Doppler band': 10 ** (band.error_db / 10),
              'straight track': float(np.mean(phase_errors ** 2)),
              # next term of the Hankel function that the stationary phase stands for
              'stationary phase': (3 / (8 * k_x_ends[0] * scene.distance_m.min())) ** 2,
              'read pixels': 10 ** (_READ_ERROR_DB / 10)}
    return WavenumberPlan(
        grid, radar, n_samples, tx_m.copy(), rx_m.copy(), track, frequencies, scene.centre_m, band,
        int(taps), first, step, n_x,
        with_chance({cause: 10 * math.log10(max(e, _LEAST)) for cause, e in errors.items()},
                    chance_db),
        () if band.warning is None else (band.warning,))


def _check_paddings(**paddings: float | None) -> None:
    for name, value in paddings.items():
        if value is not None and not 1 <= value < math.inf:
            raise ValueError(f'{name}={value}; expected at least 1')


def fewest_taps(target_db: float, range_padding: float = 2.0) -> int:
    """Taps of the Stolt interpolation that keep within an error, or the most that are sensible."""
    return next((taps for taps in _TAPS if 10 * math.log10(_stolt_error(taps, range_padding))
                 <= target_db - _TAPS_SHARE_DB), _TAPS[-1])


@functools.cache
def _stolt_error(taps: int, range_padding: float) -> float:
    """Mean squared error of tones, spread by the windowed sinc, where the scene has it worst.

    A scatterer at the share u of the period is the tone ``exp(j 2 pi u n)`` over the samples n of
    k_x; a value between two of them at t has ``sum_n w(n - t) exp(j 2 pi u (n - t))`` of it.
    """
    place = (np.arange(_PLACES) + 0.5) / _PLACES
    share = np.linspace(-0.5, 0.5, _SHARES) / range_padding
    away = np.arange(taps) + 1 - taps // 2 - place[:, None]
    weight = np.sinc(away) * (0.54 + 0.46 * np.cos(2 * np.pi * away / taps))
    gain = np.einsum('pn,pnu->pu', weight, np.exp(2j * np.pi * away[..., None] * share))
    return float(np.mean(np.abs(gain - 1) ** 2, axis=0).max())


def _outline(grid: MapGrid) -> tuple[np.ndarray, np.ndarray]:
    """Corners and middle (5, 3), and all pixels of the edge (S, 3), metres."""
    x, y = grid.x_m, grid.y_m
    edge = ([(a, b) for a in x for b in y[[0, -1]]] + [(a, b) for a in x[[0, -1]] for b in y])
    corners = [(a, b) for a in x[[0, -1]] for b in y[[0, -1]]] + [grid.centre_m[:2]]
    return tuple(np.array([(*p, grid.z_m) for p in points]) for points in (corners, edge))


def _check_place(scene: SlantScene, radar: RadarParameters, frequencies: np.ndarray) -> None:
    """Refuse grids on the track, seen along the track, or outside the recorded ranges."""
    nearest = NEAREST_WAVELENGTHS * radar.wavelength_m
    if scene.distance_m.min() < nearest:
        raise ValueError(f'the grid comes within {scene.distance_m.min():.4g} m of the line of '
                         f'flight; expected at least {nearest:.4g} m '
                         f'({NEAREST_WAVELENGTHS:g} wavelengths)')
    sines = scene.sines()
    if max(-sines[0], sines[1]) > LARGEST_SINE:
        degrees = [math.degrees(math.asin(s)) for s in sines]
        raise ValueError(f'the grid is seen at {degrees[0]:.1f} to {degrees[1]:.1f} degrees from '
                         'broadside, nearly along the track; expected at most '
                         f'{math.degrees(math.asin(LARGEST_SINE)):.1f} degrees')
    if len(frequencies) < 2:
        raise ValueError('the band of the profiles holds one frequency only; expected at least '
                         'two, record longer profiles')
    period = radar.propagation_speed_m_per_s / (2 * (frequencies[1] - frequencies[0]))
    start = radar.range_start_m
    ranges = scene.ranges()
    if ranges[0] < start or ranges[1] > start + period:
        raise ValueError(f'the grid lies {ranges[0]:.1f} to {ranges[1]:.1f} m from the antenna, '
                         f'the profiles cover {start:.1f} to {start + period:.1f} m and repeat '
                         'beyond; move or shrink the grid, or record longer')


@dataclasses.dataclass(frozen=True)
class SlantScene:
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

    def weight(self, sine: np.ndarray) -> np.ndarray:
        """Weight of the spectrum at sines of the angle from broadside."""
        out = ((sine >= self.stopped[0]) & (sine <= self.stopped[1])).astype(float)
        for passed, stopped in zip(self.passed, self.stopped, strict=True):
            if passed != stopped:
                t = np.clip((sine - stopped) / (passed - stopped), 0.0, 1.0)
                out *= t * t * t * (10 - 15 * t + 6 * t * t)  # smooth to the second derivative
        return out

    def wavenumbers(self, k: np.ndarray) -> np.ndarray:
        """(I,) int64 numbers of the k_u that hold the band at every k, ascending."""
        ends = np.multiply.outer(self.stopped, k[[0, -1]]) / self.step
        return np.arange(math.floor(ends.min()), math.ceil(ends.max()) + 1)

    def range_wavenumbers(self, k: np.ndarray) -> tuple[float, float]:
        """Least and largest k_x of the band."""
        lo, hi = self.stopped
        nearest = 0.0 if lo < 0 < hi else min(abs(lo), abs(hi))
        farthest = max(abs(lo), abs(hi))
        return k[0] * math.sqrt(1 - farthest ** 2), k[-1] * math.sqrt(1 - nearest ** 2)


def choose_band(scene: SlantScene, k_max: float, azimuth_padding: float | None) -> DopplerBand:
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


def _fresnel_length(scene: SlantScene, sines: tuple[float, float], k_max: float) -> float:
    """Part of the aperture over which the phase to a pixel turns by pi, as a sine."""
    nearest = 0.0 if sines[0] < 0 < sines[1] else min(map(abs, sines))
    return math.sqrt(2 * np.pi / k_max * (1 - nearest ** 2) ** 1.5 / scene.distance_m.min())


def _room_for_guards(spacing_m: float, sines: tuple[float, float], fresnel: float, k_max: float
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


def image_wavenumber(plan: WavenumberPlan, block: PulseBlock) -> np.ndarray:
    """Image by a plan, complex64."""
    track, band = plan.track, plan.band
    slant = _transform(plan, *_slow_time_spectrum(plan, block))
    scale = np.exp(0.25j * np.pi) * math.sqrt(2 * np.pi) / (band.n_fft * track.spacing_m)
    return slant.read(plan.grid, track, scale)


def _transform(plan: WavenumberPlan, k_y: np.ndarray, spectrum: np.ndarray) -> SlantImage:
    """Reference of the scene centre, Stolt interpolation and inverse transform."""
    k, band, step = plan.wavenumbers, plan.band, plan.step
    nearest = band.range_wavenumbers(k)[0]
    stolt = np.zeros((len(k_y), plan.n_x), np.complex64)
    for lo in range(0, len(k_y), _ROWS_PER_PASS):
        rows = slice(lo, lo + _ROWS_PER_PASS)
        k_u = k_y[rows, None]
        weight = band.weight(k_u / k)
        k_x = np.sqrt(np.where(weight > 0, k * k - k_u * k_u, nearest ** 2))
        # Equation 12. The amplitude of the stationary phase, which the paper leaves out,
        # makes the image equal to time-domain correlation in scale and phase.
        matched = spectrum[rows] * (weight * k / k_x ** 1.5) * np.exp(
            1j * (k_x * plan.centre_m[1] + k_u * plan.centre_m[0]))
        spread(matched, (k_x - plan.first) / step, plan.taps, stolt[rows])
    return SlantImage.from_spectrum(stolt, (k_y[0], plan.first), (band.step, step),
                                    plan.centre_m)


def _slow_time_spectrum(plan: WavenumberPlan, block: PulseBlock) -> tuple[np.ndarray, np.ndarray]:
    """Slow-time transform, summed over the channels with their offsets along the track.

    Returns the k_u (I,) and the spectrum (I, K) complex128. The transform repeats itself in k_u:
    rows are unrolled to the band of the grid, which moves with frequency.
    """
    band, track, k = plan.band, plan.track, plan.wavenumbers
    number = band.wavenumbers(k)
    k_u = number * band.step
    out = np.zeros((len(k_u), len(k)), np.complex128)
    for channel, offset in enumerate(track.offsets_m):
        one = slice(channel, channel + 1)
        part = dataclasses.replace(block, samples=block.samples[:, one], tx_m=block.tx_m[:, one],
                                   rx_m=block.rx_m[:, one])
        spectrum = scipy.fft.fft(band_spectrum(part)[1][:, 0], band.n_fft, axis=0)
        shift = np.exp(-1j * k_u * (track.first_m + offset))
        out += spectrum[number % band.n_fft] * shift[:, None]
    return k_u, out


@dataclasses.dataclass(frozen=True)
class SlantImage:
    """Image over position along the track and distance from it, one period, at baseband.

    Parameters
    ----------
    samples : (M_y, M_x) complex64
        Convolved such that the kernel of `read` restores the image; the centre stands at index
        (0, 0), what lies before it at the end.
    spacing_m : (2,) floats
        Spacing of the samples along the track and across, metres.
    centre_m : (2,) floats
        Position along the track and distance from it at index (0, 0), metres.
    carrier : (2,) floats
        k_y and k_x of zero frequency, radians per metre.
    """

    samples: np.ndarray
    spacing_m: tuple[float, float]
    centre_m: tuple[float, float]
    carrier: tuple[float, float]

    @classmethod
    def from_spectrum(cls, spectrum: np.ndarray, first: np.ndarray | tuple[float, float],
                      steps: np.ndarray | tuple[float, float], centre_m: tuple[float, float]
                      ) -> SlantImage:
        """Image ``sum_yx F_yx exp(j k_y (y - Y_c) + j k_x (x - X_c))``.

        Parameters
        ----------
        spectrum : (I, J) complex64
            F at ``k_y = first[0] + i steps[0]``, ``k_x = first[1] + j steps[1]``.
        first, steps : (2,) floats
            Radians per metre.
        centre_m : (2,) floats
            ``(Y_c, X_c)``, metres.
        """
        shape = [scipy.fft.next_fast_len(2 * n) for n in spectrum.shape]
        padded = np.zeros(shape, np.complex64)
        gains = [1 / _kernel_response((np.arange(n) - n // 2) / m)
                 for n, m in zip(spectrum.shape, shape, strict=True)]
        padded[:spectrum.shape[0], :spectrum.shape[1]] = spectrum * (
            gains[0][:, None] * gains[1]).astype(np.float32)
        padded = np.roll(padded, [-(n // 2) for n in spectrum.shape], axis=(0, 1))
        samples = scipy.fft.ifft2(padded, norm='forward', overwrite_x=True,
                                  workers=numba.get_num_threads())
        carrier = tuple(float(f + s * (n // 2))
                        for f, s, n in zip(first, steps, spectrum.shape, strict=True))
        spacing = tuple(2 * np.pi / (s * m) for s, m in zip(steps, shape, strict=True))
        return cls(samples, spacing, tuple(centre_m), carrier)

    def read(self, grid: MapGrid, track: StraightTrack, scale: complex) -> np.ndarray:
        """Pixels of a map grid, each at its own distance and position.

        Parameters
        ----------
        grid : MapGrid
            Where the pixels are.
        track : StraightTrack
            Whose coordinates the image has.
        scale : complex
            Factor; pixels are also multiplied by the square root of their distance in metres.

        Returns
        -------
        (n_y, n_x) complex64
        """
        out = np.empty(grid.shape, np.complex64)
        _read_pixels(self.samples, self.spacing_m, self.centre_m, self.carrier, complex(scale),
                     track.origin_m, track.direction, grid.x_m, grid.y_m, grid.z_m, out)
        return out


def _kernel_response(frequency: np.ndarray) -> np.ndarray:
    """Fourier transform of the kernel of `SlantImage.read` at cycles per sample."""
    kernel = _BY_NODE * _READ_TAPS / 2 * np.exp(_SHAPE * (np.sqrt(1 - _NODES ** 2) - 1))
    return np.cos(np.pi * _READ_TAPS * np.multiply.outer(frequency, _NODES)) @ kernel


@njit(parallel=True)
def spread(values, position, taps, out):
    """Stolt interpolation: spread each value over `taps` uniform k_x by a windowed sinc.

    Parameters
    ----------
    values : (R, K) complex128
        Values at measured wavenumbers.
    position : (R, K) float64
        Their k_x in samples of `out`.
    taps : int
        Length of the Hamming window, even.
    out : (R, J) complex64
        Changed in place.
    """
    cos_step, sin_step = np.cos(2 * np.pi / taps), np.sin(2 * np.pi / taps)
    for row in numba.prange(values.shape[0]):
        for i in range(values.shape[1]):
            value = values[row, i]
            if value == 0:
                continue
            first = int(np.floor(position[row, i])) - taps // 2 + 1
            t = position[row, i] - first
            sine = np.sin(np.pi * t) / np.pi
            c, s = np.cos(2 * np.pi * t / taps), np.sin(2 * np.pi * t / taps)
            for j in range(taps):
                sinc = sine / t if abs(t) > 1e-9 else 1.0
                out[row, first + j] += np.complex64(value * (sinc * (0.54 + 0.46 * c)))
                t -= 1.0
                sine = -sine
                c, s = c * cos_step + s * sin_step, s * cos_step - c * sin_step


@njit(parallel=True)
def _read_pixels(samples, spacing, centre, carrier, scale, origin, direction, x, y, z, out):
    """Read a `SlantImage` at the slant-plane coordinates of every pixel of a map grid.

    The kernel ``exp(b (sqrt(1 - (2 d / taps)^2) - 1))`` of non-uniform Fourier transforms leaves
    an error of about 1e-5.
    """
    taps, shape = _READ_TAPS, _SHAPE
    n_rows, n_columns = samples.shape
    for i in numba.prange(len(y)):
        weight = np.empty(taps)
        column = np.empty(taps, np.int64)
        for j in range(len(x)):
            dx, dy, dz = x[j] - origin[0], y[i] - origin[1], z - origin[2]
            along = dx * direction[0] + dy * direction[1] + dz * direction[2]
            dx -= along * direction[0]
            dy -= along * direction[1]
            dz -= along * direction[2]
            distance = np.sqrt(dx * dx + dy * dy + dz * dz)
            u, v = along - centre[0], distance - centre[1]
            first = np.floor(v / spacing[1]) - (taps // 2 - 1)
            for b in range(taps):
                d = (v / spacing[1] - first - b) * (2 / taps)
                weight[b] = np.exp(shape * (np.sqrt(max(1 - d * d, 0.0)) - 1))
                column[b] = int(first + b) % n_columns
            first = np.floor(u / spacing[0]) - (taps // 2 - 1)
            total = 0j
            for a in range(taps):
                d = (u / spacing[0] - first - a) * (2 / taps)
                row = int(first + a) % n_rows
                line = 0j
                for b in range(taps):
                    line += weight[b] * samples[row, column[b]]
                total += line * np.exp(shape * (np.sqrt(max(1 - d * d, 0.0)) - 1))
            phase = carrier[0] * u + carrier[1] * v
            out[i, j] = (scale * np.sqrt(distance)) * total * complex(np.cos(phase), np.sin(phase))
