"""Parameter of the terrain heights on which a node images."""

from __future__ import annotations

import contextlib
import zipfile
from collections.abc import Mapping

import numpy as np

from sar_imaging.files import check_file
from sar_imaging.geometry.grids import MapGrid
from sar_imaging.geometry.terrain import Terrain
from sar_imaging.memory import available_bytes

from ..runtime.parameters import ConfigurationError, Parameter

TERRAIN_FILE = Parameter(
    'terrain.file', '', 'File (.npz) with heights of the ground; empty for the plane '
    'grid.centre_z.')


def terrain_heights(parameters: Mapping[str, object], grid: MapGrid) -> np.ndarray | None:
    """(n_y, n_x) float64 heights of the pixels in metres, NaN where unknown; None for a plane.

    Raises
    ------
    ConfigurationError
        The file cannot be read or has no height in the grid.
    """
    path = parameters[TERRAIN_FILE.name]
    if not path:
        return None
    try:
        _check_size(path)
        return Terrain.load(path).heights(grid)
    except ValueError as error:
        raise ConfigurationError(f'parameter {TERRAIN_FILE.name}: {error}') from error


def _check_size(path: str) -> None:
    """Refuse files whose arrays do not fit into half of the memory, packed as they may be."""
    most = available_bytes() // 2
    check_file(path, most)
    with contextlib.suppress(OSError, zipfile.BadZipFile), zipfile.ZipFile(path) as archive:
        # What is no archive is told of when it is read.
        total = sum(member.file_size for member in archive.infolist())
        if total > most:
            raise ValueError(f'terrain {path} unpacks to {total / 1e6:.3g} MB, more than half of '
                             'the memory; write fewer heights')
