# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Parameters of the image grid, and of the terrain heights on which a node images."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ...configuration.constraints import check_settings
from ...configuration.parameters import imaging_from_parameters
from ...configuration.settings import Imaging, Machine
from ...geometry.grids import MapGrid, VolumeGrid
from ...geometry.terrain import Terrain
from ..runtime.parameters import ConfigurationError, Parameter, refused

MAX_IMAGE_PIXELS = Parameter('max_image_pixels', 2**25, 'Larger images are refused.', 'pixels',
                             1, 2**31 - 1)
GRID_PARAMETERS = (
    Parameter('grid.centre_x', 0.0, 'Middle of the image, x in the imaging frame.', 'm',
              -1e8, 1e8),
    Parameter('grid.centre_y', 0.0, 'Middle of the image, y in the imaging frame.', 'm',
              -1e8, 1e8),
    Parameter('grid.centre_z', 0.0, 'Height of the image plane in the imaging frame.', 'm',
              -1e8, 1e8),
    Parameter('grid.size_x', 100.0, 'Extent of the image along x.', 'm', 0.0, 1e6),
    Parameter('grid.size_y', 100.0, 'Extent of the image along y.', 'm', 0.0, 1e6),
    Parameter('grid.spacing', 0.25, 'Pixel spacing along x and y; at most half the null spacing.',
              'm', 1e-4, 1e4),
    MAX_IMAGE_PIXELS,
)


def imaging_settings(parameters: Mapping[str, Any]) -> Imaging:
    """Settings that the parameters describe, the grid among them.

    Raises
    ------
    ConfigurationError
        They make no sense, or the image has more pixels than allowed, or than fit into memory.
    """
    with refused():
        imaging = imaging_from_parameters(parameters)
    if findings := check_settings(imaging, Machine.this_one()):
        raise ConfigurationError('; '.join(finding.text for finding in findings))
    return imaging


def describe_grid(grid: MapGrid | VolumeGrid) -> str:
    """Grid in words."""
    if isinstance(grid, VolumeGrid):
        steps = ' x '.join(f'{step:g}' for step in np.linalg.norm(grid.steps_m[::-1], axis=1))
        x, y, z = grid.origin_m + (np.array(grid.shape) - 1) @ grid.steps_m / 2
        return (f'{grid.n_x} x {grid.n_y} x {grid.n_z} cells of {steps} m around '
                f'({x:g}, {y:g}, {z:g}) m')
    x, y, z = grid.centre_m
    return (f'{grid.n_x} x {grid.n_y} pixels of {grid.spacing_m:g} m around '
            f'({x:g}, {y:g}, {z:g}) m')


TERRAIN_FILE = Parameter(
    'terrain.file', '', 'File (.npz) with heights of the ground; empty for the plane '
    'grid.centre_z.')


def terrain_heights(parameters: Mapping[str, Any], grid: MapGrid) -> np.ndarray | None:
    """(n_y, n_x) float64 heights of the pixels in metres, NaN where unknown; None for a plane.

    Raises
    ------
    ConfigurationError
        The file cannot be read or has no height in the grid.
    """
    path = parameters[TERRAIN_FILE.name]
    if not path:
        return None
    with refused(f'parameter {TERRAIN_FILE.name}: '):
        return Terrain.load(path).heights(grid)
