"""Platform positions at the pulses: a straight track with known perturbations."""

from __future__ import annotations

import dataclasses

import numpy as np

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
        Of the broadband noise.
    """

    centre_m: tuple[float, float, float]
    velocity_m_per_s: tuple[float, float, float]
    polynomial: tuple[tuple[float, float, float], ...] = ()
    vibrations: tuple[Vibration, ...] = ()
    broadband_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    seed: int = 0

    def positions(self, time_s) -> np.ndarray:
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
