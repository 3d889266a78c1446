# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Right recordings of families that the doctor was not tuned on, by echoes of their own code.

Nothing here comes from the package's simulator: echoes are written down from the equations of
`sar_imaging.signal.radar`, one scatterer after the other.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from scipy.spatial.transform import Rotation

from sar_imaging.geometry.grids import MapGrid
from sar_imaging.signal.pulses import PulseBlock
from sar_imaging.signal.radar import RadarParameters, Waveform

from .doctor_cases import Case, turning

_C = 299_792_458.0
_START_NS = 1_700_000_000_000_000_000


def beats(f_start_hz, slope, rate_hz, n, adc_s, delays_s, amplitudes) -> np.ndarray:
    """(P, C, N) beat signals of dechirped ramps, of scatterers at delays (P, C, S)."""
    t = adc_s + np.arange(n) / rate_hz
    out = np.zeros((*delays_s.shape[:2], n), complex)
    for s, amplitude in enumerate(amplitudes):
        tau = delays_s[..., s, None]
        cycles = (f_start_hz + slope * t) * tau - 0.5 * slope * tau**2
        out += amplitude * np.exp(-2j * np.pi * np.remainder(cycles, 1.0))
    return out


def fmcw(f_start_hz, slope, rate_hz, n, adc_s) -> RadarParameters:
    """Radar of `beats`."""
    return RadarParameters(
        f_start_hz + slope * (adc_s + (n - 1) / 2 / rate_hz), slope * n / rate_hz, rate_hz, 0.0,
        n / rate_hz, slope, Waveform.FMCW)


def steps(carrier_hz, bandwidth_hz, n, reference_s, delays_s, amplitudes) -> np.ndarray:
    """(P, C, N) phase histories of a stepped-frequency radar."""
    f = carrier_hz + (np.arange(n) - (n - 1) / 2) * bandwidth_hz / n
    out = np.zeros((*delays_s.shape[:2], n), complex)
    for s, amplitude in enumerate(amplitudes):
        cycles = f * (delays_s[..., s, None] - reference_s)
        out += amplitude * np.exp(-2j * np.pi * np.remainder(cycles, 1.0))
    return out


def wavelets(carrier_hz, bandwidth_hz, rate_hz, n, start_s, delays_s, amplitudes) -> np.ndarray:
    """(P, C, N) real samples of Gaussian pulses on their carrier."""
    t = start_s + np.arange(n) / rate_hz
    out = np.zeros((*delays_s.shape[:2], n))
    for s, amplitude in enumerate(amplitudes):
        u = t - delays_s[..., s, None]
        out += amplitude * np.exp(-(math.pi * bandwidth_hz / 2 * u)**2 / 1.4) * np.cos(
            2 * np.pi * carrier_hz * u)
    return out


def delays(tx_m, rx_m, points_m, speed=_C) -> np.ndarray:
    """(P, C, S) two-way delays."""
    return (np.linalg.norm(tx_m[:, :, None] - points_m, axis=-1)
            + np.linalg.norm(rx_m[:, :, None] - points_m, axis=-1)) / speed


def _scattered(rng, n, centre, half, z=0.0, strong=2):
    points = np.c_[rng.uniform(-0.9, 0.9, (n, 2)) * half + centre[:2], np.full(n, z)]
    amplitudes = rng.rayleigh(0.6, n)
    amplitudes[:strong] = rng.uniform(1.5, 3.0, strong)
    return points, amplitudes


def _case(rng, kind, radar, samples, tx, rx, rate_hz, grid, *, window='none', snr_db=None,
          attitude=None) -> Case:
    real = np.isrealobj(samples)
    rms = math.sqrt(np.mean(np.square(np.abs(samples))))
    noise = 10 ** (-(rng.uniform(0, 15) if snr_db is None else snr_db) / 20) * rms
    samples = samples + noise * (rng.standard_normal(samples.shape) + (
        0 if real else 1j * rng.standard_normal(samples.shape))) / (1 if real else math.sqrt(2))
    n = len(tx)
    stamps = _START_NS + np.rint(1e9 * np.arange(n) / rate_hz).astype(np.int64)
    block = PulseBlock(radar, False, stamps, np.arange(n), samples.astype(np.complex64), tx, rx)
    return Case(kind, block, grid, window, attitude)


def _path(rng, n, length_m, wander_m, height_m) -> np.ndarray:
    """(P, 1, 3) places along x at uneven speed, with smooth errors beside the line."""
    u = np.linspace(-0.5, 0.5, n)
    a = rng.uniform(0, 2 * np.pi, 6)
    x = length_m * (u + rng.uniform(0.03, 0.07) * np.sin(2 * np.pi * rng.uniform(1, 2) * u + a[0]))
    y, z = (wander_m * (np.sin(2 * np.pi * rng.uniform(0.7, 1.5) * u + a[k])
                        + 0.4 * np.sin(2 * np.pi * rng.uniform(2, 3) * u + a[k + 1]))
            for k in (1, 3))
    return np.c_[x, y, height_m + z][:, None]


def _rail(rng, kind, points, amplitudes, range_m, half, *, n=None, n_channels=None, snr_db=None):
    n = n or int(rng.integers(240, 400))
    radar = 23.5e9, rng.uniform(8e12, 14e12), 2.5e6, 256, 6e-6
    wavelength = _C / 24e9
    track = _path(rng, n, n * 0.3 * wavelength, 4e-3, rng.uniform(0.5, 2.0))
    n_channels = n_channels or int(rng.integers(1, 4))
    places = (np.arange(n_channels) - (n_channels - 1) / 2) * rng.uniform(0.5, 1.5) * wavelength
    centres = track + places[:, None] * [1.0, 0.0, 0.0]
    samples = beats(*radar, delays(centres, centres, points), amplitudes)
    return _case(rng, kind, fmcw(*radar), samples, centres, centres, rng.uniform(20, 200),
                 MapGrid.from_size((0, range_m, 0), 2 * half, 2 * half, half / 60),
                 snr_db=snr_db, attitude=turning('rail', int(rng.integers(1 << 30)), n))


def few(rng) -> Case:
    """One to three strong scatterers and hardly anything else."""
    range_m = rng.uniform(6, 14)
    half = 0.2 * range_m
    points, amplitudes = _scattered(rng, int(rng.integers(1, 4)), (0, range_m), half, strong=1)
    return _rail(rng, 'few', points, amplitudes, range_m, half)


def clutter(rng) -> Case:
    """Speckle of a rough plane, nothing brighter."""
    range_m = rng.uniform(6, 12)
    half = 0.2 * range_m
    points, _ = _scattered(rng, 1500, (0, range_m), 1.3 * half, strong=0)
    amplitudes = (rng.standard_normal(1500) + 1j * rng.standard_normal(1500))
    return _rail(rng, 'clutter', points, amplitudes, range_m, half, snr_db=15)


def near(rng) -> Case:
    """60 GHz at some decimetres: angles and migration are large."""
    range_m = rng.uniform(0.4, 0.9)
    half = 0.3 * range_m
    points, amplitudes = _scattered(rng, int(rng.integers(4, 16)), (0, range_m), half)
    radar = 60e9, rng.uniform(50e12, 90e12), 5e6, 256, 5e-6
    n = int(rng.integers(240, 400))
    track = _path(rng, n, n * 1.2e-3, 8e-4, rng.uniform(0.02, 0.2))
    samples = beats(*radar, delays(track, track, points), amplitudes)
    return _case(rng, 'near', fmcw(*radar), samples, track, track, rng.uniform(50, 300),
                 MapGrid.from_size((0, range_m, 0), 2 * half, 2 * half, half / 60),
                 attitude=turning('slider', int(rng.integers(1 << 30)), n))


def bistatic(rng) -> Case:
    """A transmitter that stands still and a receiver that moves, or both apart on a vehicle."""
    range_m = rng.uniform(80, 200)
    half = 0.12 * range_m
    points, amplitudes = _scattered(rng, int(rng.integers(4, 24)), (0, range_m), half)
    carrier, bandwidth, n_f = 9.6e9, rng.uniform(200e6, 400e6), 320
    n = int(rng.integers(240, 360))
    rx = _path(rng, n, n * rng.uniform(0.6, 1.0) * _C / carrier * 2, 0.1, rng.uniform(10, 40))
    tx = (np.broadcast_to(rng.uniform([-60, -20, 5], [60, 20, 40]), rx.shape).copy()
          if rng.random() < 0.5 else rx + rng.uniform([-4, -1, -1], [4, 1, 1]))
    reference = 2 * range_m / _C
    samples = steps(carrier, bandwidth, n_f, reference, delays(tx, rx, points), amplitudes)
    radar = RadarParameters(carrier, bandwidth, bandwidth, reference,
                            waveform=Waveform.STEPPED_FREQUENCY)
    return _case(rng, 'bistatic', radar, samples, tx, rx, rng.uniform(50, 200),
                 MapGrid.from_size((0, range_m, 0), 2 * half, 2 * half, half / 60))


def ground(rng) -> Case:
    """Ground penetrating radar: real pulses in a medium, layers, hyperbolas; some as spectra."""
    speed = _C / math.sqrt(rng.uniform(4, 10))
    carrier = rng.uniform(0.6e9, 1.6e9)
    bandwidth, rate, n_s = 0.9 * carrier, 16 * carrier, 512
    depth = 0.35 * n_s / rate * speed / 2
    n = int(rng.integers(160, 320))
    track = _path(rng, n, rng.uniform(1.5, 3.0) * depth, 0.02 * depth, 0.0)
    offset = rng.uniform(0.02, 0.08)
    tx, rx = track - [offset, 0, 0], track + [offset, 0, 0]
    k = int(rng.integers(2, 8))
    half = 0.45 * depth
    points = np.c_[rng.uniform(-0.9, 0.9, k) * half, depth + rng.uniform(-0.9, 0.9, k) * half,
                   np.zeros(k)]
    tau = delays(tx, rx, points, speed)
    layers = rng.uniform(0.5, 1.4, int(rng.integers(1, 4))) * depth * 2 / speed
    wavy = layers * (1 + 0.002 * np.sin(np.linspace(0, 5, n))[:, None, None])
    tau = np.concatenate([tau, wavy, np.full((n, 1, 1), 2 * offset / speed)], axis=-1)
    amplitudes = np.r_[rng.uniform(0.5, 2, k), rng.uniform(0.3, 2, len(layers)), 3.0]
    real = wavelets(carrier, bandwidth, rate, n_s, 0.0, tau, amplitudes)
    grid = MapGrid.from_size((0, depth, 0), 2 * half, 2 * half, half / 60)
    if rng.random() < 0.5:  # real samples, as they are
        radar = RadarParameters(carrier, bandwidth, rate, 0.0, waveform=Waveform.PASSBAND,
                                propagation_speed_m_per_s=speed)
        return _case(rng, 'ground', radar, real, tx, rx, 50.0, grid, snr_db=20)
    # the spectrum of gated real samples, as many archives hold it
    spectrum = np.fft.rfft(real, axis=-1)
    f = np.fft.rfftfreq(n_s, 1 / rate)
    band = np.flatnonzero((f > carrier - bandwidth / 2) & (f < carrier + bandwidth / 2))
    step = f[1] - f[0]
    middle = (f[band[0]] + f[band[-1]]) / 2
    reference = rng.choice([0.0, n_s / rate / 2])
    samples = spectrum[..., band] * np.exp(2j * np.pi * f[band] * reference)
    radar = RadarParameters(middle, len(band) * step, len(band) * step, reference,
                            waveform=Waveform.STEPPED_FREQUENCY, propagation_speed_m_per_s=speed)
    return _case(rng, 'ground', radar, samples, tx, rx, 50.0, grid, snr_db=20)


def wide(rng) -> Case:
    """A radar on a rotating arm, facing outward; its pivot stands still."""
    n = int(rng.integers(300, 420))
    arm = rng.uniform(0.15, 0.6)
    half_turn = rng.uniform(0.6, 1.1)
    u = np.linspace(-1, 1, n)
    angle = np.pi / 2 + half_turn * (u + rng.uniform(0.02, 0.05) * np.sin(5 * u + rng.random()))
    track = arm * np.c_[np.cos(angle), np.sin(angle), 0 * angle][:, None]
    attitude = Rotation.from_rotvec(angle[:, None] * [0.0, 0.0, 1.0])
    range_m = rng.uniform(2.5, 6)
    half = 0.4 * range_m
    points, amplitudes = _scattered(rng, int(rng.integers(4, 20)), (0, range_m), half)
    start = rng.choice([24e9, 77e9])
    radar = start, rng.uniform(20e12, 50e12), 2.6e6, 256, 4e-6
    beam = np.exp(-(np.angle(np.exp(1j * (np.arctan2(points[:, 1], points[:, 0])
                                          - angle[:, None]))) / 0.6)**2)
    tau = delays(track, track, points)
    t = radar[4] + np.arange(256) / radar[2]
    samples = np.zeros((n, 1, 256), complex)
    for s, amplitude in enumerate(amplitudes):
        x = tau[..., s, None]
        samples += (amplitude * beam[:, s, None, None]) * np.exp(-2j * np.pi * np.remainder(
            (radar[0] + radar[1] * t) * x - 0.5 * radar[1] * x**2, 1.0))
    return _case(rng, 'wide', fmcw(*radar), samples, track, track, rng.uniform(20, 100),
                 MapGrid.from_size((0, range_m, 0), 2 * half, 2 * half, half / 60),
                 attitude=attitude)


def short(rng) -> Case:
    """Twenty to eighty pulses."""
    range_m = rng.uniform(6, 12)
    half = 0.2 * range_m
    points, amplitudes = _scattered(rng, int(rng.integers(4, 16)), (0, range_m), half)
    return _rail(rng, 'short', points, amplitudes, range_m, half, n=int(rng.integers(20, 80)))


def raster(rng) -> Case:
    """Rows of a scanner before an object with a straight edge that flashes."""
    range_m = rng.uniform(0.5, 1.0)
    half = 0.35 * range_m
    points, amplitudes = _scattered(rng, int(rng.integers(6, 20)), (0, range_m), half)
    edge = np.c_[np.full(40, rng.uniform(-0.3, 0.3) * half),
                 np.full(40, range_m + rng.uniform(-0.3, 0.3) * half), np.linspace(-0.3, 0.3, 40)]
    points, amplitudes = np.r_[points, edge], np.r_[amplitudes, np.full(40, 0.5)]
    return _scanner(rng, 'raster', points, amplitudes, (0.0, range_m, 0.0), half)


def volume(rng) -> Case:
    """Rows of a scanner before objects at all heights, one of which is imaged."""
    range_m = rng.uniform(0.5, 1.0)
    half = 0.35 * range_m
    points, amplitudes = _scattered(rng, int(rng.integers(20, 60)), (0, range_m), half)
    points[:, 2] = rng.uniform(-half, half, len(points))
    height_m = float(points[int(rng.integers(len(points))), 2])  # of one of the objects
    return _scanner(rng, 'volume', points, amplitudes, (0.0, range_m, height_m), half)


def _scanner(rng, kind, points, amplitudes, centre, half) -> Case:
    columns, rows = (int(v) for v in rng.integers(24, 40, 2))
    carrier = rng.choice([22e9, 28e9])
    pitch = 0.35 * _C / carrier
    x, z = np.meshgrid(pitch * (np.arange(columns) - columns / 2),
                       pitch * (np.arange(rows) - rows / 2))
    track = np.c_[x.ravel(), 0 * x.ravel(), z.ravel()][:, None]
    bandwidth, n_f = rng.uniform(4e9, 8e9), 128
    reference = rng.choice([0.0, 2 * centre[1] / _C])
    samples = steps(carrier, bandwidth, n_f, reference, delays(track, track, points), amplitudes)
    radar = RadarParameters(carrier, bandwidth, bandwidth, reference,
                            waveform=Waveform.STEPPED_FREQUENCY)
    return _case(rng, kind, radar, samples, track, track, rng.uniform(20, 100),
                 MapGrid.from_size(centre, 2 * half, 2 * half, half / 60))


def hover(rng) -> Case:
    """Ultra-wideband radar on a drone: level flight between two hovers, at uneven speed."""
    n, rate_hz = 800, 100.0
    t = np.arange(n) / rate_hz
    rise, fall = rng.uniform(0.5, 1.5), rng.uniform(6.0, 7.5)
    speed = np.clip((t - rise) / 1.0, 0, 1) * np.clip((fall - t) / 1.0, 0, 1)
    x = np.cumsum(speed * (1 + 0.1 * np.sin(2.2 * t + rng.random()))) / rate_hz
    x = (x - x.mean()) * rng.uniform(0.8, 1.3)
    a = rng.uniform(0, 6, 4)
    track = np.c_[x, 0.05 * np.sin(0.9 * t + a[0]) + 0.01 * np.sin(4 * t + a[1]),
                  rng.uniform(2, 5) + 0.04 * np.sin(1.1 * t + a[2])][:, None]
    heading = rng.uniform(0, 2 * np.pi)
    turn = Rotation.from_rotvec([0, 0, heading])
    range_m = rng.uniform(5, 9)
    half = 0.3 * range_m
    points, amplitudes = _scattered(rng, int(rng.integers(3, 14)), (0, range_m), half)
    carrier, bandwidth, rate, n_s = 3.95e9, 1.5e9, 16.384e9, 1536
    start = 2 * max(0.5, range_m - 1.5 * half - 1.0) / _C
    samples = wavelets(carrier, bandwidth, rate, n_s, start, delays(track, track, points),
                       amplitudes)
    radar = RadarParameters(carrier, bandwidth, rate, start, waveform=Waveform.PASSBAND)
    track = turn.apply(track[:, 0])[:, None]
    centre = turn.apply([0, range_m, 0])
    return _case(rng, 'hover', radar, samples, track, track, rate_hz,
                 MapGrid.from_size(tuple(centre), 2.4 * half, 2.4 * half, half / 60),
                 attitude=turning('drone', int(rng.integers(1 << 30)), n))


def upright(rng) -> Case:
    """Two or three transmitters and four receivers, upright on a slider."""
    range_m = rng.uniform(1.2, 2.5)
    half = 0.3 * range_m
    points, amplitudes = _scattered(rng, int(rng.integers(4, 16)), (0, range_m), half)
    points[:, 2] = 0.0
    radar = 60e9, rng.uniform(30e12, 60e12), 4e6, 256, 5e-6
    n = int(rng.integers(100, 180))
    pitch = _C / 61e9 / 2
    track = _path(rng, n, n * 0.9e-3, 6e-4, rng.uniform(0.3, 0.8))
    n_tx = int(rng.integers(2, 4))
    up = np.array([0.0, 0.0, 1.0])
    tx = track + np.repeat(4 * pitch * np.arange(n_tx), 4)[:, None] * up
    rx = track + np.tile(pitch * np.arange(4), n_tx)[:, None] * up
    samples = beats(*radar, delays(tx, rx, points), amplitudes)
    return _case(rng, 'upright', fmcw(*radar), samples, tx, rx, rng.uniform(20, 100),
                 MapGrid.from_size((0, range_m, 0), 2 * half, 2 * half, half / 60))


FAMILIES: dict[str, Callable[[np.random.Generator], Case]] = {
    'few': few, 'clutter': clutter, 'near': near, 'bistatic': bistatic, 'ground': ground,
    'wide': wide, 'short': short, 'raster': raster, 'hover': hover, 'upright': upright,
    'volume': volume}


def family_case(name: str, seed: int) -> Case:
    """A random right recording of a family."""
    return FAMILIES[name](np.random.default_rng([seed, list(FAMILIES).index(name)]))
