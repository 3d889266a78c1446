# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Simulate moving scatterers, with their exact positions at the times of the pulses."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable

import numpy as np
from numpy.typing import ArrayLike

from ..signal.radar import RadarParameters
from .echoes import EchoSimulator


@dataclasses.dataclass(frozen=True)
class Mover:
    """A point scatterer on a straight line at constant speed.

    Parameters
    ----------
    name : str
        For reports and figures.
    position_m : (3,) floats
        Place at time zero, which is the middle of the recording, imaging frame, metres.
    velocity_m_per_s : (3,) floats
        Velocity, imaging frame, metres per second.
    amplitude : complex
        Amplitude of its echo; 1 gives a compressed peak of 1.

    Raises
    ------
    ValueError
        A number is not finite, or there are not three of them.

    Examples
    --------
    >>> from sar_imaging.simulation import Mover
    >>> car = Mover('car', position_m=(100.0, 0.0, 0.0), velocity_m_per_s=(10.0, 5.0, 0.0))
    >>> car.positions([-1.0, 1.0]).tolist()
    [[90.0, -5.0, 0.0], [110.0, 5.0, 0.0]]
    >>> print(f'{car.radial_velocity_m_per_s((0.0, 0.0, 0.0)):.1f} m/s away from the radar')
    10.0 m/s away from the radar
    """

    name: str
    position_m: tuple[float, float, float]
    velocity_m_per_s: tuple[float, float, float]
    amplitude: complex = 1.0 + 0.0j

    def __post_init__(self) -> None:
        for field in ('position_m', 'velocity_m_per_s'):
            value = tuple(float(v) for v in getattr(self, field))
            if len(value) != 3 or not np.isfinite(value).all():
                raise ValueError(f'{field}={value} of mover {self.name!r}; expected three finite '
                                 'numbers')
            object.__setattr__(self, field, value)
        object.__setattr__(self, 'amplitude', complex(self.amplitude))
        if not np.isfinite(self.amplitude):
            raise ValueError(f'amplitude={self.amplitude} of mover {self.name!r} is not finite')

    def positions(self, time_s: ArrayLike) -> np.ndarray:
        """``(..., 3)`` float64 places at times ``(...)`` in seconds, metres."""
        time_s = np.asarray(time_s, float)[..., None]
        return np.array(self.position_m) + time_s * np.array(self.velocity_m_per_s)

    def radial_velocity_m_per_s(self, centre_m: ArrayLike) -> float:
        """Range rate at time zero seen from a place at rest, positive away from it, m/s."""
        sight = np.array(self.position_m) - np.asarray(centre_m, float)
        return float(sight @ np.array(self.velocity_m_per_s) / np.linalg.norm(sight))


def mover_echoes(movers: Iterable[Mover], radar: RadarParameters, n_samples: int, *,
                 compressed: bool, tx_m: np.ndarray, rx_m: np.ndarray,
                 time_s: np.ndarray) -> np.ndarray:
    """Echoes of movers, which stand still while a pulse travels (stop and go).

    A mover at ``x_0 + v t`` has the same distances to the phase centres as a scatterer at rest at
    ``x_0`` to phase centres moved by ``-v t``, so that the echoes are as exact as those of
    `EchoSimulator`. The time a pulse travels, some microseconds, is left out: it displaces a car
    by a tenth of a millimetre, alike in all channels and pulses.

    Parameters
    ----------
    movers : iterable of Mover
        What moves.
    radar : RadarParameters
        Radar parameters of the samples to make.
    n_samples : int
        Fast-time samples per pulse and channel.
    compressed : bool
        True for range profiles.
    tx_m, rx_m : (P, C, 3) float64
        Phase centres, metres.
    time_s : (P,) float64
        Times of the pulses from the middle of the recording, seconds.

    Returns
    -------
    (P, C, N) complex128

    Raises
    ------
    ValueError
        A mover lies outside the record.
    """
    out = np.zeros((*np.shape(tx_m)[:2], n_samples), complex)
    time_s = np.asarray(time_s, float)[:, None, None]
    for mover in movers:
        simulator = EchoSimulator(radar, n_samples, compressed=compressed,
                                  points_m=np.array([mover.position_m]),
                                  amplitudes=np.array([mover.amplitude]))
        moved = time_s * np.array(mover.velocity_m_per_s)
        out += simulator(tx_m - moved, rx_m - moved)
    return out
