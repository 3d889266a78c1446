"""What of the map an aperture tells something about."""

from __future__ import annotations

import dataclasses

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from sar_imaging.configuration.scene_grid import Coverage
from sar_imaging.geometry.earth import Datum

from ....products.sources import Source
from ..job import Job
from ..prediction import surface_points
from ..windows import Window

_FINE, _COARSE = 257, 33  # places along either side: of the area, and at which coverage is asked
_EDGE = 1e-6  # of the sides of an area, within which a place is on its edge


class OutOfSightError(ValueError):
    """An aperture tells nothing about the map; the text says why."""


@dataclasses.dataclass(frozen=True)
class Footprint:
    """Part of the map.

    Attributes
    ----------
    corners_m : ((x, y), ...) floats
        In the map's frame, counter-clockwise, metres.
    window : Window
        Pixels around it.
    """

    corners_m: tuple[tuple[float, float], ...]
    window: Window


def moved(points_m: np.ndarray, own: Datum | None, wanted: Datum | None) -> np.ndarray:
    """(..., 3) points of one frame in another, metres; the same where either stands nowhere."""
    if own is None or wanted is None or own == wanted:
        return points_m
    return wanted.from_ecef(own.to_ecef(points_m))


def footprint(source: Source, coverage: Coverage, job: Job, *, alone: bool) -> Footprint:
    """Footprint of an aperture: the area that is told, as far as its pulses see it.

    - The area: that of the recording, within that of the job; where either tells none, the other.
    - Ranges: those that all its profiles cover.
    - Along the track, of a recording with several apertures: what is nearest to this one, as far
      as the distance between pulses is unambiguous.

    Parameters
    ----------
    source : Source
        The aperture.
    coverage : Coverage
        Of its range profiles, in the map's frame.
    job : Job
        With the map's frame.
    alone : bool
        Whether the recording has no other aperture.

    Raises
    ------
    OutOfSightError
        Nobody tells the area, or nothing of it is seen.
    """
    hull = _area(source, job)
    places = np.concatenate([hull, _raster(hull, _FINE)])
    places = places[_inside(places, hull)]
    whole = alone
    if job.area_m is not None:
        places, whole = _clipped(places, job.area_m), False
    if not alone:
        near = _nearest(places, coverage, job)
        places, whole = places[near], whole or bool(near.all())
    corners = hull if whole else _box(places)
    places = np.concatenate([corners, _raster(corners, _COARSE)])
    places = places[_inside(places, corners)]
    seen = coverage.covers(surface_points(job, places))
    if not seen.any():
        near, far = coverage.swath_m
        distance = np.linalg.norm(coverage.centres_m.mean(axis=(0, 1))
                                  - surface_points(job, places).mean(axis=0))
        raise OutOfSightError(
            f'no profile reaches its area: they cover {near:.0f} to {far:.0f} m, and it lies '
            f'{distance:.0f} m away; check height_m and area_m of the job, and the datum')
    if not seen.all():
        corners = _box(places[seen])
    return Footprint(tuple(map(tuple, corners.tolist())), Window.around(corners, job.spacing_m))


def _raster(hull: np.ndarray, n: int) -> np.ndarray:
    """(n * n, 2) places on the box around some corners."""
    low, high = hull.min(axis=0), hull.max(axis=0)
    axes = (np.linspace(a, b, n) for a, b in zip(low, high, strict=True))
    return np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)


def _area(source: Source, job: Job) -> np.ndarray:
    """(N, 2) corners of the area, counter-clockwise, metres of the map's frame."""
    if source.area_m is not None:
        points = moved(source.area_m, source.datum, job.datum)[:, :2]
        try:
            return points[ConvexHull(points).vertices]
        except (QhullError, ValueError) as error:
            raise OutOfSightError(
                'the area that it names is a line or a point; correct it in the recording, or '
                'leave it out') from error
    if job.area_m is None:
        raise OutOfSightError('it does not state where its scene is; add area_m to the job')
    return _box(np.array(job.area_m).reshape(2, 2))


def _box(points: np.ndarray) -> np.ndarray:
    (x0, y0), (x1, y1) = points.min(axis=0), points.max(axis=0)
    return np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)])


def _inside(points: np.ndarray, hull: np.ndarray) -> np.ndarray:
    """(N,) bool which points lie in a convex polygon, counter-clockwise."""
    edges = np.roll(hull, -1, axis=0) - hull
    offsets = points[:, None] - hull
    cross = edges[:, 0] * offsets[..., 1] - edges[:, 1] * offsets[..., 0]
    return (cross >= -_EDGE * np.ptp(hull, axis=0).max() ** 2).all(axis=1)


def _clipped(places: np.ndarray, area_m) -> np.ndarray:
    """Places within the job's area; those beyond its edges are moved onto them."""
    low, high = np.array(area_m[:2]), np.array(area_m[2:])
    if (places.max(axis=0) < low).any() or (places.min(axis=0) > high).any():
        raise OutOfSightError('it lies beyond the area_m of the job; enlarge that, or leave it '
                              'out')
    return np.clip(places, low, high)


def _nearest(places: np.ndarray, coverage: Coverage, job: Job) -> np.ndarray:
    """(N,) bool which places are abeam of the aperture, as far as they are unambiguous."""
    track = coverage.centres_m.mean(axis=1)
    along = (track[-1] - track[0])[:2]
    length = np.linalg.norm(along)
    if length == 0.0:
        return np.ones(len(places), bool)
    distance = (places - track.mean(axis=0)[:2]) @ (along / length)
    middle = surface_points(job, places[[np.abs(distance).argmin()]])[0]
    reach = coverage.unambiguous_m(middle) / 2
    inside = np.abs(distance) <= reach * (1 + _EDGE)
    # a spotlight looks ahead or behind: what it names is all unambiguous then
    return inside if inside.any() and np.ptp(distance) > 2 * reach else np.ones(len(places), bool)
