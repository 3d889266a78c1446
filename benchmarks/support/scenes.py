# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Phase histories of random scatterers for the benchmarks, made quickly in bounded memory."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from sar_imaging.geometry import MapGrid
from sar_imaging.signal import SPEED_OF_LIGHT, PulseBlock, RadarParameters, Waveform
from sar_imaging.simulation.echoes import two_way_delays

CARRIER_HZ = 10e9
N_SCATTERERS = 30
_PULSES_AT_ONCE = 64


@dataclasses.dataclass(frozen=True)
class Case:
    """One image to form.

    The radar flies along y at x = -range_m and looks along +x; the map is centred on the origin
    and resolution is twice the pixel spacing in both directions. Receivers stand half a
    wavelength apart along the track, the transmitter in their middle (the array of Rosenberg &
    Gray).
    """

    range_m: float
    n_side: int
    n_pulses: int
    n_channels: int
    spacing_m: float

    @property
    def pixel_pulses(self) -> float:
        """Work of a direct imager; each channel counts as a pulse."""
        return self.n_side**2 * self.n_pulses * self.n_channels

    @property
    def grid(self) -> MapGrid:
        """Map of the image; FastSAR's planar grids put the origin half a pixel off the middle."""
        return MapGrid((-self.spacing_m / 2, -self.spacing_m / 2, 0.0), self.n_side, self.n_side,
                       self.spacing_m)

    @property
    def aperture_m(self) -> float:
        """Length of the synthetic aperture, metres."""
        return SPEED_OF_LIGHT / CARRIER_HZ * self.range_m / (4 * self.spacing_m)

    @property
    def n_frequencies(self) -> int:
        """Frequencies of a pulse: unambiguous over 1.5 times the map, a power of two."""
        return 2 ** math.ceil(math.log2(0.75 * self.n_side))

    def phase_centres(self) -> tuple[np.ndarray, np.ndarray]:
        """(P, C, 3) float64 transmit and receive phase centres, metres."""
        tx = np.zeros((self.n_pulses, self.n_channels, 3))
        tx[..., 0] = -self.range_m
        tx[..., 1] = np.linspace(-0.5, 0.5, self.n_pulses)[:, None] * self.aperture_m
        rx = tx.copy()
        place = np.arange(self.n_channels) - (self.n_channels - 1) / 2
        rx[..., 1] += place * SPEED_OF_LIGHT / CARRIER_HZ / 2
        return tx, rx


def phase_history(case: Case) -> PulseBlock:
    """Phase history of unit scatterers at random places of the map, referenced to its middle."""
    bandwidth = SPEED_OF_LIGHT / (4 * case.spacing_m)
    reference = 2 * case.range_m / SPEED_OF_LIGHT
    tx, rx = case.phase_centres()
    extent = case.n_side * case.spacing_m
    places = (np.random.default_rng(1).random((N_SCATTERERS, 2)) - 0.5) * 0.8 * extent
    points = np.c_[places, np.zeros(N_SCATTERERS)]
    samples = np.empty((case.n_pulses, case.n_channels, case.n_frequencies), np.complex64)
    for start in range(0, case.n_pulses, _PULSES_AT_ONCE):
        part = slice(start, start + _PULSES_AT_ONCE)
        delays = two_way_delays(tx[part], rx[part], points) - reference
        samples[part] = _sum_of_phasors(delays, bandwidth, case.n_frequencies)
    radar = RadarParameters(CARRIER_HZ, bandwidth, bandwidth, reference,
                            waveform=Waveform.STEPPED_FREQUENCY)
    numbers = np.arange(case.n_pulses)
    return PulseBlock(radar, False, numbers, numbers, samples, tx, rx)


def _sum_of_phasors(delays_s, bandwidth_hz, n) -> np.ndarray:
    """(P, C, n) sums of ``exp(-j 2 pi f tau)`` over (P, C, S) delays.

    Frequency number ``i F + j`` is a product of phasors that depend on i and on j alone, which
    makes the sum over scatterers a product of two small matrices.
    """
    fine = 2 ** (round(math.log2(n)) // 2)
    step = bandwidth_hz / n
    first = CARRIER_HZ - (n - 1) / 2 * step
    coarse_hz = first + step * fine * np.arange(n // fine)
    coarse = np.multiply.outer(delays_s, coarse_hz)
    fine = np.multiply.outer(delays_s, step * np.arange(fine))
    both = (np.exp(-2j * np.pi * np.mod(cycles, 1.0)) for cycles in (coarse, fine))
    left, right = both
    return (left.swapaxes(-1, -2) @ right).reshape(*delays_s.shape[:2], n)
