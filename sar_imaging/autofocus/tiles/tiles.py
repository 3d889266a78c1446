"""Image tiles around bright points: sub-aperture images of a few pixels, focused again quickly.

The aperture is cut into sub-apertures. For each tile and sub-aperture a short piece of range
profile around the tile's centre is formed once, all pulses of the sub-aperture summed in phase:
an image of that sub-aperture as far as a tile needs one. Another geometry then only moves the
pieces along range and turns their phase; the tile's image is a sum over sub-apertures, not over
pulses.
"""

from __future__ import annotations

import math

import numpy as np

from ...planning.interpolators import design_interpolator
from ...signal.pulses import PulseBlock
from ..models import Geometry
from . import kernels

PIECES_PER_RESOLUTION = 4  # samples of a piece; linear interpolation between them
PIXELS = 7, 21  # of a tile, along range and azimuth
_RANGE_STEP, _AZIMUTH_STEP = 0.7, 0.55  # their spacing in resolutions
_MARGIN = 3.0  # of the pieces beyond the tile for geometry to move, range resolutions


class Tiles:
    """Small image tiles, kept by sub-aperture, whose focus follows a change of the geometry.

    Parameters
    ----------
    block : PulseBlock
        Range profiles.
    geometry : Geometry
        Phase centres at which the pieces are formed.
    points : (K, 3) array_like
        Centres of the tiles, metres.
    n_subapertures : int
        Sub-apertures U to cut the aperture into.
    n_segments : int
        Coherent segments G; sub-apertures of different segments add in power only. Azimuth
        pixels are G times as wide as those of the whole aperture.
    pixels : (int, int)
        Pixels of a tile along range and azimuth, odd.

    Attributes
    ----------
    points : (K, 3) float64
        Centres of the tiles, metres.
    segment : (U,) int64
        Segment of each sub-aperture.
    wavenumber : float
        ``4 pi / lambda``, rad/m.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging.autofocus import Geometry
    >>> from sar_imaging.autofocus.tiles import Tiles
    >>> from sar_imaging.simulation import SCENARIOS
    >>> block = next(SCENARIOS['psf']().blocks(40))
    >>> geometry = Geometry(block.tx_m, block.rx_m)
    >>> tiles = Tiles(block, geometry, [[10_000.0, 0.0, 0.0]], n_subapertures=8)
    >>> images = tiles.focus(tiles.half_path_change(geometry))
    >>> images.shape, int(np.abs(images[0, :, 0]).argmax())  # brightest in the middle
    ((1, 147, 1), 73)
    """

    def __init__(self, block: PulseBlock, geometry: Geometry, points, n_subapertures: int,
                 n_segments: int = 1, pixels: tuple[int, int] = PIXELS):
        radar = block.radar
        self.points = np.asarray(points, np.float64)
        self.wavenumber = radar.wavenumber_rad_per_m
        self.n_segments = n_segments
        self._owner = np.arange(block.n_pulses) * n_subapertures // block.n_pulses
        self.segment = np.arange(n_subapertures) * n_segments // n_subapertures
        self._cuts = np.searchsorted(self.segment, np.arange(n_segments + 1))
        self._step_m = radar.range_resolution_m / PIECES_PER_RESOLUTION
        self._start = self._half_paths(geometry)
        middles = self._middles(geometry)
        self._pixels = np.stack([self._tile(k, middles, radar, pixels)
                                 for k in range(len(self.points))])
        self._planned = self._plan_pixels(middles)
        reach = float(np.abs(self._planned[0]).max()) + _MARGIN * PIECES_PER_RESOLUTION
        self._centre = math.ceil(reach)
        pieces = self._cut(block, geometry, 2 * self._centre + 3)
        self._pieces = pieces.real.ravel(), pieces.imag.ravel()
        self._shape = (*self._pixels.shape[:2], *pieces.shape[1:])

    def half_path_change(self, geometry: Geometry) -> np.ndarray:
        """(K, U) float64 change of the half path to the tiles' centres, metres."""
        return self._half_paths(geometry) - self._start

    def focus(self, change_m) -> np.ndarray:
        """Images of the segments.

        Parameters
        ----------
        change_m : (K, U) float64
            Change of the half paths, metres.

        Returns
        -------
        (K, X, G) complex64
        """
        shape = (*self._shape[:2], self.n_segments)
        out = np.empty((2, math.prod(shape)), np.float32)
        kernels.focus_tiles(*self._arguments(change_m), *out)
        return (out[0] + 1j * out[1]).reshape(shape)

    def correlate(self, change_m, weight) -> tuple[np.ndarray, np.ndarray]:
        """Adjoint of `focus`: what the sub-apertures contribute to weighted tiles.

        Parameters
        ----------
        change_m : (K, U) float64
            Change of the half paths, metres.
        weight : (K, X, G) complex64
            Weight of the pixels.

        Returns
        -------
        along : (K, U) complex128
            ``sum_x conj(weight) contribution``.
        slope : (K, U) complex128
            Derivative of the same by the change, 1/m.
        """
        out = np.zeros((4, change_m.size))
        kernels.correlate_tiles(*self._arguments(change_m), weight.real.ravel(),
                                weight.imag.ravel(), *out)
        along, slope = ((re + 1j * im).reshape(change_m.shape) for re, im in (out[:2], out[2:]))
        return along, slope / self._step_m + 1j * self.wavenumber * along

    def position(self, k: int, pixel: int) -> np.ndarray:
        """(3,) float64 position of a pixel of tile `k`, metres."""
        return self._pixels[k, pixel]

    def _arguments(self, change_m):
        reach = _MARGIN * PIECES_PER_RESOLUTION  # what moves further is out of the tile
        shift = self._centre + np.clip(change_m / self._step_m, -reach, reach)
        angle = np.remainder(self.wavenumber * change_m, 2 * np.pi)
        return (self._shape, self._cuts, *self._pieces,
                *(a.astype(np.float32).ravel() for a in (shift, np.cos(angle), np.sin(angle))),
                *self._planned)

    def _middles(self, geometry: Geometry):
        """Mean transmit and receive phase centre of each sub-aperture, (U, 3) each."""
        first = np.searchsorted(self._owner, np.arange(len(self.segment)))
        count = np.diff(first, append=len(self._owner))[:, None]
        return [np.add.reduceat(centres.mean(axis=1), first) / count
                for centres in geometry[:2]]

    def _half_paths(self, geometry: Geometry) -> np.ndarray:
        total = 0.0
        for centre in self._middles(geometry):
            dx, dy, dz = (self.points[:, None, axis] - centre[:, axis] for axis in range(3))
            total = total + 0.5 * np.sqrt(dx * dx + dy * dy + dz * dz)
        return total + geometry.range_bias_m

    def _tile(self, k: int, middles, radar, pixels) -> np.ndarray:
        """(X, 3) pixels on the horizontal plane through a point, along range and azimuth."""
        look = 0.5 * sum((self.points[k] - c) / np.linalg.norm(self.points[k] - c, axis=-1,
                                                              keepdims=True) for c in middles)
        mean = look[:, :2].mean(axis=0)
        slope = np.linalg.norm(mean)
        along_range = mean / slope
        along_azimuth = np.array([-along_range[1], along_range[0]])
        swing = max(float(np.ptp(look[:, :2] @ along_azimuth)), 1e-6)
        range_step = _RANGE_STEP * radar.range_resolution_m / slope
        azimuth_step = _AZIMUTH_STEP * self.n_segments * radar.wavelength_m / 2 / swing
        r, a = ((np.arange(n) - n // 2) * step
                for n, step in zip(pixels, (range_step, azimuth_step), strict=True))
        flat = r[:, None, None] * along_range + a[:, None] * along_azimuth
        out = np.tile(self.points[k], (r.size * a.size, 1))
        out[:, :2] += flat.reshape(-1, 2)
        return out

    def _plan_pixels(self, middles):
        out = np.empty((3, *self._pixels.shape[:2], len(self.segment)), np.float32)
        kernels.plan_pixels(self.points, self._pixels, *middles, self.wavenumber,
                            self._step_m, *out)
        return tuple(part.reshape(-1) for part in out)

    def _cut(self, block: PulseBlock, geometry: Geometry, length: int) -> np.ndarray:
        radar = block.radar
        rows = np.ascontiguousarray(block.samples).reshape(-1, block.n_samples)
        path = 0.5 * sum(
            np.linalg.norm(self.points[:, None] - np.reshape(c, (-1, 3)), axis=-1)
            for c in geometry[:2])
        measured = path + geometry.range_bias_m
        step = self._step_m / radar.sample_spacing_m
        position = (measured - radar.range_start_m) / radar.sample_spacing_m - self._centre * step
        kernel = design_interpolator(radar.sample_rate_hz / radar.bandwidth_hz)
        pieces = np.zeros((len(path), len(self.segment), length), np.complex64)
        kernels.cut_profiles(rows, kernel.weights, kernel.first, position,
                             2 * measured / radar.wavelength_m,
                             np.repeat(self._owner, block.n_channels), step, pieces)
        return pieces
