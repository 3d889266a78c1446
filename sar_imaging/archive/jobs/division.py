"""All pieces of a job, from the scans of its recordings: `divide`."""

from __future__ import annotations

import dataclasses
from collections import defaultdict
from collections.abc import Iterator, Sequence

import numpy as np

from sar_imaging.memory import IMAGE_BYTES
from sar_imaging.planning.costs import DEFAULT

from .apertures import PIECE_S, PROCESS_BYTES, WRITE_S_PER_BYTE, machine_pace
from .job import Job
from .pieces import (
    CoherencePiece,
    ImagePiece,
    MosaicPiece,
    Piece,
    ProductPiece,
    StripPiece,
    SumPiece,
)
from .plan import ArchivePlan, check_fits
from .scans import ApertureScan
from .windows import Window, union

# Times of pixels, measured on one core beside other programs, and divided by how much these
# slowed down what `CostModel` knows.
LOOKS_BYTES = 4  # of a pixel of a mosaic or a strip: mean power, and its numbers of looks are few
LOOKS_S_PER_PIXEL = 2e-8  # of a pixel of each image
COHERENCE_BYTES = 6  # of a pixel: coherence and phase, compressed
COHERENCE_S_PER_PIXEL = 2e-7
GEOTIFF_BYTES = 5  # of a pixel: 32 bits, a third of it again for overviews, compressed
GEOTIFF_S_PER_PIXEL = 5.5e-8
GEOTIFF_MEMORY = 1e8  # bytes, of GDAL and its cache
FILE_S = 0.04  # of a file, whatever its size: libraries, projection, transform
REPORT_S, REPORT_S_PER_SCAN, REPORT_S_PER_PIXEL = 0.5, 0.005, 3e-8
REPORT_BYTES = 2e8  # of a process that draws the mosaic
SICD_BYTES = 48  # of a pixel: the image, and what writing it takes (measured: 40)
_SHARED = 0.5  # of the pixels of both windows of a pair together
_LARGEST_ANGLE_RAD = 0.05  # between lines of sight of a pair; images decorrelate before
_TILES_AT_ONCE = 12  # times a tile of complex pixels, that sums and means take


def divide(job: Job, scans: Sequence[ApertureScan], *, free_bytes: float | None = None
           ) -> ArchivePlan:
    """Divide a job into pieces.

    Parameters
    ----------
    job : Job
        With the datum of the map's frame.
    scans : sequence of ApertureScan
        All apertures.
    free_bytes : float, optional
        Free on the disk of the output; looked up if left out.

    Returns
    -------
    ArchivePlan
        It depends on the job and the scans alone, but for the seconds of its pieces, which know
        the costs that were measured on this machine.

    Raises
    ------
    ArchiveTooLargeError
        A piece does not fit a worker, or the results do not fit the disk.
    """
    scans = sorted(scans, key=lambda scan: scan.name)
    images = _Images(job)
    for scan in scans:
        images.add(scan)
    pieces: list[Piece] = [*images.pieces]
    if scans:
        if job.products.strips:
            pieces += _strips(job, scans, images)
        if job.products.mosaic:
            pieces += _mosaic(job, scans, images)
        if job.products.coherence_window:
            pieces += _coherence(job, scans, images)
        pieces += _products(job, scans, images, pieces)
    pace = machine_pace()
    pieces = [dataclasses.replace(piece, seconds=pace * piece.seconds) for piece in pieces]
    plan = ArchivePlan(job, tuple(pieces), len(scans), images.window)
    check_fits(plan, free_bytes)
    return plan


class _Images:
    """Pieces that make the aperture images, and which of them make which pixels."""

    def __init__(self, job: Job):
        self.job, self.pieces = job, []
        self._final: dict[str, list[tuple[Window, str]]] = {}
        self._windows: list[Window] = []

    @property
    def window(self) -> Window | None:
        """Pixels around all images; None without any."""
        return union(self._windows) if self._windows else None

    def add(self, scan: ApertureScan) -> None:
        """Divide one image as its scan found best."""
        self._windows.append(scan.window)
        final = self._final[scan.name] = []
        for window in scan.division.windows:
            place = '' if len(scan.division.windows) == 1 else f' {_place(window, self.job.tile)}'
            final.append((window, self._window(scan, window, place)))

    def keys(self, name: str, window: Window) -> tuple[str, ...]:
        """Pieces that make the pixels of an image within a window."""
        return tuple(key for own, key in self._final[name] if own.intersection(window))

    def _window(self, scan: ApertureScan, window: Window, place: str) -> str:
        """Pieces of one window; returns the key of the last."""
        division = scan.division
        written = IMAGE_BYTES * window.n_pixels
        share = window.n_pixels / max(w.n_pixels for w in division.windows)
        waiting = []
        for number, (start, stop) in enumerate(division.pulses):
            alone = len(division.pulses) == 1
            key = f'image {scan.name}{place}' + ('' if alone else f' pulses {start}-{stop - 1}')
            partial = '' if alone else f'p{number}'
            self.pieces.append(ImagePiece(
                key=key, seconds=division.seconds * share, memory_bytes=division.memory_bytes,
                reads_bytes=scan.reads_bytes * (stop - start) // scan.n_pulses,
                writes_bytes=written, scan=scan, window=window, pulses=(start, stop),
                method=division.method, partial=partial))
            waiting.append((number, number, key, partial))
        while len(waiting) > 1:  # a tree whose shape follows from the number of leaves alone
            pairs = [waiting[i:i + 2] for i in range(0, len(waiting), 2)]
            last = len(pairs) == 1
            waiting = [pair[0] if len(pair) == 1 else self._sum(scan, window, place, *pair, last)
                       for pair in pairs]
        return waiting[0][2]

    def _sum(self, scan: ApertureScan, window: Window, place: str, one, other, last: bool):
        first, final = one[0], other[1]
        partial = '' if last else f'p{first}-{final}'
        key = f'sum {scan.name}{place} parts {first}-{final}'
        moved = IMAGE_BYTES * window.n_pixels
        self.pieces.append(SumPiece(
            key=key, needs=(one[2], other[2]),
            seconds=PIECE_S + 3 * moved * WRITE_S_PER_BYTE,
            memory_bytes=_tiles_bytes(self.job), reads_bytes=2 * moved, writes_bytes=moved,
            scan=scan, window=window, parts=(one[3], other[3]), partial=partial))
        return first, final, key, partial


def _place(window: Window, tile: int) -> str:
    """Tiles of a window in words: those of its first row and column, and of its last."""
    rows = window.row0 // tile, (window.row1 - 1) // tile
    columns = window.column0 // tile, (window.column1 - 1) // tile
    names = [f'{a}' if a == b else f'{a}..{b}' for a, b in (rows, columns)]
    return f'tile {names[0]},{names[1]}'


def _tiles_bytes(job: Job, margin: int = 0, least: float = 0.0) -> int:
    tiles = _TILES_AT_ONCE * IMAGE_BYTES * (job.tile + 2 * margin)**2
    return int(PROCESS_BYTES + max(tiles, least))


def _by_tile(job: Job, scans: Sequence[ApertureScan]) -> Iterator[
        tuple[Window, tuple[ApertureScan, ...]]]:
    """Tiles with pixels of at least one aperture, and those apertures, row by row."""
    found: dict[Window, list[ApertureScan]] = defaultdict(list)
    for scan in scans:
        for tile in scan.window.tiles(job.tile):
            found[tile].append(scan)
    for tile in sorted(found):
        yield tile, tuple(found[tile])


def _looks(job: Job, images: _Images, tile: Window, scans: tuple[ApertureScan, ...]) -> dict:
    """What pieces of means of power have in common."""
    n_pixels = sum(tile.intersection(scan.window).n_pixels for scan in scans)
    read = IMAGE_BYTES * n_pixels
    return dict(
        tile=tile, images=tuple((scan.name, scan.window) for scan in scans),
        needs=tuple(key for scan in scans for key in images.keys(scan.name, tile)),
        seconds=PIECE_S + LOOKS_S_PER_PIXEL * n_pixels, memory_bytes=_tiles_bytes(job),
        reads_bytes=read, writes_bytes=LOOKS_BYTES * min(n_pixels, tile.n_pixels))


def _strips(job: Job, scans: Sequence[ApertureScan], images: _Images) -> Iterator[Piece]:
    of_recording: dict[str, list[ApertureScan]] = defaultdict(list)
    for scan in scans:
        of_recording[scan.recording].append(scan)
    for name, some in of_recording.items():
        extent = union(scan.window for scan in some).on_tiles(job.tile)
        for tile, own in _by_tile(job, some):
            yield StripPiece(key=f'strip {name} {_place(tile, job.tile)}', recording=name,
                             strip=extent, **_looks(job, images, tile, own))


def _mosaic(job: Job, scans: Sequence[ApertureScan], images: _Images) -> Iterator[Piece]:
    extent = images.window.on_tiles(job.tile)
    for tile, own in _by_tile(job, scans):
        yield MosaicPiece(key=f'mosaic {_place(tile, job.tile)}', mosaic=extent,
                          **_looks(job, images, tile, own))


def _coherence(job: Job, scans: Sequence[ApertureScan], images: _Images) -> Iterator[Piece]:
    margin = job.products.coherence_window
    for pair in find_pairs(scans, job.tile, job.spacing_m):
        extent = pair.window.on_tiles(job.tile)
        for tile in extent.tiles(job.tile):
            n_pixels = tile.intersection(pair.window).n_pixels
            needs = (key for scan in (pair.first, pair.second)
                     # looks and phase of the whole pair are measured before its first tile
                     for key in images.keys(scan.name, pair.window))
            yield CoherencePiece(
                key=f'coherence {pair.name} {_place(tile, job.tile)}', needs=tuple(needs),
                seconds=PIECE_S + COHERENCE_S_PER_PIXEL * n_pixels,
                memory_bytes=2 * _tiles_bytes(job, margin) - int(PROCESS_BYTES),
                reads_bytes=2 * IMAGE_BYTES * n_pixels,
                writes_bytes=COHERENCE_BYTES * n_pixels, pair=pair.name, first=pair.first,
                second=pair.second, tile=tile, extent=extent)


def _products(job: Job, scans: Sequence[ApertureScan], images: _Images,
              pieces: Sequence[Piece]) -> list[Piece]:
    """Files for other programs, and the catalogue of everything."""
    out: list[ProductPiece] = []
    if job.datum is not None:
        out += _image_files(job, scans, images)
        out += _tiled_files(job, scans, pieces)
    last = tuple(p.key for p in (*pieces, *out) if not isinstance(p, ImagePiece | SumPiece))
    finals = tuple(key for scan in scans for key in images.keys(scan.name, scan.window))
    out.append(ProductPiece(key='catalogue and report', product='catalogue', needs=finals + last,
                            memory_bytes=_tiles_bytes(job, least=REPORT_BYTES),
                            extent=images.window, **_report_traffic(scans, pieces)))
    return out


def _report_traffic(scans: Sequence[ApertureScan], pieces: Sequence[Piece]) -> dict:
    """Time and bytes of the catalogue and the report, which has a picture of the mosaic."""
    mosaic = sum(p.writes_bytes for p in pieces if isinstance(p, MosaicPiece))
    n_pixels = mosaic / LOOKS_BYTES
    return dict(seconds=REPORT_S + REPORT_S_PER_SCAN * len(scans) + REPORT_S_PER_PIXEL * n_pixels,
                reads_bytes=mosaic)


def _image_files(job: Job, scans: Sequence[ApertureScan], images: _Images
                 ) -> Iterator[ProductPiece]:
    for scan in scans:
        for name in job.products.images:
            n = scan.window.n_pixels
            # SICD is imaged anew, on a grid of its own, and written as a whole
            memory = PROCESS_BYTES + SICD_BYTES * n if name == 'sicd' else (
                _tiles_bytes(job, least=GEOTIFF_MEMORY))
            yield ProductPiece(
                key=f'{name} {scan.name}', product=f'image {name}', subject=scan.name,
                scans=(scan,), extent=scan.window,
                needs=images.keys(scan.name, scan.window),
                seconds=_image_file_s(scan, name), memory_bytes=int(memory),
                reads_bytes=scan.reads_bytes if name == 'sicd' else IMAGE_BYTES * n,
                writes_bytes=(IMAGE_BYTES if name == 'sicd' else GEOTIFF_BYTES) * n)


def _image_file_s(scan: ApertureScan, name: str) -> float:
    n = scan.window.n_pixels
    if name == 'geotiff':
        return FILE_S + GEOTIFF_S_PER_PIXEL * n
    imaged = {'point_pixel': float(n) * scan.n_pulses * scan.n_channels}
    return FILE_S + DEFAULT.seconds(imaged) + IMAGE_BYTES * n * WRITE_S_PER_BYTE


def _tiled_files(job: Job, scans: Sequence[ApertureScan], pieces: Sequence[Piece]
                 ) -> Iterator[ProductPiece]:
    """GeoTIFF files of strips, mosaic and coherence."""
    by_name = {scan.name: scan for scan in scans}
    groups: dict[tuple[str, str], list[Piece]] = defaultdict(list)
    for piece in pieces:
        if isinstance(piece, StripPiece | MosaicPiece | CoherencePiece):
            subject = getattr(piece, 'recording', '') or getattr(piece, 'pair', '')
            groups[piece.KIND, subject].append(piece)
    for (kind, subject), own in groups.items():
        first = own[0]
        if isinstance(first, CoherencePiece):
            used = (first.first, first.second)
            extent = first.first.window.intersection(first.second.window)
        elif isinstance(first, StripPiece):
            names = dict.fromkeys(name for piece in own for name, _ in piece.images)
            used = tuple(by_name[name] for name in names)
            extent = union(scan.window for scan in used)
        else:
            used, extent = (), union(scan.window for scan in scans)
        n = sum(common.n_pixels for piece in own
                if (common := piece.tile.intersection(extent)) is not None)
        # numbers of looks are small; coherence is smooth
        files, size = (2, GEOTIFF_BYTES / 2) if kind == 'coherence' else (1, GEOTIFF_BYTES)
        yield ProductPiece(
            key=f'geotiff of the {kind} {subject}'.rstrip(), product=f'{kind} geotiff',
            subject=subject, scans=used, extent=extent, needs=tuple(piece.key for piece in own),
            seconds=FILE_S + files * GEOTIFF_S_PER_PIXEL * n,
            memory_bytes=_tiles_bytes(job, least=GEOTIFF_MEMORY),
            reads_bytes=files * LOOKS_BYTES * n, writes_bytes=int(files * size * n))


@dataclasses.dataclass(frozen=True)
class Pair:
    """Two apertures to compare.

    Attributes
    ----------
    first, second : ApertureScan
        The first of its stack, and another one.
    window : Window
        Pixels that both have.
    """

    first: ApertureScan
    second: ApertureScan
    window: Window

    @property
    def name(self) -> str:
        """Unique within the archive."""
        return f'{self.first.name}__{self.second.name}'


def find_pairs(scans: Sequence[ApertureScan], tile: int, spacing_m: float) -> list[Pair]:
    """First of each stack with each other one, in the order of their times.

    An aperture belongs to the stack of the earliest aperture of another recording, of the same
    carrier, that shares half of the pixels with it and saw their middle from the same direction,
    to within 0.05 rad. Otherwise it begins a stack.
    """
    begun: dict[tuple[int, int], list[ApertureScan]] = defaultdict(list)
    pairs = []
    for scan in sorted(scans, key=lambda s: (s.first_ns, s.name)):
        row, column = _middle(scan.window)
        for first in begun[row // tile, column // tile]:
            common = first.window.intersection(scan.window)
            if common is not None and _together(first, scan, common, spacing_m):
                pairs.append(Pair(first, scan, common))
                break
        else:
            for part in scan.window.tiles(tile):
                begun[part.row0 // tile, part.column0 // tile].append(scan)
    return pairs


def _middle(window: Window) -> tuple[int, int]:
    return (window.row0 + window.row1) // 2, (window.column0 + window.column1) // 2


def _together(first: ApertureScan, second: ApertureScan, common: Window, spacing_m: float) -> bool:
    if first.recording == second.recording or first.radar.carrier_hz != second.radar.carrier_hz:
        return False
    both = first.window.n_pixels + second.window.n_pixels - common.n_pixels
    if common.n_pixels < _SHARED * both:
        return False
    row, column = _middle(common)
    place = np.array([column * spacing_m, -row * spacing_m, 0.0])
    sights = [np.array(scan.centre_m) - place for scan in (first, second)]
    one, other = (sight / np.linalg.norm(sight) for sight in sights)
    return float(np.linalg.norm(one - other)) <= _LARGEST_ANGLE_RAD
