# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""The grid that SICD wants: rows along range, away from the radar, seen from above.

A pulse at the frequency f contributes the plane wave ``exp(+j 2 pi K . x)`` about a place x, with
``K = (f / c) (u_t + u_r)``, where u_t and u_r point from transmitter and receiver to x: the
gradient of the phase of equation 17. SICD describes an image by what of K lies in its plane
(NGA.STND.0024-1, section 2.2).
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from numpy.typing import ArrayLike

from ...geometry.grids import PlaneGrid
from ..acquisition import Acquisition

N_WEIGHTS = 64
_N_DIRECTIONS = 2048  # between the pulses, at which the density of a support is taken
_LEAST_BAND = 1e-3
_MAX_PULSES = 512  # more would not change a width by a thousandth


@dataclasses.dataclass(frozen=True, eq=False)
class SpatialSupport:
    """Spatial frequencies of a place along one direction of the image, cycles per metre.

    Attributes
    ----------
    low, high : float
        Its ends.
    weights : (64,) float64
        How much of the pulses and frequencies lies at even steps from one end to the other, the
        largest 1.
    width_m : float
        Width of the impulse response at -3 dB, metres.
    """

    low: float
    high: float
    weights: np.ndarray
    width_m: float

    @property
    def centre(self) -> float:
        """Middle of the support."""
        return 0.5 * (self.low + self.high)

    @property
    def bandwidth(self) -> float:
        """Extent of the support."""
        return self.high - self.low


def directions(acquisition: Acquisition, points_m: ArrayLike) -> np.ndarray:
    """(P, S, 3) float64 half sums of the unit vectors from transmitter and receiver to points."""
    points = np.asarray(points_m, np.float64).reshape(-1, 3)
    total = np.zeros((acquisition.n_pulses, len(points), 3))
    for centres in (acquisition.tx_m, acquisition.rx_m):
        look = points - centres[:, None]
        total += 0.5 * look / np.linalg.norm(look, axis=-1, keepdims=True)
    return total


def thinned(acquisition: Acquisition) -> Acquisition:
    """The same acquisition with as many pulses as a support needs, the outermost among them."""
    chosen = np.unique(np.linspace(0, acquisition.n_pulses - 1, _MAX_PULSES).round().astype(int))
    return dataclasses.replace(
        acquisition, pointing=None, **{name: getattr(acquisition, name)[chosen]
                                       for name in ('stamp_ns', 'tx_m', 'rx_m')})


def support(acquisition: Acquisition, point_m: ArrayLike, axis: ArrayLike) -> SpatialSupport:
    """Spatial frequencies that the image has at a place along one direction.

    Parameters
    ----------
    acquisition : Acquisition
        Pulses, each of the same weight; the band counts as flat.
    point_m : (3,) array_like
        Place in the imaging frame, metres.
    axis : (3,) array_like
        Unit vector in the imaging frame.

    Returns
    -------
    SpatialSupport
    """
    along = directions(thinned(acquisition), point_m)[:, 0] @ np.asarray(axis, np.float64)
    between = np.interp(np.linspace(0, len(along) - 1, _N_DIRECTIONS), np.arange(len(along)),
                        along)
    ends = np.sort(np.multiply.outer(between, acquisition.wavenumbers_per_m), axis=1)
    low, high = float(ends.min()), float(ends.max())
    edges = np.linspace(low, high, 8 * N_WEIGHTS + 1)
    least = _LEAST_BAND * (high - low)  # of a direction across the axis
    share = (edges - ends[:, :1]) / np.maximum(ends[:, 1:] - ends[:, :1], least)
    density = np.diff(np.clip(share, 0.0, 1.0).mean(axis=0))
    weights = density.reshape(N_WEIGHTS, 8).sum(axis=1)
    return SpatialSupport(low, high, weights / weights.max(), _response_width(
        0.5 * (edges[1:] + edges[:-1] - low - high), density / density.sum()))


def _response_width(frequencies: np.ndarray, density: np.ndarray) -> float:
    """Width at -3 dB of ``sum density exp(j 2 pi k x)``, metres."""
    extent = np.ptp(frequencies)

    def level(x: float) -> float:
        return np.abs(density @ np.exp(2j * np.pi * frequencies * x))

    near, far = 0.0, 0.25 / extent
    while level(far) ** 2 > 0.5:
        near, far = far, 1.25 * far
    for _ in range(40):  # bisection to the last digit
        middle = 0.5 * (near + far)
        near, far = (middle, far) if level(middle) ** 2 > 0.5 else (near, middle)
    return near + far


def centres(acquisition: Acquisition, points_m: np.ndarray, axis: np.ndarray) -> np.ndarray:
    """(S,) float64 middles of the supports of places along a direction, cycles per metre."""
    along = directions(thinned(acquisition), points_m) @ np.asarray(axis, np.float64)
    ends = np.multiply.outer(np.array(acquisition.wavenumbers_per_m), along)
    return 0.5 * (ends.min(axis=(0, 1)) + ends.max(axis=(0, 1)))


OVERSAMPLING = 1.5  # of the spatial band; the checker wants 1.1 to 2.2
_LEAST_QUARTERS = 8  # of a turn from row to row, below which rounding would change the spacing
UP = np.array([0.0, 0.0, 1.0])


def centre_of_aperture(acquisition: Acquisition) -> tuple[np.ndarray, np.ndarray]:
    """Place and velocity of the phase centre in the middle of the acquisition's time.

    Returns
    -------
    place_m : (3,) float64
        Metres.
    velocity_m_per_s : (3,) float64
        Metres per second; of length 0 where the radar does not move.
    """
    times = (acquisition.stamp_ns - acquisition.stamp_ns[0]) * 1e-9
    centre = acquisition.centre_m
    if acquisition.n_pulses < 2 or not times[-1] > 0:
        raise ValueError(f'the acquisition has {acquisition.n_pulses} pulses within '
                         f'{times[-1]:g} s; expected two or more at different times')
    order = min(4, acquisition.n_pulses - 1)
    fits = [np.polynomial.Polynomial.fit(times, centre[:, axis], order) for axis in range(3)]
    middle = times[-1] / 2
    return (np.array([fit(middle) for fit in fits]),
            np.array([fit.deriv()(middle) for fit in fits]))


def sicd_axes(acquisition: Acquisition, centre_m: ArrayLike, plane: str
              ) -> tuple[np.ndarray, np.ndarray]:
    """Unit vectors of rows and columns of an image about a place.

    Parameters
    ----------
    acquisition : Acquisition
        Where the radar was.
    centre_m : (3,) array_like
        Middle of the image, imaging frame, metres.
    plane : str
        ``'ground'``: horizontal, or ``'slant'``: through the line of sight and the velocity in
        the middle of the aperture.

    Returns
    -------
    row, column : (3,) float64
        Directions in which the number of the row and of the column grows: rows away from the
        radar, and their cross product upwards.

    Raises
    ------
    ValueError
        There is no such plane, or the geometry does not span it.
    """
    place, velocity = centre_of_aperture(acquisition)
    look = np.asarray(centre_m, np.float64) - place
    look /= np.linalg.norm(look)
    if plane == 'ground':
        normal = UP
    elif plane == 'slant':
        normal = np.cross(look, velocity)
        normal = normal * math.copysign(1.0, normal[2])
    else:
        raise ValueError(f'plane={plane!r}; expected "ground" or "slant"')
    length = np.linalg.norm(normal)
    if not length > 1e-6 * max(float(np.linalg.norm(velocity)), 1e-6):
        raise ValueError('the line of sight lies along the flight, or the radar does not move: '
                         'there is no slant plane; form the image on the ground plane')
    normal = normal / length
    row = look - (look @ normal) * normal
    if not np.linalg.norm(row) > 1e-3:
        raise ValueError('the radar looks straight down: no direction on the ground leads away '
                         'from it')
    row /= np.linalg.norm(row)
    return row, np.cross(normal, row)


def sicd_grid(acquisition: Acquisition, centre_m: ArrayLike, range_size_m: float,
              cross_size_m: float, *, plane: str = 'ground',
              spacing_m: tuple[float, float] | None = None) -> PlaneGrid:
    """Make a grid for an image that `write_sicd` writes without resampling.

    Rows run along range, away from the radar, so that shadows fall downward; columns run to the
    right as seen from above. The carrier turns by a whole number of quarter turns from row to
    row, so that taking it out and putting it back loses no bit.

    Parameters
    ----------
    acquisition : Acquisition
        Pulses of the image to come.
    centre_m : (3,) array_like
        Middle of the grid, imaging frame, metres.
    range_size_m, cross_size_m : float
        Size along range (rows) and across it (columns) on the plane, metres.
    plane : str
        ``'ground'``: horizontal at the height of the centre; ``'slant'``: through the line of
        sight and the velocity in the middle of the aperture.
    spacing_m : (2,) floats, optional
        Spacing of the rows and of the columns, metres; the first is made a little smaller for the
        quarter turns. From the resolution unless told: 1.5 samples for each width of the band.

    Returns
    -------
    PlaneGrid

    Raises
    ------
    ValueError
        The geometry spans no such plane, or a size is not positive.

    Examples
    --------
    >>> from sar_imaging.formats import Acquisition, sicd_grid
    >>> from sar_imaging.recordings import read_blocks
    >>> acquisition = Acquisition.of(read_blocks('bags/spotlight'))
    >>> grid = sicd_grid(acquisition, (0.0, 0.0, 0.0), range_size_m=40.0, cross_size_m=30.0)
    >>> down, right = (float((step @ step) ** 0.5) for step in grid.steps_m)
    >>> print(f'{grid.shape}: {down:.2f} m from row to row, {right:.2f} m between columns')
    (179, 246): 0.23 m from row to row, 0.12 m between columns
    """
    centre = np.asarray(centre_m, np.float64)
    for name, size in (('range_size_m', range_size_m), ('cross_size_m', cross_size_m)):
        if not (math.isfinite(size) and size > 0):
            raise ValueError(f'{name}={size}; expected a positive length in metres')
    row, column = sicd_axes(acquisition, centre, plane)
    if spacing_m is None:
        row_step, column_step = (
            1 / (OVERSAMPLING * support(acquisition, centre, axis).bandwidth)
            for axis in (row, column))
    else:
        row_step, column_step = spacing_m
    row_step = _whole_quarters(row_step, support(acquisition, centre, row).centre)
    n_rows, n_columns = (max(2, round(size / step) + 1)
                         for size, step in ((range_size_m, row_step),
                                            (cross_size_m, column_step)))
    origin = centre - (n_rows // 2) * row_step * row - (n_columns // 2) * column_step * column
    return PlaneGrid(tuple(origin), tuple(column_step * column), tuple(row_step * row),
                     n_columns, n_rows)


def _whole_quarters(step_m: float, centre: float) -> float:
    """The next smaller spacing from row to row of which the carrier makes whole quarter turns."""
    quarters = math.floor(4 * centre * step_m)
    return quarters / (4 * centre) if quarters >= _LEAST_QUARTERS else step_m
