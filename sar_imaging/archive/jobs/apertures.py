"""How the image of an aperture is divided, and what imaging a window of it takes.

It is imaged whole, by tiles, by sub-apertures, or by both, by method, seconds of one core and
memory.
"""

from __future__ import annotations

import dataclasses
import statistics
from collections.abc import Iterator

import numpy as np

from ...backends import AUTO
from ...geometry.earth import SEMI_MAJOR_M
from ...geometry.grids import Grid, MapGrid, TerrainGrid
from ...geometry.illumination import AntennaPattern, Pointing
from ...imaging.image import Report
from ...imaging.imager import plan_image
from ...imaging.methods import AFBP, EXACT
from ...memory import IMAGE_BYTES, granting
from ...planning.costs import DEFAULT, costs, using
from ...signal.radar import RadarParameters
from .job import Job
from .scans import Division
from .windows import Window

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
        Of its process, at most.
    """

    method: str
    seconds: float
    memory_bytes: int


@dataclasses.dataclass(frozen=True, eq=False)
class Pulses:
    """Range profiles to image, without their samples.

    Attributes
    ----------
    radar : RadarParameters
        Of the profiles.
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

    def part(self, start: int, stop: int) -> Pulses:
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


def choose_method(job: Job, grid: Grid, pulses: Pulses) -> tuple[str, float, float]:
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


def _held(job: Job, grid: Grid, pulses: Pulses, method: str) -> tuple[float, float, Report]:
    """Seconds and bytes of a method that images all pulses at once."""
    held = 2 * pulses.n_pulses * pulses.pulse_bytes
    with using(DEFAULT), granting(max(room_bytes(job) - held, 0)):
        report = pulses.report(grid, method, job.target_db)
    return report.seconds or 0.0, report.n_bytes + held, report


def predict(job: Job, pulses: Pulses, window: Window) -> Prediction | None:
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


def _streamed(job: Job, grid: Grid, pulses: Pulses) -> tuple[float, float]:
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


def surface_points(job: Job, points_m) -> np.ndarray:
    """(N, 3) float64 points of the map's surface at (N, 2 or 3) x and y of its frame, metres.

    On the ellipsoid they are those whose height is found below or above the plane, which is
    exact to what the normal turns meanwhile.
    """
    points = np.array(points_m, np.float64)[:, :2]
    points = np.column_stack([points, np.full(len(points), job.height_m)])
    if job.surface == 'ellipsoid' and job.datum is not None:
        latitude, longitude, _ = job.datum.to_geographic(points)
        points[:, 2] = job.datum.from_geographic(
            latitude, longitude, job.datum.height_m + job.height_m)[:, 2]
    return points


_MOST_PARTS = 4096  # of pulses or of windows
_FEWEST_PULSES = 8  # of a sub-aperture
_DEAR = 2.0  # times the least work
_SUM_TRAFFIC = 3  # of a sum: two partial images are read, one is written


class UndividableError(ValueError):
    """No division of an aperture fits the memory of a worker; the text says what would."""


def divide_aperture(job: Job, pulses: Pulses, window: Window) -> Division:
    """The division that takes the least time, within the memory of a worker.

    Pieces shall take `Job.longest_piece_s` at most, where that does not double the work. An
    aperture that can be imaged as a whole is. Otherwise it is divided into 1, 2, 4, ...
    sub-apertures, each on so few windows as fit; the cheapest of these is taken.

    Parameters
    ----------
    job : Job
        With the bound of memory.
    pulses : Pulses
        Of the aperture.
    window : Window
        Of its image.

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
    for parts in _doubling(max(1, pulses.n_pulses // _FEWEST_PULSES)):
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


def _doubling(most: int) -> Iterator[int]:
    number = 1
    while number <= min(most, _MOST_PARTS):
        yield number
        number *= 2


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


def _division(job: Job, pulses: Pulses, windows: tuple[Window, ...], parts: int
              ) -> Division | None:
    """Some windows and sub-apertures, where the largest piece fits."""
    cuts = np.linspace(0, pulses.n_pulses, parts + 1).astype(int)
    largest = max(windows, key=lambda part: part.n_pixels)
    middle = parts // 2  # its sub-aperture looks from where the whole does
    piece = predict(job, pulses.part(cuts[middle], cuts[middle + 1]), largest)
    if piece is None:
        return None
    sums = (parts - 1) * sum(_sum_seconds(w) for w in windows)
    share = sum(w.n_pixels for w in windows) / largest.n_pixels  # of equal pieces
    return Division(windows, tuple(zip(cuts[:-1].tolist(), cuts[1:].tolist(), strict=True)),
                    piece.seconds, share * parts * piece.seconds + sums, piece.memory_bytes,
                    piece.method)


def _sum_seconds(window: Window) -> float:
    return _SUM_TRAFFIC * IMAGE_BYTES * window.n_pixels * WRITE_S_PER_BYTE


def _too_large(job: Job, pulses: Pulses, window: Window) -> str:
    """What the smallest piece would take, and what to do."""
    [*_, finest] = _windows(window, job.tile)
    some = pulses.part(0, max(1, min(pulses.n_pulses, _FEWEST_PULSES)))
    largest = max(finest, key=lambda part: part.n_pixels)
    memory = job.memory_bytes
    while memory < 1e15 and _fits(job, some, largest, memory) is None:
        memory *= 1.25
    rows, columns = largest.shape
    return (f'{columns} by {rows} pixels of {some.n_pulses} pulses take more than the '
            f'{job.memory_bytes / 1e9:.3g} GB of a worker, {PROCESS_BYTES / 1e9:g} GB of which it '
            f'needs itself; allow memory_gb: {memory / 1e9:.2g}, or take smaller tiles '
            f'(tile: {max(16, job.tile // 32 * 16)})')


def _fits(job: Job, pulses: Pulses, window: Window, memory_bytes: float) -> Prediction | None:
    return predict(dataclasses.replace(job, memory_bytes=memory_bytes), pulses, window)
