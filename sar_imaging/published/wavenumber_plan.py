"""Plan of spatial matched-filter interpolation (omega-k with Stolt) for any number of channels.

Rosenberg & Gray, equations 9 to 12: a Fourier transform over slow time, the inner product of the
channels with the reference of the scene centre, the change of variables from (omega, k_u) to
(k_x, k_y) by a Hamming-windowed sinc, and a two-dimensional inverse Fourier transform.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Mapping

import numpy as np

from ..geometry.grids import MapGrid
from ..geometry.straight_track import (
    StraightTrack,
    check_straight,
    fit_straight_track,
    path_errors,
)
from ..memory import IMAGE_BYTES
from ..planning.plan import Plan
from ..signal.radar import RadarParameters
from ..signal.spectra import band_frequencies
from .doppler_band import LARGEST_SINE, DopplerBand, Scene, choose_band

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


@dataclasses.dataclass(frozen=True, eq=False)
class WavenumberPlan(Plan):
    """How pulses of a straight track are imaged in the wavenumber domain.

    Attributes
    ----------
    grid : MapGrid
        Where the pixels are.
    radar : RadarParameters
        Of the compressed profiles.
    n_samples : int
        Samples of each profile.
    track : StraightTrack
        Fitted to the phase centres.
    frequencies_hz : (K,) float64
        Of the profiles' band, absolute, ascending, hertz.
    centre_m : (float, float)
        Middle of the scene along the track and distance from it, metres.
    band : DopplerBand
        Slow-time transform, and what of it is used.
    taps : int
        Of the Stolt interpolation.
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


def plan_wavenumber(grid: MapGrid, radar: RadarParameters, n_samples: int, tx_m, rx_m, *,
                    target_db: float = -60.0, taps: int | None = None, range_padding: float = 2.0,
                    azimuth_padding: float | None = None) -> WavenumberPlan:
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
        Of the compressed profiles.
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
    taps = fewest_taps(target_db, range_padding) if taps is None else taps
    if taps < 2 or taps % 2:
        raise ValueError(f'taps={taps}; expected an even number, at least 2')
    corners, outline = _outline(grid)
    track = fit_straight_track(tx_m, rx_m)
    check_straight(track, tx_m, rx_m, corners, wavelength_m=radar.wavelength_m,
                   tolerance_wavelengths=PATH_TOLERANCE_WAVELENGTHS)
    scene = Scene(track, *track.coordinates(outline))
    frequencies = band_frequencies(radar, n_samples, compressed=True)
    k = 4 * np.pi * frequencies / radar.propagation_speed_m_per_s
    _check_place(scene, radar, frequencies)
    band = choose_band(scene, k[-1], azimuth_padding)
    span = max(np.ptp(scene.distance_m), grid.spacing_m)
    step = 2 * np.pi / (range_padding * span)
    k_x_ends = band.range_wavenumbers(k)
    first = k_x_ends[0] - step * (taps // 2)
    n_x = math.ceil((k_x_ends[1] - first) / step) + taps // 2 + 1
    turns = 2 * np.pi * path_errors(track, tx_m, rx_m, corners) / radar.wavelength_m
    errors = {'Stolt interpolation': _stolt_error(taps, range_padding),
              'Doppler band': 10 ** (band.error_db / 10),
              'straight track': float(np.mean(turns ** 2)),
              # next term of the Hankel function that the stationary phase stands for
              'stationary phase': (3 / (8 * k_x_ends[0] * scene.distance_m.min())) ** 2,
              'read pixels': 10 ** (_READ_ERROR_DB / 10)}
    return WavenumberPlan(
        grid, radar, n_samples, track, frequencies, scene.centre_m, band, int(taps), first, step,
        n_x,
        {cause: 10 * math.log10(max(e, _LEAST)) for cause, e in errors.items()},
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


def _check_place(scene: Scene, radar: RadarParameters, frequencies) -> None:
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
