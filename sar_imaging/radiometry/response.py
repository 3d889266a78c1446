# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""What an image makes of a target, of a rough surface and of noise, at each of its pixels.

In the image ``f(x) = sum_m w_m s_m(D_m(x)) exp(+j k D_m(x))`` a target at x of cross section 1 m^2
has the amplitude ``G(x) = sum_m w_m g_m / (R_t R_r)``, for a radar of gain 1 (`RadarConstant`).
A rough surface of backscatter coefficient sigma0 has the mean power ``sigma0 G^2 A``, where the
area A of the impulse response h is ``integral |h|^2 / |h(x)|^2`` over the surface.

By Parseval's theorem that is an integral over the wavenumbers that the pulses fill: pulse m fills
the line ``k q_m`` with ``q_m = u_t + u_r`` the sum of the unit vectors from x to its antennas, and
neighbouring pulses are ``|q_m x q_m'|`` apart. So

    A G^2 = 2 pi c  sum_m |a_m|^2 / |(q_m x q_m') n|  *  sum_i p_i^2 / k_i / (df (sum_i p_i)^2)

with the pulse's amplitude a_m in G, the surface's normal n, and the window p_i over frequencies df
apart. Without n the area is that of the slant plane, which beta nought refers to. (I. G. Cumming
and F. H. Wong, Digital Processing of Synthetic Aperture Radar Data, 2005, section 4.7, gives the
case of a straight track: ``A = c lambda / (4 B sin(incidence) angle)``.)
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np
import scipy
from numpy.typing import ArrayLike

from ..geometry.grids import Grid, TerrainGrid
from ..geometry.illumination import Illumination
from ..signal.radar import RadarParameters
from ..signal.windows import window as spectral_window

_KNOTS = 49  # along a side of the image; cubic splines between them
_BINS = 64  # of the band
_LEAST_PULSES = 8
_NEIGHBOURS = 4  # pulses on either side that tell how fast the direction turns
_DIM = 1e-4  # of the largest amplitude: less counts as not lit


@dataclasses.dataclass(frozen=True, eq=False)
class ImageResponse:
    """Response of an image to targets, surfaces and noise, by pixel; NaN where nothing is lit.

    Attributes
    ----------
    amplitude : (n_y, n_x) float64
        Image amplitude G of a target of 1 m^2, for a radar of gain 1, 1 / m^2.
    area_m2 : (n_y, n_x) float64
        Area of the impulse response on the surface of the grid, m^2.
    slant_area_m2 : (n_y, n_x) float64
        The same in the plane of track and pixel, m^2.
    incidence_rad : (n_y, n_x) float64
        Angle between the surface's normal and the mean direction to the radar, radians.
    noise_gain : (n_y, n_x) float64
        Image power of noise of power 1 in the samples of the profiles.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging import MapGrid, RadarParameters
    >>> from sar_imaging.radiometry import image_response
    >>> radar = RadarParameters(10e9, 300e6, 400e6, first_sample_delay_s=6e-7)
    >>> track = np.zeros((64, 1, 3))
    >>> track[:, 0, 1:] = np.stack([np.linspace(-5, 5, 64), np.full(64, 50.0)], axis=-1)
    >>> response = image_response(MapGrid((80.0, 0.0, 0.0), 16, 16, 0.5), radar, track, track)
    >>> print(f'incidence {np.degrees(response.incidence_rad[8, 8]):.1f} degrees')
    incidence 58.1 degrees
    """

    amplitude: np.ndarray
    area_m2: np.ndarray
    slant_area_m2: np.ndarray
    incidence_rad: np.ndarray
    noise_gain: np.ndarray


def image_response(grid: Grid, radar: RadarParameters, tx_m: ArrayLike, rx_m: ArrayLike, *,
                   illumination: Illumination | None = None, weighted: bool = False,
                   weighting: str = 'none', pulse_weights: ArrayLike | None = None
                   ) -> ImageResponse:
    """Compute what an image makes of targets, surfaces and noise, before or after it is formed.

    Parameters
    ----------
    grid : Grid
        Grid of the image, with rows and columns: a map, on terrain or not, a plane, a polar grid.
    radar : RadarParameters
        Radar parameters of the pulses.
    tx_m, rx_m : (P, C, 3) array_like
        Phase centres, metres. The channels of a pulse stand close together compared with the
        aperture, and are balanced.
    illumination : Illumination, optional
        How strongly each echo lights each point; 1 everywhere if left out.
    weighted : bool
        The image was formed with this illumination, so that echoes have its weights.
    weighting : str
        Spectral window of the profiles, see `sar_imaging.signal.windows`.
    pulse_weights : (P,) array_like, optional
        Window over the pulses.

    Returns
    -------
    ImageResponse

    Raises
    ------
    ValueError
        The grid has no rows and columns, there are fewer than eight pulses, or the track does not
        pass the scene: no area is resolved then.

    Notes
    -----
    All is computed on 49 x 49 pixels and interpolated, which departs by less than 0.01 dB where
    the pattern is wider than a twentieth of the image.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging import MapGrid, RadarParameters
    >>> from sar_imaging.radiometry import image_response
    >>> radar = RadarParameters(10e9, 300e6, 400e6, first_sample_delay_s=6e-7)
    >>> track = np.zeros((64, 1, 3))
    >>> track[:, 0, 1:] = np.stack([np.linspace(-5, 5, 64), np.full(64, 50.0)], axis=-1)
    >>> response = image_response(MapGrid((80.0, 0.0, 0.0), 16, 16, 0.5), radar, track, track)
    >>> response.area_m2.shape
    (16, 16)
    >>> print(f'{response.area_m2[8, 8]:.3f} m^2 of ground in a resolution cell')
    0.082 m^2 of ground in a resolution cell
    """
    tx_m, rx_m = np.asarray(tx_m, np.float64), np.asarray(rx_m, np.float64)
    if len(grid.shape) != 2:
        raise ValueError(f'an image of shape {grid.shape}; radiometry needs rows and columns')
    if tx_m.ndim != 3 or tx_m.shape != rx_m.shape or len(tx_m) < _LEAST_PULSES:
        raise ValueError(f'tx_m.shape={tx_m.shape}, rx_m.shape={rx_m.shape}; expected (P, C, 3) '
                         f'of both with {_LEAST_PULSES} pulses or more')
    weights = np.ones(len(tx_m)) if pulse_weights is None else np.asarray(pulse_weights, float)
    knots = [np.unique(np.rint(np.linspace(0, n - 1, min(n, _KNOTS))).astype(int))
             for n in grid.shape]
    points = grid.positions(*np.meshgrid(*knots, indexing='ij'))
    flat = getattr(grid, 'map_grid', grid)
    normals = _normals(flat, *knots)
    sums = np.stack([_sums(row, normal, tx_m, rx_m, weights, illumination, weighted)
                     for row, normal in zip(points, normals, strict=True)], axis=1)
    turn = 2 * math.pi * radar.propagation_speed_m_per_s * _band_sum(radar, weighting)
    values = [_interpolated(knots, layer, grid.shape) for layer in sums]
    amplitude, noise, surface, slant = values[:4]
    amplitude = np.where(amplitude > _DIM * amplitude.max(), amplitude, np.nan)
    area, slant_area = (turn * s / amplitude ** 2 for s in (surface, slant))
    look = np.stack(values[4:7], -1) / np.linalg.norm(values[4:7], axis=0)[..., None]
    normal = _interpolated_normals(knots, normals, grid.shape)
    if isinstance(grid, TerrainGrid):
        across = np.stack(values[7:], -1)
        steep = _terrain_normals(grid)
        area = area * np.abs((across * normal).sum(-1) / (across * steep).sum(-1))
        normal = steep
    incidence = np.arccos(np.clip(np.abs((look * normal).sum(-1)), 0, 1))
    return ImageResponse(amplitude, area, slant_area,
                         np.where(np.isnan(amplitude), np.nan, incidence),
                         np.where(np.isnan(amplitude), np.nan, noise))


def echo_sums(points: np.ndarray, tx_m: np.ndarray, rx_m: np.ndarray, weights: np.ndarray,
              illumination: Illumination | None, weighted: bool
              ) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Sums over the echoes of P pulses of C channels at K points (K, 3), metres.

    Returns
    -------
    total, noise : (K,) float64
        Amplitude G of a target of 1 m^2, 1 / m^2, and power of noise of power 1.
    echoes : (P, K) float64
        What each pulse adds to G.
    direction : (P, K, 3) float64
        Sum of the unit vectors to its antennas.
    """
    to_tx, to_rx = (centres[:, :, None] - points for centres in (tx_m, rx_m))  # (P, C, K, 3)
    far_tx, far_rx = (np.linalg.norm(v, axis=-1) for v in (to_tx, to_rx))
    gain = 1.0 if illumination is None else illumination.amplitude(points).reshape(far_tx.shape)
    weight = weights[:, None, None] * (gain if weighted else 1.0) * np.ones(far_tx.shape)
    echoes = (weight * gain / (far_tx * far_rx)).sum(axis=1)
    direction = (to_tx / far_tx[..., None] + to_rx / far_rx[..., None]).mean(axis=1)
    return echoes.sum(axis=0), (weight ** 2).sum(axis=(0, 1)), echoes, direction


def _sums(points: np.ndarray, normals: np.ndarray, tx_m: np.ndarray, rx_m: np.ndarray,
          weights: np.ndarray, illumination: Illumination | None, weighted: bool) -> np.ndarray:
    """(10, K) sums over pulses at K points: G, noise, of surface and slant plane, directions."""
    total, noise, echoes, direction = echo_sums(points, tx_m, rx_m, weights, illumination,
                                                weighted)
    n = min(_NEIGHBOURS, len(tx_m) // 4)
    index = np.arange(len(tx_m))
    after, before = np.minimum(index + n, len(index) - 1), np.maximum(index - n, 0)
    turning = ((direction[after] - direction[before])
               / (after - before)[:, None, None])
    across = np.cross(direction, turning)  # normal of the slant plane, as long as the spacing
    power = echoes ** 2
    with np.errstate(divide='ignore', invalid='ignore'):
        surface, slant = (
            np.where(power > 0, power / spacing, 0.0).sum(axis=0)
            for spacing in (np.abs((across * normals).sum(-1)), np.linalg.norm(across, axis=-1)))
    if not np.isfinite([surface, slant]).all():
        raise ValueError('the radar stood still, turned back or flew straight at the scene: such '
                         'pulses resolve no area; image those alone that pass it')
    total = np.maximum(total, np.finfo(float).tiny)
    mean = [((power[..., None] * v).sum(axis=0) / power.sum(axis=0).clip(1e-300)[:, None]).T
            for v in (direction, across / np.linalg.norm(across, axis=-1, keepdims=True))]
    return np.vstack([total, noise, surface, slant, *mean])


def _band_sum(radar: RadarParameters, weighting: str) -> float:
    """``sum p^2 / k / (df (sum p)^2)`` over the band, k one-way wavenumbers, m s."""
    baseband = ((np.arange(_BINS) + 0.5) / _BINS - 0.5) * radar.bandwidth_hz
    wavenumber = 2 * np.pi * (radar.carrier_hz + baseband) / radar.propagation_speed_m_per_s
    shape = spectral_window(weighting, _BINS)
    return float((shape ** 2 / wavenumber).sum()
                 / (radar.bandwidth_hz / _BINS * shape.sum() ** 2))


def _normals(grid: Grid, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """(K_y, K_x, 3) unit normals of a flat or polar grid at some of its pixels."""
    places = [np.meshgrid(np.clip(rows + row, 0, grid.shape[0] - 1),
                          np.clip(columns + column, 0, grid.shape[1] - 1), indexing='ij')
              for row, column in ((1, 0), (-1, 0), (0, 1), (0, -1))]
    below, above, right, left = (grid.positions(*place) for place in places)
    normal = np.cross(right - left, above - below)
    return normal / np.linalg.norm(normal, axis=-1, keepdims=True)


def _terrain_normals(grid: TerrainGrid) -> np.ndarray:
    """(n_y, n_x, 3) unit normals of the terrain by its slopes."""
    down, right = np.gradient(grid.height_m, grid.map_grid.spacing_m)
    normal = np.stack([-right, down, np.ones(grid.shape)], -1)  # row 0 is the largest y
    return normal / np.linalg.norm(normal, axis=-1, keepdims=True)


def _interpolated_normals(knots: Sequence[np.ndarray], normals: np.ndarray,
                          shape: tuple[int, int]) -> np.ndarray:
    return np.stack([_interpolated(knots, normals[..., i], shape) for i in range(3)], -1)


def _interpolated(knots: Sequence[np.ndarray], values: np.ndarray, shape: tuple[int, int]
                  ) -> np.ndarray:
    """Values at some rows and columns, at all of them, by cubic splines."""
    orders = [min(3, len(k) - 1) for k in knots]
    if min(orders) < 1:
        raise ValueError(f'an image of {shape[0]} x {shape[1]} pixels; expected two or more rows '
                         'and columns')
    return scipy.interpolate.RectBivariateSpline(*knots, values, kx=orders[0], ky=orders[1])(
        *(np.arange(n) for n in shape))
