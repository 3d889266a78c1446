# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Variables of data files: NumPy, MATLAB, HDF5, CSV, P440 logs; sizes are checked before reading.

Names of nested variables have points: ``data.fp`` is the field fp of the MATLAB structure data,
or the data set fp of the HDF5 group data. The variables of a CSV file are its columns.

Logs of Time Domain's radars P410, P440 and P452 have one line of text for each scan. The maker's
program MRM-RET and its sample application write lines of comma-separated fields, the second of
which names the kind. A scan is a line of the kind ``MrmFullScanInfo``: times, first and last
delay in picoseconds, step in bins, then the samples. Other lines are passed over.
"""

from __future__ import annotations

import functools
import itertools
import struct
import zlib
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.io import loadmat, whosmat

from ..files import reading
from ..formats.extras import require
from ..numpy_files import check_expansion, check_memory, open_npz, read_npy
from ..signal.radar import SPEED_OF_LIGHT
from .description import DescriptionError

_SCAN = 'MrmFullScanInfo'
_BIN_S = 1 / (512 * 1.024e9)  # of the radar's timer
_RAW = 1  # of the field filtering: others were filtered in range or over time
# Places of the fields by the number of those before the samples, the last of which counts these:
# MRM-RET, and the sample application without its five reserved fields.
_PLACES = {16: {'time': 4, 'start': 9, 'step': 11, 'filtering': 12, 'antenna': 13},
           11: {'time': 4, 'start': 5, 'step': 7, 'filtering': 8, 'antenna': 9}}
_SEARCHED = 10_000  # characters in which the first scan is announced


def is_log(path: Path) -> bool:
    """Whether a text file is such a log."""
    with path.open(encoding='utf-8', errors='replace') as file:
        return _SCAN in file.read(_SEARCHED)


def read_log(path: Path) -> dict[str, np.ndarray]:
    """Variables of a log.

    Parameters
    ----------
    path : Path
        Text file.

    Returns
    -------
    dict of str to array
        ``scan`` (P, N) int32; ``time_s`` (P,) float64 by the radar's clock, in steps of a
        millisecond; ``host_time_s`` (P,) float64 when the computer received it, since 1970;
        ``range_start_m`` and ``range_bin_m``, float64: range of the first sample, antenna delays
        included, and from sample to sample.

    Raises
    ------
    DescriptionError
        It holds no raw scans, or scans of several settings.
    """
    return _read(path, path.stat().st_mtime_ns)


@functools.lru_cache(maxsize=1)  # one description asks for each variable
def _read(path: Path, _: int) -> dict[str, np.ndarray]:
    heads, scans, filtered = [], [], 0
    with path.open(encoding='utf-8', errors='replace') as file:
        for number, line in enumerate(file, 1):
            fields = line.split(',')
            if len(fields) < 2 or fields[1].strip() != _SCAN or fields[0].strip() == 'Timestamp':
                continue
            try:
                head, samples = _scan(fields)
            except (ValueError, OverflowError):
                raise DescriptionError(
                    f'{path.name}: line {number} is no whole {_SCAN}: expected 16 or 11 fields, '
                    'the last of which counts the samples behind it; was the file cut off? '
                    'Remove the line') from None
            if head['filtering'] != _RAW:
                filtered += 1
                continue
            heads.append(head)
            scans.append(samples)
    if not scans:
        raise DescriptionError(f'{path.name} holds no raw scans but {filtered} filtered ones; '
                               'expected lines MrmFullScanInfo with Filtering 1: switch the raw '
                               'scans on in the program that logs')
    for key, meaning in (('start', 'ScanStartPs'), ('step', 'ScanStepBins'),
                         ('antenna', 'AntennaId')):
        found = {head[key] for head in heads}
        if len(found) > 1:
            raise DescriptionError(f'{path.name}: scans with {meaning} of '
                                   f'{", ".join(map(str, sorted(found)))}; expected one setting: '
                                   'cut the log into one file for each')
    if len({scan.size for scan in scans}) > 1:
        raise DescriptionError(f'{path.name}: scans of {min(s.size for s in scans)} to '
                               f'{max(s.size for s in scans)} samples; expected one length')
    return {'scan': np.stack(scans),
            'time_s': 1e-3 * np.array([head['time'] for head in heads]),
            'host_time_s': np.array([head['host'] for head in heads]),
            'range_start_m': np.array(0.5e-12 * SPEED_OF_LIGHT * heads[0]['start']),
            'range_bin_m': np.array(0.5 * SPEED_OF_LIGHT * _BIN_S * heads[0]['step'])}


def _scan(fields: list[str]) -> tuple[dict[str, float], np.ndarray]:
    """Numbers before the samples, and (N,) int32 samples."""
    for n, places in _PLACES.items():
        if len(fields) > n and int(float(fields[n - 1])) == len(fields) - n:
            head = {key: int(fields[place]) for key, place in places.items()}
            return {**head, 'host': float(fields[0])}, np.array(fields[n:], np.int32)
    raise ValueError(fields[:2])


_HDF5_MAGIC = b'\x89HDF\r\n\x1a\n'
_MATLAB_HEADER = 512  # of HDF5 files that MATLAB wrote
_MATLAB_5_HEADER, _MATLAB_COMPRESSED = 128, 15
_PEEKED = 4096  # bytes of a compressed variable, which hold its size
_MOST_NAMES = 100  # that a message lists
_SEPARATORS = ',;\t'
_BYTES_PER_CHARACTER = 8  # of a table of numbers, as Python reads it


def find_files(folder: Path, pattern: str, key: str) -> list[Path]:
    """Files of a pattern in a folder, in the order of their names.

    Raises
    ------
    DescriptionError
        There is none.
    """
    if '**' in pattern:
        raise DescriptionError(f'{key}: {pattern} names every folder below; expected a file, or a '
                               "pattern such as '*.mat'")
    given = folder / pattern
    if given.is_dir():
        raise DescriptionError(f'{key}: {given} is a folder; expected a file, or a bag whose '
                               'topic samples.topic names')
    alone = given.is_file() or Path(pattern).is_absolute()
    found = [given] if alone else sorted(folder.glob(pattern))
    files = [file for file in found if file.is_file()]
    if not files:
        raise DescriptionError(f'{key}: {folder} holds no file {pattern}; name the folder with '
                               'the data as second argument, or correct the name')
    return files


class DataFiles:
    """Variables of one file, or of several that continue each other.

    Parameters
    ----------
    paths : sequence of Path
        In the order of their pulses.
    """

    def __init__(self, paths: Sequence[Path]):
        self.paths = list(paths)
        self._read: dict[tuple[Path, str], np.ndarray] = {}

    def parts(self, name: str) -> list[np.ndarray]:
        """The variable of each file."""
        out = []
        for path in self.paths:
            if (path, name) not in self._read:
                self._read[path, name] = read_variable(path, name)
            out.append(self._read[path, name])
        return out

    def joined(self, name: str, axis: int = 0) -> np.ndarray:
        """The variables of all files, one after the other along an axis."""
        parts = self.parts(name)
        beside = [part.shape[:axis] + part.shape[axis + 1:] for part in parts]
        for path, part, shape in zip(self.paths, parts, beside, strict=True):
            if shape != beside[0]:
                raise DescriptionError(
                    f'{path.name}: {name}.shape={part.shape} does not continue {parts[0].shape} '
                    f'of {self.paths[0].name}; load files of one recording at a time')
        return parts[0] if len(parts) == 1 else np.concatenate(parts, axis=axis)

    def real(self, name: str) -> np.ndarray:
        """As `joined`, of numbers that are not complex."""
        array = self.joined(name)
        if array.dtype.kind == 'c':
            raise DescriptionError(f'{self.paths[0].name}: {name} holds complex numbers; expected '
                                   'real ones')
        return array

    def same(self, name: str) -> np.ndarray:
        """A variable that must be equal in all files."""
        parts = self.parts(name)
        for path, part in zip(self.paths, parts, strict=True):
            if not np.array_equal(part, parts[0]):
                raise DescriptionError(
                    f'{path.name}: {name} differs from that of {self.paths[0].name}; load files '
                    'of one recording at a time')
        return parts[0]


def read_variable(path: Path, name: str) -> np.ndarray:
    """Array of a variable.

    Parameters
    ----------
    path : Path
        File of type .npy, .npz, .mat, .h5, .hdf5 or .csv, or P440 log (.csv, .txt, .log).
    name : str
        Name of the variable; .npy files have one, whatever its name.

    Raises
    ------
    DescriptionError
        The file cannot be read, lacks the variable, or this is too large.
    MissingExtraError
        It is an HDF5 file, and h5py is not installed.
    """
    readers = {'.npy': lambda path, _: read_npy(path), '.npz': _npz, '.mat': _mat,
               '.h5': _hdf5, '.hdf5': _hdf5, '.csv': _text, '.txt': _text, '.log': _text}
    reader = readers.get(path.suffix.lower())
    if reader is None:
        raise DescriptionError(
            f'{path.name} has no variable {name}: variables are in files of type '
            f'{", ".join(readers)}; other samples need samples.dtype and samples.sizes, and '
            'times a file of their own (times.file) or times.interval_s')
    with reading(path, f'a file of type {path.suffix.lower()}', DescriptionError):
        array = np.asarray(reader(path, name))
    if array.dtype.kind not in 'iufcb':
        raise DescriptionError(f'{path.name}: {name} holds {array.dtype}; expected numbers')
    return array


def _data_sets(group: Any, h5py: Any, deeper: int = 3) -> Iterator[str]:
    """Names of the data sets of a group, and of some levels below."""
    for key in group:
        if isinstance(group.get(key, getlink=True), h5py.HardLink):
            if isinstance(item := group[key], h5py.Dataset):
                yield key
            elif deeper and isinstance(item, h5py.Group):
                yield from (f'{key}.{name}' for name in _data_sets(item, h5py, deeper - 1))


def _absent(path: Path, name: str, present: Iterable[str]) -> DescriptionError:
    return DescriptionError(f'{path.name} has no variable {name}; it has '
                            f'{", ".join(sorted(present)) or "none"}')


def _npz(path: Path, name: str) -> np.ndarray:
    with open_npz(path) as arrays:
        if name not in arrays.names:
            raise _absent(path, name, arrays.names)
        return arrays[name]


def _text(path: Path, name: str) -> np.ndarray:
    check_memory(path.name, _BYTES_PER_CHARACTER * path.stat().st_size)
    if is_log(path):
        variables = read_log(path)
    else:
        names, rows = read_table(path)
        variables = dict(zip(names, rows.T, strict=True))
    if name not in variables:
        raise _absent(path, name, variables)
    return variables[name]


def _mat(path: Path, name: str) -> np.ndarray:
    with path.open('rb') as file:
        head = file.read(_MATLAB_HEADER + len(_HDF5_MAGIC))
    if head[_MATLAB_HEADER:] == _HDF5_MAGIC or head.startswith(_HDF5_MAGIC):
        return _hdf5(path, name, matlab=True)
    first, *fields = name.split('.')
    shapes = {entry[0]: entry[1] for entry in whosmat(path)}
    if first not in shapes:
        raise _absent(path, name, shapes)
    check_memory(f'{first} of {path.name}', _matlab_bytes(path))
    value = loadmat(path, squeeze_me=True, struct_as_record=False, variable_names=[first])[first]
    for field in fields:
        present = getattr(value, '_fieldnames', ())
        if field not in present:
            raise _absent(path, name, [f'{first}.{other}' for other in present])
        value = getattr(value, field)
    return value


def _matlab_bytes(path: Path) -> int:
    """Size of the variables of a MATLAB file of version 5 to 7.2 when they are unpacked."""
    total = n_bytes = path.stat().st_size
    with path.open('rb') as file:
        place = _MATLAB_5_HEADER
        while place + 8 <= n_bytes:
            file.seek(place)
            kind, size = struct.unpack('<II', file.read(8))
            if kind == _MATLAB_COMPRESSED:
                tag = zlib.decompressobj().decompress(file.read(min(size, _PEEKED)), 8)
                unpacked = int.from_bytes(tag[4:], 'little')
                check_expansion(f'a variable of {path.name}', unpacked, size)
                total += unpacked
            place += 8 + size
    return total


def _hdf5(path: Path, name: str, *, matlab: bool = False) -> np.ndarray:
    h5py = require('h5py', f'reading {path.name}', 'hdf5')
    with h5py.File(path, 'r') as file:
        item = file
        for part in name.replace('.', '/').split('/'):
            link = item.get(part, getlink=True) if isinstance(item, h5py.Group) else None
            if link is not None and not isinstance(link, h5py.HardLink):
                raise DescriptionError(f'{path.name}: {name} is a link to {link.path}; expected '
                                       'the numbers themselves')
            item = None if link is None else item[part]
        if not isinstance(item, h5py.Dataset):
            raise _absent(path, name, itertools.islice(_data_sets(file, h5py), _MOST_NAMES))
        if item.external or item.is_virtual:
            raise DescriptionError(f'{path.name}: {name} is stored in other files; expected the '
                                   'numbers in this one')
        told = f'{name} of {path.name}'
        check_memory(told, item.nbytes)
        check_expansion(told, item.nbytes, item.id.get_storage_size())
        array = np.asarray(item[()])
    if array.dtype.names is not None and len(array.dtype.names) == 2:  # real and imaginary part
        real, imaginary = (array[field] for field in array.dtype.names)
        array = real + 1j * imaginary
    # MATLAB stores the first axis last, and has no array of one axis.
    return np.squeeze(array.T) if matlab else array


def read_table(path: Path) -> tuple[list[str], np.ndarray]:
    """Column names and rows of a CSV file.

    Parameters
    ----------
    path : Path
        Columns are separated by commas, semicolons, tabs or spaces.

    Returns
    -------
    names : list of str
    rows : (N, len(names)) float64

    Raises
    ------
    DescriptionError
        It is no such table.
    """
    text = path.read_text(encoding='utf-8-sig')
    lines = [line for line in text.splitlines() if line.strip()]
    if len(lines) < 2:
        raise DescriptionError(f'{path.name} has no rows; expected a line of column names and one '
                               'line for each pose')
    separator = next((s for s in _SEPARATORS if s in lines[0]), None)
    names = [name.strip().strip('#').strip().strip('"') for name in lines[0].split(separator)]
    if all(_is_number(name) for name in names):
        raise DescriptionError(f'{path.name} has no line of column names, its first line is '
                               f'{lines[0][:60]!r}; put a line such as time,x,y,z before it')
    return names, numbers(path, lines[1:], separator, len(names), first=2)


def numbers(path: Path, lines: list[str], separator: str | None, n_columns: int, *,
            first: int = 1, expected: str = '') -> np.ndarray:
    """(N, n_columns) float64 numbers of lines of text.

    Parameters
    ----------
    path : Path
        For messages.
    lines : list of str
        Rows.
    separator : str or None
        Between columns; None for blanks.
    n_columns : int
        Number of columns of each row.
    first : int
        Number of the first row, for messages.
    expected : str
        What the columns are, for messages.

    Raises
    ------
    DescriptionError
        A row is longer or shorter, or holds something else.
    """
    rows = [line.split(separator) for line in lines]
    if not rows:
        raise DescriptionError(f'{path.name} has no rows' + (f'; expected {expected}' if expected
                                                            else ''))
    for number, row in enumerate(rows, first):
        if len(row) != n_columns:
            raise DescriptionError(f'{path.name}: row {number} has {len(row)} columns; expected '
                                   f'{n_columns}' + (f', {expected}' if expected else ''))
    try:
        return np.array(rows, np.float64)
    except ValueError:
        number, text = next((number, text) for number, row in enumerate(rows, first)
                            for text in row if not _is_number(text))
        advice = ('write decimals with a point' if _is_number(text.replace(',', '.')) else
                  'write times in seconds and angles as quaternions')
        raise DescriptionError(f'{path.name}: row {number} holds {text.strip()!r}; expected '
                               f'numbers: {advice}') from None


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
