# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""How the pixels of one of our images lie in SICD's order, and where its carrier is.

Our samples have the whole carrier in them: from pixel to pixel they turn by ``2 pi K . step``.
SICD takes out a centre frequency KCtr along rows and along columns. It is chosen so that the
samples turn by whole quarters from pixel to pixel, which exchanges and negates real and imaginary
part: no bit is lost.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from ...geometry.grids import EvenGrid, Grid, TerrainGrid
from ..acquisition import Acquisition
from .grid import UP, SpatialSupport, centre_of_aperture, centres, support

_RIGHT_ANGLE = 1e-6  # cosine between rows and columns
_LEAST_UPWARD = 0.1  # cosine between the plane's normal and the vertical
_ADVICE = 'form the image on sar_imaging.formats.sicd_grid(...)'
_SAME_PLANE = np.cos(np.radians(0.5))


@dataclasses.dataclass(frozen=True, eq=False)
class SicdLayout:
    """Rows and columns of SICD in one of our images.

    Attributes
    ----------
    transposed, row_sign, column_sign : bool, int, int
        What takes our array to SICD's: the transpose, then every axis forwards or backwards.
    shape : (2,) int
        Rows and columns.
    origin_m : (3,) float64
        Place of pixel ``[0, 0]`` of SICD's order, metres.
    axes : (2, 3) float64
        Unit vectors of row and column in the imaging frame.
    spacing_m : (2,) float64
        Spacing of rows and columns, metres.
    plane : str
        ``'GROUND'``, ``'SLANT'`` or ``'OTHER'``.
    supports : (2,) SpatialSupport
        Supports of rows and columns at the scene centre point.
    quarters : (2,) int
        Quarter turns of the carrier from pixel to pixel that are taken out.
    """

    transposed: bool
    row_sign: int
    column_sign: int
    shape: tuple[int, int]
    origin_m: np.ndarray
    axes: np.ndarray
    spacing_m: np.ndarray
    plane: str
    supports: tuple[SpatialSupport, SpatialSupport]
    quarters: tuple[int, int]

    @property
    def scp_pixel(self) -> tuple[int, int]:
        """Row and column of the scene centre point."""
        return self.shape[0] // 2, self.shape[1] // 2

    @property
    def scp_m(self) -> np.ndarray:
        """(3,) scene centre point, imaging frame, metres."""
        return self.position(*self.scp_pixel)

    @property
    def centre_per_m(self) -> tuple[float, float]:
        """KCtr of rows and columns, cycles per metre."""
        return tuple(quarters / (4 * spacing) for quarters, spacing in zip(
            self.quarters, self.spacing_m, strict=True))

    def position(self, row: ArrayLike, column: ArrayLike) -> np.ndarray:
        """(..., 3) place of pixels in SICD's order, imaging frame, metres."""
        index = np.stack(np.broadcast_arrays(row, column), axis=-1) * self.spacing_m
        return self.origin_m + index @ self.axes

    def ordered(self, samples: np.ndarray) -> np.ndarray:
        """Samples in SICD's order, still with their carrier."""
        samples = samples.T if self.transposed else samples
        return samples[::self.row_sign, ::self.column_sign]

    def at_baseband(self, samples: np.ndarray) -> np.ndarray:
        """(rows, columns) complex64 pixels of SICD from samples of ours."""
        ordered = self.ordered(samples)
        out = np.empty(self.shape, np.complex64)
        for axis, quarters in enumerate(self.quarters):
            turns = quarters * (np.arange(self.shape[axis]) - self.scp_pixel[axis]) % 4
            source = out if axis else ordered
            for turn in range(4):
                index = (slice(None),) * axis + (turns == turn,)
                out[index] = turned(source[index], turn)
        return out

    def offsets(self, acquisition: Acquisition, points_m: np.ndarray) -> np.ndarray:
        """(2, S) centres of the spectra of places less KCtr, along rows and columns."""
        return np.stack([centres(acquisition, points_m, axis) - centre for axis, centre in zip(
            self.axes, self.centre_per_m, strict=True)])


def turned(samples: np.ndarray, quarters: int) -> np.ndarray:
    """Samples times ``exp(-j pi/2 quarters)``, exactly."""
    out = np.empty_like(samples)
    real, imaginary = samples.real, samples.imag
    if quarters % 2:
        real, imaginary = imaginary, -real
    if quarters % 4 >= 2:
        real, imaginary = -real, -imaginary
    out.real, out.imag = real, imaginary
    return out


def lay_out(grid: Grid, acquisition: Acquisition) -> SicdLayout:
    """SICD's order for an image on a map or on a plane of any orientation.

    Raises
    ------
    ValueError
        The pixels lie on no plane seen from above, or are too far apart for the resolution.
    """
    steps = _checked_steps(grid)
    middle = np.asarray(grid.positions(grid.shape[0] // 2, grid.shape[1] // 2))
    place, velocity = centre_of_aperture(acquisition)
    look = middle - place
    lengths = np.linalg.norm(steps, axis=1)
    transposed, signs = _orientation(steps / lengths[:, None], look)
    order = [1, 0] if transposed else [0, 1]
    spacing = lengths[order]
    axes = steps[order] * (np.array(signs) / spacing)[:, None]
    n_rows, n_columns = (int(grid.shape[axis]) for axis in order)
    shape = n_rows, n_columns
    first = [0 if sign > 0 else n - 1 for sign, n in zip(signs, shape, strict=True)]
    origin = np.asarray(grid.positions(*(first[axis] for axis in order)))
    scp = origin + (np.array(shape) // 2 * spacing) @ axes
    along, across = (support(acquisition, scp, axis) for axis in axes)
    supports = along, across
    _check_sampling(supports, spacing)
    quarters = tuple(round(4 * one.centre * step) for one, step in zip(supports, spacing,
                                                                       strict=True))
    return SicdLayout(transposed, *signs, shape, origin, axes, spacing,
                  _plane_name(np.cross(*axes), look, velocity), supports, quarters)


def _checked_steps(grid: Grid) -> np.ndarray:
    """(2, 3) steps of rows and columns of a plane that SICD describes."""
    if isinstance(grid, TerrainGrid):
        raise ValueError('the image lies on terrain; the pixels of SICD lie on a plane. Write a '
                         f'GeoTIFF, or {_ADVICE}: a reader projects it onto the terrain')
    if not isinstance(grid, EvenGrid) or len(grid.shape) != 2:
        raise ValueError(f'the image lies on a {type(grid).__name__}; expected a MapGrid or '
                         f'PlaneGrid: {_ADVICE}')
    units = grid.steps_m / np.linalg.norm(grid.steps_m, axis=1)[:, None]
    cosine = units[0] @ units[1]
    if abs(cosine) > _RIGHT_ANGLE:
        raise ValueError(f'rows and columns meet at {np.degrees(np.arccos(cosine)):.4f} degrees; '
                         f'expected 90: {_ADVICE}')
    if abs(np.cross(*units) @ UP) < _LEAST_UPWARD:
        raise ValueError('the plane of the image is upright; SICD wants one whose normal points '
                         f'away from the Earth: {_ADVICE}')
    return grid.steps_m


def _check_sampling(supports: Sequence[SpatialSupport], spacing: np.ndarray) -> None:
    for name, one, step in zip(('rows', 'columns'), supports, spacing, strict=True):
        if one.bandwidth * step > 1:
            raise ValueError(f'{name} are {step:g} m apart, but the image has detail of '
                             f'{1 / one.bandwidth:g} m: SICD does not describe aliased images; '
                             f'choose a smaller spacing, or {_ADVICE}')


def _orientation(units: np.ndarray, look: np.ndarray) -> tuple[bool, tuple[int, int]]:
    """Whether rows and columns change places, and their signs: rows away from the radar."""
    away = units @ look
    transposed = bool(abs(away[1]) > abs(away[0]))
    row, column = units[::-1] if transposed else units
    row_sign = 1 if row @ look > 0 else -1
    column_sign = 1 if np.cross(row_sign * row, column) @ UP > 0 else -1
    return transposed, (row_sign, column_sign)


def _plane_name(normal: np.ndarray, look: np.ndarray, velocity: np.ndarray) -> str:
    if normal @ UP > _SAME_PLANE:
        return 'GROUND'
    slant = np.cross(look, velocity)
    length = np.linalg.norm(slant)
    return 'SLANT' if length and abs(normal @ slant) / length > _SAME_PLANE else 'OTHER'
