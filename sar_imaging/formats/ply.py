"""Point clouds as PLY files (Turk 1994), which CloudCompare, MeshLab, Open3D and Blender read."""

from __future__ import annotations

import os
import pathlib
from collections.abc import Mapping

import numpy as np

from ..files import replacing

_ENDING = '.ply'


def write_ply(path: os.PathLike | str, points_m: np.ndarray,
              properties: Mapping[str, np.ndarray] | None = None, comment: str = '') -> None:
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
