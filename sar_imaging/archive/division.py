# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""How a job is divided into pieces, and what these take: seconds of one core, memory, traffic.

There are two ways to divide: the map into tiles, and the pulses of an aperture into
sub-apertures. Images take both; strips, mosaics and coherence follow the tiles.
"""

from __future__ import annotations

import dataclasses
import math
import shutil
import statistics
from collections import defaultdict
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..backends import AUTO
from ..geometry.earth import SEMI_MAJOR_M
from ..geometry.grids import Grid, MapGrid, TerrainGrid
from ..geometry.illumination import AntennaPattern, Pointing
from ..imaging.image import Report
from ..imaging.imager import plan_image
from ..imaging.methods import AFBP, EXACT
from ..memory import IMAGE_BYTES, granting
from ..planning.costs import DEFAULT, costs, using
from ..signal.radar import RadarParameters
from .job import Job
from .pieces import (
    ImagePiece,
    Piece,
    ProductPiece,
    SumPiece,
    TilePiece,
)
from .scans import ApertureScan, Division
from .windows import Window, union

PROCESS_BYTES = 4e8  # of Python, its libraries and compiled kernels
BLOCK_SHARE = 0.1  # of the rest of a worker's memory, for the samples of a block
BLOCK_COPIES = 3  # of a block: as it was recorded, joined, and compressed
ROUNDED_BYTES = 56  # of a pixel on the ellipsoid: its height, its place and what sorts it
READ_S_PER_BYTE = 1 / 300e6  # from a disk, through the conversion of messages
WRITE_S_PER_BYTE = 1 / 500e6  # with compression
COMPRESSION_S_PER_BYTE = 1 / 40e6  # of raw samples, to range profiles
CORRELATION_S = 8e-8  # of a pixel that is checked, a pulse and a channel
WORTH_PLANNING_S = 10.0  # of exact backprojection: less is spent while AFBP is planned, up to 3 s
PIECE_S = 0.01  # of any piece: its files, its record, Dask
PLAN_S = 0.02  # of an image: its plan, phase centres


@dataclasses.dataclass(frozen=True)
class Prediction:
    """What a piece takes.

    Attributes
    ----------
    method : str
        By which it is imaged.
    seconds : float
        On one core.
    memory_bytes : int
        Memory of its process, at most.
    """

    method: str
    seconds: float
    memory_bytes: int


@dataclasses.dataclass(frozen=True, eq=False)
class DividedPulses:
    """Range profiles to image, without their samples.

    Attributes
    ----------
    radar : RadarParameters
        Radar parameters of the profiles.
    n_samples : int
        Their length.
    tx_m, rx_m : (P, C, 3) float64
        Phase centres in the map's frame, metres.
    raw_samples : int
        Recorded samples of a pulse and channel that have to be compressed; 0 of profiles.
    illumination : AntennaPattern or None
        That images are weighed by.
    pointing : Pointing or None
        Where the antenna looked at the pulses, with `illumination`.
    """

    radar: RadarParameters
    n_samples: int
    tx_m: np.ndarray
    rx_m: np.ndarray
    raw_samples: int = 0
    illumination: AntennaPattern | None = None
    pointing: Pointing | None = None

    @property
    def n_pulses(self) -> int:
        """Number of pulses P."""
        return len(self.tx_m)

    @property
    def pulse_bytes(self) -> int:
        """Of the profiles of a pulse."""
        return 8 * self.tx_m.shape[1] * self.n_samples

    @property
    def recorded_bytes(self) -> int:
        """Of all samples as they were recorded."""
        return 8 * self.n_pulses * self.tx_m.shape[1] * (self.raw_samples or self.n_samples)

    def part(self, start: int, stop: int) -> DividedPulses:
        """Some of the pulses."""
        cut = slice(start, stop)
        return dataclasses.replace(self, tx_m=self.tx_m[cut], rx_m=self.rx_m[cut],
                                   pointing=self.pointing and self.pointing.select(cut))

    def report(self, grid: Grid, method: str, target_db: float) -> Report:
        """Report of an image of them, as it is planned."""
        return plan_image(grid, self.radar, self.n_samples, self.tx_m, self.rx_m, method=method,
                          target_db=target_db, illumination=self.illumination,
                          pointing=self.pointing).report


def machine_pace() -> float:
    """How much longer this machine takes than the default costs say; 1 unless they were measured.

    The middle of the ratios of all costs (`sar-imaging measure-costs`). Predicted times alone
    know it: methods and divisions follow from the default costs on any machine.
    """
    usual, found = dataclasses.asdict(DEFAULT), dataclasses.asdict(costs())
    return statistics.median(found[name] / usual[name] for name in usual)


def room_bytes(job: Job) -> float:
    """Memory of a worker that is left for images and pulses, bytes."""
    return job.memory_bytes - PROCESS_BYTES


def choose_method(job: Job, grid: Grid, pulses: DividedPulses) -> tuple[str, float, float]:
    """Method of an image, its predicted seconds, and bytes with the pulses that wait.

    Exact backprojection streams the pulses. Any other method holds them all, and is taken where
    it was asked for, or where it is the quicker one, meets the target and has room. The choice
    depends on the job and the pulses alone, not on what memory happens to be free.

    Raises
    ------
    MemoryError
        There is no room.
    ValueError
        The geometry does not allow the method, or the target.
    """
    if job.method not in (AUTO, EXACT):
        return job.method, *_held(job, grid, pulses, job.method)[:2]
    exact = EXACT, *_streamed(job, grid, pulses)
    if job.method == EXACT or exact[1] < WORTH_PLANNING_S or not isinstance(grid, MapGrid):
        return exact
    try:
        seconds, n_bytes, report = _held(job, grid, pulses, AFBP)
    except (ValueError, MemoryError):
        return exact
    doubtful = report.plan.subapertures.warnings
    return (AFBP, seconds, n_bytes) if seconds < exact[1] and not doubtful else exact


def _held(job: Job, grid: Grid, pulses: DividedPulses, method: str) -> tuple[float, float, Report]:
    """Seconds and bytes of a method that images all pulses at once."""
    held = 2 * pulses.n_pulses * pulses.pulse_bytes
    with using(DEFAULT), granting(max(room_bytes(job) - held, 0)):
        report = pulses.report(grid, method, job.target_db)
    return report.seconds or 0.0, report.n_bytes + held, report


def predict(job: Job, pulses: DividedPulses, window: Window) -> Prediction | None:
    """What the image of some pulses on a window takes; None where it does not fit a worker.

    Raises
    ------
    ValueError
        The geometry does not allow the method or the target.
    """
    room, n_pixels = room_bytes(job), window.n_pixels
    rounded = job.surface == 'ellipsoid' and job.datum is not None
    if (IMAGE_BYTES + rounded * ROUNDED_BYTES) * n_pixels > room:
        return None
    grid = planned_grid(job, window)
    try:
        method, seconds, n_bytes = choose_method(job, grid, pulses)
    except MemoryError:
        return None
    # a chunk is copied while it is written
    n_bytes += rounded * ROUNDED_BYTES * n_pixels + 2 * IMAGE_BYTES * job.tile**2
    if n_bytes > room:
        return None
    seconds += PIECE_S + PLAN_S + READ_S_PER_BYTE * pulses.recorded_bytes
    seconds += WRITE_S_PER_BYTE * IMAGE_BYTES * n_pixels
    if pulses.raw_samples:
        seconds += COMPRESSION_S_PER_BYTE * pulses.recorded_bytes
    checked = min(job.checked_pixels, n_pixels) * pulses.n_pulses * pulses.tx_m.shape[1]
    return Prediction(method, seconds + CORRELATION_S * checked, int(PROCESS_BYTES + n_bytes))


def _streamed(job: Job, grid: Grid, pulses: DividedPulses) -> tuple[float, float]:
    """Seconds and bytes of exact backprojection, block by block."""
    block = min(pulses.n_pulses, max(1, int(BLOCK_SHARE * room_bytes(job) // pulses.pulse_bytes)))
    middle = (pulses.n_pulses - block) // 2
    some = pulses.part(middle, middle + block)
    with using(DEFAULT), granting(room_bytes(job)):
        report = some.report(grid, EXACT, job.target_db)
    return (report.seconds * pulses.n_pulses / block,
            report.n_bytes + BLOCK_COPIES * block * pulses.pulse_bytes)


def planned_grid(job: Job, window: Window) -> Grid:
    """Pixels of a window, on the map's surface to within what plans notice."""
    grid = window.grid(job.spacing_m, job.height_m)
    if job.surface != 'ellipsoid' or job.datum is None:
        return grid
    drop = (grid.x_m**2 + grid.y_m[:, None]**2) / (2 * SEMI_MAJOR_M)
    return TerrainGrid(grid, job.height_m - drop)


_MOST_PARTS = 4096  # of pulses or of windows
_FEWEST_PULSES = 8  # of a sub-aperture
_DEAR = 2.0  # times the least work
_SUM_TRAFFIC = 3  # of a sum: two partial images are read, one is written


class UndividableError(ValueError):
    """No division of an aperture fits the memory of a worker; the text says what would."""


def divide_aperture(job: Job, pulses: DividedPulses, window: Window) -> Division:
    """The division that takes the least time, within the memory of a worker.

    Pieces shall take `Job.longest_piece_s` at most, where that does not double the work. An
    aperture that can be imaged as a whole is. Otherwise it is divided into 1, 2, 4, ...
    sub-apertures, each on so few windows as fit; the cheapest of these is taken.

    Parameters
    ----------
    job : Job
        With the bound of memory.
    pulses : DividedPulses
        Pulses of the aperture.
    window : Window
        Window of its image.

    Returns
    -------
    Division
        It depends on nothing else, such as the number of workers.

    Raises
    ------
    UndividableError
        A tile and a few pulses are too much already.
    ValueError
        The geometry does not allow the method or the target.
    """
    found: list[Division] = []
    most = min(_MOST_PARTS, max(1, pulses.n_pulses // _FEWEST_PULSES))
    for parts in (2**power for power in range(most.bit_length())):
        own = []
        for windows in _windows(window, job.tile):
            division = _division(job, pulses, windows, parts)
            if division is None:
                continue
            own.append(division)
            if division.seconds <= job.longest_piece_s or _is_dear(division, [*found, *own]):
                break  # finer ones take longer together
        found += own
        if own and (own[0].seconds <= job.longest_piece_s and len(own[0].windows) == 1
                    or all(_is_dear(division, found) for division in own)):
            break
    if not found:
        raise UndividableError(_too_large(job, pulses, window))
    found = [division for division in found if not _is_dear(division, found)]
    short = [division for division in found if division.seconds <= job.longest_piece_s]
    if short:
        return min(short, key=lambda division: division.total_seconds)
    return min(found, key=lambda division: division.seconds)


def _is_dear(division: Division, found: list[Division]) -> bool:
    """Whether a division takes much longer, all in all, than another one that fits."""
    return division.total_seconds > _DEAR * min(other.total_seconds for other in found)


def _windows(window: Window, tile: int) -> Iterator[tuple[Window, ...]]:
    """The window whole, then in twice as many parts each time, down to single tiles."""
    parts = (window,)
    yield parts
    while len(parts) < _MOST_PARTS:
        finer = tuple(half for part in parts for half in _halves(part, tile))
        if finer == parts:
            return
        yield (parts := finer)


def _halves(window: Window, tile: int) -> tuple[Window, ...]:
    """A window cut between tiles across its longer side, where it has several."""
    whole = window.on_tiles(tile)
    n_rows, n_columns = (n // tile for n in whole.shape)
    if n_rows == n_columns == 1:
        return (window,)
    if n_rows >= n_columns:
        cut = whole.row0 + n_rows // 2 * tile
        return (Window(window.row0, cut, window.column0, window.column1),
                Window(cut, window.row1, window.column0, window.column1))
    cut = whole.column0 + n_columns // 2 * tile
    return (Window(window.row0, window.row1, window.column0, cut),
            Window(window.row0, window.row1, cut, window.column1))


def _division(job: Job, pulses: DividedPulses, windows: tuple[Window, ...], parts: int
              ) -> Division | None:
    """Some windows and sub-apertures, where the largest piece fits."""
    cuts = np.linspace(0, pulses.n_pulses, parts + 1).astype(int)
    largest = max(windows, key=lambda part: part.n_pixels)
    middle = parts // 2  # its sub-aperture looks from where the whole does
    piece = predict(job, pulses.part(cuts[middle], cuts[middle + 1]), largest)
    if piece is None:
        return None
    n_pixels = sum(w.n_pixels for w in windows)
    sums = (parts - 1) * _SUM_TRAFFIC * IMAGE_BYTES * n_pixels * WRITE_S_PER_BYTE
    share = n_pixels / largest.n_pixels  # of equal pieces
    return Division(windows, tuple(zip(cuts[:-1].tolist(), cuts[1:].tolist(), strict=True)),
                    piece.seconds, share * parts * piece.seconds + sums, piece.memory_bytes,
                    piece.method)


def _too_large(job: Job, pulses: DividedPulses, window: Window) -> str:
    """What the smallest piece would take, and what to do."""
    [*_, finest] = _windows(window, job.tile)
    some = pulses.part(0, max(1, min(pulses.n_pulses, _FEWEST_PULSES)))
    largest = max(finest, key=lambda part: part.n_pixels)
    memory = job.memory_bytes
    while memory < 1e15 and predict(dataclasses.replace(job, memory_bytes=memory), some,
                                    largest) is None:
        memory *= 1.25
    rows, columns = largest.shape
    return (f'{columns} by {rows} pixels of {some.n_pulses} pulses take more than the '
            f'{job.memory_bytes / 1e9:.3g} GB of a worker, {PROCESS_BYTES / 1e9:g} GB of which it '
            f'needs itself; allow memory_gb: {memory / 1e9:.2g}, or take smaller tiles '
            f'(tile: {max(16, job.tile // 32 * 16)})')


_SPARE = 1.05  # times the predicted size of the results, for records and pictures
_UNITS = ('B', 'kB', 'MB', 'GB', 'TB', 'PB')


class ArchiveTooLargeError(ValueError):
    """A job does not fit the memory of a worker or the disk; one line tells numbers and remedy."""


@dataclasses.dataclass(frozen=True)
class ArchivePlan:
    """All pieces of a job after the scans, and what they take together.

    Attributes
    ----------
    job : Job
        With the datum of the map's frame.
    pieces : tuple of Piece
        Those that others need stand before them.
    n_apertures : int
        Number of apertures of all recordings.
    window : Window or None
        Whole tiles of the map; None without any aperture.
    """

    job: Job
    pieces: tuple[Piece, ...]
    n_apertures: int
    window: Window | None

    @property
    def seconds(self) -> float:
        """Predicted on one core."""
        return math.fsum(piece.seconds for piece in self.pieces)

    def seconds_on(self, workers: int) -> float:
        """Predicted on some workers of one core, without traffic between them.

        The longest chain of pieces that need each other, or all shared evenly.
        """
        return max(self.longest_chain_s, self.seconds / max(1, workers))

    @property
    def longest_chain_s(self) -> float:
        """Seconds of the longest chain of pieces that need each other."""
        done: dict[str, float] = {}
        for piece in self.pieces:
            before = max((done[key] for key in piece.needs), default=0.0)
            done[piece.key] = before + piece.seconds
        return max(done.values(), default=0.0)

    @property
    def largest(self) -> Piece | None:
        """The piece that takes the most memory."""
        return max(self.pieces, key=lambda piece: piece.memory_bytes, default=None)

    @property
    def reads_bytes(self) -> int:
        """From the disk."""
        return sum(piece.reads_bytes for piece in self.pieces)

    @property
    def writes_bytes(self) -> int:
        """To the disk."""
        return sum(piece.writes_bytes for piece in self.pieces)

    @property
    def network_bytes(self) -> int:
        """Between scheduler and workers: pieces and what they answer, no pixels."""
        return sum(2500 + 80 * len(piece.needs) for piece in self.pieces)

    @property
    def disk_bytes(self) -> float:
        """That the output folder may take while the job runs.

        Partial images are among it, and what stands beside the largest file while it is written.
        """
        beside = max((p.writes_bytes for p in self.pieces if isinstance(p, ProductPiece)),
                     default=0)
        return _SPARE * self.writes_bytes + beside

    def __str__(self) -> str:
        rows = defaultdict(list)
        for piece in self.pieces:
            rows[piece.KIND].append(piece)
        lines = [*self._head(), f'{"pieces":<12}{"number":>8}{"core time":>12}{"longest":>10}'
                 f'{"memory":>10}{"read":>10}{"written":>10}']
        for kind, some in rows.items():
            lines.append(_row(kind, some))
        if len(rows) > 1:
            lines.append(_row('all', self.pieces))
        lines += ['', 'time on 1, 2, 4, 16, 64 workers of one core: ' + ', '.join(
            duration(self.seconds_on(n)) for n in (1, 2, 4, 16, 64))]
        largest = self.largest
        if largest is not None:
            lines.append(f'memory of a worker: {size(largest.memory_bytes)} of '
                         f'{size(self.job.memory_bytes)}, for {largest.key}')
        lines.append(f'disk: {size(self.disk_bytes)} in {self.job.output}; network: '
                     f'{size(self.network_bytes)} between scheduler and workers, no pixels')
        return '\n'.join([*lines, *self.notes])

    def _head(self) -> list[str]:
        job, window = self.job, self.window
        if window is None:
            return ['no aperture can be imaged', '']
        rows, columns = window.shape
        place = 'local frame' if job.datum is None else (
            f'{job.datum.latitude_deg:.5f}, {job.datum.longitude_deg:.5f}')
        return [f'{self.n_apertures} apertures on a map of {columns:,} by {rows:,} pixels of '
                f'{job.spacing_m:g} m ({rows * columns / 1e6:,.4g} Mpixel), frame at {place}', '']

    @property
    def notes(self) -> list[str]:
        """What a person should know, a line each."""
        out = []
        if self.job.datum is None:
            out.append('no recording tells a datum: no GeoTIFF, no SICD, no catalogue; add one to '
                       'the job for those')
        slow = [p for p in self.pieces if p.KIND == 'image'
                and p.seconds > self.job.longest_piece_s]
        if slow:
            longest = max(slow, key=lambda piece: piece.seconds)
            out.append(f'{len(slow)} pieces take longer than longest_piece_s: '
                       f'{self.job.longest_piece_s:g}, up to {duration(longest.seconds)}; smaller '
                       'tiles make them shorter')
        return out


def _row(name: str, pieces: Sequence[Piece]) -> str:
    longest = max(piece.seconds for piece in pieces)
    memory = max(piece.memory_bytes for piece in pieces)
    return (f'{name:<12}{len(pieces):>8,}'
            f'{duration(math.fsum(p.seconds for p in pieces)):>12}{duration(longest):>10}'
            f'{size(memory):>10}{size(sum(p.reads_bytes for p in pieces)):>10}'
            f'{size(sum(p.writes_bytes for p in pieces)):>10}')


def duration(seconds: float) -> str:
    """A time for people: ``'1.5 s'``, ``'12 min'``, ``'3.4 h'``, ``'2.5 d'``."""
    for limit, unit, length in ((90, 's', 1), (5400, 'min', 60), (48 * 3600, 'h', 3600)):
        if seconds < limit:
            return f'{seconds / length:.2g} {unit}'
    return f'{seconds / 86400:.3g} d'


def size(n_bytes: float) -> str:
    """A number of bytes for people: ``'12.3 MB'``."""
    number = 0
    while n_bytes >= 999.5 and number < len(_UNITS) - 1:
        n_bytes, number = n_bytes / 1000, number + 1
    return f'{n_bytes:.3g} {_UNITS[number]}'


def check_fits(plan: ArchivePlan, free_bytes: float) -> None:
    """Refuse a plan that fits no worker, or not the disk.

    Parameters
    ----------
    plan : ArchivePlan
        To check.
    free_bytes : float
        Free on the disk of the output.

    Raises
    ------
    ArchiveTooLargeError
        It does not fit.
    """
    job, largest = plan.job, plan.largest
    if largest is not None and largest.memory_bytes > job.memory_bytes:
        needed = math.ceil(largest.memory_bytes / 1e8) / 10
        raise ArchiveTooLargeError(
            f'{largest.key} takes {size(largest.memory_bytes)}, and a worker may take '
            f'{size(job.memory_bytes)}; allow memory_gb: {needed:g}, or take smaller tiles '
            f'(tile: {max(16, job.tile // 32 * 16)})')
    if plan.disk_bytes > free_bytes:
        spacing = job.spacing_m * math.sqrt(plan.disk_bytes / max(free_bytes, 1))
        raise ArchiveTooLargeError(
            f'the results take {size(plan.disk_bytes)}, and the disk of {job.output} has '
            f'{size(free_bytes)} free; name another output, choose a smaller area_m or a larger '
            f'spacing_m (for instance {spacing:.2g})')


def free_disk(folder: Path) -> float:
    """Bytes free where a folder is or will be, what is in it already included."""
    present = folder
    while not present.exists():
        present = present.parent
    used = sum(p.stat().st_size for p in folder.rglob('*') if p.is_file()) if (
        present == folder) else 0
    return shutil.disk_usage(present).free + used


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


def divide(job: Job, scans: Sequence[ApertureScan]) -> ArchivePlan:
    """Divide a job into pieces.

    Parameters
    ----------
    job : Job
        With the datum of the map's frame.
    scans : sequence of ApertureScan
        All apertures.

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
    maps = _maps(job, scans)
    pieces: list[Piece] = [*images.pieces]
    for one in maps:
        pieces += one.tiles(job, images)
    if scans:
        pieces += _products(job, scans, images, maps, pieces)
    pace = machine_pace()
    pieces = [dataclasses.replace(piece, seconds=pace * piece.seconds) for piece in pieces]
    plan = ArchivePlan(job, tuple(pieces), len(scans), images.window)
    check_fits(plan, free_disk(job.output))
    return plan


_Partial = tuple[int, int, str, str]  # first and last leaf, key of the piece, name


class _Images:
    """Pieces that make the aperture images, and which of them make which pixels."""

    def __init__(self, job: Job):
        self.job = job
        self.pieces: list[ImagePiece | SumPiece] = []
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

    def _sum(self, scan: ApertureScan, window: Window, place: str, one: _Partial, other: _Partial,
             last: bool) -> _Partial:
        first, final = one[0], other[1]
        partial = '' if last else f'p{first}-{final}'
        key = f'sum {scan.name}{place} parts {first}-{final}'
        moved = IMAGE_BYTES * window.n_pixels
        self.pieces.append(SumPiece(
            key=key, needs=(one[2], other[2]),
            seconds=PIECE_S + _SUM_TRAFFIC * moved * WRITE_S_PER_BYTE,
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


@dataclasses.dataclass(frozen=True)
class _Map:
    """Arrays over tiles that are made of aperture images: `TilePiece` explains kind and subject.

    `window` has the pixels that belong to the apertures.
    """

    kind: str
    subject: str
    scans: Sequence[ApertureScan]
    window: Window

    @property
    def name(self) -> str:
        return f'{self.kind} {self.subject}'.rstrip()

    def tiles(self, job: Job, images: _Images) -> Iterator[TilePiece]:
        """Pieces of the tiles with pixels of at least one aperture, row by row."""
        of_tile: dict[Window, list[ApertureScan]] = defaultdict(list)
        for scan in self.scans:
            for tile in (self if self.kind == 'coherence' else scan).window.tiles(job.tile):
                of_tile[tile].append(scan)
        takes = _coherence_takes if self.kind == 'coherence' else _looks_takes
        for tile, scans in sorted(of_tile.items()):
            yield TilePiece(
                key=f'{self.name} {_place(tile, job.tile)}', KIND=self.kind, subject=self.subject,
                tile=tile, extent=self.window.on_tiles(job.tile),
                images=tuple((scan.name, scan.window) for scan in scans),
                **takes(self, job, images, tile, scans))


def _looks_takes(_: _Map, job: Job, images: _Images, tile: Window,
                 scans: Sequence[ApertureScan]) -> dict[str, Any]:
    """What a tile of means of power needs and takes."""
    n_pixels = sum(tile.intersection(scan.window).n_pixels for scan in scans)
    return dict(
        needs=tuple(key for scan in scans for key in images.keys(scan.name, tile)),
        seconds=PIECE_S + LOOKS_S_PER_PIXEL * n_pixels, memory_bytes=_tiles_bytes(job),
        reads_bytes=IMAGE_BYTES * n_pixels,
        writes_bytes=LOOKS_BYTES * min(n_pixels, tile.n_pixels))


def _coherence_takes(pair: _Map, job: Job, images: _Images, tile: Window,
                     scans: Sequence[ApertureScan]) -> dict[str, Any]:
    """What a tile of coherence needs and takes."""
    n_pixels = tile.intersection(pair.window).n_pixels
    return dict(
        # looks and phase of the whole pair are measured before its first tile
        needs=tuple(key for scan in scans for key in images.keys(scan.name, pair.window)),
        marks=tuple(scan.fingerprint for scan in scans),
        seconds=PIECE_S + COHERENCE_S_PER_PIXEL * n_pixels,
        memory_bytes=2 * _tiles_bytes(job, job.products.coherence_window) - int(PROCESS_BYTES),
        reads_bytes=2 * IMAGE_BYTES * n_pixels, writes_bytes=COHERENCE_BYTES * n_pixels)


def _maps(job: Job, scans: Sequence[ApertureScan]) -> list[_Map]:
    """Strips, mosaic and pairs that the job wants."""
    found: list[_Map] = []
    if job.products.strips:
        of_recording: dict[str, list[ApertureScan]] = defaultdict(list)
        for scan in scans:
            of_recording[scan.recording].append(scan)
        found += [_Map('strip', name, some, union(scan.window for scan in some))
                  for name, some in of_recording.items()]
    if job.products.mosaic and scans:
        found.append(_Map('mosaic', '', scans, union(scan.window for scan in scans)))
    if job.products.coherence_window:
        found += _pairs(scans, job.tile, job.spacing_m)
    return found


def _products(job: Job, scans: Sequence[ApertureScan], images: _Images, maps: Sequence[_Map],
              pieces: Sequence[Piece]) -> list[Piece]:
    """Files for other programs, and the catalogue of everything."""
    out: list[Piece] = []
    if job.datum is not None:
        out += _image_files(job, scans, images)
        out += [_map_file(job, one, [p for p in pieces if isinstance(p, TilePiece)
                                     and (p.KIND, p.subject) == (one.kind, one.subject)])
                for one in maps]
    last = tuple(p.key for p in (*pieces, *out) if not isinstance(p, ImagePiece | SumPiece))
    finals = tuple(key for scan in scans for key in images.keys(scan.name, scan.window))
    mosaic = sum(p.writes_bytes for p in pieces if p.KIND == 'mosaic')
    out.append(ProductPiece(
        key='catalogue and report', product='catalogue', needs=finals + last,
        memory_bytes=_tiles_bytes(job, least=REPORT_BYTES), extent=images.window,
        seconds=REPORT_S + REPORT_S_PER_SCAN * len(scans)
        + REPORT_S_PER_PIXEL * mosaic / LOOKS_BYTES, reads_bytes=mosaic))
    return out


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
                scan=scan, extent=scan.window,
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


def _map_file(job: Job, one: _Map, tiles: Sequence[TilePiece]) -> ProductPiece:
    """GeoTIFF files of a strip, the mosaic or a pair."""
    n = sum(piece.tile.intersection(one.window).n_pixels for piece in tiles)
    # numbers of looks are small; coherence is smooth
    files, size = (2, GEOTIFF_BYTES / 2) if one.kind == 'coherence' else (1, GEOTIFF_BYTES)
    return ProductPiece(
        key=f'geotiff of the {one.name}', product=f'{one.kind} geotiff', subject=one.subject,
        extent=one.window, needs=tuple(piece.key for piece in tiles),
        seconds=FILE_S + files * GEOTIFF_S_PER_PIXEL * n,
        memory_bytes=_tiles_bytes(job, least=GEOTIFF_MEMORY),
        reads_bytes=files * LOOKS_BYTES * n, writes_bytes=int(files * size * n))


def _pairs(scans: Sequence[ApertureScan], tile: int, spacing_m: float) -> list[_Map]:
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
                pairs.append(_Map('coherence', f'{first.name}__{scan.name}', (first, scan),
                                  common))
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
