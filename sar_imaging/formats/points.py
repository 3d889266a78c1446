# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Points of the imaging frame as GeoJSON and CSV with their place on the Earth, and clouds as PLY.

PLY files (Turk 1994) open in CloudCompare, MeshLab, Open3D and Blender.
"""

from __future__ import annotations

import csv
import json
import math
import os
import pathlib
from collections.abc import Iterator, Mapping
from typing import Any, TextIO

import numpy as np
from numpy.typing import ArrayLike

from ..files import replacing
from ..geometry.earth import Datum

GEOJSON, CSV = FORMATS = ('geojson', 'csv')
_DEGREES, _METRES = 9, 4  # decimals: a tenth of a millimetre


def write_points(path: os.PathLike[str] | str, points_m: ArrayLike, datum: Datum,
                 properties: Mapping[str, ArrayLike] | None = None) -> None:
    """Write points with latitude, longitude and ellipsoidal height.

    GeoJSON (RFC 7946) has a feature for each point, longitude first as it demands. CSV has columns
    ``latitude``, ``longitude`` (degrees), ``height`` (metres) and those of the properties. What is
    not known (NaN) is null in the former, empty in the latter.

    Parameters
    ----------
    path : path
        File to write, ending in ``.geojson`` or ``.csv``; complete or absent.
    points_m : (n, 3) array_like
        Imaging frame, metres.
    datum : Datum
        Place of the imaging frame on the Earth.
    properties : mapping of str to (n,) array_like, optional
        Further columns; the places in the frame are always among them as x, y and z.

    Raises
    ------
    ValueError
        The path ends otherwise, or a shape is wrong.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging.formats import write_points
    >>> from sar_imaging.geometry import Datum
    >>> poles = np.array([[0.0, 0.0, 0.0], [0.0, 100.0, 0.0]])
    >>> write_points('poles.csv', poles, Datum(47.0, 8.0, 450.0),
    ...              {'snr_db': np.array([20.0, 17.0])})
    >>> with open('poles.csv') as file:
    ...     header, _, second = file.read().splitlines()
    >>> header
    'latitude,longitude,height,x,y,z,snr_db'
    >>> f'{float(second.split(",")[0]):.5f}'
    '47.00090'
    """
    path = pathlib.Path(path)
    points_m = np.asarray(points_m, np.float64)
    if points_m.ndim != 2 or points_m.shape[1] != 3:
        raise ValueError(f'points_m.shape={points_m.shape}; expected (n, 3), metres')
    columns = dict(zip('xyz', points_m.T, strict=True)) | {
        name: np.asarray(values) for name, values in (properties or {}).items()}
    for name, values in columns.items():
        if values.shape != (len(points_m),):
            raise ValueError(f'{name}.shape={values.shape}; expected ({len(points_m)},), one for '
                             'each point')
    suffix = path.suffix.removeprefix('.')
    if suffix not in FORMATS:
        raise ValueError(f'{path.name}: expected a name that ends in '
                         f'{" or ".join(f".{name}" for name in FORMATS)}')
    places = np.stack(datum.to_geographic(points_m), axis=-1)
    with replacing(path) as part, open(part, 'w', encoding='utf-8', newline='') as file:
        if suffix == GEOJSON:
            json.dump({'type': 'FeatureCollection',
                       'features': list(_features(places, columns))}, file, indent=1)
        else:
            _write_csv(file, places, columns)


def _features(places: np.ndarray, columns: Mapping[str, np.ndarray]) -> Iterator[dict[str, Any]]:
    for row, (latitude, longitude, height) in enumerate(places.tolist()):
        known = math.isfinite(latitude)
        coordinates = [round(longitude, _DEGREES), round(latitude, _DEGREES),
                       round(height, _METRES)]
        yield {'type': 'Feature',
               'geometry': {'type': 'Point', 'coordinates': coordinates} if known else None,
               'properties': {name: _value(values[row]) for name, values in columns.items()}}


def _write_csv(file: TextIO, places: np.ndarray, columns: Mapping[str, np.ndarray]) -> None:
    writer = csv.writer(file)
    writer.writerow(['latitude', 'longitude', 'height', *columns])
    for row, (latitude, longitude, height) in enumerate(places.tolist()):
        numbers = (_value(values[row]) for values in columns.values())
        writer.writerow([_text(latitude, _DEGREES), _text(longitude, _DEGREES),
                         _text(height, _METRES), *('' if v is None else v for v in numbers)])


def _text(value: float, decimals: int) -> str:
    return f'{value:.{decimals}f}' if math.isfinite(value) else ''


def _value(value: object) -> Any:
    """A number or text of Python; None for a number that is not finite."""
    value = value.item() if isinstance(value, np.generic) else value
    return None if isinstance(value, float) and not math.isfinite(value) else value


_ENDING = '.ply'


def write_ply(path: os.PathLike[str] | str, points_m: ArrayLike,
              properties: Mapping[str, ArrayLike] | None = None, comment: str = '') -> None:
    """Write points with scalar properties as a binary PLY file, complete or not at all.

    ``x``, ``y`` and ``z`` are doubles, so that places far from the origin keep their millimetres;
    further properties are floats.

    Parameters
    ----------
    path : path
        File to write, ending in ``.ply``.
    points_m : (n, 3) array_like
        Imaging frame, metres.
    properties : mapping of str to (n,) array_like, optional
        Further values of each point, such as ``intensity``.
    comment : str
        Line of the header that tells what this is.

    Raises
    ------
    ValueError
        The path ends otherwise, a shape is wrong, or a name or the comment does not fit into a
        line of ASCII.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging.formats import write_ply
    >>> points = np.array([[1.0, 2.0, 0.5], [1.5, 2.0, 0.7]])
    >>> write_ply('cloud.ply', points, {'intensity': np.array([30.0, 24.0])})
    >>> with open('cloud.ply', 'rb') as file:
    ...     print(file.read().split(b'end_header')[0].decode('ascii').splitlines()[2])
    element vertex 2
    """
    path = pathlib.Path(path)
    if path.suffix != _ENDING:
        raise ValueError(f'{path.name}: expected a name that ends in {_ENDING}')
    points_m = np.asarray(points_m, np.float64)
    if points_m.ndim != 2 or points_m.shape[1] != 3:
        raise ValueError(f'points_m.shape={points_m.shape}; expected (n, 3), metres')
    columns = {name: np.asarray(values, np.float32)
               for name, values in (properties or {}).items()}
    for name, values in columns.items():
        if values.shape != (len(points_m),):
            raise ValueError(f'{name}.shape={values.shape}; expected ({len(points_m)},), one for '
                             'each point')
        if not (name.isascii() and name.isidentifier()):
            raise ValueError(f'{name!r} names no property; expected a word of ASCII letters')
    if not (comment.isascii() and comment.isprintable()):
        raise ValueError(f'comment={comment!r}; expected one line of ASCII')
    table = np.empty(len(points_m), [*((axis, '<f8') for axis in 'xyz'),
                                     *((name, '<f4') for name in columns)])
    for axis, values in zip('xyz', points_m.T, strict=True):
        table[axis] = values
    for name, values in columns.items():
        table[name] = values
    header = ['ply', 'format binary_little_endian 1.0',
              *([f'comment {comment}'] if comment else []),
              f'element vertex {len(table)}', *(f'property double {axis}' for axis in 'xyz'),
              *(f'property float {name}' for name in columns), 'end_header', '']
    with replacing(path) as part:
        part.write_bytes('\n'.join(header).encode('ascii') + table.tobytes())
