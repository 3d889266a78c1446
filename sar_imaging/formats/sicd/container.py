# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""The NITF file around a SICD image: its XML and its pixels, with sizes checked beforehand.

sarkit reads files of SICD 1.1 and later; this reads those of the versions before as well, and
believes no number of a file before it was compared with the size of the file.

Pixels are floating point, integers of 16 bits, or amplitude and phase of 8.
"""

from __future__ import annotations

import codecs
import io
import itertools
import logging
import os
from typing import IO, Any

import numpy as np

from ...files import told
from ..extras import require

FLOAT, INTEGER, AMPLITUDE_PHASE = PIXEL_TYPES = 'RE32F_IM32F', 'RE16I_IM16I', 'AMP8I_PHS8I'
DTYPES = {FLOAT: np.dtype(np.complex64),
          INTEGER: np.dtype([('real', np.int16), ('imag', np.int16)]),
          AMPLITUDE_PHASE: np.dtype([('amp', np.uint8), ('phase', np.uint8)])}
_LARGEST = 32767
_TABLE_DB = 72.0  # of amplitudes of 8 bits: 0.28 dB from one to the next


def encoded(samples: np.ndarray, pixel_type: str) -> tuple[np.ndarray, np.ndarray | None,
                                                           float | None]:
    """Pixels of a type from complex samples.

    Parameters
    ----------
    samples : (rows, columns) complex64
        At baseband.
    pixel_type : str
        One of `PIXEL_TYPES`.

    Returns
    -------
    pixels : (rows, columns)
        Pixels of the type's dtype.
    amplitudes : (256,) float64 or None
        What codes of 8 bits stand for.
    scale : float or None
        What integers were multiplied by.

    Raises
    ------
    ValueError
        There is no such type, or a sample is not finite.
    """
    if pixel_type not in PIXEL_TYPES:
        raise ValueError(f'pixel_type={pixel_type!r}; expected one of {", ".join(PIXEL_TYPES)}')
    if pixel_type == FLOAT:
        return samples, None, None
    if not np.isfinite(samples).all():
        raise ValueError(f'{np.count_nonzero(~np.isfinite(samples))} samples are NaN or infinite, '
                         f'which {pixel_type} cannot hold; write {FLOAT}')
    out = np.empty(samples.shape, DTYPES[pixel_type])
    if pixel_type == INTEGER:
        scale = _integer_scale(samples)
        out['real'], out['imag'] = (np.rint(part * scale) for part in (samples.real.astype(float),
                                                                       samples.imag.astype(float)))
        return out, None, scale
    magnitude = np.abs(samples.astype(np.complex128))
    table = _amplitudes(float(magnitude.max(initial=0.0)))
    edges = 0.5 * (table[1:] + table[:-1])
    out['amp'] = np.searchsorted(edges, magnitude)
    turns = np.angle(samples.astype(np.complex128)) / (2 * np.pi)
    out['phase'] = np.rint(256 * turns).astype(np.int64) % 256
    return out, table, None


def decoded(pixels: np.ndarray, amplitudes: np.ndarray | None, scale: float) -> np.ndarray:
    """(rows, columns) complex64 samples of pixels of any type.

    Parameters
    ----------
    pixels : (rows, columns)
        In the machine's byte order.
    amplitudes : (256,) float64 or None
        What codes of 8 bits stand for; themselves unless told.
    scale : float
        What samples were multiplied by.
    """
    if pixels.dtype == DTYPES[FLOAT]:
        return pixels
    if pixels.dtype == DTYPES[INTEGER]:
        out = np.empty(pixels.shape, np.complex64)
        out.real, out.imag = pixels['real'] / scale, pixels['imag'] / scale
        return out
    table = np.arange(256.0) if amplitudes is None else amplitudes
    phasors = np.exp(2j * np.pi * np.arange(256) / 256)
    return (table[pixels['amp']] * phasors[pixels['phase']]).astype(np.complex64)


def _integer_scale(samples: np.ndarray) -> float:
    """Factor that uses the range of the integers; 1 for samples that are such integers."""
    values = np.ascontiguousarray(samples).view(np.float32)
    largest = float(np.abs(values).max(initial=0.0))
    if largest <= _LARGEST and (values == np.rint(values)).all():
        return 1.0
    return _LARGEST / largest


def _amplitudes(largest: float) -> np.ndarray:
    """Nothing, then even steps in decibels up to the largest.

    That is rounded, so that what was read from a file gets the same table again.
    """
    levels = 10 ** (np.linspace(-_TABLE_DB, 0.0, 255) / 20)
    return np.concatenate([[0.0], (float(f'{largest:.4e}') or 1.0) * levels])


class _Bounded(io.RawIOBase):
    """A file from which no more is read than there is, whatever is asked for."""

    def __init__(self, file: IO[bytes], size: int) -> None:
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
        Root of the XML.

    Raises
    ------
    ValueError
        The file is no NITF file, or there is no SICD in it.
    """

    def __init__(self, file: IO[bytes]) -> None:
        self._file = file
        self._size = os.fstat(file.fileno()).st_size
        self._nitf = _load(_Bounded(file, self._size))
        self.root = self._parse()

    def _parse(self) -> Any:
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


def _load(file: _Bounded) -> Any:
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
