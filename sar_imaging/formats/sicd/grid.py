"""The grid that SICD wants: rows along range, away from the radar, seen from above."""

from __future__ import annotations

import math

import numpy as np

from ...geometry.grids import PlaneGrid
from ..acquisition import Acquisition
from .spectrum import support

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


def sicd_axes(acquisition: Acquisition, centre_m,
              plane: str) -> tuple[np.ndarray, np.ndarray]:
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
    if not length > 1e-6 * max(np.linalg.norm(velocity), 1e-6):
        raise ValueError('the line of sight lies along the flight, or the radar does not move: '
                         'there is no slant plane; form the image on the ground plane')
    normal = normal / length
    row = look - (look @ normal) * normal
    if not np.linalg.norm(row) > 1e-3:
        raise ValueError('the radar looks straight down: no direction on the ground leads away '
                         'from it')
    row /= np.linalg.norm(row)
    return row, np.cross(normal, row)


def sicd_grid(acquisition: Acquisition, centre_m, range_size_m: float, cross_size_m: float, *,
              plane: str = 'ground', spacing_m: tuple[float, float] | None = None) -> PlaneGrid:
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
        Of the rows and of the columns, metres; the first is made a little smaller for the
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
    >>> from sar_imaging.tools.recordings import read_blocks
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
        spacing_m = tuple(1 / (OVERSAMPLING * support(acquisition, centre, axis).bandwidth)
                          for axis in (row, column))
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
