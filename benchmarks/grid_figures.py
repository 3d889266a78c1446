# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Draw the pictures of docs/grids.md from what its examples compute.

Run from the repository root: ``python -m benchmarks.grid_figures``.
"""

from __future__ import annotations

import pathlib
import re

import numpy as np

ROOT = pathlib.Path(__file__).parents[1]
PAGE, FOLDER = ROOT / 'docs' / 'grids.md', ROOT / 'docs' / 'images' / 'grids'
_RANGE_DB = 30.0


def run_page() -> dict:
    """Names that the page's Python examples leave behind."""
    names: dict = {}
    for code in re.findall(r'^```python\n(.*?)^```', PAGE.read_text(), re.DOTALL | re.MULTILINE):
        exec(code, names)
    return names


def draw(path: pathlib.Path, panels) -> None:
    """Draw magnitudes (rows, columns) with their extents, axes and marks into a PNG file."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(4.6 * len(panels), 4.0), layout='constrained')
    for axes, (magnitude, extent, labels, marks) in zip(figure.subplots(1, len(panels),
                                                                        squeeze=False)[0],
                                                        panels, strict=True):
        level = 20 * np.log10(np.maximum(magnitude / magnitude.max(), 1e-9))
        axes.imshow(level, extent=extent, cmap='gray', vmin=-_RANGE_DB, vmax=0,
                    interpolation='nearest')
        axes.scatter(*marks, s=120, facecolors='none', edgecolors='tab:orange', linewidths=0.8)
        axes.set_xlabel(f'{labels[0]} (m)')
        axes.set_ylabel(f'{labels[1]} (m)')
    figure.savefig(path, dpi=75)


def _extent(first, last, row_first, row_last, steps):
    """Of an image: half a pixel beyond the outermost ones."""
    u, v = steps
    return first - u / 2, last + u / 2, row_last - v / 2, row_first + v / 2


def main() -> None:
    """Draw all."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    names = run_page()
    for name, grid, image, marks in (('wall', names['wall'], names['wall_image'], 'window'),
                                     ('ground', names['section'], names['section_image'],
                                      'pipes')):
        points = grid.points()
        step = abs(grid.step_v_m[2])
        extent = _extent(points[0, 0, 0], points[0, -1, 0], points[0, 0, 2], points[-1, 0, 2],
                         (step, step))
        draw(FOLDER / f'{name}.png', [(np.abs(image), extent, ('x', 'z'),
                                       names[marks][:, [0, 2]].T)])
    grid, magnitude, houses = names['volume'], np.abs(names['volume_image']), names['houses']
    points, step = grid.points(), grid.step_x_m[0]
    x, y, z = points[0, 0, [0, -1], 0], points[0, [0, -1], 0, 1], points[[0, -1], 0, 0, 2]
    draw(FOLDER / 'volume.png', [
        (magnitude.max(axis=0), _extent(*x, *y, (step, step)), ('x', 'y'), houses[:, :2].T),
        (magnitude.max(axis=1)[::-1], _extent(*x, *z[::-1], (step, step)), ('x', 'z'),
         houses[:, [0, 2]].T),
        (magnitude.max(axis=2)[::-1, ::-1], _extent(*y[::-1], *z[::-1], (step, step)), ('y', 'z'),
         houses[:, 1:].T)])


if __name__ == '__main__':
    main()
