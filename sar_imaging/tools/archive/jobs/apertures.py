"""How the image of one aperture is divided: whole, by tiles, by sub-apertures, or by both."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import numpy as np

from sar_imaging.memory import IMAGE_BYTES

from .job import Job
from .prediction import PROCESS_BYTES, WRITE_S_PER_BYTE, Prediction, Pulses, predict
from .scans import Division
from .windows import Window

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
