"""Spatial matched-filter interpolation (omega-k with Stolt) for any number of channels.

Rosenberg & Gray, equations 9 to 12: a Fourier transform over slow time, the inner product of the
channels with the reference of the scene centre, the change of variables from (omega, k_u) to
(k_x, k_y) by a Hamming-windowed sinc, and a two-dimensional inverse Fourier transform. The cost
grows with the sum of samples and pixels, not with pixels times pulses as that of backprojection;
the price is a straight and evenly sampled track.
"""

from __future__ import annotations

import dataclasses
import math
import warnings

import numpy as np
import scipy.fft

from ..backends.cpu.baselines.stolt import SlantImage, spread
from ..geometry import MapGrid
from ..geometry.straight_track import StraightTrack, check_straight, fit_straight_track
from ..signal.pulses import PulseBlock
from ..signal.spectra import band_spectrum

#: Largest error of the two-way path that the straight track may cause, wavelengths (11 degrees).
PATH_TOLERANCE_WAVELENGTHS = 1 / 32
#: The grid must be this many wavelengths from the track for the method of stationary phase.
NEAREST_WAVELENGTHS = 20.0
#: Largest sine of the angle from broadside.
LARGEST_SINE = 0.98
#: Width of the guard either side of the grid's own Doppler band, in Fresnel lengths. With 2, 3,
#: 4, 6 of them the band alone costs -61, -76, -81, -89 dB against time-domain correlation.
GUARD_FRESNEL_LENGTHS = 4.0
#: Share of the guard, next to the grid's own band, in which the spectrum does not fall yet.
GUARD_FLAT = 0.2
#: A guard narrower than this is reported.
LEAST_GUARD_FRESNEL_LENGTHS = 2.0

_ROWS_PER_PASS = 256


class WavenumberImager:
    """Image pulses of a straight, evenly sampled track in the wavenumber domain.

    The track may run in any direction and at any height, the grid may lie anywhere beside it:
    the transform images distance from the line of flight against position along it (the slant
    plane of the paper), and each pixel of the horizontal map grid is read at its own exact
    distance and position. The reference is that of the middle of the grid, and the Doppler band
    is taken around the grid's own, so squint and off-centre scenes need nothing special.

    Parameters
    ----------
    grid : MapGrid
        Where the pixels are.
    taps : int
        Samples over which the Hamming-windowed sinc of the Stolt interpolation spreads, even.
        They decide the error against time-domain correlation: some -55, -57, -62, -68 and
        -79 dB with 8, 16, 32, 64 and 256 of them.
    range_padding : float
        Period of the image in range over the extent of the grid in range, at least 1. Sets the
        spacing in k_x and with it the pass band of the interpolation. With 1, as published,
        scatterers near the near and far edge of the grid lose up to half their magnitude and
        appear at the opposite edge as well (6 dB lost and a ghost of equal strength at the
        very edge).
    azimuth_padding : float, optional
        Length of the slow-time transform over the number of pulses, at least 1; 1 as published,
        which wraps around. By default as long as it takes to keep the grid free of that.

    Raises
    ------
    ValueError
        A parameter is out of range.

    Examples
    --------
    >>> plan = WavenumberImager(grid)    # doctest: +SKIP
    >>> image = plan(profiles)           # doctest: +SKIP
    """

    def __init__(self, grid: MapGrid, *, taps: int = 16, range_padding: float = 2.0,
                 azimuth_padding: float | None = None):
        if not isinstance(grid, MapGrid):
            raise ValueError(f'grid is a {type(grid).__name__}; the wavenumber imager images a '
                             'MapGrid: use exact backprojection')
        if taps < 2 or taps % 2:
            raise ValueError(f'taps={taps}; expected an even number, at least 2')
        if not (math.isfinite(range_padding) and range_padding >= 1):
            raise ValueError(f'range_padding={range_padding}; expected at least 1')
        if azimuth_padding is not None and not (math.isfinite(azimuth_padding)
                                                and azimuth_padding >= 1):
            raise ValueError(f'azimuth_padding={azimuth_padding}; expected at least 1 or None')
        self.grid, self.taps = grid, int(taps)
        self.range_padding, self.azimuth_padding = range_padding, azimuth_padding
        self._corners, self._outline = _outline(grid)

    def __call__(self, block: PulseBlock) -> np.ndarray:
        """Image of one block.

        Parameters
        ----------
        block : PulseBlock
            Range profiles, or the phase history of a stepped-frequency radar, with phase centres;
            all pulses of the aperture, in order.

        Returns
        -------
        (n_y, n_x) complex64
            Image with the phase and scale of time-domain correlation of the band spectrum, row 0
            at the largest y.

        Raises
        ------
        ValueError
            The block has no positions; the track is not straight and even; the pulses are too
            far apart for the Doppler band of the grid; the grid touches the track, is seen along
            it, or lies outside the profiles.

        Warns
        -----
        UserWarning
            The pulses sample hardly more than the Doppler band of the grid.
        """
        if not block.has_positions:
            raise ValueError('the block has no phase centres; imaging needs the transmit and '
                             'receive position of every pulse and channel')
        track = fit_straight_track(block.tx_m, block.rx_m)
        check_straight(track, block.tx_m, block.rx_m, self._corners,
                       wavelength_m=block.radar.wavelength_m,
                       tolerance_wavelengths=PATH_TOLERANCE_WAVELENGTHS)
        scene = _Scene(track, *track.coordinates(self._outline))
        frequencies, _ = band_spectrum(block.select(slice(0, 1)))
        k = 4 * np.pi * frequencies / block.radar.propagation_speed_m_per_s
        _check_place(scene, block, frequencies)
        band = _doppler_band(scene, k[-1], self.azimuth_padding)
        slant = self._transform(scene, band, k, *_slow_time_spectrum(block, scene, band, k))
        scale = np.exp(0.25j * np.pi) * math.sqrt(2 * np.pi) / (band.n_fft * track.spacing_m)
        return slant.read(self.grid, track, scale)

    def _transform(self, scene: _Scene, band: _DopplerBand, k, k_y, spectrum) -> SlantImage:
        """Reference of the scene centre, Stolt interpolation and inverse transform."""
        span = max(np.ptp(scene.distance_m), self.grid.spacing_m)
        step = 2 * np.pi / (self.range_padding * span)
        k_x_ends = band.range_wavenumbers(k)
        first = k_x_ends[0] - step * (self.taps // 2)
        n_x = math.ceil((k_x_ends[1] - first) / step) + self.taps // 2 + 1
        stolt = np.zeros((len(k_y), n_x), np.complex64)
        for lo in range(0, len(k_y), _ROWS_PER_PASS):
            rows = slice(lo, lo + _ROWS_PER_PASS)
            k_u = k_y[rows, None]
            weight = band.weight(k_u / k)
            k_x = np.sqrt(np.where(weight > 0, k * k - k_u * k_u, k_x_ends[0] ** 2))
            # Equation 12. The amplitude of the stationary phase, which the paper leaves out,
            # makes the image equal to time-domain correlation in scale and phase.
            matched = spectrum[rows] * (weight * k / k_x ** 1.5) * np.exp(
                1j * (k_x * scene.centre_m[1] + k_u * scene.centre_m[0]))
            spread(matched, (k_x - first) / step, self.taps, stolt[rows])
        return SlantImage.from_spectrum(stolt, (k_y[0], first), (band.step, step),
                                        scene.centre_m)


def _outline(grid: MapGrid) -> tuple[np.ndarray, np.ndarray]:
    """Corners and middle (5, 3), and all pixels of the edge (S, 3), metres."""
    x, y = grid.x_m, grid.y_m
    edge = ([(a, b) for a in x for b in y[[0, -1]]] + [(a, b) for a in x[[0, -1]] for b in y])
    corners = [(a, b) for a in x[[0, -1]] for b in y[[0, -1]]] + [grid.centre_m[:2]]
    return tuple(np.array([(*p, grid.z_m) for p in points]) for points in (corners, edge))


@dataclasses.dataclass(frozen=True)
class _Scene:
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


def _check_place(scene: _Scene, block: PulseBlock, frequencies) -> None:
    """Refuse grids on the track, seen along the track, or outside the recorded ranges."""
    nearest = NEAREST_WAVELENGTHS * block.radar.wavelength_m
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
    period = block.radar.propagation_speed_m_per_s / (2 * (frequencies[1] - frequencies[0]))
    start = block.radar.range_start_m - (0.0 if block.compressed else period / 2)
    ranges = scene.ranges()
    if ranges[0] < start or ranges[1] > start + period:
        raise ValueError(f'the grid lies {ranges[0]:.1f} to {ranges[1]:.1f} m from the antenna, '
                         f'the profiles cover {start:.1f} to {start + period:.1f} m and repeat '
                         'beyond; move or shrink the grid, or record longer')


@dataclasses.dataclass(frozen=True)
class _DopplerBand:
    """Slow-time transform and the part of its spectrum that is used.

    The band is bounded by sines of the angle from broadside, ``k_u / k``: weight 1 between the
    `passed` ones, 0 outside the `stopped` ones.
    """

    n_fft: int
    step: float  # of k_u, radians per metre
    passed: tuple[float, float]
    stopped: tuple[float, float]

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


def _doppler_band(scene: _Scene, k_max: float, azimuth_padding) -> _DopplerBand:
    """Choose the length of the slow-time transform and the Doppler band.

    The grid's own band is extended by a guard on either side, over which the spectrum falls
    smoothly: cut sharply, it would ring. What the guard images lies outside the grid; the
    transform must be long enough that it does not wrap around into the grid. If the length asked
    for is too short even without a guard, the whole band between half the pulse rate is used, as
    the paper does, and wraps.
    """
    spacing, sines = scene.track.spacing_m, scene.sines()
    fresnel = _fresnel_length(scene, sines, k_max)
    room = _room_for_guards(spacing, sines, fresnel, k_max)
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
        return _DopplerBand(n_fft, step, whole, whole)
    stopped = (max(free[0], whole[0]), min(free[1], whole[1]))
    passed = tuple(s + GUARD_FLAT * (t - s) for s, t in zip(sines, stopped, strict=True))
    return _DopplerBand(n_fft, step, passed, stopped)


def _fresnel_length(scene: _Scene, sines, k_max: float) -> float:
    """Part of the aperture over which the phase to a pixel turns by pi, as a sine."""
    nearest = 0.0 if sines[0] < 0 < sines[1] else min(map(abs, sines))
    return math.sqrt(2 * np.pi / k_max * (1 - nearest ** 2) ** 1.5 / scene.distance_m.min())


def _room_for_guards(spacing_m: float, sines, fresnel: float, k_max: float) -> float:
    """Width left for a guard on either side of the grid's own band, as a sine.

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
    if room < least:
        wanted = needed + 2 * least * k_max
        warnings.warn(
            f'{what}, hardly more than the {needed:.4g} rad/m that the grid spans; expect errors '
            f'above -50 dB towards the ends of the grid along the track. Pulses at most every '
            f'{2 * np.pi / wanted:.4g} m or a smaller grid avoid them', stacklevel=4)
    return room


def _slow_time_spectrum(block: PulseBlock, scene: _Scene, band: _DopplerBand, k):
    """Slow-time transform, summed over the channels with their offsets along the track.

    Returns the k_u (I,) and the spectrum (I, K) complex128. The transform repeats itself in k_u:
    rows are unrolled to the band of the grid, which moves with frequency.
    """
    number = band.wavenumbers(k)
    k_u = number * band.step
    out = np.zeros((len(k_u), len(k)), np.complex128)
    for channel, offset in enumerate(scene.track.offsets_m):
        one = slice(channel, channel + 1)
        part = dataclasses.replace(block, samples=block.samples[:, one], tx_m=block.tx_m[:, one],
                                   rx_m=block.rx_m[:, one])
        spectrum = scipy.fft.fft(band_spectrum(part)[1][:, 0], band.n_fft, axis=0)
        shift = np.exp(-1j * k_u * (scene.track.first_m + offset))
        out += spectrum[number % band.n_fft] * shift[:, None]
    return k_u, out
