# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Random and measured right recordings, into which the campaign of the doctor injects faults."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator

import numpy as np
from scipy.spatial.transform import Rotation

from sar_imaging.geometry.grids import MapGrid
from sar_imaging.signal.dechirp import fmcw_parameters
from sar_imaging.signal.pulses import PulseBlock
from sar_imaging.signal.radar import SPEED_OF_LIGHT, RadarParameters, Waveform
from sar_imaging.simulation.echoes import EchoSimulator, quantise

from .mistake_recordings import DATA, MEASURED

KINDS = ('slider', 'rail', 'drone', 'uwb')
_START_NS = 1_700_000_000_000_000_000


@dataclasses.dataclass(frozen=True)
class Case:
    """A recording of one aperture and where its scene is.

    Parameters
    ----------
    kind : str
        One of `KINDS`, or the name of a measured recording.
    block : PulseBlock
        Raw pulses with phase centres.
    grid : MapGrid
        Its scene.
    window : str
        Of the range compression.
    attitude : Rotation or None
        Of the platform at each pulse.
    sizes : tuple of float
        Of the fault that was injected, as a doctor who is right would tell them.
    """

    kind: str
    block: PulseBlock
    grid: MapGrid
    window: str = 'none'
    attitude: Rotation | None = None
    sizes: tuple[float, ...] = ()


def right_case(seed: int) -> Case:
    """A random recording without fault: radar, track, scene, noise and converter."""
    rng = np.random.default_rng([seed, 22])
    kind = KINDS[seed % len(KINDS)]
    radar, n_samples, range_m, track, rate_hz = _MAKERS[kind](rng)
    half = (0.08 if kind == 'drone' else 0.16) * range_m  # what its antenna sees
    spacing = max(0.4 * radar.range_resolution_m, 2 * half / 160)
    grid = MapGrid.from_size((0.0, range_m, 0.0), 2 * half, 2 * half, spacing)
    n_scatterers = int(rng.integers(4, 25))
    points = np.c_[rng.uniform(-0.9, 0.9, (n_scatterers, 2)) * half + [0.0, range_m],
                   np.zeros(n_scatterers)]
    amplitudes = rng.rayleigh(0.6, n_scatterers) * np.exp(2j * np.pi * rng.random(n_scatterers))
    amplitudes[:2] *= 2.5 / np.abs(amplitudes[:2])
    n_channels = 1 if radar.waveform == Waveform.PASSBAND else int(rng.integers(1, 5))
    places = (np.arange(n_channels) - (n_channels - 1) / 2) * rng.uniform(0.5, 2.0)
    centres = track[:, None] + places[:, None] * radar.wavelength_m * np.array([1.0, 0.0, 0.0])
    samples = EchoSimulator(radar, n_samples, compressed=False, points_m=points,
                            amplitudes=amplitudes)(centres, centres)
    rms = math.sqrt(np.mean(np.square(np.abs(samples))))
    noise = 10 ** (rng.uniform(-6.0, 3.0) / 20) * rms
    samples = samples + noise / math.sqrt(2) * (
        rng.standard_normal(samples.shape) + 1j * rng.standard_normal(samples.shape))
    if radar.waveform.is_real:
        samples = samples.real
    largest = max(np.abs(samples.real).max(), np.abs(samples.imag).max())
    scale = 2.0 ** math.ceil(math.log2(largest * rng.uniform(1.0, 3.0)))
    samples = quantise(samples + 0j, int(rng.integers(10, 17)), scale)
    jitter_s = rng.uniform(0.0, 2e-6, len(track))  # of a radar that stamps its own pulses
    stamps = _START_NS + np.rint(1e9 * (np.arange(len(track)) / rate_hz + jitter_s)
                                 ).astype(np.int64)
    block = PulseBlock(radar, False, stamps, np.arange(len(track)) + int(rng.integers(1000)),
                       samples, centres, centres)
    return Case(kind, block, grid, attitude=turning(kind, seed, len(track)))


def turning(kind: str, seed: int, n: int) -> Rotation:
    """Attitudes of a platform at n pulses: of a slider and a rail mostly its yaw, by a degree."""
    rng = np.random.default_rng([seed, 23])
    time = np.linspace(0.0, 1.0, n)[:, None]
    waves = sum(rng.standard_normal(3) * np.sin(
        2 * np.pi * (rng.uniform(0.6, 1.2, 3) * k * time + rng.random(3))) for k in (1, 2, 3))
    guided = kind in ('slider', 'rail', 'mimo')
    rms_deg = rng.uniform(0.3, 1.0) * np.array([0.3, 0.3, 1.0]) if guided else rng.uniform(
        1.5, 4.0, 3)
    return Rotation.from_rotvec(np.radians(rms_deg) * waves / waves.std(axis=0))


def measured_cases() -> Iterator[Case]:
    """The measured recordings, loaded as `sar-imaging load` does; none where they are absent."""
    if DATA.is_dir():
        for make in MEASURED.values():
            recording = make()
            arm = rotating_arm(recording.block) if recording.name == 'arcsar' else None
            yield Case(recording.name, recording.block, recording.grid, recording.window, arm)


def rotating_arm(block: PulseBlock) -> Rotation:
    """Attitudes of an arm that turns about the origin, x along it."""
    x, y = block.phase_centre_m[:, :2].T
    return Rotation.from_rotvec(np.arctan2(y, x)[:, None] * [0.0, 0.0, 1.0])


def _track(rng, n: int, length_m: float, height_m: float, wander: float) -> np.ndarray:
    """Along x, not quite uniform and not quite straight."""
    u = np.linspace(-0.5, 0.5, n)
    a, b, c = rng.uniform(0, 2 * np.pi, 3)
    # speed varies by some tens of per cent: a constant one hides errors of the clock
    x = length_m * (u + rng.uniform(0.04, 0.08) * np.sin(2 * np.pi * u * rng.uniform(1, 2) + a))
    return np.c_[x, wander * np.sin(2 * np.pi * rng.uniform(0.8, 2.0) * u + b),
                 height_m + wander * np.sin(2 * np.pi * rng.uniform(0.8, 2.0) * u + c)]


def _slider(rng):
    start = rng.choice([60e9, 77e9])
    radar = fmcw_parameters(start_frequency_hz=start, slope_hz_per_s=rng.uniform(40e12, 80e12),
                            sample_rate_hz=5e6, n_samples=256, adc_start_s=6e-6)
    n = int(rng.integers(320, 480))
    range_m = rng.uniform(2.0, 5.0)
    track = _track(rng, n, n * 0.24 * radar.wavelength_m, rng.uniform(0.1, 0.5), 1e-3)
    return radar, 256, range_m, track, rng.uniform(50, 500)


def _rail(rng):
    radar = fmcw_parameters(start_frequency_hz=24e9, slope_hz_per_s=rng.uniform(8e12, 15e12),
                            sample_rate_hz=2.5e6, n_samples=256, adc_start_s=6e-6,
                            **({'real_samples': True} if rng.random() < 0.3 else {}))
    n = int(rng.integers(320, 480))
    range_m = rng.uniform(6.0, 15.0)
    track = _track(rng, n, n * 0.3 * radar.wavelength_m, rng.uniform(0.5, 2.0), 4e-3)
    return radar, 256, range_m, track, rng.uniform(20, 200)


def _drone(rng):
    bandwidth = rng.uniform(150e6, 400e6)
    rate = 1.25 * bandwidth
    pulse_s = rng.uniform(0.4e-6, 0.8e-6)
    range_m = rng.uniform(250.0, 600.0)
    half = 0.2 * range_m
    start = 2 * (range_m - half) / SPEED_OF_LIGHT
    n_samples = int(math.ceil((pulse_s + 4 * half / SPEED_OF_LIGHT) * rate / 2) * 2)
    sign = rng.choice([-1, 1])
    radar = RadarParameters(rng.choice([5.4e9, 9.6e9]), bandwidth, rate, start, pulse_s,
                            sign * bandwidth / pulse_s, Waveform.LFM)
    n = int(rng.integers(240, 360))
    # pulses as close as the width of the scene demands
    track = _track(rng, n, n * rng.uniform(1.5, 3.0) * radar.wavelength_m,
                   rng.uniform(30.0, 100.0), 0.5)
    return radar, n_samples, range_m, track, rng.uniform(50, 200)


def _uwb(rng):
    radar = RadarParameters(3.95e9, 1.5e9, 16.384e9, 2 * 2.0 / SPEED_OF_LIGHT,
                            waveform=Waveform.PASSBAND)
    n = int(rng.integers(240, 400))
    range_m = rng.uniform(6.0, 11.0)
    track = _track(rng, n, rng.uniform(4.0, 8.0), rng.uniform(0.5, 4.0), 0.05)
    return radar, 1536, range_m, track, rng.uniform(20, 100)


_MAKERS = {'slider': _slider, 'rail': _rail, 'drone': _drone, 'uwb': _uwb}
