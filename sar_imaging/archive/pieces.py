# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Pieces: what one task computes. Each kind says what it needs and what it makes."""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Mapping
from pathlib import Path

from .scans import ApertureScan
from .windows import Window

_PREDICTED = ('seconds', 'memory_bytes', 'reads_bytes', 'writes_bytes')


@dataclasses.dataclass(frozen=True, kw_only=True)
class Piece:
    """What every piece tells of itself.

    Attributes
    ----------
    KIND : str
        Word for its kind, in tables and on the dashboard.
    key : str
        Unique within the job, and readable: ``'image flight-012_aperture-003 tile 4-7'``.
    needs : tuple of str
        Keys of the pieces that have to be done before.
    seconds : float
        Predicted, on one core.
    memory_bytes : int
        Predicted, at most.
    reads_bytes, writes_bytes : int
        Predicted traffic with the disk.
    """

    KIND = ''

    key: str
    needs: tuple[str, ...] = ()
    seconds: float = 0.0
    memory_bytes: int = 0
    reads_bytes: int = 0
    writes_bytes: int = 0

    def fingerprint(self) -> str:
        """SHA-256 of all that the piece is, predictions aside; with the same job, of its bits."""
        fields = {f.name: getattr(self, f.name) for f in dataclasses.fields(self)
                  if f.name not in _PREDICTED}
        return hashlib.sha256(repr((type(self).__name__, fields)).encode()).hexdigest()


@dataclasses.dataclass(frozen=True, kw_only=True)
class ScanPiece(Piece):
    """Look through one recording: `scanning.scan`.

    Attributes
    ----------
    path : Path
        Recording.
    recording : str
        Its name in the archive.
    files : tuple of (str, int, int)
        Name, size and time of change (ns) of its files: others are scanned anew.
    """

    KIND = 'scan'

    path: Path
    recording: str
    files: tuple[tuple[str, int, int], ...] = ()


@dataclasses.dataclass(frozen=True, kw_only=True)
class ImagePiece(Piece):
    """Image of an aperture's pulses, or of some, on its window, or on a part.

    Attributes
    ----------
    scan : ApertureScan
        Aperture.
    window : Window
        Pixels.
    pulses : (int, int)
        Index of the first pulse, by counter, and of the one after the last.
    method : str
        Method of `plan_image`, chosen by the scan: pulses of ``'exact'`` are streamed.
    partial : str
        Name of the partial image; empty where it is the image itself on these pixels.
    """

    KIND = 'image'

    scan: ApertureScan
    window: Window
    pulses: tuple[int, int]
    method: str = 'exact'
    partial: str = ''


@dataclasses.dataclass(frozen=True, kw_only=True)
class SumPiece(Piece):
    """Sum of two partial images on the same pixels, ``parts[0] + parts[1]``.

    Attributes
    ----------
    scan : ApertureScan
        Aperture.
    window : Window
        Pixels.
    parts : (str, str)
        Names of the partial images.
    partial : str
        Name of the sum; empty where it is the image itself on these pixels.
    """

    KIND = 'sum'

    scan: ApertureScan
    window: Window
    parts: tuple[str, str]
    partial: str = ''


@dataclasses.dataclass(frozen=True, kw_only=True)
class TilePiece(Piece):
    """One tile of what is made of several aperture images.

    Attributes
    ----------
    KIND : str
        ``'strip'``, ``'mosaic'`` or ``'coherence'``.
    subject : str
        Name of the recording of a strip, or of a pair; empty for the mosaic.
    tile : Window
        Whole tile.
    extent : Window
        Whole tiles that the arrays cover.
    images : tuple of (str, Window)
        Names and windows of the aperture images, in order: those with pixels in the tile, or both
        of a pair.
    marks : tuple of str
        Fingerprints of the recordings of a pair, of which something is measured as a whole.
    """

    KIND: str
    subject: str
    tile: Window
    extent: Window
    images: tuple[tuple[str, Window], ...]
    marks: tuple[str, ...] = ()


@dataclasses.dataclass(frozen=True, kw_only=True)
class ProductPiece(Piece):
    """A file for other programs, made of arrays that are complete.

    Attributes
    ----------
    product : str
        ``'image geotiff'``, ``'image sicd'``, ``'strip geotiff'``, ``'mosaic geotiff'``,
        ``'coherence geotiff'`` or ``'catalogue'``, the last one, with the report.
    subject : str
        Name of the aperture, strip or pair; empty for the mosaic and the catalogue.
    scan : ApertureScan or None
        Aperture of an image.
    extent : Window or None
        Pixels of the file: those that belong to an aperture, within the whole tiles of the
        arrays.
    """

    KIND = 'product'

    product: str
    subject: str = ''
    scan: ApertureScan | None = None
    extent: Window | None = None


@dataclasses.dataclass(frozen=True)
class PieceResult:
    """What a piece that is done tells, beside time and memory, which its record has.

    Attributes
    ----------
    predicted_error_db, measured_error_db : float or None
        Predicted error and measured error of aperture images against time-domain correlation, dB;
        None where there is none.
    warnings : tuple of str
        What a person should know.
    files : tuple of str
        What it wrote, below the output folder.
    found : mapping
        More that its kind tells, fit for JSON.
    """

    predicted_error_db: float | None = None
    measured_error_db: float | None = None
    warnings: tuple[str, ...] = ()
    files: tuple[str, ...] = ()
    found: Mapping[str, object] = dataclasses.field(default_factory=dict)


class ArchiveDataError(RuntimeError):
    """The data of a piece are bad; trying again does not help."""
