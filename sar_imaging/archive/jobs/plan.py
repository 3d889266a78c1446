"""What a job takes: `ArchivePlan`, printed before the start and refused where it cannot fit."""

from __future__ import annotations

import dataclasses
import math
import shutil
from collections import defaultdict
from pathlib import Path

from .job import Job
from .pieces import Piece, ProductPiece
from .windows import Window

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
        Of all recordings.
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


def _row(name: str, pieces) -> str:
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


def check_fits(plan: ArchivePlan, free_bytes: float | None = None) -> None:
    """Refuse a plan that fits no worker, or not the disk.

    Parameters
    ----------
    plan : ArchivePlan
        To check.
    free_bytes : float, optional
        Free on the disk of the output; looked up if left out.

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
    free = free_disk(job.output) if free_bytes is None else free_bytes
    if plan.disk_bytes > free:
        spacing = job.spacing_m * math.sqrt(plan.disk_bytes / max(free, 1))
        raise ArchiveTooLargeError(
            f'the results take {size(plan.disk_bytes)}, and the disk of {job.output} has '
            f'{size(free)} free; name another output, choose a smaller area_m or a larger '
            f'spacing_m (for instance {spacing:.2g})')


def free_disk(folder: Path) -> float:
    """Bytes free where a folder is or will be, what is in it already included."""
    present = folder
    while not present.exists():
        present = present.parent
    used = sum(p.stat().st_size for p in folder.rglob('*') if p.is_file()) if (
        present == folder) else 0
    return shutil.disk_usage(present).free + used
