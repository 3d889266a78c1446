"""Faults of counters and times: lost pulses, stamps of receipt, stamps of whole frames."""

from __future__ import annotations

import numpy as np

from ...signal.pulses import PulseBlock
from ..track import median_around
from .finding import LIKELY, Finding

_FEWEST = 16  # pulses that tell a pattern
_GAP = 1.6  # intervals between two pulses that follow each other by their numbers
_LATE = 0.03  # of an interval: scatter of the stamps from which receipt is likely
_LEAST_LATE_S = 20e-6
_HALF = 8  # pulses on each side of one whose neighbours tell its time
_SCATTER = 1.48  # standard deviation of normal numbers over their median magnitude
_SHARED = 0.5  # of the pulses, that have the stamp of the one before
_REGULAR = 0.95  # of the frames, that have as many pulses as most


def timing_findings(block: PulseBlock) -> list[Finding]:
    """Find lost pulses and times that are not those of transmission.

    Parameters
    ----------
    block : PulseBlock
        Pulses in the order sent, raw or compressed.

    Returns
    -------
    list of Finding

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging import concatenate
    >>> from sar_imaging.diagnosis.signals import timing_findings
    >>> from sar_imaging.simulation import SCENARIOS
    >>> block = concatenate(list(SCENARIOS['psf']().blocks()))
    >>> timing_findings(block)
    []
    >>> kept = np.delete(np.arange(200), [40, 41, 90])  # lost on the way
    >>> for finding in timing_findings(block.select(kept)):
    ...     print(finding.evidence)
    3 of 200 pulses are missing in 2 gaps of their numbers, up to 2 in a row
    """
    if block.n_pulses < _FEWEST:
        return []
    order = np.argsort(block.counter.astype(np.int64), kind='stable')
    counter = block.counter.astype(np.int64)[order]
    time_s = (block.stamp_ns[order] - block.stamp_ns[order[0]]) * 1e-9
    shared = _frames(counter, time_s)
    found = [_lost(counter), shared]
    if shared is None:
        found.append(_backward(time_s))
        what, counter, time_s = _rhythm(counter, time_s)
        found.append(_receipt(what, counter, time_s) or _gaps(what, counter, time_s))
    return [finding for finding in found if finding is not None]


def _lost(counter: np.ndarray) -> Finding | None:
    steps = np.diff(counter)
    n_lost, n_gaps = int((steps - 1).clip(0).sum()), int(np.count_nonzero(steps > 1))
    if not n_lost:
        return None
    return Finding('lost pulses', (
        f'{n_lost} of {n_lost + len(counter)} pulses are missing in {n_gaps} gaps of their '
        f'numbers, up to {int(steps.max()) - 1} in a row'),
        'enlarge queues and network buffers between radar and recorder; images take gaps into '
        'account, but their sidelobes rise', 'numbers that are all there')


def _rhythm(counter: np.ndarray, time_s: np.ndarray) -> tuple[str, np.ndarray, np.ndarray]:
    """Frames, by their first pulses, of a radar that pauses after each; else its pulses.

    Returns their name, numbers and times, seconds.
    """
    steps = np.diff(time_s) / np.diff(counter).clip(1)
    starts = 1 + np.flatnonzero(steps > _GAP * np.percentile(steps, 25))  # half, of two pulses
    if len(starts) >= _FEWEST:
        since = counter[starts] - counter[starts[0]]
        length = int(np.median(np.diff(since)))
        if length > 1 and np.mean(since % length == 0) >= _REGULAR:
            return 'frames', since // length, time_s[starts]
    return 'pulses', counter, time_s


def _gaps(what: str, counter: np.ndarray, time_s: np.ndarray) -> Finding | None:
    """Pauses between pulses, or frames, whose numbers follow each other."""
    steps = np.diff(time_s)
    following = np.diff(counter) == 1
    around = median_around(steps, _HALF)
    odd = following & (steps > _GAP * around) & (around > 0)
    if not odd.any() or np.count_nonzero(odd) > 0.1 * len(steps):
        return None  # none, or the rhythm of the radar
    missing = int(np.rint(steps[odd] / around[odd] - 1).sum())
    return Finding('lost pulses without gaps in their numbers', (
        f'{np.count_nonzero(odd)} pauses hold about {missing} {what} more, although the '
        'numbers of the pulses follow each other'),
        'let the radar number its pulses, not the program that receives them: positions by '
        'number are wrong after each pause', 'the rhythm of a radar that sends frames', LIKELY)


def _frames(counter: np.ndarray, time_s: np.ndarray) -> Finding | None:
    """Many pulses have the stamp of the one before: the time of their frame."""
    same = (np.diff(time_s) == 0) & (np.diff(counter) > 0)
    if same.mean() < _SHARED:
        return None
    per_frame = (len(time_s)) / (np.count_nonzero(~same) + 1)
    return Finding('stamps of frames', (
        f'{same.mean():.0%} of the pulses have the stamp of the one before, about '
        f'{per_frame:.0f} pulses for each stamp'),
        'give every pulse its own time: that of its frame plus its place in the frame times the '
        'pulse repetition interval', 'a clock of coarse steps, which are as long as a pulse')


def _receipt(what: str, counter: np.ndarray, time_s: np.ndarray) -> Finding | None:
    """Stamps scatter as those do that a computer gives when data arrive."""
    interval = float(np.median(np.diff(time_s) / np.diff(counter).clip(1)))
    if interval <= 0 or len(time_s) < 4 * _HALF:
        return None
    late = scatter_s(counter, time_s)
    spread = _SCATTER * float(np.median(np.abs(late)))  # few pauses do not count
    if spread < max(_LATE * interval, _LEAST_LATE_S):
        return None
    return Finding('stamps of receipt', (
        f'stamps scatter by {1e3 * spread:.3g} ms around their trend, {spread / interval:.0%} '
        f'of the interval between {what}, up to {1e3 * np.abs(late).max():.3g} ms'),
        'stamp pulses by the clock of the radar, when they are sent; where it has none, set '
        "frames.stamp: receipt and frames.period_s in the description of a driver's messages, or "
        'fit a line through the stamps of receipt and subtract the delay',
        'the clock of a radar, whose pulses are evenly spaced', LIKELY)


def scatter_s(counter: np.ndarray, time_s: np.ndarray) -> np.ndarray:
    """Times less a line through their neighbours on both sides, seconds; without the ends."""
    n = len(counter)
    offsets = np.concatenate([np.arange(-_HALF, 0), np.arange(1, _HALF + 1)])
    at = np.arange(_HALF, n - _HALF)
    u = (counter[at[:, None] + offsets] - counter[at, None]).astype(float)
    t = time_s[at[:, None] + offsets]
    mean_u, mean_t = u.mean(axis=1, keepdims=True), t.mean(axis=1, keepdims=True)
    slope = (((u - mean_u) * (t - mean_t)).sum(axis=1)
             / np.square(u - mean_u).sum(axis=1))
    return time_s[at] - (mean_t[:, 0] - slope * mean_u[:, 0])


def _backward(time_s: np.ndarray) -> Finding | None:
    n = int(np.count_nonzero(np.diff(time_s) < 0))
    if not n:
        return None
    return Finding('times that run backwards', f'{n} pulses have an earlier stamp than the one '
                   'before by number', "order the pulses by the radar's numbers, and stamp them "
                   'by one clock that is never set back',
                   'pulses that were received in another order, whose numbers tell it')

