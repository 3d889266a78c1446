# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""A spaceborne stripmap of one scatterer, and its image in closed form."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator

import numpy as np

from sar_imaging.geometry import MapGrid
from sar_imaging.geometry.illumination import AntennaPattern, Illumination, PatternCut, Pointing
from sar_imaging.signal import SPEED_OF_LIGHT, PulseBlock, RadarParameters
from sar_imaging.simulation.echoes import EchoSimulator


@dataclasses.dataclass(frozen=True)
class Stripmap:
    """30 s of a satellite's flight, whose antenna lights a point for a small part of that.

    The two-way amplitude over azimuth is ``cos(pi x / L) ** 2`` of the place x along the track,
    L long: `in_beam_s` seconds of flight.
    """

    carrier_hz: float
    bandwidth_hz: float
    repetition_hz: float
    in_beam_s: float
    n_samples: int
    seconds: float = 30.0
    speed_m_per_s: float = 7000.0
    height_m: float = 500e3
    range_m: float = 600e3

    @property
    def radar(self) -> RadarParameters:
        """Of profiles around the scatterer, which lies a third of them behind their start."""
        rate = 1.5 * self.bandwidth_hz
        before = self.n_samples / 3 / rate
        return RadarParameters(self.carrier_hz, self.bandwidth_hz, rate,
                               2 * self.range_m / SPEED_OF_LIGHT - before)

    @property
    def n_pulses(self) -> int:
        """Of the recording."""
        return round(self.seconds * self.repetition_hz)

    @property
    def target_m(self) -> tuple[float, float, float]:
        """The scatterer, on the ground to the left of the track, abeam in the middle of it."""
        return 0.0, math.sqrt(self.range_m ** 2 - self.height_m ** 2), 0.0

    @property
    def lit_m(self) -> float:
        """L: way of the satellite while a point is lit, metres."""
        return self.in_beam_s * self.speed_m_per_s

    @property
    def pattern(self) -> AntennaPattern:
        """A squared cosine over azimuth, zero where the point is no longer lit."""
        return AntennaPattern(PatternCut.cosine(math.atan(self.lit_m / 2 / self.range_m)))

    def blocks(self, n_pulses: int, noise: float = 0.0, seed: int = 0, amplitude: float = 1.0
               ) -> Iterator[PulseBlock]:
        """Range profiles of the scatterer as it is lit, with white noise in the band."""
        rng = np.random.default_rng(seed)
        simulator = EchoSimulator(self.radar, self.n_samples, compressed=True,
                                  points_m=[self.target_m], amplitudes=[amplitude])
        inside = np.abs(np.fft.fftfreq(self.n_samples)) <= 1 / 3
        step = self.speed_m_per_s / self.repetition_hz
        for start in range(0, self.n_pulses, n_pulses):
            number = np.arange(start, min(start + n_pulses, self.n_pulses))
            centres = np.zeros((len(number), 1, 3))
            centres[:, 0, 0] = (number - (self.n_pulses - 1) / 2) * step
            centres[:, 0, 2] = self.height_m
            depression = math.asin(self.height_m / self.range_m)
            pointing = Pointing(np.tile([0, math.cos(depression), -math.sin(depression)],
                                        (len(number), 1)))
            weight = Illumination.of_pulses(self.pattern, pointing, centres, centres).amplitude(
                np.array([self.target_m]))[:, 0]
            samples = np.zeros((len(number), 1, self.n_samples), np.complex64)
            lit = np.flatnonzero(weight)
            if len(lit):
                samples[lit] = simulator(centres[lit], centres[lit]) * weight[lit, None, None]
            if noise:
                parts = rng.normal(size=(2, *samples.shape)) * noise / math.sqrt(2)
                spectrum = np.fft.fft(parts[0] + 1j * parts[1]) * inside
                samples += np.fft.ifft(spectrum)
            yield PulseBlock(self.radar, True, number * round(1e9 / self.repetition_hz), number,
                             samples, centres, centres, pointing=pointing)

    def response(self, offset_m) -> np.ndarray:
        """Image along azimuth: the transform of the squared amplitude, ``cos ** 4``, times pulses.

        ``f(d) = n L [3/8 s(u) + (s(u - 1) + s(u + 1)) / 4 + (s(u - 2) + s(u + 2)) / 16]``, s the
        sinc, n pulses per metre, ``u = 2 L d / (wavelength R)``.
        """
        u = 2 * self.lit_m * np.asarray(offset_m) / (self.radar.wavelength_m * self.range_m)
        pulses = self.in_beam_s * self.repetition_hz
        return pulses * (0.375 * np.sinc(u) + 0.25 * (np.sinc(u - 1) + np.sinc(u + 1))
                         + 0.0625 * (np.sinc(u - 2) + np.sinc(u + 2)))

    def lit_share(self, grid: MapGrid) -> float:
        """Share of the pairs of a pulse and a pixel that is lit."""
        number = np.arange(self.n_pulses) - (self.n_pulses - 1) / 2
        along = number * self.speed_m_per_s / self.repetition_hz
        return float(np.mean([np.mean(np.abs(along - x) < self.lit_m / 2)
                              for x in grid.x_m[::max(1, grid.n_x // 64)]]))

    @staticmethod
    def width_m(offset_m, amplitude) -> float:
        """Full width at half power of a peak that is sampled evenly, metres."""
        fine = np.linspace(offset_m[0], offset_m[-1], 20 * len(offset_m))
        # band-limited between samples
        step = offset_m[1] - offset_m[0]
        value = np.abs(np.sinc((fine[:, None] - offset_m) / step) @ amplitude)
        above = fine[value >= value.max() * math.sqrt(0.5)]
        return float(above[-1] - above[0])
