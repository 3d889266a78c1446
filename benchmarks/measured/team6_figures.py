# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Pictures of the team 6 rail recording with different alignments, for the gallery.

Run: python -m benchmarks.measured.team6_figures out/team6_nominal out/team6_estimated \
    out/team6_fitted --output out/team6
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from sar_imaging.files import filling
from sar_imaging.geometry.grids import MapGrid
from sar_imaging.recordings.bag_io import read_truth
from sar_imaging.tools.program import run_command

_ZOOM_M = 0.5  # half width around a reflector


def parser() -> argparse.ArgumentParser:
    """Command-line parser."""
    p = argparse.ArgumentParser(
        prog='team6_figures', description='Draw the images of several evaluations side by side: '
        'team6_rail.png with the first and the last of them, team6_reflectors.png with the '
        'surveyed reflectors in all of them.')
    p.add_argument('folder', type=Path, nargs='+', help='output folders of evaluate')
    p.add_argument('--output', type=Path, default=Path('out/team6'), metavar='FOLDER',
                   help='folder for the pictures (default: %(default)s)')
    return p


def main(argv: Sequence[str] | None = None) -> int:
    """Run the program; returns its exit status."""
    arguments = parser().parse_args(argv)
    return run_command(lambda: run(arguments))


def run(arguments: argparse.Namespace) -> int:
    """Draw the images of all folders; returns the exit status."""
    images = {f.name.removeprefix('team6_'): _read(f) for f in arguments.folder}
    with filling(arguments.output) as folder:
        draw(images, folder)
    return 0


def _read(folder: Path) -> tuple[np.ndarray, MapGrid, np.ndarray]:
    """Amplitude, its grid, and the surveyed places (n, 2) of the scatterers measured in it."""
    quality = json.loads((folder / 'quality.json').read_text())
    survey = [s['position_m'][:2] for s in read_truth(quality['recording'])['scatterers']]
    return np.abs(np.load(folder / 'image.npy')), MapGrid(**quality['grid']), np.array(survey)


def draw(images: dict[str, tuple[np.ndarray, MapGrid, np.ndarray]], output: Path) -> None:
    """Draw both pictures.

    Parameters
    ----------
    images : dict
        By name: amplitude (n_y, n_x), its grid, and surveyed places (n, 2), metres.
    output : Path
        Folder.
    """
    top = max(float(image.max()) for image, *_ in images.values())
    names = list(images)
    ends = names[:1] + names[1:][-1:]
    figure = Figure(figsize=(5.2 * len(ends), 6.2), layout='constrained')
    axes = figure.subplots(1, len(ends), squeeze=False)
    for axis, name in zip(axes[0], ends, strict=True):
        picture = _show(axis, images[name], top, 40.0)
        axis.plot(*images[name][2].T, 'o', mfc='none', mec='tab:orange', ms=11)
        axis.set(title=f'{name} alignment', xlabel='x (m)', ylabel='y (m)')
    _save(figure, axes, picture, output / 'team6_rail.png')
    places = images[names[0]][2]
    figure = Figure(figsize=(3.4 * len(names) + 1.2, 3.5 * len(places)), layout='constrained')
    axes = figure.subplots(len(places), len(names), squeeze=False, sharex='row', sharey='row')
    for column, name in zip(axes.T, names, strict=True):
        for number, (axis, (x, y)) in enumerate(zip(column, places, strict=True), 1):
            picture = _show(axis, images[name], top, 30.0)
            axis.plot(x, y, '+', color='tab:orange', ms=16, mew=2, label='survey')
            axis.set(xlim=(x - _ZOOM_M, x + _ZOOM_M), ylim=(y - _ZOOM_M, y + _ZOOM_M),
                     xlabel='x (m)', title=f'reflector {number}, {name} alignment')
    for axis in axes[:, 0]:
        axis.set_ylabel('y (m)')
    axes[0, 0].legend(fontsize=9, loc='lower left')
    _save(figure, axes, picture, output / 'team6_reflectors.png')


def _show(axis, image, top: float, range_db: float):
    amplitude, grid, _ = image
    half = grid.spacing_m / 2
    extent = (grid.x_m[0] - half, grid.x_m[-1] + half, grid.y_m[-1] - half, grid.y_m[0] + half)
    level = 20 * np.log10(np.maximum(amplitude / top, 1e-6))
    return axis.imshow(level, vmin=-range_db, vmax=0, extent=extent, cmap='gray',
                       interpolation='bilinear')


def _save(figure, axes, picture, path: Path) -> None:
    figure.colorbar(picture, ax=axes, label='dB relative to the brightest pixel', shrink=0.8)
    figure.savefig(path, dpi=90)


if __name__ == '__main__':
    sys.exit(main())
