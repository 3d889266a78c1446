"""Where a frame stands on the Earth, from places that are known in it and on the Earth."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from ..earth import Datum, ecef_to_geographic

_LARGEST_FRAME_M = 200e3  # from the origin; frames that go further are no tangent planes
_FEWEST = 3  # fixes that tell a heading: two would agree with any pair of places alike
_KEPT_SHARE = 1 / 50  # of the baseline: from one pair that is kept to the next
_DISAGREEMENT = 0.1  # of the baseline, or three standard deviations: more is a contradiction
_STEPS = 20
_ENOUGH_M = 1e-9


@dataclasses.dataclass(frozen=True)
class FoundDatum:
    """A datum that follows from fixes.

    Parameters
    ----------
    datum : Datum
        Of the frame.
    n_fixes : int
        Fixes that it is made of.
    residual_m : float
        Root mean square distance between fixes and places, metres; NaN for one fix.
    heading_std_deg : float
        How well the heading is known, degrees: what fixes that are wrong by their standard
        deviation, or by the residual, mean over the baseline. NaN where the heading was given.

    Examples
    --------
    >>> from sar_imaging.geometry.navigation import DatumSearch, Fix
    >>> found = DatumSearch(heading_deg=0.0).add(Fix(0, 47.0, 8.0, 450.0).ecef_m, (0.0, 0.0, 0.0))
    >>> print(f'{found.datum.latitude_deg:.4f}, {found.datum.longitude_deg:.4f}, '
    ...       f'{found.n_fixes} fix')
    47.0000, 8.0000, 1 fix
    """

    datum: Datum
    n_fixes: int
    residual_m: float = math.nan
    heading_std_deg: float = math.nan


def datum_through(ecef_m, place_m, heading_deg: float) -> Datum:
    """Datum of a frame with a known heading in which a place on the Earth is known.

    Parameters
    ----------
    ecef_m : (3,) array_like
        The place on the Earth, metres.
    place_m : (3,) array_like
        The same place in the frame, metres.
    heading_deg : float
        Bearing of the frame's y axis at its origin, degrees clockwise from north.

    Returns
    -------
    Datum
        WGS 84, degrees and metres.

    Raises
    ------
    ValueError
        The place is so far from the origin that the frame can be no tangent plane.

    Examples
    --------
    >>> from sar_imaging.geometry.navigation import Fix, datum_through
    >>> antenna = Fix(0, 47.0, 8.0, 450.0).ecef_m
    >>> datum = datum_through(antenna, (100.0, 0.0, 2.0), heading_deg=0.0)
    >>> print(f'{datum.latitude_deg:.5f}, {datum.longitude_deg:.5f}, {datum.height_m:.2f} m')
    47.00000, 7.99869, 448.00 m
    """
    ecef_m, place_m = np.asarray(ecef_m, np.float64), np.asarray(place_m, np.float64)
    _check_extent(place_m)
    datum = _at(ecef_m, heading_deg)
    for _ in range(_STEPS):  # contracts by the angle at the Earth's centre, 1/30 or less
        off = ecef_m - datum.to_ecef(place_m)
        datum = _at(datum.origin_ecef_m + off, heading_deg)
        if np.linalg.norm(off) < _ENOUGH_M:
            break
    return datum


class DatumSearch:
    """Find the datum of a frame while its platform moves.

    With a given heading one fix tells the datum. Without, places at least `baseline_m` apart do:
    the turn and the shift about the vertical that bring the fixes closest to the places (least
    squares; Umeyama 1991 in two dimensions, without scale), repeated with the datum found until
    the curvature of the Earth is in it.

    Parameters
    ----------
    heading_deg : float
        Bearing of the frame's y axis, degrees clockwise from north; of no meaning with a baseline.
    baseline_m : float
        Least horizontal distance between the places that tell the heading, metres; 0 where it is
        given.

    Attributes
    ----------
    reason : str
        Why there is no datum yet.

    Examples
    --------
    >>> from sar_imaging.geometry import Datum
    >>> from sar_imaging.geometry.navigation import DatumSearch
    >>> truth = Datum(47.0, 8.0, 450.0, heading_deg=30.0)
    >>> search = DatumSearch(baseline_m=20.0)
    >>> for x in (0.0, 25.0, 50.0):  # the platform drives along the frame's x
    ...     found = search.add(truth.to_ecef([x, 0.0, 0.0]), (x, 0.0, 0.0))
    ...     if found is None:
    ...         print(search.reason)
    1 good fixes at places up to 0 m apart; the heading needs 3 and 20 m
    2 good fixes at places up to 25 m apart; the heading needs 3 and 20 m
    >>> print(f'heading {found.datum.heading_deg:.3f} degrees')
    heading 30.000 degrees
    """

    def __init__(self, heading_deg: float = 0.0, baseline_m: float = 0.0):
        self._heading_deg, self._baseline_m = heading_deg, baseline_m
        self._begin('no good fix yet')

    def add(self, ecef_m, place_m, std_m: float = math.nan) -> FoundDatum | None:
        """Add a place that is known on the Earth and in the frame.

        Parameters
        ----------
        ecef_m, place_m : (3,) array_like
            Earth-centred, and in the frame; metres.
        std_m : float
            Standard deviation of the former, metres; NaN where nobody tells.

        Returns
        -------
        FoundDatum or None
            None where more is needed; `reason` says what.

        Raises
        ------
        ValueError
            The places contradict the fixes; those so far are forgotten.
        """
        ecef_m, place_m = np.asarray(ecef_m, np.float64), np.asarray(place_m, np.float64)
        if not self._baseline_m:
            return FoundDatum(datum_through(ecef_m, place_m, self._heading_deg), 1)
        _check_extent(place_m)
        if self._place_m and (math.dist(place_m[:2], self._place_m[-1][:2])
                              < _KEPT_SHARE * self._baseline_m):
            return None  # standing still tells nothing new
        self._ecef_m.append(ecef_m)
        self._place_m.append(place_m)
        self._std_m.append(std_m)
        first = self._place_m[0]
        way_m = max(math.dist(place[:2], first[:2]) for place in self._place_m)
        if way_m < self._baseline_m or len(self._place_m) < _FEWEST:
            self.reason = (f'{len(self._place_m)} good fixes at places up to {way_m:.3g} m apart; '
                           f'the heading needs {_FEWEST} and {self._baseline_m:g} m')
            return None
        return self._fit(way_m)

    def _begin(self, reason: str) -> None:
        self._ecef_m: list[np.ndarray] = []
        self._place_m: list[np.ndarray] = []
        self._std_m: list[float] = []
        self.reason = reason

    def _fit(self, way_m: float) -> FoundDatum:
        ecef_m, place_m = np.array(self._ecef_m), np.array(self._place_m)
        datum = _fitted(ecef_m, place_m)
        off_m = datum.from_ecef(ecef_m) - place_m
        residual_m = math.sqrt(np.mean(np.sum(off_m**2, axis=1)))
        known = [std for std in self._std_m if math.isfinite(std)]
        std_m = max(known, default=0.0)
        if residual_m > max(_DISAGREEMENT * way_m, 3 * std_m):
            self._begin('fixes and poses contradict each other')
            raise ValueError(f'{len(place_m)} fixes and the poses at their times differ by '
                             f'{residual_m:.3g} m over {way_m:.3g} m of way, whatever the '
                             'heading: is z of the frame up, and are their clocks the same?')
        return FoundDatum(datum, len(place_m), residual_m,
                          math.degrees(max(residual_m, std_m) / way_m))


def _fitted(ecef_m: np.ndarray, place_m: np.ndarray) -> Datum:
    """Datum whose frame has (N, 3) points of the Earth closest to their places in it."""
    datum = _at(ecef_m[0], 0.0)
    middle = place_m.mean(axis=0)
    for _ in range(_STEPS):
        found = datum.from_ecef(ecef_m)
        centre = found.mean(axis=0)
        a, b = (found - centre)[:, :2], (place_m - middle)[:, :2]
        turn = math.atan2(np.sum(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]), np.sum(a * b))
        cosine, sine = math.cos(turn), math.sin(turn)
        back = np.array([[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]])
        shift = centre - back @ middle  # of the origin, along the axes so far
        heading = math.remainder(datum.heading_deg + math.degrees(turn), 360.0)
        datum = _at(datum.to_ecef(shift), heading)
        if np.linalg.norm(shift) < _ENOUGH_M and abs(turn) < 1e-12:
            break
    return datum


def _at(ecef_m: np.ndarray, heading_deg: float) -> Datum:
    return Datum(*(float(v) for v in ecef_to_geographic(ecef_m)), heading_deg=heading_deg)


def _check_extent(place_m: np.ndarray) -> None:
    far_m = float(np.linalg.norm(place_m))
    if not far_m <= _LARGEST_FRAME_M:
        raise ValueError(f'the platform is {far_m / 1e3:.4g} km from the origin of its frame; '
                         f'expected a local frame, at most {_LARGEST_FRAME_M / 1e3:g} km: map '
                         'projections such as UTM and Earth-centred frames have no datum')
