# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Draw a scene of the drone: its image, the cells of the former rule, and the obstacle map.

Run from the repository root: ``python -m benchmarks.obstacle_picture``.
"""

from __future__ import annotations

import argparse
import pathlib

import numpy as np

from sar_imaging.exploitation.obstacles import ObstacleDetector
from sar_imaging.exploitation.obstacles.obstacle_map import FREE, OCCUPIED, ObstacleMap

from .obstacle_campaign import former_map
from .support.obstacle_scenes import Platform, random_scene

PICTURE = pathlib.Path(__file__).parents[1] / 'docs' / 'images' / 'obstacles.png'
_RANGE_DB = 50.0


def draw(name: str, seed: int, path: pathlib.Path) -> None:
    """Draw one scene of a platform, from three apertures, into a PNG file."""
    from matplotlib.figure import Figure

    platform = Platform(name)
    grid, scene, found = platform.grid, random_scene(platform, seed), ObstacleMap()
    for i, view in enumerate(platform.views):
        image, _ = scene.images(platform, i)
        found.add(ObstacleDetector(grid, view)(image), round(i * platform.aperture_s * 1e9))
        if i == 0:
            level = 20 * np.log10(np.maximum(np.abs(image) / np.abs(image).max(), 1e-9))
            former = former_map(image)
    states = found.states()
    shades = np.where(states == OCCUPIED, 0.0, np.where(states == FREE, 1.0, 0.75))
    half = 0.5 * grid.spacing_m
    extent = (grid.x_m[0] - half, grid.x_m[-1] + half, grid.y_m[-1] - half, grid.y_m[0] + half)
    figure = Figure(figsize=(13.5, 4.9), layout='constrained')
    panels = figure.subplots(1, 3, sharey=True)
    for panel, picture, title, limits in (
            (panels[0], level, f'image, {_RANGE_DB:.0f} dB', (-_RANGE_DB, 0)),
            (panels[1], np.where(former, 0.0, 1.0), 'former map: 30 dB above the median', (0, 1)),
            (panels[2], shades, 'obstacle_map after three apertures', (0, 1))):
        panel.imshow(picture, extent=extent, cmap='gray', vmin=limits[0], vmax=limits[1],
                     interpolation='nearest')
        panel.scatter(*scene.obstacles_m[:, :2].T, s=160, facecolors='none',
                      edgecolors='tab:orange')
        panel.set_title(title)
        panel.set_xlabel('x (m)')
    panels[0].set_ylabel('y (m)')
    figure.savefig(path, dpi=75)


def main() -> None:
    """Draw the picture of the documentation."""
    parser = argparse.ArgumentParser(description=__doc__.split('\n')[0])
    parser.add_argument('--platform', default='drone_uwb')
    parser.add_argument('--seed', type=int, default=7)
    parser.add_argument('--output', type=pathlib.Path, default=PICTURE)
    arguments = parser.parse_args()
    draw(arguments.platform, arguments.seed, arguments.output)


if __name__ == '__main__':
    main()
