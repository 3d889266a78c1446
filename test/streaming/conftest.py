"""Tracks of two apertures that are imaged while the pulses arrive."""

import numpy as np

LENGTH = 96  # pulses of an aperture


def _arc(n_pulses, radius_m=400.0, step_m=0.3):
    """A circle flown at constant speed, tangent to the y axis in the middle."""
    angle = (np.arange(n_pulses) - (n_pulses - 1) / 2) * step_m / radius_m
    return np.c_[radius_m * (np.cos(angle) - 1), radius_m * np.sin(angle), 0 * angle]


def _shaken(n_pulses):
    """A straight track with a random walk of 4 mm per pulse and a vibration of 20 mm."""
    rng = np.random.default_rng(3)
    track = np.c_[0 * np.arange(n_pulses), (np.arange(n_pulses) - n_pulses / 2) * 0.3,
                  0 * np.arange(n_pulses)]
    track += np.cumsum(rng.normal(0, 0.004, (n_pulses, 3)), axis=0)
    return track + 0.02 * np.sin(np.arange(n_pulses) * 0.9)[:, None]


def _accelerating(n_pulses):
    u = np.linspace(-1, 1, n_pulses)
    return np.c_[0 * u, n_pulses * 0.15 * (u + 0.3 * u ** 2), 0 * u]


TRACKS = {
    'straight': {'aperture_m': 0.3 * 2 * LENGTH},
    'straight, 5 channels': {'aperture_m': 0.3 * 2 * LENGTH, 'channels': 5},
    'near': {'range_m': 100.0, 'aperture_m': 6.0},
    'bowed': {'aperture_m': 60.0, 'bend_m': 4.0},
    'circular': {'track_m': _arc(2 * LENGTH)},
    'shaken': {'track_m': _shaken(2 * LENGTH)},
    'accelerating': {'track_m': _accelerating(2 * LENGTH)},
}
