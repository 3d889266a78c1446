# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Platform positions at the pulses: a straight track with perturbations, or a raster."""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import ArrayLike

from .noise import gaussian

POSITION_STEP_M = 2.0**-20  # about one micrometre


@dataclasses.dataclass(frozen=True)
class Vibration:
    """Sinusoidal motion added to the track.

    Parameters
    ----------
    amplitude_m : (3,) floats
        Amplitude along x, y, z, metres.
    frequency_hz : float
        Frequency, hertz.
    phase_cycles : float
        Phase at time zero, cycles.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging.simulation import Trajectory, Vibration
    >>> rotor = Vibration(amplitude_m=(0.0, 0.0, 0.002), frequency_hz=50.0, phase_cycles=0.25)
    >>> flight = Trajectory((0.0, 0.0, 50.0), (0.0, 8.0, 0.0), vibrations=(rotor,))
    >>> [round(z, 3) for z in flight.positions(np.array([0.0, 0.01]))[:, 2].tolist()]
    [50.002, 49.998]
    """

    amplitude_m: tuple[float, float, float]
    frequency_hz: float
    phase_cycles: float = 0.0


@dataclasses.dataclass(frozen=True)
class Trajectory:
    """Track of the platform's reference point; time zero is the middle of the recording.

    Position at time t: ``centre + velocity t + sum_k polynomial[k] t^(k+2) + vibrations +
    broadband``. Positions are rounded to 2^-20 m, as a navigation system would report them: what
    echoes are computed from is exactly what the recording states.

    Parameters
    ----------
    centre_m : (3,) floats
        Position at time zero, metres.
    velocity_m_per_s : (3,) floats
        Mean velocity, metres per second.
    polynomial : tuple of (3,) floats
        Coefficients of t^2, t^3, ... along x, y, z: m/s^2, m/s^3, ...
    vibrations : tuple of Vibration
        Sinusoids, such as a phugoid or a rotor.
    broadband_m : (3,) floats
        Standard deviation of noise that is independent from pulse to pulse, metres.
    seed : int
        Seed of the broadband noise.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging.simulation import Trajectory
    >>> flight = Trajectory(centre_m=(0.0, 0.0, 50.0), velocity_m_per_s=(0.0, 8.0, 0.0),
    ...                     polynomial=((0.25, 0.0, 0.0),))  # 0.5 m/s^2 sideways
    >>> flight.positions(np.array([-2.0, 0.0, 2.0])).tolist()
    [[1.0, -16.0, 50.0], [0.0, 0.0, 50.0], [1.0, 16.0, 50.0]]
    """

    centre_m: tuple[float, float, float]
    velocity_m_per_s: tuple[float, float, float]
    polynomial: tuple[tuple[float, float, float], ...] = ()
    vibrations: tuple[Vibration, ...] = ()
    broadband_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    seed: int = 0

    def positions(self, time_s: ArrayLike) -> np.ndarray:
        """Positions at the times of all pulses.

        Parameters
        ----------
        time_s : (P,) array_like, float64
            Times from the middle of the recording, seconds. The broadband noise belongs to the
            index of a pulse, so pass the whole recording and select from the result.

        Returns
        -------
        (P, 3) float64
            Positions in the imaging frame, metres.
        """
        t = np.asarray(time_s, float)[:, None]
        out = np.asarray(self.centre_m, float) + t * np.asarray(self.velocity_m_per_s, float)
        for power, coefficient in enumerate(self.polynomial, start=2):
            out = out + t**power * np.asarray(coefficient, float)
        for v in self.vibrations:
            cycles = v.frequency_hz * t + v.phase_cycles
            out = out + np.sin(2 * np.pi * cycles) * np.asarray(v.amplitude_m, float)
        if any(self.broadband_m):
            noise = [gaussian(self.seed, axis, len(t)) for axis in range(3)]
            out = out + np.stack(noise, axis=1) * np.asarray(self.broadband_m, float)
        return np.round(out / POSITION_STEP_M) * POSITION_STEP_M


@dataclasses.dataclass(frozen=True)
class RasterScan:
    """Rows of places one above the other, as a scanner of two axes visits them: there and back.

    Parameters
    ----------
    origin_m : (3,) floats
        First place, metres.
    step_m : (3,) floats
        From place to place within a row, metres.
    row_step_m : (3,) floats
        From row to row, metres.
    n_per_row : int
        Places of a row.
    rate_hz : float
        Places per second.

    Raises
    ------
    ValueError
        A number of places or the rate is not positive.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging.simulation import RasterScan
    >>> scan = RasterScan((0.0, 0.0, 1.0), step_m=(0.01, 0.0, 0.0), row_step_m=(0.0, 0.0, 0.01),
    ...                   n_per_row=3, rate_hz=10.0)
    >>> scan.positions(np.arange(6) / 10.0).round(2).tolist()  # there, one row up, and back
    [[0.0, 0.0, 1.0], [0.01, 0.0, 1.0], [0.02, 0.0, 1.0], [0.02, 0.0, 1.01], [0.01, 0.0, ...
    """

    origin_m: tuple[float, float, float]
    step_m: tuple[float, float, float]
    row_step_m: tuple[float, float, float]
    n_per_row: int
    rate_hz: float

    def __post_init__(self) -> None:
        if self.n_per_row < 1 or not self.rate_hz > 0:
            raise ValueError(f'n_per_row={self.n_per_row}, rate_hz={self.rate_hz}; expected at '
                             'least one place in a row and a positive rate')

    def positions(self, time_s: ArrayLike) -> np.ndarray:
        """Positions at the times of all pulses.

        Parameters
        ----------
        time_s : (P,) array_like, float64
            Times of the whole recording, one for each place, seconds; the first is that of
            `origin_m`.

        Returns
        -------
        (P, 3) float64
            Positions in the imaging frame, metres.
        """
        t = np.asarray(time_s, float)
        number = np.rint((t - t[:1]) * self.rate_hz).astype(int)
        row, place = np.divmod(number, self.n_per_row)
        place = np.where(row % 2, self.n_per_row - 1 - place, place)
        out = (np.asarray(self.origin_m, float) + place[:, None] * np.asarray(self.step_m, float)
               + row[:, None] * np.asarray(self.row_step_m, float))
        return np.round(out / POSITION_STEP_M) * POSITION_STEP_M
