# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Make the positions of the measured Gotcha recording wrong, and correct them by autofocus.

Run: python -m benchmarks.measured.focus_gotcha FOLDER --output out/focus_gotcha
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from scipy.interpolate import CubicSpline

from benchmarks.support.reporting import run_and_report
from sar_imaging.autofocus.live import live_autofocus
from sar_imaging.geometry.grids import MapGrid
from sar_imaging.imaging.imager import plan_image
from sar_imaging.quality import contrast, entropy, measure_scatterer
from sar_imaging.recordings import load
from sar_imaging.signal.pulses import PulseBlock
from sar_imaging.signal.radar import SPEED_OF_LIGHT
from sar_imaging.signal.range_compression import RangeCompressor

GRID = MapGrid.from_size((0.0, 0.0, 0.0), 100.0, 100.0, 0.1)
REFLECTOR_M = (-15.60, 21.60, 0.0)
TRACK_ERROR_M, TIME_OFFSET_S, RANGE_BIAS_M = 0.1, 0.1, 0.1
_SEARCH_M = 2.5  # the reflector is the brightest pixel so near: no image shows a displacement
_CUT_M = 2.0
_SHOWN_M, _SHOWN_HALF_M = (-20.0, 20.0), 27.0  # reflectors in the grass, road, first cars
_RANGE_DB = 50.0


def read_profiles(folder: Path) -> PulseBlock:
    """Range profiles of the recording."""
    pulses = load('gotcha', folder).block
    return RangeCompressor.for_block(pulses)(pulses)


def flawed(profiles: PulseBlock) -> PulseBlock:
    """Profiles whose positions and delays are wrong in a known way.

    A smooth error of the track in three dimensions (Legendre polynomials to degree 5, up to
    `TRACK_ERROR_M` along an axis), positions read `TIME_OFFSET_S` too late, and ranges
    `RANGE_BIAS_M` too long.
    """
    n = profiles.n_pulses
    time_s = (profiles.stamp_ns - profiles.stamp_ns[0]) * 1e-9
    shapes = np.polynomial.legendre.legvander(np.linspace(-1.0, 1.0, n), 5)[:, 1:]
    error = shapes @ np.random.default_rng(1).standard_normal((5, 3))
    error *= TRACK_ERROR_M / np.abs(error).max()
    track = CubicSpline(time_s, profiles.tx_m)(time_s + TIME_OFFSET_S) + error[:, None]
    delay_s = profiles.radar.first_sample_delay_s + 2 * RANGE_BIAS_M / SPEED_OF_LIGHT
    radar = dataclasses.replace(profiles.radar, first_sample_delay_s=delay_s)
    return dataclasses.replace(profiles, radar=radar, tx_m=track, rx_m=track)


def compare(profiles: PulseBlock, grid: MapGrid = GRID) -> tuple[dict, dict[str, np.ndarray]]:
    """Image with the recorded positions, with wrong ones, and after autofocus of the latter.

    Parameters
    ----------
    profiles : PulseBlock
        Of the recording.
    grid : MapGrid
        With the brighter reflector.

    Returns
    -------
    figures : dict
        Of each image, and autofocus's report.
    images : dict of str to (n_y, n_x) complex64
        By the same names.
    """
    wrong = flawed(profiles)
    images = {'recorded': _image(profiles, grid), 'wrong': _image(wrong, grid)}
    result = live_autofocus(grid, track_error_m=TRACK_ERROR_M,
                            time_offset_s=TIME_OFFSET_S).process(wrong, images['wrong'])
    images['autofocus'] = result.image
    blocks = {'recorded': profiles, 'wrong': wrong, 'autofocus': result.block}
    figures = {name: measure(image, blocks[name], grid) for name, image in images.items()}
    figures['report'] = dataclasses.asdict(dataclasses.replace(result.report, curve=None))
    return figures, images


def measure(image, block: PulseBlock, grid: MapGrid) -> dict:
    """Contrast and entropy, and the response of the brighter reflector wherever it stands."""
    near = np.hypot(grid.x_m - REFLECTOR_M[0], grid.y_m[:, None] - REFLECTOR_M[1]) < _SEARCH_M
    row, column = np.unravel_index(np.argmax(np.abs(image) * near), near.shape)
    place = (grid.x_m[column], grid.y_m[row], grid.z_m)
    found = measure_scatterer(
        image, grid, place, aperture_centre_m=block.phase_centre_m.mean(axis=0),
        wavenumber_rad_per_m=block.radar.wavenumber_rad_per_m, cut_half_width_range_m=_CUT_M,
        cut_half_width_azimuth_m=_CUT_M).as_json()
    names = ('irw_range_m', 'irw_azimuth_m', 'pslr_range_db', 'pslr_azimuth_db', 'peak_x_m',
             'peak_y_m', 'reason')
    peak_db = 20 * np.log10(np.abs(image[row, column]))
    return {'contrast': contrast(image), 'entropy': entropy(image), 'peak_db': float(peak_db),
            **{name: found[name] for name in names}}


def _image(block: PulseBlock, grid: MapGrid) -> np.ndarray:
    imager = plan_image(grid, block.radar, block.n_samples, method='exact', target_db=-80.0)
    return imager(block).samples


def draw(path: Path, images: dict[str, np.ndarray], grid: MapGrid) -> None:
    """Draw the images side by side, on the same scale.

    Parameters
    ----------
    path : Path
        PNG file to write.
    images : dict
        From `compare`.
    grid : MapGrid
        Their grid.
    """
    titles = {'recorded': 'recorded positions', 'wrong': 'positions made wrong',
              'autofocus': 'after autofocus'}
    top = max(float(np.abs(image).max()) for image in images.values())
    half = grid.spacing_m / 2
    extent = (grid.x_m[0] - half, grid.x_m[-1] + half, grid.y_m[-1] - half, grid.y_m[0] + half)
    figure = Figure(figsize=(10.0, 3.6), layout='constrained')
    axes = figure.subplots(1, len(images), sharey=True)
    for panel, (name, image) in zip(axes, images.items(), strict=True):
        level = 20 * np.log10(np.maximum(np.abs(image) / top, 10 ** (-_RANGE_DB / 20)))
        drawn = panel.imshow(level, extent=extent, cmap='gray', vmin=-_RANGE_DB, vmax=0.0)
        x, y = _SHOWN_M
        panel.set(title=titles[name], xlabel='x (m)', xlim=(x - _SHOWN_HALF_M, x + _SHOWN_HALF_M),
                  ylim=(y - _SHOWN_HALF_M, y + _SHOWN_HALF_M))
    axes[0].set_ylabel('y (m)')
    figure.colorbar(drawn, ax=axes, label='dB relative to the brightest pixel', shrink=0.9)
    figure.savefig(path, dpi=100)


def run(folder: Path, output: Path) -> dict:
    """Compare, draw; returns the contents of results.json."""
    figures, images = compare(read_profiles(folder))
    output.mkdir(parents=True, exist_ok=True)
    draw(output / 'focus_gotcha.png', images, GRID)
    return figures


def parser() -> argparse.ArgumentParser:
    """Command-line parser."""
    p = argparse.ArgumentParser(
        prog='focus_gotcha', description='Image the AFRL Gotcha data with the recorded positions, '
        'with wrong ones, and after autofocus of the latter; figures and a picture.')
    p.add_argument('folder', type=Path, help='folder with the .mat files of one pass')
    p.add_argument('--output', type=Path, default=Path('out/focus_gotcha'), metavar='FOLDER',
                   help='folder for results.json and focus_gotcha.png (default: %(default)s)')
    return p


def main(argv: Sequence[str] | None = None) -> int:
    """Run the program; returns its exit status."""
    arguments = parser().parse_args(argv)
    return run_and_report(arguments.output, lambda folder: run(arguments.folder, folder),
                          lambda results: json.dumps(results, indent=2))


if __name__ == '__main__':
    sys.exit(main())
