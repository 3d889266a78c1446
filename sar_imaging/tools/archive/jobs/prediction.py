"""What imaging a window of an aperture takes: method, seconds of one core, memory."""

from __future__ import annotations

import dataclasses
import statistics

import numpy as np

from sar_imaging.backends import AUTO
from sar_imaging.geometry.earth import SEMI_MAJOR_M
from sar_imaging.geometry.grids import Grid, MapGrid, TerrainGrid
from sar_imaging.geometry.illumination import AntennaPattern, Pointing
from sar_imaging.imaging.image import Report
from sar_imaging.imaging.imager import plan_image
from sar_imaging.imaging.methods import AFBP, EXACT
from sar_imaging.memory import IMAGE_BYTES, granting
from sar_imaging.planning.costs import DEFAULT, costs, using
from sar_imaging.signal.radar import RadarParameters

from .job import Job
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
