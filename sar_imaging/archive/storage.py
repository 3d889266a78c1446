# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Arrays on disk whose chunks are tiles of the map's lattice: each complete, or absent.

They are Zarr (format 2), so that any program reads them. A chunk is written beside its place and
renamed, as all stores of Zarr do with folders. Chunks of zeros alone are absent, too.

Chunks are compressed by LZ4 after their bits are sorted: powers of speckle lose 17 % and complex
samples 8 %, pixels that no image has nearly all, for 3 to 5 ns a pixel, which a disk of 500 MB/s
takes for 2 bytes. (zlib saves 10 % of powers for 130 ns.)
"""

from __future__ import annotations

import functools
import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import DTypeLike

from ..formats import require
from .pieces import ArchiveDataError
from .scans import bring_to_disk, write_text
from .windows import Window

EXTRA = 'archive'
IMAGES, PARTIALS, MOSAIC = 'images.zarr', 'partials.zarr', 'mosaic.zarr'
STRIPS, COHERENCE = 'strips.zarr', 'coherence.zarr'
_CODEC = {'id': 'blosc', 'cname': 'lz4', 'clevel': 5, 'shuffle': 2, 'blocksize': 0}


class TiledArray:
    """A two-dimensional array over whole tiles of the lattice.

    Parameters
    ----------
    path : Path
        Its folder.
    extent : Window
        Whole tiles that it covers.
    tile : int
        Sides of a tile, pixels.

    Attributes
    ----------
    path, extent, tile :
        As given.
    """

    def __init__(self, path: Path, extent: Window, tile: int):
        if extent != extent.on_tiles(tile):
            raise ValueError(f'the extent {extent.as_tuple} is not made of whole tiles of {tile} '
                             'pixels')
        self.path, self.extent, self.tile = Path(path), extent, tile

    def create(self, dtype: DTypeLike, fill_value: float, *,
               attributes: Mapping[str, object] | None = None) -> None:
        """Make the array, or open the one that is there already.

        Parameters
        ----------
        dtype : dtype
            Data type of the values.
        fill_value : number
            Value of pixels that nobody wrote.
        attributes : mapping, optional
            What readers are told, of JSON types; `extent` is added.
        """
        require('zarr', 'storing images', EXTRA)
        _write_once(self.path.parent / '.zgroup', {'zarr_format': 2})
        if not (self.path / '.zarray').exists():
            extent = {'extent': list(self.extent.as_tuple), 'tile': self.tile}
            _write_once(self.path / '.zattrs', extent | dict(attributes or {}))
            fill = ('NaN' if isinstance(fill_value, float) and math.isnan(fill_value) else
                    [0.0, 0.0] if np.dtype(dtype).kind == 'c' else fill_value)
            _write_once(self.path / '.zarray', {
                'zarr_format': 2, 'shape': list(self.extent.shape), 'order': 'C',
                'chunks': [self.tile, self.tile], 'dtype': np.dtype(dtype).str,
                'fill_value': fill, 'filters': None, 'compressor': _CODEC})
        if self.array.shape != self.extent.shape:
            raise ArchiveDataError(
                f'{self.path} has {self.array.shape} pixels, expected {self.extent.shape}: it is '
                'of another job; choose another output folder')

    @property
    def exists(self) -> bool:
        """Whether there is such an array."""
        return (self.path / '.zarray').exists()

    @functools.cached_property
    def array(self) -> Any:
        """The Zarr array, opened when first asked for."""
        return require('zarr', 'reading images', EXTRA).open_array(str(self.path), mode='r+')

    def has(self, tile: Window) -> bool:
        """Whether a tile was written, and is not all zeros."""
        return self._chunk(tile).exists()

    def _chunk(self, tile: Window) -> Path:
        row = (tile.row0 - self.extent.row0) // self.tile
        column = (tile.column0 - self.extent.column0) // self.tile
        return self.path / f'{row}.{column}'

    def write(self, window: Window, values: np.ndarray, whole: Window) -> None:
        """Write what an array of a window holds, tile by tile, each once and complete.

        Parameters
        ----------
        window : Window
            Window of the values.
        values : (rows, columns) array
            Its pixels.
        whole : Window
            All pixels that the array will ever hold: edges of `window` within it lie between
            tiles.

        They are on the disk when this returns.

        Raises
        ------
        ValueError
            An edge of the window cuts a tile that other windows write, too.
        """
        for tile in window.tiles(self.tile):
            part = tile.intersection(window)
            if part != tile.intersection(whole):
                raise ValueError(f'window {window.as_tuple} cuts the tile {tile.as_tuple} of '
                                 f'{whole.as_tuple}; expected edges between tiles')
            buffer = np.full((self.tile, self.tile), self.array.fill_value, self.array.dtype)
            buffer[part.within(tile)] = values[part.within(window)]
            self.array[tile.within(self.extent)] = buffer
            if self.has(tile):
                bring_to_disk(self._chunk(tile))
        bring_to_disk(self.path)

    def read(self, window: Window) -> np.ndarray:
        """Pixels of a window; fill values where nobody wrote and beyond the array."""
        out = np.full(window.shape, self.array.fill_value, self.array.dtype)
        common = window.intersection(self.extent)
        if common is not None:
            for tile in common.tiles(self.tile):  # one chunk at a time bounds the memory
                part = tile.intersection(common)
                out[part.within(window)] = self.array[part.within(self.extent)]
        return out


def _write_once(path: Path, contents: Mapping[str, object]) -> None:
    """Write JSON where there is none, complete or not at all; all who do so write the same."""
    if not path.exists():
        write_text(path, json.dumps(contents, indent=1) + '\n')


def image_array(output: Path, name: str, window: Window, tile: int) -> TiledArray:
    """Array of an aperture's image."""
    return TiledArray(output / IMAGES / name, window.on_tiles(tile), tile)


def partial_array(output: Path, name: str, partial: str, window: Window,
                  tile: int) -> TiledArray:
    """Array of an image of some pulses of an aperture."""
    place = '-'.join(map(str, window.as_tuple))
    return TiledArray(output / PARTIALS / name / f'{partial}.{place}', window.on_tiles(tile), tile)
