# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Random scenes of obstacles, clutter and noise before the three shipped platforms.

Range profiles are synthesised from exact paths over the band, so that clutter of thousands of
scatterers costs little; they carry the window of the shipped files. The maps are smaller than
those of the files and the pulses further apart; band, aperture, range and pixels are theirs.
"""

from __future__ import annotations

import dataclasses
import math
import pathlib

import numpy as np
from scipy import fft

from sar_imaging.compilation import njit
from sar_imaging.configuration.parameters import read_configuration
from sar_imaging.exploitation.obstacles.aperture_view import ApertureView
from sar_imaging.geometry.grids import MapGrid
from sar_imaging.imaging.imager import plan_image
from sar_imaging.signal.pulses import PulseBlock
from sar_imaging.signal.radar import SPEED_OF_LIGHT, RadarParameters
from sar_imaging.signal.windows import window

CONFIG = pathlib.Path(__file__).parents[2] / 'sar_imaging' / 'config'
#: Side of the map in metres and pulses per aperture.
SIZES = {'airborne_x_band': (45.0, 256), 'drone_uwb': (8.0, 256), 'automotive_77ghz': (4.0, 256)}
_MARGIN_CELLS = 6.0
_CLUTTER_PER_CELL = 4.0
_LANES = 16


class Platform:
    """A shipped platform before a small map.

    Parameters
    ----------
    name : str
        Name of its configuration file.
    size_m : float, optional
        Side of the map; that of `SIZES` by default.
    n_apertures : int
        Apertures one after the other; the configured place is the middle of all.
    """

    def __init__(self, name: str, size_m: float | None = None, n_apertures: int = 3):
        settings = read_configuration(CONFIG / f'{name}.yaml')
        acquisition, imaging = settings.acquisition(), settings.imaging()
        size, n_pulses = SIZES[name]
        size = size_m or size
        self.name, self.full_grid = name, imaging.grid
        self.grid = MapGrid.from_size(imaging.grid.centre_m, size, size, imaging.grid.spacing_m)
        speed = acquisition.speed_m_per_s
        self.aperture_s = imaging.pulses_per_aperture / acquisition.prf_hz
        flight = np.array(acquisition.velocity_m_per_s) / speed
        step = speed * self.aperture_s / n_pulses
        along = (np.arange(n_pulses) - (n_pulses - 1) / 2) * step
        middles = (np.arange(n_apertures) - (n_apertures - 1) / 2) * step * n_pulses
        self.apertures = [np.array(acquisition.centre_m) + (m + along)[:, None] * flight
                          for m in middles]
        self._plan_profiles(acquisition.radar, imaging.window)
        self.views = [ApertureView.of_positions(p, self.radar) for p in self.apertures]
        self.range_m = float(np.mean([v.polar(np.array(self.grid.centre_m))[0]
                                      for v in self.views]))

    def _plan_profiles(self, radar: RadarParameters, name: str) -> None:
        cell = radar.range_resolution_m
        points = self.grid.points()[::8, ::8, None]
        reach = [np.linalg.norm(points - p[::16], axis=-1) for p in self.apertures]
        near = min(r.min() for r in reach) - _MARGIN_CELLS * cell
        far = max(r.max() for r in reach) + _MARGIN_CELLS * cell
        rate = 1.5 * radar.bandwidth_hz
        n = fft.next_fast_len(math.ceil((far - near) * 2 * rate / SPEED_OF_LIGHT))
        self.radar = RadarParameters(radar.carrier_hz, radar.bandwidth_hz, rate,
                                     2 * near / SPEED_OF_LIGHT)
        self._half = int(radar.bandwidth_hz / 2 / (rate / n))
        self._weights = window(name, 2 * self._half + 1)
        self._n_samples, self._near_m = n, near
        self._imager = plan_image(self.grid, self.radar, n, method='exact', target_db=-60.0)

    def spectra(self, aperture: int, points_m, amplitudes) -> np.ndarray:
        """(P, K) complex128 echoes; amplitude 1 stands for 0 dBsm in the middle of the map."""
        wavenumber = 4 * math.pi / SPEED_OF_LIGHT
        return _echoes(self.apertures[aperture], np.asarray(points_m, float).reshape(-1, 3),
                       np.asarray(amplitudes, complex) * self.range_m**2,
                       wavenumber * self.radar.carrier_hz,
                       wavenumber * self.radar.sample_rate_hz / self._n_samples, self._half,
                       self._near_m)

    def noise(self, rng: np.random.Generator, level_db: float) -> np.ndarray:
        """(P, K) complex128 noise that makes so much power in the image, dBsm."""
        share = self._weights / self._weights.sum()
        n_pulses = len(self.apertures[0])
        std = math.sqrt(10 ** (level_db / 10) * n_pulses / np.sum(share**2) / 2)
        draw = rng.standard_normal((2, n_pulses, 2 * self._half + 1))
        return std * (draw[0] + 1j * draw[1])

    def image(self, aperture: int, spectra: np.ndarray) -> np.ndarray:
        """(n_y, n_x) complex64 image, as the node backprojection forms it, in units of 0 dBsm."""
        return self._imager(self.profiles(aperture, spectra)).samples

    def profiles(self, aperture: int, spectra: np.ndarray) -> PulseBlock:
        """Range profiles of an aperture, counted from the first one."""
        positions = self.apertures[aperture]
        spread = np.zeros((len(positions), self._n_samples), complex)
        spread[:, np.arange(-self._half, self._half + 1)] = spectra * self._weights
        scale = self._n_samples / self._weights.sum() / len(positions)
        profiles = (fft.ifft(spread, axis=1) * scale).astype(np.complex64)
        counter = aperture * len(positions) + np.arange(len(positions))
        stamp_ns = np.rint(counter * (1e9 * self.aperture_s / len(positions))).astype(np.int64)
        centres = positions[:, None]
        return PulseBlock(self.radar, True, stamp_ns, counter, profiles[:, None], centres, centres)


@njit(fastmath=True)
def _echoes(positions, points, amplitudes, wavenumber, step, half, near_m):
    """Sum of echoes over the band by a recurrence, amplitude falling with the range squared."""
    n_bins, n_points = 2 * half + 1, len(points)
    out = np.zeros((len(positions), n_bins), np.complex128)
    now, turn = np.zeros((2, _LANES)), np.zeros((2, _LANES))
    for p in range(len(positions)):
        for first in range(0, n_points, _LANES):
            now[:] = 0.0
            for lane in range(min(_LANES, n_points - first)):
                i = first + lane
                d = math.sqrt((positions[p, 0] - points[i, 0])**2
                              + (positions[p, 1] - points[i, 1])**2
                              + (positions[p, 2] - points[i, 2])**2)
                phase = -(wavenumber * d - half * step * (d - near_m))
                z = amplitudes[i] / (d * d) * complex(math.cos(phase), math.sin(phase))
                now[0, lane], now[1, lane] = z.real, z.imag
                turn[0, lane] = math.cos(step * (d - near_m))
                turn[1, lane] = -math.sin(step * (d - near_m))
            for k in range(n_bins):
                re, im = 0.0, 0.0
                for lane in range(_LANES):
                    a, b = now[0, lane], now[1, lane]
                    re += a
                    im += b
                    now[0, lane] = a * turn[0, lane] - b * turn[1, lane]
                    now[1, lane] = a * turn[1, lane] + b * turn[0, lane]
                out[p, k] += complex(re, im)
    return out


@dataclasses.dataclass(frozen=True)
class ObstacleScene:
    """Points on the plane of the map.

    Parameters
    ----------
    obstacles_m : (N, 3) float64
        Places, metres.
    rcs_dbsm : (N,) float64
        Radar cross-sections.
    noise_dbsm : float or None
        Noise in the image; None without.
    clutter_m, clutter : (M, 3) float64, (M,) complex128
        Scatterers of a rectangle of clutter, and their amplitudes.
    seed : int
        Of the noise.
    """

    obstacles_m: np.ndarray
    rcs_dbsm: np.ndarray
    noise_dbsm: float | None
    clutter_m: np.ndarray
    clutter: np.ndarray
    seed: int

    def images(self, platform: Platform, aperture: int) -> tuple[np.ndarray, np.ndarray]:
        """Image of all of it, and of noise and clutter alone, (n_y, n_x) complex64."""
        rng = np.random.default_rng([self.seed, aperture])
        amplitudes = 10 ** (self.rcs_dbsm / 20) * np.exp(
            2j * np.pi * rng.random(len(self.rcs_dbsm)))
        behind = platform.spectra(aperture, self.clutter_m, self.clutter)
        if self.noise_dbsm is not None:
            behind += platform.noise(rng, self.noise_dbsm)
        background = platform.image(aperture, behind)
        return background + platform.image(
            aperture, platform.spectra(aperture, self.obstacles_m, amplitudes)), background


def random_scene(platform: Platform, seed: int, *, texture_shape: float | None = None
                 ) -> ObstacleScene:
    """1 to 20 obstacles of -10 to 20 dBsm, noise and clutter from none to strong.

    Parameters
    ----------
    platform : Platform
        Before whose map they stand.
    seed : int
        Decides everything.
    texture_shape : float, optional
        Of the clutter's K distribution; by default every second scene has slight texture (10),
        the others none.
    """
    rng = np.random.default_rng([seed, sorted(SIZES).index(platform.name)])
    grid = platform.grid
    half = (grid.n_x - 1) / 2 * grid.spacing_m
    n = int(rng.integers(1, 21))
    places = np.zeros((n, 3))
    places[:, :2] = rng.uniform(-0.95, 0.95, (n, 2)) * half
    noise, level = (float(rng.uniform(-45, -3)) if rng.random() > 0.1 else None
                    for _ in range(2))
    extent = rng.uniform(0.25, 0.6, 2) * 2 * half
    middle = rng.uniform(-1, 1, 2) * (half - extent / 2)
    cell = platform.radar.range_resolution_m * platform.views[0].resolution_m(grid.centre_m)[1]
    m = int(_CLUTTER_PER_CELL * extent.prod() / cell) if level is not None else 0
    clutter = np.zeros((m, 3))
    clutter[:, :2] = middle + rng.uniform(-0.5, 0.5, (m, 2)) * extent
    shape = texture_shape or (10.0 if seed % 2 else math.inf)
    texture = rng.gamma(shape, 1 / shape, m) if math.isfinite(shape) else np.ones(m)
    draw = rng.standard_normal((2, m))
    amplitudes = np.sqrt(10 ** ((level or 0.0) / 10) / _CLUTTER_PER_CELL / 2 * texture) * (
        draw[0] + 1j * draw[1])
    centre = np.array(grid.centre_m)
    return ObstacleScene(centre + places, rng.uniform(-10, 20, n), noise, centre + clutter,
                         amplitudes, seed)
