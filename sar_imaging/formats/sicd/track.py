# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Tracks as SICD has them: polynomials of time in Earth-centred coordinates."""

from __future__ import annotations

import dataclasses
import datetime

import numpy as np
from numpy.typing import ArrayLike

from ...geometry.earth import Datum
from ...signal.radar import SPEED_OF_LIGHT
from ..acquisition import EPOCH, Acquisition, date_of

_WANTED_M = 1e-4  # residual at which a higher order is not worth its coefficients
_HIGHEST_ORDER = 9
_MICROSECOND = 1000  # nanoseconds: dates in XML are exact to it
BISTATIC_RAD = np.radians(1.0)  # between transmitter and receiver, seen from the scene


@dataclasses.dataclass(frozen=True, eq=False)
class Track:
    """Polynomials of an acquisition.

    Attributes
    ----------
    start : datetime.datetime
        Beginning of the collection, UTC, a whole microsecond.
    pulse_s : (P,) float64
        Times of transmission since then, seconds.
    duration_s : float
        From the start to one pulse interval after the last pulse.
    middle_s : float
        Centre of aperture, since the start.
    arp, tx, rx : (3, n) float64
        Coefficients in ECEF, metres, by rising power of seconds since the start: middle between
        the phase centres, by the time at which the pulse meets the scene, transmitter by the
        time of transmission, receiver by that of reception.
    residual_m : float
        Largest distance of a phase centre from its polynomial.
    bistatic : bool
        Whether transmitter and receiver stand apart, as seen from the scene.
    """

    start: datetime.datetime
    pulse_s: np.ndarray
    duration_s: float
    middle_s: float
    arp: np.ndarray
    tx: np.ndarray
    rx: np.ndarray
    residual_m: float
    bistatic: bool


def fit_track(acquisition: Acquisition, datum: Datum, scene_m: ArrayLike) -> Track:
    """Fit polynomials of the lowest order that leaves 0.1 mm, or of order 9.

    Parameters
    ----------
    acquisition : Acquisition
        Two pulses or more.
    datum : Datum
        Datum of its frame.
    scene_m : (3,) array_like
        Middle of the image, imaging frame, metres.

    Raises
    ------
    ValueError
        All pulses were sent at one time, or the radar does not move.
    """
    first, last = int(acquisition.stamp_ns[0]), int(acquisition.stamp_ns[-1])
    if not last > first:
        raise ValueError(f'all {acquisition.n_pulses} pulses were sent at {first} ns; SICD needs '
                         'pulses at two times or more')
    start_ns = first - first % _MICROSECOND
    pulse_s = (acquisition.stamp_ns - start_ns) * 1e-9
    interval_s = (last - first) * 1e-9 / (acquisition.n_pulses - 1)
    out, back = (np.linalg.norm(centre - np.asarray(scene_m), axis=1) / SPEED_OF_LIGHT
                 for centre in (acquisition.tx_m, acquisition.rx_m))
    scene_s = pulse_s + out
    fits = [_fit(times, datum.to_ecef(places)) for times, places in (
        (scene_s, acquisition.centre_m), (pulse_s, acquisition.tx_m),
        (scene_s + back, acquisition.rx_m))]
    bistatic = _bistatic_angle(acquisition, scene_m) > BISTATIC_RAD
    used = fits if bistatic else fits[:1]
    middle_s = 0.5 * (scene_s[0] + scene_s[-1])
    speed = np.linalg.norm(evaluate(np.polynomial.polynomial.polyder(fits[0][0], axis=1),
                                    middle_s))
    if not speed * (last - first) * 1e-9 > 1e-6:
        raise ValueError('the radar does not move: SICD describes images by the direction of '
                         'flight; write a GeoTIFF')
    arp, tx, rx = (fit for fit, _ in fits)
    return Track(date_of(start_ns), pulse_s, pulse_s[-1] + interval_s, float(middle_s),
                 arp, tx, rx, max(error for _, error in used), bool(bistatic))


def evaluate(coefficients: np.ndarray, times_s: ArrayLike) -> np.ndarray:
    """(..., 3) positions of a polynomial (3, n) at times, seconds."""
    values = np.polynomial.polynomial.polyval(np.asarray(times_s, np.float64), coefficients.T)
    return np.moveaxis(np.asarray(values), 0, -1)


def stamp_of(start: datetime.datetime, seconds: ArrayLike) -> np.ndarray:
    """int64 nanoseconds since 1970 of times since a date."""
    since = start - EPOCH
    whole = (since.days * 86400 + since.seconds) * 10**9 + since.microseconds * 1000
    return whole + np.rint(np.asarray(seconds) * 1e9).astype(np.int64)


def _fit(times_s: np.ndarray, places_m: np.ndarray) -> tuple[np.ndarray, float]:
    """Coefficients (3, n) by power of the time and the largest distance that is left."""
    for order in range(1, min(_HIGHEST_ORDER, len(times_s) - 1) + 1):
        fit = np.stack([_coefficients(times_s, places_m[:, axis], order) for axis in range(3)])
        error = float(np.linalg.norm(evaluate(fit, times_s) - places_m, axis=1).max())
        if error <= _WANTED_M:
            break
    return fit, error


def _coefficients(times_s: np.ndarray, values: np.ndarray, order: int) -> np.ndarray:
    """(order + 1,) coefficients of a fit over its own interval, expanded about time 0."""
    series = np.polynomial.Polynomial.fit(times_s, values, order).convert().coef
    return np.pad(series, (0, order + 1 - len(series)))


def _bistatic_angle(acquisition: Acquisition, scene_m: ArrayLike) -> float:
    """Largest angle between transmitter and receiver, radians, as seen from the scene."""
    to_tx, to_rx = (centre - np.asarray(scene_m) for centre in (acquisition.tx_m,
                                                                acquisition.rx_m))
    sine = np.linalg.norm(np.cross(to_tx, to_rx), axis=1)
    return float(np.arctan2(sine, (to_tx * to_rx).sum(axis=1)).max())
