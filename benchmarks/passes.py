# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Two simulated passes compared: figures and the picture of docs/exploitation.md.

Run from the repository root: ``python -m benchmarks.passes``, five minutes. False
alarms are those of echoes simulated apart from the package (`support.echoes`).
"""

from __future__ import annotations

import argparse
import dataclasses
import itertools
import json
import pathlib

import numpy as np
from matplotlib.colors import ListedColormap
from scipy.ndimage import uniform_filter
from tqdm import tqdm

from sar_imaging.exploitation.passes import PassComparison, compare_passes
from sar_imaging.geometry import MapGrid
from sar_imaging.imaging.imager import plan_image
from sar_imaging.signal.pulses import concatenate
from sar_imaging.simulation.scenarios import SCENARIOS
from sar_imaging.simulation.scenarios.catalogue import (
    BASELINE_M,
    CAR_M,
    TERRACE_HEIGHT_M,
    TERRACE_M,
)

from .exploitation_figures import FOLDER, decibels, draw, panels
from .support.echoes import C, block_of, profiles, radar_of
from .support.machine import machine

RESULTS = pathlib.Path(__file__).parent / 'results' / 'passes.json'
RATE = 1e-4
WINDOW = 7
COHERENCES = (0.0, 0.3, 0.6, 0.8, 0.9, 0.95, 0.97, 0.99)
FAR_M = 12.0  # from a car: its sidelobes are below the noise


@dataclasses.dataclass(frozen=True)
class Geometry:
    """Of pairs without a change."""

    carrier_hz: float
    bandwidth_hz: float
    ground_m: float
    height_m: float
    track_m: float
    size_m: float
    spacing_m: float


GEOMETRIES = {
    'aeroplane, 1 km': Geometry(10e9, 300e6, 700.0, 700.0, 30.0, 36.0, 0.25),
    'aeroplane, 6 km': Geometry(10e9, 150e6, 5000.0, 3000.0, 60.0, 150.0, 0.8),
    'drone, 47 m': Geometry(10e9, 400e6, 40.0, 25.0, 6.0, 20.0, 0.15),
    'rail, 150 m': Geometry(17.2e9, 200e6, 150.0, 20.0, 2.0, 60.0, 0.4),
    'car radar, 15 m': Geometry(77e9, 1e9, 15.0, 3.0, 0.3, 9.0, 0.07)}


def image_pass(name: str, offset_m=(0.0, 0.0, 0.0)):
    """Image of a pass flown beside its track, and its phase centres."""
    scenario = SCENARIOS[name]()
    track = dataclasses.replace(
        scenario.trajectory, centre_m=tuple(np.add(scenario.trajectory.centre_m, offset_m)))
    block = concatenate(list(dataclasses.replace(scenario, trajectory=track).blocks(70)))
    image = plan_image(scenario.grid, block.radar, block.n_samples)(block)
    return image, block.phase_centre_m


def compare(offset_m) -> tuple[np.ndarray, PassComparison]:
    """First image, and the comparison with the second pass flown somewhere else."""
    first, track = image_pass('first_pass')
    second, other = image_pass('second_pass', offset_m)
    return first.samples, compare_passes(first, second, false_alarm_rate=RATE,
                                         tracks_m=(track, other))


def clutter_images(geometry: Geometry, n_images: int) -> tuple[list, float]:
    """Images of speckle without anything in common, and looks by the variance of their power.

    Scatterers of Gaussian amplitude stand half a resolution cell apart, so that the power is even.
    """
    g, rng = geometry, np.random.default_rng(3)
    near = np.hypot(g.ground_m - g.size_m / 2, g.height_m)
    across = C / (2 * g.bandwidth_hz) * near / (g.ground_m - g.size_m / 2)
    along = C / g.carrier_hz * near / (2 * g.track_m)
    axes = [np.arange(-g.size_m / 2 - 5 * cell, g.size_m / 2 + 5 * cell, cell / 2.2)
            for cell in (across, along)]
    x, y = np.meshgrid(*axes)
    n_pulses = int(1.5 * (g.size_m + 10 * along) / along)
    track = np.zeros((n_pulses, 1, 3))
    track[:, 0] = np.stack([np.full(n_pulses, -g.ground_m), np.linspace(-0.5, 0.5, n_pulses)
                            * g.track_m, np.full(n_pulses, g.height_m)], axis=-1)
    paths = 2 * np.sqrt((x.ravel() - track[..., :1, 0])**2 + (y.ravel() - track[..., :1, 1])**2
                        + g.height_m**2)
    radar, n_samples = radar_of(g.carrier_hz, g.bandwidth_hz, paths)
    echoes = profiles(radar, n_samples, paths,
                      rng.standard_normal((x.size, 2 * n_images)).view(complex))
    grid = MapGrid.from_size((0.0, 0.0, 0.0), g.size_m, g.size_m, g.spacing_m)
    imager = plan_image(grid, radar, n_samples, method='exact')
    images = [imager(block_of(radar, echoes[:, [i]], track)) for i in range(n_images)]
    power = np.abs(images) ** 2
    y, x = (axis.ravel() for axis in np.mgrid[-1:1:grid.n_y * 1j, -1:1:grid.n_x * 1j])
    terms = np.stack([y**i * x**j for i in range(5) for j in range(5)], axis=-1)
    mean = power.mean(axis=0).ravel()
    trend = (terms @ np.linalg.lstsq(terms, mean, rcond=None)[0]).reshape(grid.shape)
    inner = (slice(WINDOW, -WINDOW),) * 2
    summed = [uniform_filter(p / trend, WINDOW)[inner] for p in power]
    return images, float(1 / np.mean(np.var(summed, axis=(1, 2)) / np.mean(summed)**2))


def false_alarms(geometry: Geometry, n_images: int) -> dict:
    """What is said of pairs of a known coherence that differ nowhere else."""
    images, looks = clutter_images(geometry, n_images)
    inner, out = (slice(WINDOW, -WINDOW),) * 2, {}
    for true in COHERENCES:
        found = {rate: [] for rate in (1e-2, 1e-3, RATE)}
        for first, other in itertools.pairwise([*images, images[0]]):
            second = dataclasses.replace(first, samples=np.complex64(
                true * first + np.sqrt(1 - true**2) * other))
            for rate, pairs in found.items():
                pairs.append(compare_passes(first, second, window=WINDOW, false_alarm_rate=rate))
        phase, told = (np.stack([getattr(p, name)[inner] for p in found[RATE]])
                       for name in ('phase_rad', 'phase_noise_rad'))
        known = np.isfinite(phase)
        out[f'{true:g}'] = {
            'looks': round(float(np.mean([p.looks for p in found[RATE]])), 2),
            'false_changes': {f'{rate:g}': float(np.mean([p.changed[inner] for p in pairs]))
                              for rate, pairs in found.items()},
            'coherence_median': round(float(np.median([p.coherence for p in found[RATE]])), 3),
            'coherence_mean': round(float(np.mean([p.coherence for p in found[RATE]])), 3),
            'phase_told_share': round(float(known.mean()), 5),
            'phase_noise_rad': round(float(np.std(phase[known])), 4) if known.any() else None,
            'phase_noise_told_rad': (round(float(np.sqrt(np.mean(told[known]**2))), 4)
                                     if known.any() else None)}
    return {'looks_by_variance': round(looks, 2), 'pixels': phase.size, 'coherences': out}


def far_from_changes(grid) -> np.ndarray:
    """Pixels beyond the cars' sidelobes and the edges of the terrace."""
    x, y = grid.x_m[None, :], grid.y_m[:, None]
    far = np.ones(grid.shape, bool)
    for place in CAR_M.values():
        far &= (np.hypot(x - place[0], y - place[1]) > FAR_M) & (np.abs(y - place[1]) > 2.5)
        far &= np.abs(x - place[0]) > 3.0
    (x0, x1), (y0, y1) = TERRACE_M
    terrace = (x > x0 - 4) & (x < x1 + 3) & (y > y0 - 3) & (y < y1 + 3)
    return far & ~terrace & (np.abs(y) > 2.0)  # nor those of the reflector


def on_terrace(grid) -> np.ndarray:
    """Pixels on the terrace that layover and windows leave to it alone."""
    (x0, x1), (y0, y1) = TERRACE_M
    return ((np.abs(grid.x_m - (x0 + x1) / 2) < (x1 - x0) / 2 - 4)[None, :]
            & (np.abs(grid.y_m - (y0 + y1) / 2) < (y1 - y0) / 2 - 3)[:, None])


def figures(found: PassComparison) -> dict:
    """What is known against what was found."""
    grid = found.grid
    x, y = grid.x_m[None, :], grid.y_m[:, None]
    cars = {name: np.hypot(x - px, y - py) < 0.9 for name, (px, py) in CAR_M.items()}
    far, terrace = far_from_changes(grid), on_terrace(grid)
    out = {
        'looks': round(found.looks, 1),
        'coherence_far_from_changes': {
            'median': round(float(np.median(found.coherence[far])), 4),
            'lowest': round(float(found.coherence[far].min()), 4)},
        'coherence_at_cars': {name: round(float(found.coherence[at].mean()), 3)
                              for name, at in cars.items()},
        'share_of_cars_found': {name: float(found.changed[at].mean())
                                for name, at in cars.items()},
        'false_alarms_far_from_changes': float(found.changed[far].mean())}
    if np.isfinite(found.height_m).any():
        heights = found.height_m - np.nanmedian(found.height_m[far])
        out['ambiguity_height_m'] = round(float(np.nanmedian(found.ambiguity_height_m)), 2)
        out['terrace'] = {
            'true_m': TERRACE_HEIGHT_M,
            'found_m': round(float(np.nanmean(heights[terrace])), 3),
            'deviation_m': round(float(np.nanstd(heights[terrace])), 3),
            'predicted_deviation_m': round(
                float(np.nanmedian(found.height_noise_m[terrace])), 3)}
    return out


def save_picture(path: pathlib.Path, first: np.ndarray, found: PassComparison) -> None:
    """First image, coherence, changes, heights."""
    grid = found.grid
    figure, axes = panels('Two passes 1.4 m apart: a car moved, a terrace of 1.5 m')
    bar = draw(axes[0], grid, decibels(first, np.abs(first).max()), 'first pass', cmap='gray',
               vmin=-45, vmax=-5)
    figure.colorbar(bar, ax=axes[0], label='dB', shrink=0.8)
    bar = draw(axes[1], grid, found.coherence, f'coherence, {found.looks:.0f} looks',
               cmap='viridis', vmin=0, vmax=1)
    figure.colorbar(bar, ax=axes[1], label='bias removed', shrink=0.8)
    grey = decibels(first, np.abs(first).max())
    draw(axes[2], grid, grey, f'changes at {found.false_alarm_rate:g} false alarms', cmap='gray',
         vmin=-45, vmax=-5)
    draw(axes[2], grid, np.ma.masked_equal(found.changed, 0), axes[2].get_title(),
         cmap=ListedColormap(['#ff5d5d']), alpha=0.75)
    bar = draw(axes[3], grid, found.height_m, 'height of the phase', cmap='cividis', vmin=-1,
               vmax=2.5)
    figure.colorbar(bar, ax=axes[3], label='m; white: no phase', shrink=0.8)
    figure.savefig(path, dpi=110)


def main() -> None:
    """Measure, draw, write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('--output', type=pathlib.Path, default=RESULTS)
    parser.add_argument('--pairs', type=int, default=4, metavar='N',
                        help='without a change, of each geometry and coherence')
    parser.add_argument('--pictures', type=pathlib.Path, default=FOLDER)
    arguments = parser.parse_args()
    back = tuple(-v for v in BASELINE_M)
    results = {'machine': machine(), 'false_alarm_rate': RATE}
    for name, offset_m in (('same track', back), ('tracks 1.4 m apart', (0.0, 0.0, 0.0))):
        first, found = compare(offset_m)
        results[name] = figures(found)
    results['false alarms'] = {
        name: false_alarms(geometry, arguments.pairs)
        for name, geometry in tqdm(GEOMETRIES.items(), desc='geometries without a change')}
    arguments.pictures.mkdir(parents=True, exist_ok=True)
    save_picture(arguments.pictures / 'passes.png', first, found)
    arguments.output.write_text(json.dumps(results, indent=1) + '\n')
    print(json.dumps(results, indent=1))


if __name__ == '__main__':
    main()
