"""Two simulated passes compared: figures and the picture of docs/exploitation.md.

Run from the repository root: ``python -m benchmarks.passes``, a minute.
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import pathlib

import numpy as np
from matplotlib.colors import ListedColormap
from tqdm import tqdm

from sar_imaging.exploitation.passes import PassComparison, compare_passes
from sar_imaging.imaging.imager import plan_image
from sar_imaging.signal.pulses import concatenate
from sar_imaging.simulation.scenarios import SCENARIOS
from sar_imaging.simulation.scenarios.passes import BASELINE_M, CAR_M, TERRACE_HEIGHT_M, TERRACE_M

from .exploitation_figures import FOLDER, decibels, draw, panels
from .support.machine import machine

RESULTS = pathlib.Path(__file__).parent / 'results' / 'passes.json'
RATE = 1e-4
FAR_M = 12.0  # from a car: its sidelobes are below the noise


def image_pass(name: str, offset_m=(0.0, 0.0, 0.0), seed: int | None = None):
    """Image of a pass flown beside its track, with noise of its own, and its phase centres."""
    scenario = SCENARIOS[name]()
    if seed is not None:
        scenario = dataclasses.replace(scenario, seed=seed)
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


def false_alarms(n_pairs: int) -> dict:
    """Share of changed pixels in pairs that differ in nothing but their noise."""
    rates = {1e-2: [], 1e-3: [], 1e-4: []}
    for number in tqdm(range(n_pairs), desc='pairs without a change'):
        pair = [image_pass('first_pass', seed=100 + 2 * number + i)[0] for i in (0, 1)]
        for rate, found in rates.items():
            inner = compare_passes(*pair, false_alarm_rate=rate).changed[8:-8, 8:-8]
            found.append(inner.mean())
    return {'pairs': n_pairs, 'pixels': n_pairs * inner.size,
            'found': {f'{rate:g}': float(f'{np.mean(found):.2g}')
                      for rate, found in rates.items()}}


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
    parser.add_argument('--pairs', type=int, default=20, metavar='N',
                        help='without a change, for the rate of false alarms')
    parser.add_argument('--pictures', type=pathlib.Path, default=FOLDER)
    arguments = parser.parse_args()
    back = tuple(-v for v in BASELINE_M)
    results = {'machine': machine(), 'false_alarm_rate': RATE}
    for name, offset_m in (('same track', back), ('tracks 1.4 m apart', (0.0, 0.0, 0.0))):
        first, found = compare(offset_m)
        results[name] = figures(found)
    results['false alarms'] = false_alarms(arguments.pairs)
    arguments.pictures.mkdir(parents=True, exist_ok=True)
    save_picture(arguments.pictures / 'passes.png', first, found)
    arguments.output.write_text(json.dumps(results, indent=1) + '\n')
    print(json.dumps(results, indent=1))


if __name__ == '__main__':
    main()
