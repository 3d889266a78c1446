# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Which kind a file is, by its first bytes, or shall be, by its name."""

from __future__ import annotations

from pathlib import Path

from ..files import reading

RECORDING, CPHD, SICD, GEOTIFF = 'recording', 'CPHD', 'SICD', 'GeoTIFF'
DESCRIPTION = 'description'  # of arrays, in YAML, which has no first bytes
_STARTS = {b'CPHD/': CPHD, b'NITF': SICD, b'II*\0': GEOTIFF, b'MM\0*': GEOTIFF, b'II+\0': GEOTIFF,
           b'MM\0+': GEOTIFF}
_SUFFIXES = {'': RECORDING, '.cphd': CPHD, '.nitf': SICD, '.ntf': SICD, '.tif': GEOTIFF,
             '.tiff': GEOTIFF}


class UnknownKindError(ValueError):
    """A file is of no kind that this program knows."""


def kind_of(path: Path) -> str:
    """Kind of a file or folder that exists.

    Raises
    ------
    UnknownKindError
        It is none of those known, or a folder without a recording.
    FileNotFoundError
        It does not exist.
    """
    if path.is_dir():
        if not (path / 'metadata.yaml').is_file():
            raise UnknownKindError(f'{path} is a folder without metadata.yaml; expected that of a '
                                   'recording (rosbag2)')
        return RECORDING
    if path.suffix.lower() in ('.yaml', '.yml'):
        return DESCRIPTION
    with reading(path, 'CPHD, SICD or GeoTIFF', UnknownKindError), open(path, 'rb') as file:
        start = file.read(8)
    for begin, kind in _STARTS.items():
        if start.startswith(begin):
            return kind
    raise UnknownKindError(f'{path} begins with {start!r}: neither CPHD, SICD (NITF) nor GeoTIFF; '
                           'recordings are folders')


def kind_of_target(path: Path) -> str:
    """Kind of a file to make, by the end of its name; a name without an end is a recording.

    Raises
    ------
    UnknownKindError
        No kind has this end.
    """
    kind = _SUFFIXES.get(path.suffix.lower())
    if kind is None:
        told = ', '.join(f'{suffix or "no end"}: {k}' for suffix, k in _SUFFIXES.items())
        raise UnknownKindError(f'{path}: no format has the end {path.suffix!r}; expected one of '
                               f'{told}')
    return kind
