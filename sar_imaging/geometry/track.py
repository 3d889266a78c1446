# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Track of phase centres: its frame, whether it is straight, and how it continues."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

_LEAST_LENGTH = 1e-12  # metres
_LEAST_EXTENT = 1e-6  # of the distance to the scene: a shorter track has no direction


def mean_centres(tx_m: ArrayLike, rx_m: ArrayLike) -> np.ndarray:
    """(P, 3) float64 mean of all phase centres (P, C, 3) of each pulse, metres."""
    return 0.5 * (np.asarray(tx_m) + rx_m).mean(axis=1)


def unit_vector(vector: ArrayLike) -> np.ndarray:
    """(D,) float64 vector of length one, or of none where it has none."""
    vector = np.asarray(vector, np.float64)
    return vector / max(math.hypot(*vector), _LEAST_LENGTH)


def plane_rotation(angle_rad: float) -> np.ndarray:
    """(2, 2) float64 matrix of a rotation in the plane, counter-clockwise, radians."""
    cosine, sine = math.cos(angle_rad), math.sin(angle_rad)
    return np.array([[cosine, -sine], [sine, cosine]])


def main_axis(places_m: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Axes of places, (K, D), by their extent, and the extents, metres.

    Returns
    -------
    axes : (min(K, D), D) float64
        Unit vectors, the longest extent first; their signs are arbitrary.
    extents : (min(K, D),) float64
        Root of the sum of squares along each, metres.
    """
    places_m = np.asarray(places_m, np.float64)
    _, extents, axes = np.linalg.svd(places_m - places_m.mean(axis=0), full_matrices=False)
    return axes, extents


def track_beside(centres_m: np.ndarray, scene_m: ArrayLike) -> tuple[np.ndarray, int]:
    """Horizontal direction of a track and the side on which a scene lies.

    Parameters
    ----------
    centres_m : (P, 3) float64
        Phase centres, metres.
    scene_m : (2,) or (3,) array_like
        Middle of the scene, metres.

    Returns
    -------
    track : (2,) float64
        Unit vector; broadside to the scene where the track is a point or runs straight up.
    side : int
        +1 where the scene is to the left of it, -1 to the right.
    """
    look = np.asarray(scene_m, np.float64)[:2] - centres_m.mean(axis=0)[:2]
    distance = max(math.hypot(*look), 1e-9)
    axes, extents = main_axis(centres_m[:, :2])
    track = axes[0]
    if extents[0] <= _LEAST_EXTENT * distance:
        track = np.array([-look[1], look[0]]) / distance
    return track, side_of(track, look)


def side_of(track: Sequence[float] | np.ndarray, look: Sequence[float] | np.ndarray) -> int:
    """+1 where a horizontal look is to the left of a track, -1 to the right."""
    return 1 if track[0] * look[1] - track[1] * look[0] >= 0 else -1


@dataclasses.dataclass(frozen=True)
class StraightTrack:
    """Evenly spaced positions on a line, the same for all channels but for an offset along it.

    Pulse m of channel n stands ``u = (m - (P - 1) / 2) spacing + offset_n`` along the line: the
    slow-time variable u and half the antenna offset, ``0.5 d_n``, of Rosenberg & Gray, equation 3.

    Parameters
    ----------
    origin_m : (3,) float64
        Point of the line with u = 0, imaging frame, metres.
    direction : (3,) float64
        Unit vector of the flight direction, imaging frame.
    spacing_m : float
        Distance from pulse to pulse, metres.
    n_pulses : int
        Number of pulses P.
    offsets_m : (C,) float64
        Offsets of each channel along the line, mean zero, metres.
    """

    origin_m: np.ndarray
    direction: np.ndarray
    spacing_m: float
    n_pulses: int
    offsets_m: np.ndarray

    @property
    def first_m(self) -> float:
        """Position of the first pulse along the line, without a channel's offset, metres."""
        return -0.5 * (self.n_pulses - 1) * self.spacing_m

    @property
    def along_m(self) -> np.ndarray:
        """(P, C) float64 positions along the line, metres."""
        pulse = self.first_m + np.arange(self.n_pulses) * self.spacing_m
        return pulse[:, None] + self.offsets_m

    def coordinates(self, points_m: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
        """Position along the line and distance from it.

        These are y and x of the paper's slant plane, for points in any plane.

        Parameters
        ----------
        points_m : (..., 3) float64
            Points, imaging frame, metres.

        Returns
        -------
        along_m, distance_m : (...) float64
            Metres.
        """
        offset = np.asarray(points_m, float) - self.origin_m
        along = offset @ self.direction
        return along, np.linalg.norm(offset - along[..., None] * self.direction, axis=-1)


def fit_straight_track(tx_m: np.ndarray, rx_m: np.ndarray) -> StraightTrack:
    """Fit the midpoints between transmitter and receiver in the least-squares sense.

    Parameters
    ----------
    tx_m, rx_m : (P, C, 3) float64
        Phase centres in the order of the pulses, imaging frame, metres.

    Returns
    -------
    StraightTrack

    Raises
    ------
    ValueError
        There are fewer than two pulses, or the platform does not move.
    """
    midpoints = 0.5 * (tx_m + rx_m)
    n = len(midpoints)
    if n < 2:
        raise ValueError(f'{n} pulses make no track; expected at least two')
    centres = midpoints.mean(axis=1)
    origin = centres.mean(axis=0)
    pulse = np.arange(n) - (n - 1) / 2
    step = pulse @ (centres - origin) / (pulse @ pulse)
    spacing = float(np.linalg.norm(step))
    if spacing <= 1e-9 * max(1.0, float(np.abs(origin).max())):
        raise ValueError(f'the phase centres move by {spacing:.3g} m from pulse to pulse; '
                         'expected a moving platform')
    direction = step / spacing
    offsets = (midpoints - centres[:, None]).mean(axis=0) @ direction
    return StraightTrack(origin, direction, spacing, n, offsets)


def check_straight(track: StraightTrack, tx_m: np.ndarray, rx_m: np.ndarray, points_m: np.ndarray,
                   *, wavelength_m: float, tolerance_wavelengths: float) -> None:
    """Refuse phase centres that the fitted track describes badly, and say where they are off.

    What counts is the two-way path to the points. It differs where a phase centre is off the
    line, off its place along the line, or transmitter and receiver stand too far apart for their
    midpoint to stand for both (the approximation of Rosenberg & Gray, equation 3).

    Parameters
    ----------
    track : StraightTrack
        Fitted to the phase centres.
    tx_m, rx_m : (P, C, 3) float64
        Phase centres, imaging frame, metres.
    points_m : (S, 3) float64
        Points to compare the paths to, imaging frame, metres.
    wavelength_m : float
        Metres.
    tolerance_wavelengths : float
        Largest allowed error of the two-way path; one wavelength is 360 degrees of phase.

    Raises
    ------
    ValueError
        A path is wrong by more than the tolerance.
    """
    u = track.along_m[..., None]
    error = np.abs(path_errors(track, tx_m, rx_m, points_m)).max(axis=-1) / wavelength_m
    if error.max() <= tolerance_wavelengths:
        return
    m, n = np.unravel_index(error.argmax(), error.shape)
    midpoints = 0.5 * (np.asarray(tx_m) + rx_m)
    along, across = track.coordinates(midpoints[m, n])
    steps = np.linalg.norm(np.diff(midpoints.mean(axis=1), axis=0), axis=-1)
    apart = np.linalg.norm(np.subtract(tx_m, rx_m)[m, n])
    raise ValueError(
        f'the track is not straight and evenly spaced: pulse {m}, channel {n} is {across:.4g} m '
        f'({across / wavelength_m:.3g} wavelengths) off the best-fit line and '
        f'{along - u[m, n, 0]:.4g} m off its place along it; steps between pulses are '
        f'{steps.min():.6g} to {steps.max():.6g} m; transmitter and receiver are {apart:.4g} m '
        f'apart. The two-way path to the grid is wrong by {error[m, n]:.3g} wavelengths, allowed '
        f'are {tolerance_wavelengths:.3g}; use backprojection for this track')


def path_errors(track: StraightTrack, tx_m: np.ndarray, rx_m: np.ndarray, points_m: np.ndarray
                ) -> np.ndarray:
    """(P, C, S) float64 two-way paths less those from the fitted track, metres.

    Parameters
    ----------
    track, tx_m, rx_m, points_m :
        As for `check_straight`.
    """
    along, distance = track.coordinates(points_m)
    exact = sum(np.linalg.norm(np.asarray(a)[:, :, None] - points_m, axis=-1)
                for a in (tx_m, rx_m))
    return exact - 2 * np.hypot(distance, along - track.along_m[..., None])


_LEAST_FOR_CURVE = 8  # pulses
_SHARE_FOR_CURVE = 0.25  # of the wanted length that must be known to tell a curve from noise
_PATTERN = 16  # pulses in which antennas that take turns come round


def predict_track(known: Any, tx_m: np.ndarray, rx_m: np.ndarray, wanted: np.ndarray
                  ) -> tuple[np.ndarray, np.ndarray]:
    """Carry phase centres on, from some pulses to others.

    A line, or a parabola once enough is known, through each coordinate of the latest pulses; what
    it leaves over, such as vibration or antennas that take turns, is repeated.

    Parameters
    ----------
    known : (K,) int array
        Numbers of the known pulses, ascending.
    tx_m, rx_m : (K, C, 3) float64
        Their phase centres, metres.
    wanted : (W,) int array
        Numbers of the wanted pulses.

    Returns
    -------
    tx_m, rx_m : (W, C, 3) float64
        Metres; of known pulses as given.

    Raises
    ------
    ValueError
        Nothing is known.
    """
    known, wanted = np.asarray(known, np.int64), np.asarray(wanted, np.int64)
    if not len(known):
        raise ValueError('no phase centre is known; expected at least that of one pulse')
    values = np.concatenate([np.asarray(a, float).reshape(len(known), -1) for a in (tx_m, rx_m)],
                            axis=1)
    _, at, source = np.intersect1d(wanted, known, assume_unique=True, return_indices=True)
    given = values[source]
    latest = known > known[-1] - len(wanted)
    known, values = known[latest], values[latest]
    origin, span = known[-1], max(int(np.ptp(known)), 1)
    basis = _basis((known - origin) / span, _order(known, wanted))
    coefficients = np.linalg.lstsq(basis, values, rcond=None)[0]
    left = values - basis @ coefficients
    # the residual of the pulse a whole number of patterns before
    count = span + 1
    period = count // _PATTERN * _PATTERN or count
    like = known[0] + count - period + (wanted - known[0] - count) % period
    near = np.clip(np.searchsorted(known, like), 0, len(known) - 1)
    result = (_basis((wanted - origin) / span, basis.shape[1] - 1) @ coefficients) + left[near]
    result[at] = given
    shape = (2, len(wanted), *np.shape(tx_m)[1:])
    half = result.shape[1] // 2
    return tuple(np.stack([result[:, :half], result[:, half:]]).reshape(shape))


def _order(known: Any, wanted: np.ndarray) -> int:
    if len(known) == 1:
        return 0
    enough = np.ptp(known) >= _SHARE_FOR_CURVE * np.ptp(wanted)
    return 2 if enough and len(known) >= _LEAST_FOR_CURVE else 1


def _basis(t: np.ndarray, order: int) -> np.ndarray:
    return np.asarray(t, float)[:, None] ** np.arange(order + 1)
