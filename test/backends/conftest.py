"""Small scenes whose profiles come straight from the signal model."""

import dataclasses

import numpy as np
import pytest

from sar_imaging.geometry import MapGrid
from sar_imaging.signal import SPEED_OF_LIGHT, PulseBlock, RadarParameters, Waveform

CARRIER_HZ, BANDWIDTH_HZ, RATE_HZ = 10e9, 300e6, 400e6


@dataclasses.dataclass(frozen=True)
class Scene:
    """A map and the pulses that see the scatterers on it."""

    grid: MapGrid
    block: PulseBlock

    @property
    def echoes(self):
        """Samples, transmitters and receivers with one echo per pulse and channel."""
        block = self.block
        return (block.samples.reshape(-1, block.n_samples), block.tx_m.reshape(-1, 3),
                block.rx_m.reshape(-1, 3))


def make_scene(range_m, *, n=48, pulses=64, aperture_m=None, height_m=0.0, bend_m=0.0, apart_m=0.0,
               channels=1, history=False, n_points=60):
    """Profiles, or phase histories, of random scatterers all over a map at some range along x.

    The track runs along y, `bend_m` further out in its middle; receivers stand `apart_m` behind
    the transmitter, and half a wavelength from channel to channel.
    """
    rng = np.random.default_rng(3)
    spacing_m = 0.25
    u = np.linspace(-0.5, 0.5, pulses)
    tx = np.zeros((pulses, channels, 3))
    tx[..., 0] = (bend_m * (1 - 4 * u ** 2))[:, None]
    tx[..., 1] = ((0.03 * range_m if aperture_m is None else aperture_m) * u)[:, None]
    tx[..., 2] = height_m
    rx = tx + apart_m * np.array([-1.0, 0.5, 0.2])
    rx[..., 1] += np.arange(channels) * SPEED_OF_LIGHT / CARRIER_HZ / 2
    grid = MapGrid((np.sqrt(range_m ** 2 - height_m ** 2), 0.0, 0.0), n, n, spacing_m)
    points = np.array(grid.centre_m) + np.c_[
        (rng.random((n_points, 2)) - 0.5) * n * spacing_m, np.zeros(n_points)]
    tau = sum(np.linalg.norm(a[:, :, None] - points, axis=-1) for a in (tx, rx)) / SPEED_OF_LIGHT
    n_samples = 2 * int(n * spacing_m * RATE_HZ / SPEED_OF_LIGHT) + 64  # or frequencies
    centre_s = float(tau.mean())
    if history:
        baseband = (np.arange(n_samples) - (n_samples - 1) / 2) * (BANDWIDTH_HZ / n_samples)
        start, rate, waveform = centre_s, BANDWIDTH_HZ, Waveform.STEPPED_FREQUENCY
        reference = np.full(n_samples, CARRIER_HZ) + baseband
    else:
        baseband = np.fft.fftfreq(n_samples, 1 / RATE_HZ)
        start, rate = centre_s - n_samples / 2 / RATE_HZ, RATE_HZ
        waveform, reference = Waveform.LFM, baseband
    spectra = np.zeros((pulses, channels, n_samples), complex)
    for k in np.flatnonzero(np.abs(baseband) <= BANDWIDTH_HZ / 2):
        cycles = (CARRIER_HZ + baseband[k]) * tau - reference[k] * start
        spectra[..., k] = np.exp(-2j * np.pi * np.mod(cycles, 1.0)).sum(axis=-1)
    samples = spectra if history else np.fft.ifft(spectra, norm='forward')
    radar = RadarParameters(CARRIER_HZ, BANDWIDTH_HZ, rate, start, waveform=waveform)
    return Scene(grid, PulseBlock(radar, not history, np.arange(pulses), np.arange(pulses),
                                  samples, tx, rx))


@pytest.fixture(name='make_scene', scope='session')
def make_scene_fixture():
    return make_scene


@pytest.fixture(scope='session')
def error_db():
    def difference(image, wanted):
        return float(20 * np.log10(np.linalg.norm(image - wanted) / np.linalg.norm(wanted)
                                   + 1e-20))

    return difference
