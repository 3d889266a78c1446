# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Simulate a jammer: band-limited noise from one place, exactly delayed to each receiver."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from scipy import fft

from ..signal.radar import RadarParameters
from .noise import complex_gaussian


@dataclasses.dataclass(frozen=True)
class Jammer:
    """Source of barrage noise that fills the radar's band, new with every pulse.

    Parameters
    ----------
    name : str
        For reports.
    position_m : (3,) floats
        Place in the imaging frame, metres.
    std : float
        Standard deviation of its complex samples in each channel, before or after range
        compression, whichever is recorded; the peak of a unit scatterer is 1.
    seed : int
        Seed of the noise.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging import RadarParameters
    >>> from sar_imaging.simulation import Jammer
    >>> radar = RadarParameters(10e9, 300e6, 400e6, first_sample_delay_s=6e-7)
    >>> jammer = Jammer('van', position_m=(500.0, 200.0, 2.0), std=3.0)
    >>> noise = jammer.samples(radar, 256, np.zeros((8, 2, 3)), counter=np.arange(8))
    >>> noise.shape, noise.dtype.name
    ((8, 2, 256), 'complex128')
    >>> print(f'{20 * np.log10(noise.std()):.0f} dB against a unit scatterer')
    9 dB against a unit scatterer
    """

    name: str
    position_m: tuple[float, float, float]
    std: float
    seed: int = 1

    def samples(self, radar: RadarParameters, n_samples: int, rx_m: np.ndarray,
                counter: np.ndarray) -> np.ndarray:
        """What the receivers record of it.

        Between receivers only the path from the jammer differs; it delays envelope and carrier.
        The record is one period of the noise, so that the differences, some samples at most,
        turn it round.

        Parameters
        ----------
        radar : RadarParameters
            Radar parameters of the samples.
        n_samples : int
            Fast-time samples N of a pulse.
        rx_m : (P, C, 3) float64
            Receive phase centres, metres.
        counter : (P,) int
            Counters of the pulses, which the noise belongs to.

        Returns
        -------
        (P, C, N) complex128
        """
        step = radar.sample_rate_hz / n_samples
        half = min(math.floor(radar.bandwidth_hz / 2 / step), (n_samples - 1) // 2)
        bins = np.arange(-half, half + 1)
        path = np.linalg.norm(np.asarray(rx_m) - np.array(self.position_m), axis=-1)
        delay = (path - path.mean(axis=1, keepdims=True)) / radar.propagation_speed_m_per_s
        cycles = np.remainder(delay[..., None] * (radar.carrier_hz + step * bins), 1.0)
        noise = np.stack([complex_gaussian(self.seed, int(c), bins.size) for c in counter])
        spectrum = np.zeros((*path.shape, n_samples), complex)
        spectrum[..., bins] = noise[:, None] * np.exp(-2j * np.pi * cycles)
        return fft.ifft(spectrum) * (self.std * n_samples / math.sqrt(bins.size))
