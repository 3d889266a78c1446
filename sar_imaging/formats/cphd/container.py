# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""The container of CPHD: header, metadata and arrays, whose sizes are checked against the file.

Layout of the file: NGA.STND.0068-1 (CPHD 1.0.1 and 1.1.0). Nothing is allocated by what a header
or the metadata declare before the file is known to hold it.
"""

from __future__ import annotations

import contextlib
import dataclasses
import os
from pathlib import Path
from typing import Any

import numpy as np

from ...files import naming, reading, told
from ..extras import require

PURPOSE = 'CPHD'
_LONGEST_HEADER = 2**16  # bytes; real ones have a few hundred
_LARGEST_XML = 2**26  # bytes; real ones have tens of thousands
_TERMINATOR = b'\f\n'
_NEEDED_VECTOR_PARAMETERS = ('TxTime', 'TxPos', 'RcvPos', 'SRPPos', 'FX1', 'FX2', 'TOA1', 'TOA2',
                             'SC0', 'SCSS')
_SAMPLE_TYPES = {'CI2': np.dtype(('>i1', (2,))), 'CI4': np.dtype(('>i2', (2,))),
                 'CF8': np.dtype('>c8')}


class CphdError(ValueError):
    """A file is no CPHD, is damaged, or holds what cannot be imaged; or pulses are no CPHD.

    Examples
    --------
    >>> from sar_imaging.formats.cphd import CphdError, CphdReader
    >>> with open('notes.cphd', 'w') as file:
    ...     _ = file.write('no phase histories')
    >>> try:
    ...     CphdReader('notes.cphd')
    ... except CphdError as error:
    ...     print(error)
    notes.cphd is no CPHD: it begins with b'no phase histori', not with b'CPHD/1.1.0'
    """


@dataclasses.dataclass(frozen=True)
class ChannelLayout:
    """Where the arrays of a channel stand in the file.

    Parameters
    ----------
    n_vectors, n_samples : int
        Number of vectors and samples of the channel.
    signal_offset, pvp_offset : int
        Bytes from the beginning of the file.
    """

    n_vectors: int
    n_samples: int
    signal_offset: int
    pvp_offset: int


class Container:
    """An open CPHD file.

    Parameters
    ----------
    path : path
        File to open.

    Attributes
    ----------
    path : Path
        The file.
    n_bytes : int
        Its size.
    version : str
        ``'1.0.1'`` or ``'1.1.0'``.
    header : dict of str to str
        Its header's fields.
    tree : lxml.etree.ElementTree
        Its metadata.
    channels : dict of str to ChannelLayout
        By identifier, in the order of the file.
    sample_type : str
        ``'CI2'``, ``'CI4'`` or ``'CF8'``.

    Raises
    ------
    CphdError
        It is no CPHD, is truncated, or contradicts itself.
    OSError
        It cannot be opened.
    MissingExtraError
        sarkit is not installed.
    """

    def __init__(self, path: Path | str):
        self.path = Path(path)
        self._sarkit = require('sarkit.cphd', PURPOSE)
        with reading(self.path, 'CPHD', CphdError), contextlib.ExitStack() as opened:
            self._file = opened.enter_context(open(self.path, 'rb', buffering=0))
            self.n_bytes = os.fstat(self._file.fileno()).st_size
            self.version, self.header, self.n_header_bytes = self._read_header()
            self.tree = self._read_metadata()
            self.sample_type = self._sample_type()
            self.pvp_type = self._pvp_type()
            self.channels = self._layout()
            opened.pop_all()

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def __enter__(self) -> Container:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def text(self, path: str, default: str | None = None) -> str:
        """Text of an element, ``'Global/SGN'``; an element without a default must be there."""
        found = self.tree.findtext('/'.join(f'{{*}}{step}' for step in path.split('/')))
        if found is None or not found.strip():
            if default is None:
                raise CphdError(f'{self.path}: the metadata have no {path}')
            return default
        return found.strip()

    def read_pvps(self, channel: str) -> np.ndarray:
        """(n_vectors,) structured array of the parameters of a channel's vectors."""
        layout = self.channels[channel]
        return self._array(layout.pvp_offset, layout.n_vectors, self.pvp_type)

    def read_support_array(self, name: str) -> np.ndarray:
        """(rows, columns) gain and phase of a support array of an antenna."""
        kind = np.dtype([('Gain', '>f4'), ('Phase', '>f4')])
        for node in self.tree.findall('{*}Data/{*}SupportArray'):
            if node.findtext('{*}Identifier') == name:
                rows, columns = (self._count(node, f'Num{what}') for what in ('Rows', 'Cols'))
                place = self._place(node, name, 'ArrayByteOffset', self._block('SUPPORT'),
                                    rows * columns * kind.itemsize)
                return self._array(place, rows * columns, kind).reshape(rows, columns)
        raise CphdError(f'{self.path}: there is no support array {name!r}')

    def read_samples(self, channel: str, start: int, stop: int) -> np.ndarray:
        """Samples of some vectors of a channel, as the file has them.

        Returns
        -------
        (n, N) complex64, or (n, N, 2) int8 or int16
            Big endian; integers as real and imaginary parts.
        """
        layout, kind = self.channels[channel], _SAMPLE_TYPES[self.sample_type]
        row = np.dtype((kind, (layout.n_samples,)))
        return self._array(layout.signal_offset + start * row.itemsize, stop - start, row)

    def _array(self, offset: int, count: int, kind: np.dtype) -> np.ndarray:
        self._file.seek(offset)
        array = np.fromfile(self._file, kind, count)
        if len(array) != count:
            raise CphdError(f'{self.path}: {count} vectors expected at byte {offset}, '
                            f'{len(array)} found; the file was truncated while it was read')
        return array

    def _read_header(self) -> tuple[str, dict[str, str], int]:
        start = self._file.read(_LONGEST_HEADER)
        if not start.startswith(b'CPHD/'):
            raise CphdError(f'{self.path} is no CPHD: it begins with {start[:16]!r}, not with '
                            "b'CPHD/1.1.0'")
        end = start.find(_TERMINATOR)
        if end < 0:
            raise CphdError(f'{self.path}: no end of the header within {len(start)} bytes')
        try:
            lines = start[:end].decode('utf-8').split('\n')
        except UnicodeDecodeError as error:
            raise CphdError(f'{self.path}: the header is no text: {told(error)}') from error
        version = lines[0][len('CPHD/'):].strip()
        if version not in [v['version'] for v in self._sarkit.VERSION_INFO.values()]:
            raise CphdError(f'{self.path} is CPHD {version}; 1.0.1 and 1.1.0 can be read')
        fields = {}
        for line in filter(None, lines[1:]):
            name, separator, value = line.partition(' := ')
            if not separator:
                raise CphdError(f'{self.path}: header line {line[:60]!r}; expected '
                                "'NAME := VALUE'")
            fields[name] = value
        return version, fields, end

    def _block(self, name: str) -> tuple[int, int]:
        """First byte and size of a block that lies within the file."""
        values = []
        for field in (f'{name}_BLOCK_BYTE_OFFSET', f'{name}_BLOCK_SIZE'):
            text = self.header.get(field)
            if text is None or not text.strip().isdecimal() or len(text) > 20:
                raise CphdError(f'{self.path}: header field {field} is {text!r}; expected a '
                                'number of bytes')
            values.append(int(text))
        offset, size = values
        if offset + size > self.n_bytes or not size:
            raise CphdError(f'{self.path}: the {name} block of {size} bytes at {offset} does not '
                            f'lie within the file of {self.n_bytes} bytes; it is truncated or '
                            'damaged')
        return offset, size

    def _read_metadata(self) -> Any:
        offset, size = self._block('XML')
        if size > _LARGEST_XML:
            raise CphdError(f'{self.path}: metadata of {size} bytes; expected at most '
                            f'{_LARGEST_XML}')
        self._file.seek(offset)
        text = self._file.read(size)
        etree = require('lxml.etree', PURPOSE)
        # entities would let a small file grow without bound, and read other files
        parser = etree.XMLParser(resolve_entities=False, no_network=True, huge_tree=False)
        try:
            root = etree.fromstring(text, parser)
        except (etree.XMLSyntaxError, ValueError) as error:
            raise CphdError(f'{self.path}: the metadata are no XML: {told(error)}') from error
        tree = root.getroottree()
        if tree.docinfo.doctype:
            raise CphdError(f'{self.path}: the metadata declare a document type; CPHD has none')
        name = etree.QName(root)
        if name.localname != 'CPHD' or name.namespace not in self._sarkit.VERSION_INFO:
            raise CphdError(f'{self.path}: the metadata are {root.tag}, not those of CPHD '
                            f'{self.version}')
        return tree

    def _sample_type(self) -> str:
        name = self.text('Data/SignalArrayFormat')
        if name not in _SAMPLE_TYPES:
            raise CphdError(f'{self.path}: samples of type {name}; expected '
                            f'{", ".join(_SAMPLE_TYPES)}')
        compression = self.text('Data/SignalCompressionID', '')
        if compression:
            raise CphdError(f'{self.path}: samples are compressed ({compression}); the standard '
                            "does not say how, decompress them with the maker's program")
        return name

    def _pvp_type(self) -> np.dtype:
        size = self._count(self.tree.getroot(), 'Data/NumBytesPVP')
        if size % 8 or size > self._block('PVP')[1]:
            raise CphdError(f'{self.path}: NumBytesPVP is {size}; expected a multiple of 8 within '
                            'the PVP block')
        with naming(self.path, 'has no parameters of vectors that can be read', CphdError):
            kind = self._sarkit.get_pvp_dtype(self.tree).newbyteorder('>')
        missing = [n for n in _NEEDED_VECTOR_PARAMETERS if n not in kind.names]
        if missing:
            raise CphdError(f'{self.path}: the vectors have no {", ".join(missing)}')
        for name in _NEEDED_VECTOR_PARAMETERS:
            wanted = np.dtype(('>f8', (3,) if name.endswith('Pos') else ()))
            if kind[name] != wanted:
                raise CphdError(f'{self.path}: {name} is of type {kind[name]}; expected {wanted}')
        return kind

    def _layout(self) -> dict[str, ChannelLayout]:
        signal, pvp = self._block('SIGNAL'), self._block('PVP')
        channels = {}
        for node in self.tree.findall('{*}Data/{*}Channel'):
            name = node.findtext('{*}Identifier')
            if not name or name in channels:
                raise CphdError(f'{self.path}: a channel without a name of its own: {name!r}')
            vectors, samples = (self._count(node, n) for n in ('NumVectors', 'NumSamples'))
            if samples < 2 or not vectors:
                raise CphdError(f'{self.path}: channel {name!r} has {vectors} vectors of '
                                f'{samples} samples')
            size = vectors * samples * _SAMPLE_TYPES[self.sample_type].itemsize
            channels[name] = ChannelLayout(
                vectors, samples,
                self._place(node, name, 'SignalArrayByteOffset', signal, size),
                self._place(node, name, 'PVPArrayByteOffset', pvp,
                            vectors * self.pvp_type.itemsize))
        if not channels:
            raise CphdError(f'{self.path}: the metadata name no channel')
        return channels

    def _count(self, node: Any, path: str) -> int:
        text = node.findtext('/'.join(f'{{*}}{step}' for step in path.split('/'))) or ''
        if not text.strip().isdecimal() or len(text) > 20:
            raise CphdError(f'{self.path}: {path} is {text[:40]!r}; expected a number')
        return int(text)

    def _place(self, node: Any, channel: str, field: str, block: tuple[int, int], size: int
               ) -> int:
        offset = self._count(node, field)
        if offset + size > block[1]:
            raise CphdError(f'{self.path}: {channel!r} takes {size} bytes from {offset} '
                            f'({field}) of a block of {block[1]}; the metadata or the file are '
                            'damaged')
        return block[0] + offset
