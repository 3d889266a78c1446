# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""The experiment of Zhang et al. 2014: a spotlight recording simulated as its phase history.

Section III of the letter, with what it leaves open chosen here and named. The recording is large
(2.1 GB), so that echoes are made pulse by pulse into memory that the caller provides.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np

from sar_imaging.geometry.grids import MapGrid
from sar_imaging.signal.radar import SPEED_OF_LIGHT, RadarParameters, Waveform
from sar_imaging.simulation.echoes import two_way_delays
from sar_imaging.simulation.scene import Scatterer, positions_and_amplitudes

CARRIER_HZ = 10e9  # "X band"
BANDWIDTH_HZ = 1.16e9
REFERENCE_RANGE_M = 10_500.0  # closest approach to the middle of the scene
RESOLUTION_M = 0.15  # nominal; in azimuth wavelength R / 2 L
SCENE_M = (1600.0, 1240.0)  # range, azimuth
PAIR_SEPARATION_M = 0.15  # points 1 and 2, in azimuth
SUBSCENE_M = 30.0  # side of the magnified subscene
#: Sizes by name: what pulses, samples and the sides of the scene are divided by.
SIZES = {'full': 1, 'small': 8}
PULSES = SAMPLES = 16384

_PULSES_AT_ONCE = 32
# Reflectors of the subscene besides points 1 to 3: range and azimuth from its middle, dB.
_NEIGHBOURS = ((-11.0, -9.5, 0.0), (-8.2, 2.6, -3.0), (-4.1, -4.8, -6.0), (-2.3, 11.6, -3.0),
               (2.9, -12.1, 0.0), (5.4, -7.3, -6.0), (8.8, 3.7, -3.0), (12.2, -1.4, 0.0))
_PAIR_AT_M, _SINGLE_AT_M = (-6.0, 7.5), (4.5, 8.5)  # from the middle of the subscene


@dataclasses.dataclass(frozen=True)
class SpotlightExperiment:
    """Radar, straight track and scene; range along x, track along y through the origin.

    Parameters
    ----------
    name : str
        Key in `SIZES`.
    radar : RadarParameters
        Stepped frequency, referenced to the middle of the scene.
    n_pulses, n_samples : int
        Pulses P of the aperture and frequencies K of each.
    aperture_m : float
        Length of the synthetic aperture, metres.
    scene_m : (float, float)
        Size of the scene in range and azimuth, metres.
    subscene_centre_m : (3,) floats
        Middle of the subscene that holds the reflectors of the letter, metres.
    scatterers : tuple of Scatterer
        The scene; the first three are the letter's points 1, 2 and 3.
    noise_db : float
        Noise in an unweighted image of the whole aperture relative to a unit scatterer, dB.
    seed : int
        Of the noise.
    """

    name: str
    radar: RadarParameters
    n_pulses: int
    n_samples: int
    aperture_m: float
    scene_m: tuple[float, float]
    subscene_centre_m: tuple[float, float, float]
    scatterers: tuple[Scatterer, ...]
    noise_db: float = -70.0
    seed: int = 2014

    @property
    def pulse_spacing_m(self) -> float:
        """Distance between neighbouring pulses along the track, metres."""
        return self.aperture_m / self.n_pulses

    @property
    def scene_centre_m(self) -> tuple[float, float, float]:
        """Middle of the scene, metres."""
        return (REFERENCE_RANGE_M, 0.0, 0.0)

    def scene_grid(self, spacing_m: float) -> MapGrid:
        """Grid of the whole scene with square pixels of this spacing, metres."""
        return MapGrid.from_size(self.scene_centre_m, *self.scene_m, spacing_m)

    def phase_centres(self) -> np.ndarray:
        """(P, 1, 3) float64 phase centres, transmit and receive alike, metres."""
        out = np.zeros((self.n_pulses, 1, 3))
        out[:, 0, 1] = (np.arange(self.n_pulses) - (self.n_pulses - 1) / 2) * self.pulse_spacing_m
        return out

    def phase_history(self, pulses: slice) -> np.ndarray:
        """Samples of some pulses, noise included.

        Parameters
        ----------
        pulses : slice
            Which; what comes does not depend on how the recording is sliced.

        Returns
        -------
        (n, K) complex64
            ``sum_p a_p exp(-j 2 pi f (tau_p - tau_0))`` at the frequencies of the radar, tau_0
            the delay of its reference, accurate to -120 dB.
        """
        positions, amplitudes = positions_and_amplitudes(self.scatterers)
        centres = self.phase_centres()[pulses]
        delays = (two_way_delays(centres, centres, positions)[:, 0]
                  - self.radar.first_sample_delay_s)
        out = _sum_of_phasors(self.radar, self.n_samples, delays, amplitudes)
        self._add_noise(out, range(self.n_pulses)[pulses])
        return out

    def record(self, out: np.ndarray, progress: Callable[[int], object] = lambda n: None) -> None:
        """Fill (P, K) complex64 with the whole phase history; reports pulses as they are made."""
        for start in range(0, self.n_pulses, _PULSES_AT_ONCE):
            part = slice(start, min(start + _PULSES_AT_ONCE, self.n_pulses))
            out[part] = self.phase_history(part)
            progress(part.stop - part.start)

    def _add_noise(self, samples, numbers) -> None:
        scale = np.float32(10 ** (self.noise_db / 20)
                           * np.sqrt(self.n_pulses * self.n_samples / 2))
        for row, number in zip(samples, numbers, strict=True):
            parts = np.random.default_rng([self.seed, number]).standard_normal(
                2 * row.size, np.float32)
            row += (scale * parts).view(np.complex64)


def spotlight_letter(size: str = 'full', *, pair_phase_deg: float = 180.0) -> SpotlightExperiment:
    """Experiment of the letter, at full size or smaller.

    Smaller sizes keep carrier, bandwidth, range and aperture, and with them the resolution; they
    have fewer pulses over the same aperture and fewer samples over the same band, which narrows
    the unambiguous azimuth and range, and a scene that is smaller by the same factor.

    Parameters
    ----------
    size : str
        Key in `SIZES`.
    pair_phase_deg : float
        Phase of the echo of point 2 relative to point 1, degrees. A path longer by half a
        wavelength (7.5 mm of range) gives the 180 degrees taken by default; corner reflectors
        placed by hand have any. Below about 110 degrees no imager separates the two points
        behind a Hamming window.

    Returns
    -------
    SpotlightExperiment
    """
    factor = SIZES[size]
    wavelength = SPEED_OF_LIGHT / CARRIER_HZ
    radar = RadarParameters(CARRIER_HZ, BANDWIDTH_HZ, BANDWIDTH_HZ,
                            2 * REFERENCE_RANGE_M / SPEED_OF_LIGHT,
                            waveform=Waveform.STEPPED_FREQUENCY)
    scene = (SCENE_M[0] / factor, SCENE_M[1] / factor)
    middle = (REFERENCE_RANGE_M + 0.15 * scene[0], 0.2 * scene[1], 0.0)
    return SpotlightExperiment(
        size, radar, PULSES // factor, SAMPLES // factor,
        wavelength * REFERENCE_RANGE_M / (2 * RESOLUTION_M), scene, middle,
        (*_reflectors(middle, pair_phase_deg), *_field(scene, middle)))


def _reflectors(middle, pair_phase_deg) -> list[Scatterer]:
    """Points 1 to 3 and the other reflectors of the subscene."""
    def place(name, offset, amplitude, beside=0.0):
        x, y = middle[0] + offset[0], middle[1] + offset[1]
        # Across the line of sight from the middle of the aperture, so that range stays the same.
        r = np.hypot(x, y)
        return Scatterer(name, (x - beside * y / r, y + beside * x / r, 0.0), amplitude)

    half = PAIR_SEPARATION_M / 2
    pair = [place('point 1', _PAIR_AT_M, 1.0, half),
            place('point 2', _PAIR_AT_M, np.exp(1j * np.radians(pair_phase_deg)), -half)]
    return [*pair, place('point 3', _SINGLE_AT_M, 1.0),
            *(place(f'reflector {i}', (x, y), 10 ** (db / 20))
              for i, (x, y, db) in enumerate(_NEIGHBOURS, start=1))]


def _field(scene_m, subscene_centre_m) -> list[Scatterer]:
    """Scatterers along the roads of a village and scattered between, clear of the subscene."""
    random = np.random.default_rng(2014)
    along = np.linspace(-0.47, 0.47, 48)
    roads = [(along, 0.10 * np.sin(5 * along) + 0.1), (along, 0.3 * along - 0.28),
             (0.25 * along + 0.2, along), (-0.2 * along - 0.25, along)]
    places = np.concatenate([np.stack(road, axis=1) for road in roads]
                            + [random.uniform(-0.48, 0.48, (96, 2))])
    places = REFERENCE_RANGE_M * np.array([1.0, 0.0]) + places * scene_m
    amplitudes = (10 ** (random.uniform(-20.0, 0.0, len(places)) / 20)
                  * np.exp(2j * np.pi * random.random(len(places))))
    clear = np.abs(places - subscene_centre_m[:2]).max(axis=1) > 0.6 * SUBSCENE_M
    return [Scatterer(f'field {i}', (x, y, 0.0), a)
            for i, ((x, y), a) in enumerate(zip(places[clear], amplitudes[clear], strict=True))]


def _sum_of_phasors(radar: RadarParameters, n_samples: int, delays_s, amplitudes) -> np.ndarray:
    """(P, K) complex64 echoes of scatterers at (P, S) delays beyond the reference.

    A frequency is a coarse one and a fine step, so that its phasor is a product of two and the
    sum over the scatterers a product of two matrices for each pulse.
    """
    step = radar.bandwidth_hz / n_samples
    fine = 1 << (n_samples.bit_length() // 2)
    coarse = -(-n_samples // fine)
    first = radar.carrier_hz - (n_samples - 1) / 2 * step
    start = amplitudes * _phasor(first * delays_s)
    rows = start[..., None] * _powers(_phasor(fine * step * delays_s), coarse)
    columns = _powers(_phasor(step * delays_s), fine)
    product = np.matmul(rows.astype(np.complex64).transpose(0, 2, 1),
                        columns.astype(np.complex64))
    return product.reshape(len(delays_s), -1)[:, :n_samples]


def _phasor(cycles) -> np.ndarray:
    """``exp(-j 2 pi cycles)``, complex128."""
    return np.exp(-2j * np.pi * np.remainder(cycles, 1.0))


def _powers(factor, n: int) -> np.ndarray:
    """(..., n) complex128: powers 0 to n - 1, by doubling."""
    out = np.empty((*factor.shape, n), complex)
    out[..., 0] = 1.0
    done, step = 1, factor[..., None]
    while done < n:
        more = min(done, n - done)
        out[..., done:done + more] = out[..., :more] * step
        done, step = done + more, step * step
    return out
