"""Images on the pixels of a map projection: interpolated within the band that they have.

From pixel to pixel the carrier turns many times, so it is taken out first, ``exp(-j k_c D)`` with
the half path D of the middle of the aperture. What is left is band-limited about zero; it is
interpolated (Yen 1956, see `sar_imaging.quality.interpolation`), and the carrier of the new place
is put back.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from scipy import ndimage

from ..geometry.earth import SEMI_MAJOR_M, Datum
from ..geometry.grids import TerrainGrid
from ..imaging.image import Image
from ..quality.interpolation import interpolate_image
from .acquisition import Acquisition
from .georeference import from_map, to_map

_ROUNDS = 3  # that find the point of the plane over a place; each gains two digits or more
_MOST_PIXELS = 40  # for each of the image; a narrow one that lies askew needs some
_BLOCK = 1 << 17  # pixels at a time


@dataclasses.dataclass(frozen=True, eq=False)
class MapPixels:
    """Square pixels of a map projection, row 0 in the north.

    Attributes
    ----------
    crs : pyproj.CRS
        The projection.
    affine : (2, 3) float64
        Takes ``(column, row, 1)`` of a pixel's middle to easting and northing.
    shape : (2,) int
        Rows and columns.
    """

    crs: object
    affine: np.ndarray
    shape: tuple[int, int]

    def points(self, grid, datum: Datum, row, column) -> np.ndarray:
        """(..., 3) places on the surface of a grid that lie over pixels, imaging frame, metres."""
        index = np.stack([*np.broadcast_arrays(column, row), np.ones(np.shape(row))])
        east, north = np.tensordot(self.affine, index, 1)
        latitude, longitude = from_map(self.crs, east, north)
        height = np.full(np.shape(east), datum.height_m)
        for _ in range(_ROUNDS):
            points = datum.from_geographic(latitude, longitude, height)
            height = height + _surface(grid, points) - points[..., 2]
        return datum.from_geographic(latitude, longitude, height)


def covering_pixels(grid, datum: Datum, crs, spacing_m: float) -> MapPixels:
    """Pixels of a projection that cover an image.

    Their edges are multiples of the spacing, so that images beside each other share pixels.

    Raises
    ------
    ValueError
        The edge of the map runs through the image, or the map is stretched there.
    """
    rows, columns = grid.shape
    row, column = np.meshgrid(np.linspace(-0.5, rows - 0.5, 17),
                              np.linspace(-0.5, columns - 0.5, 17), indexing='ij')
    flat = getattr(grid, 'map_grid', grid)
    step = flat.steps_m
    edge = np.array(flat.origin_m) + row[..., None] * step[0] + column[..., None] * step[1]
    latitude, longitude, _ = datum.to_geographic(edge)
    east, north = to_map(crs, latitude, longitude)
    spacing = np.full(2, spacing_m)
    if crs.is_geographic:
        spacing = np.degrees(spacing_m / SEMI_MAJOR_M) / np.array(
            [np.cos(np.radians(latitude.mean())), 1.0])
    low = np.floor(np.array([east.min(), north.min()]) / spacing).astype(int)
    high = np.ceil(np.array([east.max(), north.max()]) / spacing).astype(int)
    affine = np.array([[spacing[0], 0.0, (low[0] + 0.5) * spacing[0]],
                       [0.0, -spacing[1], (high[1] - 0.5) * spacing[1]]])
    shape = (int(high[1] - low[1]), int(high[0] - low[0]))
    if math.prod(shape) > _MOST_PIXELS * (math.prod(grid.shape) + 1000):
        raise ValueError(f'in {crs.name} the image would need {shape[0]} by {shape[1]} pixels, '
                         f'here it has {grid.shape[0]} by {grid.shape[1]}: it lies on the edge '
                         'of this map, or far outside; choose another CRS')
    return MapPixels(crs, affine, shape)


def resample(image: Image, datum: Datum, acquisition: Acquisition,
             pixels: MapPixels) -> np.ndarray:
    """Samples of an image at the pixels of a map.

    Parameters
    ----------
    image : Image
        On a map, on terrain, or on a level plane; sampled at 1.25 times its bandwidth or more.
    datum : Datum
        Of its frame.
    acquisition : Acquisition
        Of its pulses.
    pixels : MapPixels
        Where samples are wanted.

    Returns
    -------
    (rows, columns) complex64
        With the carrier, as backprojection onto these pixels gives; 0 outside the image.
    """
    grid = image.grid
    baseband = np.empty(grid.shape, np.complex64)
    columns = np.arange(grid.shape[1])
    for first in range(0, grid.shape[0], max(1, _BLOCK // grid.shape[1])):
        rows = np.arange(first, min(first + max(1, _BLOCK // grid.shape[1]), grid.shape[0]))
        carrier = _carrier(acquisition, grid.positions(rows[:, None], columns))
        baseband[rows] = image.samples[rows] * carrier.conj()
    out = np.zeros(pixels.shape, np.complex64)
    for first in range(0, out.size, _BLOCK):
        row, column = np.divmod(np.arange(first, min(first + _BLOCK, out.size)), out.shape[1])
        points = pixels.points(grid, datum, row, column)
        at = _index(grid, points)
        inside = ((at >= 0) & (at <= np.array(grid.shape) - 1)).all(axis=-1)
        values = interpolate_image(baseband, *at[inside].T)
        out[row[inside], column[inside]] = values * _carrier(acquisition, points[inside])
    return out


def _carrier(acquisition: Acquisition, points: np.ndarray) -> np.ndarray:
    """``exp(+j k_c D)`` of the middle of the aperture, complex128; 1 where a place is unknown."""
    middle = acquisition.n_pulses // 2
    path = sum(np.linalg.norm(points - centre[middle], axis=-1)
               for centre in (acquisition.tx_m, acquisition.rx_m))
    cycles = path / acquisition.radar.wavelength_m
    return np.exp(2j * np.pi * np.nan_to_num(cycles - np.round(cycles)))


def _index(grid, points: np.ndarray) -> np.ndarray:
    """(..., 2) fractional row and column of places, found in the horizontal."""
    flat = getattr(grid, 'map_grid', grid)
    offset = points[..., :2] - np.array(flat.origin_m)[:2]
    return offset @ np.linalg.inv(flat.steps_m[:, :2])


def _surface(grid, points: np.ndarray) -> np.ndarray:
    """Height z of the plane or of the terrain under places; of the nearest known edge outside."""
    if isinstance(grid, TerrainGrid):
        heights = np.nan_to_num(grid.height_m, nan=float(np.nanmean(grid.height_m)))
        at = np.moveaxis(_index(grid, points), -1, 0)
        return ndimage.map_coordinates(heights, at, order=1, mode='nearest')
    normal = np.cross(*grid.steps_m)
    offset = points - np.array(grid.origin_m)
    return grid.origin_m[2] - (offset[..., :2] @ normal[:2]) / normal[2]
