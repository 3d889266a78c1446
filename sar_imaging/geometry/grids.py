"""Image grids: where the pixels are."""

from __future__ import annotations

import dataclasses
import math

import numpy as np


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
