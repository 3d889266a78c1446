# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Right recordings, simulated and measured, into which the campaign of mistakes injects them."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from benchmarks.measured.image_arcsar import arm_angles
from sar_imaging.geometry.grids import MapGrid
from sar_imaging.recordings import load
from sar_imaging.signal.dechirp import fmcw_parameters
from sar_imaging.signal.positioning import locate
from sar_imaging.signal.pulses import PulseBlock, concatenate
from sar_imaging.signal.radar import SPEED_OF_LIGHT, RadarParameters, Waveform
from sar_imaging.simulation.echoes import EchoSimulator
from sar_imaging.simulation.scenarios import SCENARIOS

DATA = Path(__file__).resolve().parents[2] / '..' / 'shared' / 'data'
START_NS = 1_700_000_000_000_000_000
_ARC_BEAM_DEG = 35.0  # the antenna sees no further to its sides


@dataclasses.dataclass(frozen=True)
class Recording:
    """One aperture of raw pulses or range profiles with positions, and where to image it.

    Parameters
    ----------
    name : str
        For the tables.
    block : PulseBlock
        The pulses.
    grid : MapGrid
        Pixels to image.
    fmcw : dict
        Arguments of `fmcw_parameters` that its radar came from; empty for others.
    window : str
        Of the range compression.
    """

    name: str
    block: PulseBlock
    grid: MapGrid
    fmcw: dict = dataclasses.field(default_factory=dict)
    window: str = 'none'


def _noise(generator, shape) -> np.ndarray:
    return (generator.standard_normal(shape) + 1j * generator.standard_normal(shape)) / 2**0.5


def _simulated(radar, n_samples, compressed, track_m, time_s, scene, noise_std, seed):
    """Block of a one-channel radar over point scatterers in noise."""
    generator = np.random.default_rng(seed)
    amplitudes = generator.rayleigh(0.5, len(scene)) * np.exp(
        2j * np.pi * generator.random(len(scene)))
    amplitudes[:3] = 2.0
    simulator = EchoSimulator(radar, n_samples, compressed=compressed, points_m=scene,
                              amplitudes=amplitudes)
    centres = np.asarray(track_m)[:, None]
    samples = simulator(centres, centres)
    samples = samples + noise_std * _noise(generator, samples.shape)
    stamps = START_NS + np.rint(1e9 * time_s).astype(np.int64)
    return PulseBlock(radar, compressed, stamps, np.arange(len(time_s)), samples, centres,
                      centres)


def _points(generator, grid: MapGrid, n: int) -> np.ndarray:
    half = 0.45 * np.array([grid.n_x - 1, grid.n_y - 1]) * grid.spacing_m
    places = np.asarray(grid.centre_m[:2]) + generator.uniform(-1, 1, (n, 2)) * half
    return np.c_[places, np.full(n, grid.z_m)]


def rail(scene: bool = True) -> Recording:
    """FMCW radar at 24 GHz on a rail that starts and stops, ground level scene ahead of it."""
    fmcw = {'start_frequency_hz': 23.5e9, 'slope_hz_per_s': 10e12, 'sample_rate_hz': 2.5e6,
            'n_samples': 256, 'adc_start_s': 6e-6}
    radar = fmcw_parameters(**fmcw)
    n = 480
    time_s = np.arange(n) / 100.0
    # 2 m along x; the carriage is slow twice, never twice in the same way.
    phase = time_s / time_s[-1]
    x = 2.0 * (phase + 0.09 * np.sin(8.0 * phase + 0.5) + 0.03 * np.sin(19.0 * phase)) - 1.0
    wander = 0.004 * np.sin(2 * np.pi * 1.3 * phase + 0.4)
    track = np.c_[x, wander, 1.0 + 0.003 * np.cos(2 * np.pi * 1.7 * phase)]
    grid = MapGrid.from_size((0.5, 7.0, 0.0), 6.0, 6.0, 0.025)
    generator = np.random.default_rng(1)
    points = _points(generator, grid, 30 if scene else 1)
    block = _simulated(radar, 256, False, track, time_s, points, 1.0, 2)
    if not scene:
        block = _only_noise(block)
    return Recording('rail', block, grid, fmcw)


def drone(scene: bool = True) -> Recording:
    """UWB profiles from a drone that drifts past a ground scene."""
    radar = RadarParameters(4.0e9, 1.2e9, 2.4e9, 2 * 8.0 / SPEED_OF_LIGHT,
                            waveform=Waveform.STEPPED_FREQUENCY)
    n = 400
    time_s = np.arange(n) / 50.0
    phase = time_s / time_s[-1]
    track = np.c_[12.0 * (phase - 0.5) + 0.5 * np.sin(2 * np.pi * phase),
                  0.4 * np.sin(2 * np.pi * 1.2 * phase + 1.0),
                  10.0 + 0.25 * np.cos(2 * np.pi * 1.6 * phase)]
    grid = MapGrid.from_size((1.0, 20.0, 0.0), 16.0, 14.0, 0.05)
    generator = np.random.default_rng(3)
    block = _simulated(radar, 512, True, track, time_s, _points(generator, grid, 30), 0.3, 4)
    if not scene:
        block = _only_noise(block)
    return Recording('drone', block, grid)


def _only_noise(block: PulseBlock) -> PulseBlock:
    generator = np.random.default_rng(5)
    return dataclasses.replace(block, samples=_noise(generator, block.samples.shape))


def spotlight() -> Recording:
    """The spotlight scenario: raw LFM pulses of five channels from a light aircraft."""
    scenario = SCENARIOS['spotlight']()
    pulses = concatenate(list(scenario.blocks()))
    return Recording('spotlight', pulses.select(slice(0, scenario.pulses_per_aperture)),
                     scenario.grid)


def arcsar() -> Recording:
    """Measured: 77 GHz FMCW radar on a rotating arm, the pulses that see the points."""
    block = load('arcsar_7', DATA / 'arcsar_77ghz').block
    angle = arm_angles(block.n_pulses)
    block = block.select(np.abs(np.degrees(angle) - 90) < _ARC_BEAM_DEG)
    fmcw = {'start_frequency_hz': 77e9, 'slope_hz_per_s': 39.058e12, 'sample_rate_hz': 2.652e6,
            'n_samples': block.n_samples, 'adc_start_s': 3.94e-6}
    grid = MapGrid.from_size((0.0, 5.0, 0.0), 8.0, 8.0, 0.02)
    return Recording('arcsar', block, grid, fmcw, 'taylor:4:35')


def mimo() -> Recording:
    """Measured: 60 GHz MIMO radar on a slider."""
    path = DATA / 'mimo_sar_60ghz' / 'mimo_chair.npz'
    block = load('mimo_60ghz', path).block
    with np.load(path) as data:
        fmcw = {'start_frequency_hz': float(data['f_start_hz']),
                'slope_hz_per_s': float(data['slope_hz_per_s']),
                'sample_rate_hz': float(data['fs_hz']), 'n_samples': block.n_samples}
    grid = MapGrid.from_size((0.0, 2.0, -0.2), 3.2, 2.8, 0.01)
    return Recording('mimo', block, grid, fmcw, 'hamming')


def gotcha() -> Recording:
    """Measured: airborne X-band spotlight."""
    block = load('gotcha', DATA / 'gotcha_pass1_hh').block
    return Recording('gotcha', block, MapGrid.from_size((0.0, 0.0, 0.0), 100.0, 100.0, 0.2))


def team6() -> Recording:
    """Measured: UWB radar on a rail with motion capture."""
    block = _rail('team6_rail_fitted')
    return Recording('team6', block, MapGrid.from_size((1.0, 1.5, 0.04), 8.0, 8.0, 0.04))


def team5() -> Recording:
    """Measured: another UWB radar on another rail."""
    block = _rail('team5_rail')
    return Recording('team5', block, MapGrid.from_size((0.0, 2.5, 0.067), 8.0, 7.0, 0.04))


def _rail(name: str) -> PulseBlock:
    """Pulses of a rail pass with their positions."""
    rail = load(name, DATA / f'bwsi2019_{name.removesuffix("_fitted")}')
    return locate(rail.block, rail.poses, rail.alignment)


SIMULATED: dict[str, Callable[[], Recording]] = {
    'rail': rail, 'spotlight': spotlight, 'drone': drone}
MEASURED: dict[str, Callable[[], Recording]] = {
    'arcsar': arcsar, 'mimo': mimo, 'gotcha': gotcha, 'team6': team6, 'team5': team5}


def recordings(names=None) -> Iterator[Recording]:
    """The recordings by name, all if left out; measured ones where the data is there."""
    for name, make in {**SIMULATED, **(MEASURED if DATA.is_dir() else {})}.items():
        if not names or name in names:
            yield make()


def others() -> Iterator[Recording]:
    """Right recordings on which nothing may be named: all scenarios, clutter, noise alone."""
    for name, make in SCENARIOS.items():
        scenario = make()
        block = concatenate(list(scenario.blocks()))
        yield Recording(f'scenario {name}', block.select(slice(0, scenario.pulses_per_aperture)),
                        scenario.grid)
    for make in (rail, drone):
        r = make(scene=False)
        yield dataclasses.replace(r, name=f'{r.name}, noise alone')
    r = spotlight()
    yield dataclasses.replace(r, name='spotlight, noise alone', block=_only_noise(r.block))
