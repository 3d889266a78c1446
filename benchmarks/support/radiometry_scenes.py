# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Range profiles of targets by the radar equation, for the figures and tests of radiometry."""

import numpy as np

from sar_imaging.geometry import MapGrid
from sar_imaging.signal import SPEED_OF_LIGHT, PulseBlock, RadarParameters
from sar_imaging.signal.windows import window
from sar_imaging.simulation.echoes import dense_spectrum

GAIN = 3.7


class Flight:
    """Radar on a straight track along y beside the origin of x, with a map in its middle.

    Both resolutions are `cell_m` on the ground.
    """

    def __init__(self, range_m, grazing_deg=40.0, *, pulses=96, channels=1, cell_m=0.5, n=64,
                 squint_rad=0.0, weighting='none', carrier_hz=10e9, slope=0.0):
        grazing = np.radians(grazing_deg)
        ground = range_m * np.cos(grazing)
        wavelength = SPEED_OF_LIGHT / carrier_hz
        self.cell_m, self.weighting = cell_m, weighting
        self.bandwidth_hz = SPEED_OF_LIGHT / (2 * cell_m * np.cos(grazing))
        self.angle_rad = wavelength / (2 * cell_m * np.cos(grazing))  # on the ground
        along = ground * (self.angle_rad * np.linspace(-0.5, 0.5, pulses) - np.tan(squint_rad))
        self.tx_m = np.zeros((pulses, channels, 3))
        self.tx_m[..., 1] = along[:, None]
        self.tx_m[..., 2] = range_m * np.sin(grazing)
        self.rx_m = self.tx_m.copy()
        self.rx_m[..., 1] += (np.arange(channels) - (channels - 1) / 2) * wavelength / 2
        self.grid = MapGrid((ground, 0.0, 0.0), n, n, 0.6 * cell_m)
        self.rate_hz = 1.5 * self.bandwidth_hz
        half_m = 0.6 * n * 0.6 * cell_m * 1.5
        corners = np.array(self.grid.centre_m) + [
            [i * half_m, j * half_m, k * half_m * slope] for i in (-1, 1) for j in (-1, 1)
            for k in (-1, 1)]
        far = np.linalg.norm(self.tx_m[[0, pulses // 2, -1], :1] - corners, axis=-1)
        self.n_samples = int((far.max() - far.min()) * 2 / SPEED_OF_LIGHT * self.rate_hz) + 96
        self.n_bins = 2 * int(self.bandwidth_hz / 2 / self.rate_hz * self.n_samples) + 1
        self.bandwidth_hz = self.n_bins * self.rate_hz / self.n_samples  # a whole number of bins
        self.radar = RadarParameters(
            carrier_hz=carrier_hz, bandwidth_hz=self.bandwidth_hz, sample_rate_hz=self.rate_hz,
            first_sample_delay_s=2 * far.min() / SPEED_OF_LIGHT - 48 / self.rate_hz)

    def block(self, points_m, amplitudes, pattern=None):
        """Profiles of targets whose cross sections are the squares of the amplitudes."""
        radar, n = self.radar, self.n_samples
        half = self.n_bins // 2
        shape = window(self.weighting, self.n_bins)
        lit = np.ones((self.tx_m[..., 0].size, len(points_m))) if pattern is None else (
            pattern.amplitude(points_m))
        samples = np.zeros((*self.tx_m.shape[:2], n), np.complex64)
        for number, index in enumerate(np.ndindex(*self.tx_m.shape[:2])):
            there, back = (np.linalg.norm(c[index] - points_m, axis=1)
                           for c in (self.tx_m, self.rx_m))
            spectrum = np.zeros(n, complex)
            spectrum[np.arange(-half, half + 1)] = shape * dense_spectrum(
                radar.carrier_hz, -half, self.n_bins, self.rate_hz / n,
                ((there + back) / SPEED_OF_LIGHT)[None, None],
                GAIN * amplitudes * lit[number] / (there * back),
                radar.first_sample_delay_s)[0, 0]
            samples[index] = np.fft.ifft(spectrum) * n / shape.sum()
        return self.pulses(samples)

    def pulses(self, samples):
        """A block of these profiles."""
        count = len(self.tx_m)
        return PulseBlock(radar=self.radar, samples=samples, compressed=True,
                          counter=np.arange(count, dtype=np.uint32),
                          stamp_ns=np.arange(count) * 10**6, tx_m=self.tx_m, rx_m=self.rx_m)


def rough_surface(flight, sigma0, rng, density=6.0):
    """Places and amplitudes of many scatterers of a surface somewhat larger than the map.

    Each lies somewhere in a square of its own: places that are all random clump, so that the
    brightness varies besides speckle.
    """
    size = flight.grid.n_x * flight.grid.spacing_m * 1.15
    side = round(np.sqrt(density) * size / flight.cell_m)
    squares = np.stack(np.meshgrid(*2 * [np.arange(side)]), -1).reshape(-1, 2)
    places = (squares + rng.random(squares.shape)) * size / side - 0.5 * size
    mean = np.sqrt(sigma0 / 2) * size / side
    noise = rng.normal(size=(len(places), 2)) @ [1, 1j]
    return np.c_[places, np.zeros(len(places))] + flight.grid.centre_m, mean * noise
