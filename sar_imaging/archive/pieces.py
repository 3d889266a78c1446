"""Pieces: what one task computes. Each kind says what it needs and what it makes."""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import ClassVar

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

    KIND: ClassVar[str]

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
        Of `plan_image`, chosen by the scan: pulses of ``'exact'`` are streamed.
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
class LooksPiece(Piece):
    """One tile of means: mean power of some apertures, and their number at each pixel.

    Attributes
    ----------
    tile : Window
        Whole tile.
    images : tuple of (str, Window)
        Names and windows of the aperture images with pixels in the tile, in order.
    """

    tile: Window
    images: tuple[tuple[str, Window], ...]


@dataclasses.dataclass(frozen=True, kw_only=True)
class StripPiece(LooksPiece):
    """One tile of a strip, the means of a recording's apertures.

    Attributes
    ----------
    recording : str
        Name of the strip.
    strip : Window
        Whole tiles of the strip, the extent of its arrays.
    """

    KIND = 'strip'

    recording: str
    strip: Window


@dataclasses.dataclass(frozen=True, kw_only=True)
class MosaicPiece(LooksPiece):
    """One tile of the mosaic, the means of all apertures.

    Attributes
    ----------
    mosaic : Window
        Whole tiles of the mosaic, the extent of its arrays.
    """

    KIND = 'mosaic'

    mosaic: Window


@dataclasses.dataclass(frozen=True, kw_only=True)
class CoherencePiece(Piece):
    """One tile of the coherence of two passes over the same pixels.

    Attributes
    ----------
    pair : str
        Name of the pair: first of the stack and other one.
    first, second : ApertureScan
        Apertures.
    tile : Window
        Whole tile; what both have of it is compared.
    extent : Window
        Whole tiles of the pair, the extent of its arrays.
    """

    KIND = 'coherence'

    pair: str
    first: ApertureScan
    second: ApertureScan
    tile: Window
    extent: Window


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
    scans : tuple of ApertureScan
        Apertures of an image, a strip or a pair; none for the mosaic and the catalogue, which
        has them all (`scans.load_scans`).
    extent : Window or None
        Pixels of the file: those that belong to an aperture, within the whole tiles of the
        arrays.
    """

    KIND = 'product'

    product: str
    subject: str = ''
    scans: tuple[ApertureScan, ...] = ()
    extent: Window | None = None


@dataclasses.dataclass(frozen=True)
class PieceResult:
    """What a piece that is done tells.

    Attributes
    ----------
    key : str
        Of the piece.
    seconds : float
        That it took.
    peak_bytes : int
        Largest memory of its process meanwhile.
    predicted_error_db, measured_error_db : float or None
        Of aperture images against time-domain correlation, dB; None where there is none.
    warnings : tuple of str
        What a person should know.
    files : tuple of str
        What it wrote, below the output folder.
    found : mapping
        More that its kind tells, fit for JSON.
    """

    key: str
    seconds: float
    peak_bytes: int = 0
    predicted_error_db: float | None = None
    measured_error_db: float | None = None
    warnings: tuple[str, ...] = ()
    files: tuple[str, ...] = ()
    found: Mapping[str, object] = dataclasses.field(default_factory=dict)


class ArchiveDataError(RuntimeError):
    """The data of a piece are bad; trying again does not help."""
