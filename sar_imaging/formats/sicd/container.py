"""The NITF file around a SICD image: its XML and its pixels, with sizes checked beforehand.

sarkit reads files of SICD 1.1 and later; this reads those of the versions before as well, and
believes no number of a file before it was compared with the size of the file.
"""

from __future__ import annotations

import codecs
import io
import itertools
import logging
import os

import numpy as np

from ...files import told
from ..extras import require
from .pixels import DTYPES


class _Bounded(io.RawIOBase):
    """A file from which no more is read than there is, whatever is asked for."""

    def __init__(self, file, size: int):
        self._file, self._size = file, size

    def read(self, size: int = -1) -> bytes:
        left = max(self._size - self._file.tell(), 0)
        return self._file.read(left if size < 0 else min(size, left))

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        return self._file.seek(offset, whence)

    def tell(self) -> int:
        return self._file.tell()


class SicdContainer:
    """Open SICD file.

    Parameters
    ----------
    file : binary file
        At its beginning.

    Attributes
    ----------
    root : lxml element
        Of the XML.

    Raises
    ------
    ValueError
        The file is no NITF file, or there is no SICD in it.
    """

    def __init__(self, file):
        self._file = file
        self._size = os.fstat(file.fileno()).st_size
        self._nitf = _load(_Bounded(file, self._size))
        self.root = self._parse()

    def _parse(self):
        etree = require('lxml.etree', 'reading SICD')
        parser = etree.XMLParser(resolve_entities=False, no_network=True, huge_tree=False)
        damage = ''
        for segment in self._nitf['DataExtensionSegments']:
            offset, size = segment['DESDATA'].get_offset(), segment['DESDATA'].get_size()
            if offset + size > self._size:
                raise ValueError(f'the file has {self._size} bytes, but its text ends at byte '
                                 f'{offset + size}: it was cut off')
            self._file.seek(offset)
            text = self._file.read(size)
            if not text.removeprefix(codecs.BOM_UTF8).lstrip().startswith(b'<'):
                continue
            try:
                root = etree.fromstring(text, parser)
            except (etree.XMLSyntaxError, ValueError) as error:
                damage = f'; its XML is damaged: {told(error)}'
                continue
            if etree.QName(root).localname == 'SICD':
                return root
        raise ValueError(f'there is no SICD in it{damage}; expected a NITF file with the XML of '
                         'one')

    def read(self, shape: tuple[int, int], pixel_type: str) -> np.ndarray:
        """Pixels of the whole image, in the machine's byte order.

        Raises
        ------
        ValueError
            The segments do not make an image of this shape and type, are compressed, or reach
            beyond the end of the file.
        """
        stored = DTYPES[pixel_type].newbyteorder('>')
        parts = self._segments(shape, stored)
        out = np.empty(shape, DTYPES[pixel_type])
        row = 0
        for offset, rows in parts:
            self._file.seek(offset)
            values = np.fromfile(self._file, stored, rows * shape[1])
            out[row:row + rows] = values.reshape(rows, shape[1])
            row += rows
        return out

    def check(self, shape: tuple[int, int], pixel_type: str) -> None:
        """Raise `ValueError` where `read` would: sizes are compared, no pixels read."""
        self._segments(shape, DTYPES[pixel_type].newbyteorder('>'))

    def _segments(self, shape: tuple[int, int], stored: np.dtype) -> list[tuple[int, int]]:
        """Offset and rows of each segment, which together are within the file."""
        found = []
        for segment in self._nitf['ImageSegments']:
            header = segment['subheader']
            if not str(header['IID1'].value).startswith('SICD'):
                continue
            told = {name: header[name].value for name in ('NROWS', 'NCOLS', 'IC', 'IMODE', 'NBPR',
                                                          'NBPC')}
            if (told['IC'], told['IMODE'], told['NBPR'], told['NBPC']) != ('NC', 'P', 1, 1):
                raise ValueError(f'its pixels are stored as {told}; expected IC=NC, IMODE=P and '
                                 'one block: neither compressed nor in blocks')
            found.append((str(header['IID1'].value), segment['Data'].get_offset(), told['NROWS'],
                          told['NCOLS']))
        if not found:
            raise ValueError('there is no image segment of SICD in it')
        found.sort()
        rows, columns = sum(part[2] for part in found), {part[3] for part in found}
        if rows != shape[0] or columns != {shape[1]}:
            raise ValueError(f'its segments hold {rows} rows of {sorted(columns)} columns, its '
                             f'XML tells of {shape[0]} rows of {shape[1]}')
        ends = [offset + n * shape[1] * stored.itemsize for _, offset, n, _ in found]
        if max(ends) > self._size:
            raise ValueError(f'the file has {self._size} bytes, but its pixels end at byte '
                             f'{max(ends)}: it was cut off')
        starts = [offset for _, offset, _, _ in found]
        for end, start in itertools.pairwise(sorted([*zip(starts, ends, strict=True)])):
            if start[0] < end[1]:
                raise ValueError('its segments overlap: the headers are damaged')
        return [(offset, n) for _, offset, n, _ in found]


def _load(file):
    """Headers of a NITF file; of a damaged one jbpy raises what its parsers meet."""
    jbpy = require('jbpy', 'reading SICD')
    logger = logging.getLogger('jbpy')  # reports each odd field; of old files there are many
    level, logger.level = logger.level, logging.CRITICAL
    try:
        if file.read(4) not in (b'NITF', b'NSIF'):
            raise ValueError('it does not begin with NITF')
        file.seek(0)
        return jbpy.Jbp().load(file)
    finally:
        logger.setLevel(level)
