# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Scenes made of point scatterers."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Sequence

import numpy as np


@dataclasses.dataclass(frozen=True)
class Scatterer:
    """A point that returns the pulse from everywhere with the same complex amplitude.

    Parameters
    ----------
    name : str
        For reports and figures.
    position_m : tuple of 3 floats
        Place in the imaging frame, metres.
    amplitude : complex
        Amplitude of its echo; 1 gives a compressed peak of 1.

    Raises
    ------
    ValueError
        A number is not finite, or the position has not three of them.

    Examples
    --------
    >>> from sar_imaging.simulation import Scatterer
    >>> post = Scatterer('gate post', position_m=(12.0, 3.5, 0.0), amplitude=0.1j)
    >>> print(f'{post.name}: {post.amplitude_db:.0f} dB')
    gate post: -20 dB
    """

    name: str
    position_m: tuple[float, float, float]
    amplitude: complex = 1.0 + 0.0j

    def __post_init__(self) -> None:
        object.__setattr__(self, 'position_m', tuple(float(v) for v in self.position_m))
        object.__setattr__(self, 'amplitude', complex(self.amplitude))
        if len(self.position_m) != 3 or not np.isfinite(self.position_m).all():
            raise ValueError(f'position_m={self.position_m} of scatterer {self.name!r}; '
                             'expected three finite numbers')
        if not np.isfinite(self.amplitude):
            raise ValueError(f'amplitude={self.amplitude} of scatterer {self.name!r} is not '
                             'finite')

    @property
    def amplitude_db(self) -> float:
        """Amplitude relative to one, dB."""
        if self.amplitude == 0:
            return -math.inf
        return 20.0 * math.log10(abs(self.amplitude))


@dataclasses.dataclass(frozen=True, eq=False)
class Clutter:
    """Many scatterers without names, whose phases are random.

    Parameters
    ----------
    positions_m : (S, 3) float64
        Places in the imaging frame, metres.
    amplitudes : (S,) complex128
        Amplitudes of their echoes; 1 gives a compressed peak of 1.

    Raises
    ------
    ValueError
        The shapes do not fit, or a number is not finite.
    """

    positions_m: np.ndarray
    amplitudes: np.ndarray

    def __post_init__(self) -> None:
        if self.positions_m.shape != (self.amplitudes.size, 3):
            raise ValueError(f'positions_m.shape={self.positions_m.shape} does not fit '
                             f'{self.amplitudes.size} amplitudes; expected three numbers each')
        if not (np.isfinite(self.positions_m).all() and np.isfinite(self.amplitudes).all()):
            raise ValueError('clutter has positions or amplitudes that are not finite')

    @property
    def std(self) -> float:
        """Standard deviation of the sum of all echoes."""
        return float(np.sqrt((np.abs(self.amplitudes) ** 2).sum()))


def positions_and_amplitudes(scatterers: Iterable[Scatterer]
                             ) -> tuple[np.ndarray, np.ndarray]:
    """``(S, 3)`` float64 positions in metres and ``(S,)`` complex128 amplitudes."""
    positions = np.array([s.position_m for s in scatterers], float).reshape(-1, 3)
    return positions, np.array([s.amplitude for s in scatterers], complex)


def letter_s(centre_m: Sequence[float], *, width_m: float = 5.0, height_m: float = 36.0,
             spacing_m: float = 0.5) -> list[Scatterer]:
    """Letter 'S' of unit scatterers: x is its width, y its height, in one horizontal plane.

    Two arcs of three quarters of an ellipse each, joined in the middle. The points are equally
    spaced in the angle of the ellipse, so that a letter stretched in azimuth, where the
    resolution is coarser, needs no more of them.

    Parameters
    ----------
    centre_m : (3,) floats
        Middle of the letter, metres.
    width_m, height_m : float
        Size along x and y, metres.
    spacing_m : float
        Distance of neighbouring scatterers where the stroke runs along x, metres.

    Returns
    -------
    list of Scatterer
        Named ``s00``, ``s01`` and so on, from the upper end of the stroke to the lower one.
    """
    radius_x, radius_y = width_m / 2, height_m / 4
    per_arc = max(2, round(1.5 * math.pi * radius_x / spacing_m))
    angles = np.radians(np.linspace(0.0, 270.0, per_arc, endpoint=False))
    upper = np.stack([radius_x * np.cos(angles), radius_y * (1 + np.sin(angles))], axis=1)
    # The letter is symmetric under half a turn about its middle, where the arcs meet.
    points = np.concatenate([upper, [[0.0, 0.0]], -upper[::-1]])
    return [Scatterer(f's{i:02d}', (centre_m[0] + x, centre_m[1] + y, centre_m[2]))
            for i, (x, y) in enumerate(points)]
