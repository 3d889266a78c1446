# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Strip of map patches that follow the platform, on one lattice of pixels."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from ..geometry.grids import MapGrid


def patch_beside(grid: MapGrid, middle_m: np.ndarray, flight: np.ndarray,
                 ahead_left_m: tuple[float, float]) -> MapGrid:
    """Map patch beside an aperture, on the pixels that a grid continues to.

    The patch has its size, spacing, height and lattice. Its middle lies `ahead_left_m` of the
    middle of the aperture, (2,) float64, metres: ahead along the flight, a unit vector (2,), and
    to the left of it.
    """
    ahead, left = ahead_left_m
    wanted = middle_m + ahead * flight + left * np.array([-flight[1], flight[0]])
    steps = np.rint((wanted - grid.centre_m[:2]) / grid.spacing_m)
    return dataclasses.replace(grid, centre_m=(
        *(grid.centre_m[:2] + steps * grid.spacing_m), grid.z_m))


class StripMosaic:
    """Map patches that follow a platform, joined to a strip.

    Where patches overlap, a pixel is taken from the one whose middle is nearest: seams lie half
    way between, and no pixel mixes the phases of two apertures. The oldest patches are dropped
    when the strip would have too many pixels.

    Parameters
    ----------
    max_pixels : int
        Most pixels of the rectangle around the strip; bounds its memory to some 12 bytes each,
        and that of the patches to 8 bytes a pixel.

    Raises
    ------
    ValueError
        The number is not positive.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging import MapGrid
    >>> from sar_imaging.streaming.mosaic import StripMosaic
    >>> strip = StripMosaic()
    >>> for y in (0.0, 8.0, 16.0):  # patches that follow the platform
    ...     patch = MapGrid((50.0, y, 0.0), 40, 40, 0.25)
    ...     strip.add(np.ones(patch.shape, np.complex64), patch)
    >>> image, grid = strip.form()
    >>> image.shape, grid.centre_m
    ((104, 40), (50.0, 8.0, 0.0))
    """

    def __init__(self, max_pixels: int = 2**25):
        if max_pixels < 1:
            raise ValueError(f'max_pixels={max_pixels}; expected at least one')
        self._max_pixels = max_pixels
        self._patches: list[_Patch] = []

    def add(self, image: np.ndarray, grid: MapGrid) -> None:
        """Add the newest patch, (n_y, n_x) complex64, which is kept and not copied.

        Raises
        ------
        ValueError
            Its pixels are not on the lattice of the strip, or it is too large by itself.
        """
        grid.check_image(image)
        if image.size > self._max_pixels:
            raise ValueError(f'the patch has {image.size} pixels; expected at most '
                             f'max_pixels={self._max_pixels}')
        row, column = self._place(grid)
        self._patches.append(_Patch(image, grid, row, column))
        while math.prod(self._box()[2:]) > self._max_pixels:
            del self._patches[0]

    def clear(self) -> None:
        """Begin another strip."""
        self._patches.clear()

    def form(self) -> tuple[np.ndarray, MapGrid]:
        """The strip so far, complex64 and 0 where no patch reaches, and the grid around it.

        Raises
        ------
        ValueError
            There is no patch.
        """
        if not self._patches:
            raise ValueError('the strip has no patch yet')
        first_row, first_column, n_y, n_x = self._box()
        strip = np.zeros((n_y, n_x), np.complex64)
        nearest = np.full((n_y, n_x), np.inf, np.float32)
        for patch in self._patches:
            top, left = patch.row - first_row, patch.column - first_column
            rows, columns = patch.image.shape
            part = np.s_[top:top + rows, left:left + columns]
            distance = np.add.outer(*((np.arange(n, dtype=np.float32) - (n - 1) / 2) ** 2
                                      for n in (rows, columns)))
            nearer = distance < nearest[part]
            strip[part][nearer] = patch.image[nearer]
            nearest[part][nearer] = distance[nearer]
        some = self._patches[0]
        spacing = some.grid.spacing_m
        x = some.grid.x_m[0] + (first_column - some.column + (n_x - 1) / 2) * spacing
        y = some.grid.y_m[0] - (first_row - some.row + (n_y - 1) / 2) * spacing
        return strip, MapGrid((x, y, some.grid.z_m), n_x, n_y, spacing)

    def _place(self, grid: MapGrid) -> tuple[int, int]:
        """Row and column of a patch's first pixel, on the lattice of the newest one."""
        if not self._patches:
            return 0, 0
        last = self._patches[-1]
        row, column = (float(v) for v in last.grid.to_pixels(grid.x_m[0], grid.y_m[0]))
        off = max(abs(row - round(row)), abs(column - round(column)))
        if (grid.spacing_m, grid.z_m) != (last.grid.spacing_m, last.grid.z_m) or off > 1e-3:
            raise ValueError(f'{grid} is not on the lattice of {last.grid}: expected the same '
                             'spacing and height, and whole pixels between them')
        return last.row + round(row), last.column + round(column)

    def _box(self) -> tuple[int, int, int, int]:
        """First row and column of the strip, its number of rows and of columns."""
        rows = [(p.row, p.row + p.image.shape[0]) for p in self._patches]
        columns = [(p.column, p.column + p.image.shape[1]) for p in self._patches]
        top, left = min(r[0] for r in rows), min(c[0] for c in columns)
        return top, left, max(r[1] for r in rows) - top, max(c[1] for c in columns) - left


@dataclasses.dataclass(frozen=True)
class _Patch:
    """A patch and the place of its first pixel on the lattice of the first patch of all."""

    image: np.ndarray
    grid: MapGrid
    row: int
    column: int
