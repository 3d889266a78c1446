# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Apertures whose stated positions are wrong in a known way, to test autofocus on."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from ..geometry.grids import MapGrid
from ..signal.pulses import PulseBlock
from ..signal.radar import SPEED_OF_LIGHT, RadarParameters
from .echoes import EchoSimulator

KINDS = ('smooth', 'vibration', 'clock')
WAVELENGTH_M = SPEED_OF_LIGHT / 10e9
_GROUND_RANGE_M, _HEIGHT_M, _APERTURE_M = 1000.0, 200.0, 30.0
_PRF_HZ = 100.0
_N_SAMPLES = 512
_N_BRIGHT, _N_FAINT, _FAINT_DB = 24, 200, -25.0
_NOISE = 0.3  # standard deviation per sample of a profile; 1 is the strongest scatterer


@dataclasses.dataclass(frozen=True)
class FlawedAperture:
    """Range profiles with wrong positions, and the truth.

    Attributes
    ----------
    kind : str
        One of `KINDS`.
    size : float
        Largest displacement in wavelengths, or the clock's offset in seconds.
    stated, true : PulseBlock
        The same profiles with the positions stated and with the true ones.
    points_m : (S, 3) float64
        Scatterers, the bright ones first, metres.
    n_bright : int
        How many are bright: 0 to -10 dB.
    grid : MapGrid
        Where to image.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging.simulation import flawed_aperture
    >>> case = flawed_aperture('smooth', 2.0, seed=1, n_pulses=32)
    >>> wrong = np.linalg.norm(case.stated.phase_centre_m - case.true.phase_centre_m, axis=-1)
    >>> print(f'{wrong.max() / case.true.radar.wavelength_m:.1f} wavelengths')
    2.1 wavelengths
    """

    kind: str
    size: float
    stated: PulseBlock
    true: PulseBlock
    points_m: np.ndarray
    n_bright: int
    grid: MapGrid

    @property
    def time_s(self) -> np.ndarray:
        """(P,) float64 times of the pulses, seconds."""
        return np.arange(self.stated.n_pulses) / _PRF_HZ


def flawed_aperture(kind: str, size: float, seed: int, *, n_pulses: int = 512,
                    half_scene_m: float = 28.0, spacing_m: float = 0.25) -> FlawedAperture:
    """Simulate an aperture of a drone whose stated positions are wrong.

    X band, at 1 km ground range, 200 m high, flying 30 m along x, looking to +y.

    300 MHz of bandwidth, resolution 0.5 m both ways; 24 bright scatterers of 0 to -10 dB and 200
    of -25 dB at random places, noise 10 dB below the strongest echo in every sample. Smooth and
    vibration errors are across the track and vertical; the clock's error is that of a drone that
    sways by some decimetres.

    Parameters
    ----------
    kind : str
        One of `KINDS`: 'smooth' is a polynomial of degree 4 with random coefficients, 'vibration'
        six sinusoids of 1.5 to 30 cycles per aperture, 'clock' positions read at the wrong time.
    size : float
        Largest displacement in wavelengths, or offset in seconds.
    seed : int
        Seed of everything random.
    n_pulses : int
        Pulses of the aperture.
    half_scene_m, spacing_m : float
        Half the side of the scene, and pixel spacing, metres.

    Returns
    -------
    FlawedAperture
        Profiles, stated and true positions.

    Examples
    --------
    >>> from sar_imaging.simulation import flawed_aperture
    >>> case = flawed_aperture('vibration', 0.1, seed=1, n_pulses=32)
    >>> case.n_bright, case.stated.n_pulses, case.grid.shape
    (24, 32, (240, 240))
    """
    rng = np.random.default_rng(seed)
    points = np.zeros((_N_BRIGHT + _N_FAINT, 3))
    points[:, :2] = rng.uniform(-half_scene_m, half_scene_m, (len(points), 2))
    points[:, 1] += _GROUND_RANGE_M
    amplitudes = np.exp(2j * np.pi * rng.random(len(points)))
    amplitudes[:_N_BRIGHT] *= 10 ** (rng.uniform(-10, 0, _N_BRIGHT) / 20)
    amplitudes[_N_BRIGHT:] *= 10 ** (_FAINT_DB / 20)
    stated, true = _tracks(kind, size, rng, n_pulses)
    samples = round(_N_SAMPLES * max(1.0, half_scene_m / 28.0))
    radar = _radar(samples)
    simulate = EchoSimulator(radar, samples, compressed=True, points_m=points,
                             amplitudes=amplitudes)
    profiles = np.concatenate([simulate(part, part) for part in
                               np.array_split(true[:, None], max(1, n_pulses // 128))])
    profiles = profiles + _NOISE / math.sqrt(2) * (
        rng.standard_normal(profiles.shape) + 1j * rng.standard_normal(profiles.shape))
    number = np.arange(n_pulses)
    stamp_ns = np.rint(number * 1e9 / _PRF_HZ).astype(np.int64)
    blocks = [PulseBlock(radar, True, stamp_ns, number, profiles, track[:, None], track[:, None])
              for track in (stated, true)]
    side = 2 * round((half_scene_m + 2.0) / spacing_m)
    return FlawedAperture(kind, size, blocks[0], blocks[1], points, _N_BRIGHT,
                          MapGrid((0.0, _GROUND_RANGE_M, 0.0), side, side, spacing_m))


def _radar(n_samples: int) -> RadarParameters:
    rate = 450e6
    middle = math.hypot(_GROUND_RANGE_M, _HEIGHT_M)
    start = middle - n_samples / 2 * SPEED_OF_LIGHT / 2 / rate
    return RadarParameters(10e9, 300e6, rate, 2 * start / SPEED_OF_LIGHT)


def _tracks(kind: str, size: float, rng: np.random.Generator, n_pulses: int
            ) -> tuple[np.ndarray, np.ndarray]:
    """Stated and true positions (P, 3)."""
    u = np.linspace(-1.0, 1.0, n_pulses)
    straight = np.stack([u * _APERTURE_M / 2, 0 * u, np.full(n_pulses, _HEIGHT_M)], axis=1)
    across = np.array([0.0, 1.0, 1.0])
    error = np.zeros_like(straight)
    if kind == 'clock':
        sway = [(rng.uniform(0.1, 0.5), rng.uniform(0.5, 1.5), rng.uniform(0, 2 * np.pi))
                for _ in range(3)]  # metres, cycles per aperture, radians

        def moving(u: np.ndarray) -> np.ndarray:
            return np.stack([u * _APERTURE_M / 2 + 0.3 * sway[0][0] * np.sin(
                                 np.pi * sway[0][1] * u + sway[0][2]),
                             sway[1][0] * np.sin(np.pi * sway[1][1] * u + sway[1][2]),
                             _HEIGHT_M + sway[2][0] * np.sin(np.pi * sway[2][1] * u
                                                             + sway[2][2])], axis=1)

        offset = rng.choice([-1.0, 1.0]) * size
        return moving(u), moving(u + offset * _PRF_HZ * (u[1] - u[0]))
    if kind == 'smooth':
        basis = np.polynomial.legendre.legvander(u, 4)[:, 1:]
        error = basis @ rng.standard_normal((4, 3)) * across
    elif kind == 'vibration':
        for _ in range(6):
            wave = np.sin(np.pi * rng.uniform(3, 60) * u + rng.uniform(0, 2 * np.pi))
            error += wave[:, None] * rng.standard_normal(3) * across
    else:
        raise ValueError(f'kind={kind!r}; use one of {", ".join(KINDS)}')
    error -= error.mean(axis=0)
    return straight, straight + error * size * WAVELENGTH_M / np.abs(error).max()
