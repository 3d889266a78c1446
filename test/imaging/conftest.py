"""Band-limited range profiles of point scatterers, straight from the signal model."""

import dataclasses

import numpy as np
import pytest

from sar_imaging.geometry import MapGrid
from sar_imaging.signal import SPEED_OF_LIGHT, PulseBlock, RadarParameters

LENGTH = 96  # pulses of an aperture that is imaged live


@dataclasses.dataclass(frozen=True)
class Case:
    """A grid, the profiles of scatterers on it, and the scatterers."""

    grid: MapGrid
    block: PulseBlock
    points: np.ndarray


def make_case(range_m, *, channels=1, height_m=0.0, heading_rad=0.0, n=96, spacing_m=0.25,
              pulses=48, aperture_m=None, n_points=12, seed=1, bend_m=0.0, track_m=None,
              extent=0.95, carrier_hz=10e9):
    """Profiles (10 GHz unless told, 300 MHz, sampled at 400 MHz) of random scatterers.

    The radar flies along y and looks along +x, all turned by `heading_rad`; receivers stand half
    a wavelength apart; `bend_m` bows the track outwards in the middle, `track_m` (pulses, 3)
    replaces it. Scatterers fill `extent` times the grid in both directions.
    """
    rng = np.random.default_rng(seed)
    carrier, bandwidth, rate = carrier_hz, 300e6, 400e6
    aperture = range_m * 0.03 if aperture_m is None else aperture_m
    u = np.linspace(-0.5, 0.5, pulses)
    tx = np.zeros((pulses, channels, 3))
    tx[..., 0] = (bend_m * (4 * u ** 2 - 1))[:, None]
    tx[..., 1] = (aperture * u)[:, None]
    tx[..., 2] = height_m
    if track_m is not None:
        tx[:] = track_m[:, None]
    rx = tx.copy()
    rx[..., 1] += (np.arange(channels) - channels // 2) * SPEED_OF_LIGHT / carrier / 2
    cos, sin = np.cos(heading_rad), np.sin(heading_rad)
    turn = np.array([[cos, sin, 0], [-sin, cos, 0], [0, 0, 1]])
    tx, rx = tx @ turn, rx @ turn
    ground = np.sqrt(range_m ** 2 - height_m ** 2)
    grid = MapGrid((ground * cos, ground * sin, 0.0), n, n, spacing_m)
    points = np.array(grid.centre_m) + np.c_[
        (rng.random((n_points, 2)) - 0.5) * extent * n * spacing_m, np.zeros(n_points)]

    def distance(a):
        return np.linalg.norm(a[:, :, None] - points, axis=-1)

    tau = (distance(tx) + distance(rx)) / SPEED_OF_LIGHT
    spacing = SPEED_OF_LIGHT / 2 / rate
    n_samples = 2 * int(0.75 * n * spacing_m / spacing) + 64
    start = 2 * (range_m - n_samples / 2 * spacing) / SPEED_OF_LIGHT
    baseband = np.fft.fftfreq(n_samples, 1 / rate)
    spectrum = np.zeros((pulses, channels, n_samples), complex)
    for k in np.flatnonzero(np.abs(baseband) <= bandwidth / 2):
        cycles = (carrier + baseband[k]) * tau - baseband[k] * start
        spectrum[..., k] = np.exp(-2j * np.pi * np.mod(cycles, 1.0)).sum(axis=-1)
    samples = np.fft.ifft(spectrum, axis=-1, norm='forward')
    radar = RadarParameters(carrier, bandwidth, rate, start)
    return Case(grid, PulseBlock(radar, True, np.arange(pulses), np.arange(pulses), samples,
                                 tx, rx), points)


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


@pytest.fixture(name='make_case', scope='session')
def make_case_fixture():
    return make_case
