# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Reference maps: the amplitude of a place, from where it was seen, and what stands on it.

A map is a folder of standard parts:

- ``amplitude.npy``: (n_y, n_x) float32, root mean square of the passes, 0 where none saw anything;
- ``passes.npy``: (n_y, n_x) uint16, how many passes saw a pixel;
- ``map.json``: grid, datum, carrier, resolution, noise floor, and the look direction of each pass;
- ``complex_0.npy`` and so on: (n_y, n_x) complex64, the image of pass 0, where it is kept. Only
  that of a single aperture has phases that a later image may share, the map itself has none;
- ``map.tif``: amplitude and passes for geographic information systems, where the datum is known;
- ``obstacles.pgm`` and ``obstacles.yaml``: occupied and free ground, as Nav2's map server reads.
"""

from __future__ import annotations

import dataclasses
import json
import math
import os
import zlib
from pathlib import Path
from typing import Any

import numpy as np

from ..exploitation.registration import LookDirection, Speckle
from ..files import check_file, filling, read_text, reading, told, write_json
from ..geometry.earth import Datum
from ..geometry.grids import MapGrid
from ..imaging.image import Image, Report
from ..numpy_files import check_memory
from .geotiff import write_raster

#: of every map; pictures and obstacles may lie beside them
MAP_FILES = 'amplitude.npy', 'passes.npy', 'map.json'
_VERSION = 1
_GREY = {0: 254, 100: 0, -1: 205}  # of free, occupied and unknown cells, as map_server takes them


@dataclasses.dataclass(frozen=True)
class Pass:
    """One pass of a reference map.

    Attributes
    ----------
    name : str
        Of its recording.
    look : LookDirection
        From the middle of the map.
    stamp_ns : int
        Time of its middle pulse.
    speckle : Speckle or None
        Its complex image, on the grid of the map, where it is kept.

    Examples
    --------
    >>> from sar_imaging.exploitation.registration import LookDirection
    >>> from sar_imaging.formats.reference_map import Pass
    >>> Pass('monday', LookDirection(90.0, 20.0), 0).look.grazing_deg
    20.0
    """

    name: str
    look: LookDirection
    stamp_ns: int
    speckle: Speckle | None = None


@dataclasses.dataclass(frozen=True, eq=False)
class ReferenceMap:
    """What images are looked for in.

    Attributes
    ----------
    image : Image
        Amplitude, float32, on a `MapGrid`.
    passes : tuple of Pass
        What it was made of.
    seen : (n_y, n_x) uint16
        How many of them saw a pixel.
    resolution_m : float
        Geometric mean of the widths of a resolution cell, metres.
    noise_floor_db : float
        Level of the darkest hundredth of the map, dB of the amplitude's unit: noise is no more.
    datum : Datum or None
        Place of its frame on the Earth.
    occupancy : (n_y, n_x) int8 or None
        0 free, 100 occupied, -1 unknown.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging import Image, MapGrid
    >>> from sar_imaging.exploitation.registration import LookDirection
    >>> from sar_imaging.formats.reference_map import (
    ...     Pass, ReferenceMap, read_reference_map, write_reference_map)
    >>> from sar_imaging.imaging.image import Report
    >>> grid = MapGrid((0.0, 0.0, 0.0), 8, 6, 0.5)
    >>> image = Image(np.ones(grid.shape, np.float32), grid, 10e9, Report('exact', '', -60.0))
    >>> reference = ReferenceMap(image, (Pass('monday', LookDirection(90.0, 20.0), 0),),
    ...                          np.ones(grid.shape, np.uint16), 0.7, -20.0)
    >>> write_reference_map('place', reference)
    ['amplitude.npy', 'passes.npy', 'map.json']
    >>> back = read_reference_map('place')
    >>> back.image.grid == grid, back.passes == reference.passes, back.resolution_m
    (True, True, 0.7)
    """

    image: Image
    passes: tuple[Pass, ...]
    seen: np.ndarray
    resolution_m: float
    noise_floor_db: float
    datum: Datum | None = None
    occupancy: np.ndarray | None = None

    @property
    def speckle(self) -> list[Speckle]:
        """Complex images of passes, of those that keep one."""
        return [one.speckle for one in self.passes if one.speckle is not None]


def write_reference_map(folder: os.PathLike[str] | str, reference: ReferenceMap) -> list[str]:
    """Write a map; returns the names of the files.

    Parameters
    ----------
    folder : path
        Made when missing; its files are complete or absent.
    reference : ReferenceMap
        The map.

    Returns
    -------
    list of str

    Raises
    ------
    ValueError
        The image lies on another grid than a `MapGrid`, or the complex image of a pass on another
        one than the map, or this has samples that are not finite.
    MissingExtraError
        The datum is known, and rasterio or pyproj is not installed.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging import Image, MapGrid
    >>> from sar_imaging.exploitation.registration import LookDirection
    >>> from sar_imaging.formats.reference_map import (
    ...     Pass, ReferenceMap, read_reference_map, write_reference_map)
    >>> from sar_imaging.imaging.image import Report
    >>> grid = MapGrid((0.0, 0.0, 0.0), 8, 6, 0.5)
    >>> image = Image(np.ones(grid.shape, np.float32), grid, 10e9, Report('exact', '', -60.0))
    >>> reference = ReferenceMap(image, (Pass('monday', LookDirection(90.0, 20.0), 0),),
    ...                          np.ones(grid.shape, np.uint16), 0.7, -20.0)
    >>> names = write_reference_map('place', reference)
    >>> read_reference_map('place').image.shape
    (6, 8)
    """
    image, grid = reference.image, reference.image.grid
    if not isinstance(grid, MapGrid):
        raise ValueError(f'the map lies on a {type(grid).__name__}; expected a MapGrid')
    with filling(folder) as part:
        np.save(part / 'amplitude.npy', np.asarray(image.samples, np.float32))
        np.save(part / 'passes.npy', np.asarray(reference.seen, np.uint16))
        names = list(MAP_FILES)
        told = [_pass_written(one, k, grid, part) for k, one in enumerate(reference.passes)]
        names += [complex_file(k) for k, one in enumerate(told) if 'complex' in one]
        write_json(part / 'map.json', {
            'version': _VERSION, 'grid': dataclasses.asdict(grid),
            'datum': reference.datum and dataclasses.asdict(reference.datum),
            'carrier_hz': image.carrier_hz, 'resolution_m': reference.resolution_m,
            'noise_floor_db': reference.noise_floor_db,
            'passes': told})
        if reference.occupancy is not None:
            write_nav2_map(part, reference.occupancy, grid)
            names += ['obstacles.pgm', 'obstacles.yaml']
        if reference.datum is not None:
            write_raster(part / 'map.tif', {'amplitude': image.samples, 'passes': reference.seen},
                         grid, reference.datum)
            names.append('map.tif')
    return names


def complex_file(number: int | str) -> str:
    """Name of the file of the complex image of a pass."""
    return f'complex_{number}.npy'


def _pass_written(one: Pass, number: int, grid: MapGrid, folder: Path) -> dict[str, Any]:
    """What map.json says of a pass, whose complex image is written."""
    told = {'name': one.name, 'look': dataclasses.asdict(one.look), 'stamp_ns': one.stamp_ns}
    if one.speckle is None:
        return told
    image = one.speckle.image
    samples = np.ascontiguousarray(image.samples, np.complex64)
    if image.grid != grid or samples.shape != grid.shape or not np.isfinite(samples).all():
        raise ValueError(f'the complex image of {one.name} has samples that are not finite, or '
                         'does not lie on the grid of the map')
    np.save(folder / complex_file(number), samples)
    return told | {'complex': {'phase_centre_m': [float(v) for v in one.speckle.phase_centre_m],
                               'crc32': zlib.crc32(samples.data)}}


def write_nav2_map(folder: Path, occupancy: np.ndarray, grid: MapGrid) -> None:
    """Write ``obstacles.pgm`` and ``obstacles.yaml`` for Nav2's map server.

    Parameters
    ----------
    folder : path
        Where to.
    occupancy : (n_y, n_x) int
        0 free, 100 occupied, -1 unknown; row 0 at the largest y.
    grid : MapGrid
        Where the cells are.
    """
    grey = np.full(occupancy.shape, _GREY[-1], np.uint8)
    for state, level in _GREY.items():
        grey[occupancy == state] = level
    rows, columns = occupancy.shape
    (folder / 'obstacles.pgm').write_bytes(b'P5\n%d %d\n255\n' % (columns, rows) + grey.tobytes())
    half = grid.spacing_m / 2
    (folder / 'obstacles.yaml').write_text(
        'image: obstacles.pgm\nmode: trinary\n'
        f'resolution: {grid.spacing_m!r}\n'
        f'origin: [{float(grid.x_m[0]) - half!r}, {float(grid.y_m[-1]) - half!r}, 0.0]\n'
        'negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n')


def read_reference_map(folder: os.PathLike[str] | str) -> ReferenceMap:
    """Read a map that `write_reference_map` wrote; its obstacles are left out.

    Parameters
    ----------
    folder : path
        Folder of the map.

    Returns
    -------
    ReferenceMap

    Raises
    ------
    FileNotFoundError
        There is none.
    ValueError
        It is no map, is damaged, or its parts contradict each other.
    MemoryError
        It is larger than the memory.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging import Image, MapGrid
    >>> from sar_imaging.exploitation.registration import LookDirection
    >>> from sar_imaging.formats.reference_map import (
    ...     Pass, ReferenceMap, read_reference_map, write_reference_map)
    >>> from sar_imaging.imaging.image import Report
    >>> grid = MapGrid((0.0, 0.0, 0.0), 8, 6, 0.5)
    >>> image = Image(np.ones(grid.shape, np.float32), grid, 10e9, Report('exact', '', -60.0))
    >>> reference = ReferenceMap(image, (Pass('monday', LookDirection(90.0, 20.0), 0),),
    ...                          np.ones(grid.shape, np.uint16), 0.7, -20.0)
    >>> names = write_reference_map('place', reference)
    >>> read_reference_map('place').image.shape
    (6, 8)
    """
    folder = Path(folder)
    with reading(folder / 'map.json', 'a reference map'):
        text = read_text(folder / 'map.json')
        try:
            tag = json.loads(text)
            if tag['version'] != _VERSION:
                raise ValueError(f'version {tag["version"]}; expected {_VERSION}')
            grid = MapGrid(**tag['grid'])
            datum = tag['datum'] and Datum(**tag['datum'])
            passes = [Pass(one['name'], LookDirection(**one['look']), one['stamp_ns'])
                      for one in tag['passes']]
            kept = {k: _complex_told(**one['complex'])
                    for k, one in enumerate(tag['passes']) if 'complex' in one}
            figures = [float(tag[name]) for name in ('carrier_hz', 'resolution_m',
                                                     'noise_floor_db')]
        except (LookupError, TypeError, ValueError, RecursionError) as error:
            raise ValueError(f'it cannot be understood: {told(error)}') from error
    amplitude, seen = (_array(folder / name, kind, grid) for name, kind in (
        ('amplitude.npy', np.float32), ('passes.npy', np.uint16)))
    image = Image(amplitude, grid, figures[0], Report('reference map', '', 0.0))
    for k, (centre_m, crc32) in kept.items():
        path = folder / complex_file(k)
        samples = _array(path, np.complex64, grid)
        if zlib.crc32(samples.data) != crc32:
            raise ValueError(f'{path} is damaged, or that of another map: expected samples whose '
                             f'CRC is {crc32}; make the map again')
        passes[k] = dataclasses.replace(passes[k], speckle=Speckle(
            dataclasses.replace(image, samples=samples), centre_m))
    return ReferenceMap(image, tuple(passes), seen, figures[1], figures[2], datum)


def _complex_told(phase_centre_m: list[float], crc32: int
                  ) -> tuple[tuple[float, float, float], int]:
    """What map.json says of a complex image, checked."""
    x, y, z = (float(v) for v in phase_centre_m)
    if not math.isfinite(x + y + z):
        raise ValueError(f'the phase centre {phase_centre_m} is not finite')
    return (x, y, z), int(crc32)


def _array(path: Path, kind: type[np.generic], grid: MapGrid) -> np.ndarray:
    check_file(path)
    with reading(path, 'a part of a reference map'):
        mapped = np.load(path, mmap_mode='r', allow_pickle=False)
        if mapped.dtype != kind or mapped.shape != grid.shape:
            raise ValueError(f'it holds {mapped.dtype} {mapped.shape}; map.json tells of '
                             f'{np.dtype(kind)} {grid.shape}')
        check_memory('the map', mapped.nbytes)
        return np.array(mapped)
