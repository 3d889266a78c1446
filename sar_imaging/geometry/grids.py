"""Map grids and the protocol of all grids: the positions of an image's pixels."""

from __future__ import annotations

import dataclasses
import math
from typing import Protocol, runtime_checkable

import numpy as np


@runtime_checkable
class Grid(Protocol):
    """Where the pixels of an image are: all that imaging in general needs to know of a grid.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging.geometry import Grid, MapGrid, PointGrid
    >>> def highest(grid: Grid) -> float:
    ...     return float(grid.points()[..., 2].max())
    >>> highest(MapGrid((0.0, 0.0, 2.0), 8, 8, 1.0))
    2.0
    >>> highest(PointGrid(np.array([[0.0, 0.0, 1.0], [5.0, 0.0, 7.0]])))
    7.0
    """

    @property
    def shape(self) -> tuple[int, ...]:
        """Shape of images."""

    def positions(self, *index) -> np.ndarray:
        """(..., 3) float64 positions of some pixels in the imaging frame, metres.

        One integer array for each axis of the image, broadcast together.
        """

    def points(self) -> np.ndarray:
        """``(*shape, 3)`` float64 positions of all pixels in the imaging frame, metres."""


@runtime_checkable
class EvenGrid(Grid, Protocol):
    """Grid whose pixels lie at equal steps along two axes or three: an image has straight lines.

    Pixel ``[i, j, ...]`` lies at ``origin_m + i * steps_m[0] + j * steps_m[1] + ...``.
    """

    @property
    def origin_m(self) -> tuple[float, float, float]:
        """Position of the pixel whose numbers are all 0, metres."""

    @property
    def steps_m(self) -> np.ndarray:
        """(A, 3) float64 step of the position along each axis of the image, metres."""


def even_positions(grid: EvenGrid, *index) -> np.ndarray:
    """(..., 3) float64 positions of some pixels of a grid with equal steps, metres."""
    return sum((np.multiply.outer(np.asarray(i, float), step)
                for i, step in zip(index, grid.steps_m, strict=True)), np.array(grid.origin_m))


@dataclasses.dataclass(frozen=True)
class MapGrid:
    """North-up grid of square pixels on a horizontal plane.

    Images on it have shape ``(n_y, n_x)``: row 0 is the largest y, column 0 the smallest x.

    Parameters
    ----------
    centre_m : (3,) floats
        Middle of the grid (x, y) and height of its plane (z) in the imaging frame, metres.
    n_x, n_y : int
        Pixels along x and y.
    spacing_m : float
        Pixel spacing along both axes, metres.

    Raises
    ------
    ValueError
        A number of pixels or the spacing is not positive, or a value is not finite.

    Examples
    --------
    >>> from sar_imaging import MapGrid
    >>> grid = MapGrid((100.0, 0.0, 0.0), n_x=5, n_y=3, spacing_m=0.5)
    >>> grid.shape
    (3, 5)
    >>> grid.positions(0, 0).tolist()  # the north-western pixel
    [99.0, 0.5, 0.0]
    >>> row, column = grid.to_pixels(100.25, 0.0)
    >>> print(f'row {row:.1f}, column {column:.1f}')
    row 1.0, column 2.5
    """

    centre_m: tuple[float, float, float]
    n_x: int
    n_y: int
    spacing_m: float

    def __post_init__(self):
        object.__setattr__(self, 'centre_m', tuple(float(v) for v in self.centre_m))
        if len(self.centre_m) != 3 or not all(map(math.isfinite, self.centre_m)):
            raise ValueError(f'centre_m={self.centre_m}; expected three finite numbers')
        if self.n_x < 1 or self.n_y < 1:
            raise ValueError(f'n_x={self.n_x}, n_y={self.n_y}; expected at least one pixel each')
        if not (math.isfinite(self.spacing_m) and self.spacing_m > 0):
            raise ValueError(f'spacing_m={self.spacing_m} must be positive and finite')

    @classmethod
    def from_size(cls, centre_m, size_x_m: float, size_y_m: float, spacing_m: float) -> MapGrid:
        """Grid whose pixel centres cover ``size_x_m`` by ``size_y_m``, edges included, metres."""
        if not (math.isfinite(spacing_m) and spacing_m > 0):
            raise ValueError(f'spacing_m={spacing_m} must be positive and finite')
        return cls(centre_m, round(size_x_m / spacing_m) + 1, round(size_y_m / spacing_m) + 1,
                   spacing_m)

    @property
    def shape(self) -> tuple[int, int]:
        """Image shape ``(n_y, n_x)``."""
        return (self.n_y, self.n_x)

    @property
    def x_m(self) -> np.ndarray:
        """(n_x,) float64 x of the columns, ascending, metres."""
        return self.centre_m[0] + (np.arange(self.n_x) - (self.n_x - 1) / 2) * self.spacing_m

    @property
    def y_m(self) -> np.ndarray:
        """(n_y,) float64 y of the rows, descending, metres."""
        return self.centre_m[1] - (np.arange(self.n_y) - (self.n_y - 1) / 2) * self.spacing_m

    @property
    def z_m(self) -> float:
        """Height of the plane, metres."""
        return self.centre_m[2]

    @property
    def origin_m(self) -> tuple[float, float, float]:
        """Position of pixel ``[0, 0]``, metres."""
        return (float(self.x_m[0]), float(self.y_m[0]), self.z_m)

    @property
    def steps_m(self) -> np.ndarray:
        """(2, 3) float64 step of the position from row to row, and from column to column."""
        return np.array([[0.0, -self.spacing_m, 0.0], [self.spacing_m, 0.0, 0.0]])

    def positions(self, row, column) -> np.ndarray:
        """(..., 3) float64 positions of some pixels, by broadcast numbers, metres."""
        x, y, z = np.broadcast_arrays(self.x_m[column], self.y_m[row], self.z_m)
        return np.stack([x, y, z], axis=-1)

    def points(self) -> np.ndarray:
        """(n_y, n_x, 3) float64 pixel positions, metres."""
        out = np.empty((*self.shape, 3))
        out[..., 0] = self.x_m
        out[..., 1] = self.y_m[:, None]
        out[..., 2] = self.z_m
        return out

    def check_image(self, image: np.ndarray) -> None:
        """Raise ValueError when an image does not have the shape of the grid."""
        if image.shape != self.shape:
            raise ValueError(f'image.shape={image.shape} does not match grid.shape={self.shape}')

    def to_pixels(self, x_m, y_m) -> tuple[np.ndarray, np.ndarray]:
        """Fractional ``(row, column)`` of positions in metres."""
        row = (self.y_m[0] - np.asarray(y_m, float)) / self.spacing_m
        column = (np.asarray(x_m, float) - self.x_m[0]) / self.spacing_m
        return row, column
