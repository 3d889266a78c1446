"""Compare when positions jump with when the echoes do: the rows of a raster, steps of a slider.

Between the rows of a raster the platform jumps, and so does what the radar hears. Both clocks are
right where positions and echoes jump between the same pulses. An image hardly tells this: with
another clock most pulses of a row stay in a row, and the image is doubled.
"""

from __future__ import annotations

import math

import numpy as np

from ..signal.pulses import PulseBlock
from ..signal.range_compression import RangeCompressor
from .hypotheses import Hypothesis, clock_drift, clock_offset
from .signals import LIKELY, Finding

_JUMP = 5.0  # median steps
_MOST_JUMPS = 0.05  # of all steps
_HEARD, _UNHEARD = 8.0, 3.0  # deviations of the change from pulse to pulse, over its median
_LARGEST_OFFSET = 0.4  # of the aperture
_RATES = np.linspace(0.75, 1.25, 201)
_FEWEST_PULSES = 32


def jump_findings(block: PulseBlock) -> list[Finding]:
    """Find whether the echoes jump at other times than the positions.

    Parameters
    ----------
    block : PulseBlock
        Raw or compressed, with phase centres.

    Returns
    -------
    list of Finding
        At most one: ``'clock offset'`` or ``'clock drift'``; none where positions do not jump at
        least twice.
    """
    if block.n_pulses < _FEWEST_PULSES or np.any(np.diff(block.stamp_ns) <= 0):
        return []
    time_s = 1e-9 * (block.stamp_ns - block.stamp_ns[0])
    between_s = (time_s[1:] + time_s[:-1]) / 2
    step_m = np.linalg.norm(np.diff(block.phase_centre_m, axis=0), axis=1)
    jumps_s = between_s[jumps(step_m)]
    if len(jumps_s) < 2:
        return []
    change = _change(block)
    if _heard(change, between_s, jumps_s) > _UNHEARD:
        return []
    interval_s = float(np.median(np.diff(time_s)))
    mistake, heard = max(_offset(change, between_s, jumps_s, interval_s),
                         _drift(change, between_s, jumps_s), key=lambda found: found[1])
    if heard < _HEARD:
        return []
    return [Finding(mistake.name, (
        f'positions jump {len(jumps_s)} times, and the echoes jump as often, by {heard:.0f} '
        'deviations of their changes from pulse to pulse, but at other times'), mistake.advice,
        'clocks as they are, and all offsets and rates', LIKELY, mistake.sizes)]


def jumps(step_m: np.ndarray) -> np.ndarray:
    """(K,) steps (N,) of positions that are jumps; those next to each other are one."""
    at = np.flatnonzero(step_m > _JUMP * np.median(step_m))
    if len(at) > max(2, _MOST_JUMPS * len(step_m)):
        return at[:0]
    groups = np.split(at, np.flatnonzero(np.diff(at) > 1) + 1) if len(at) else []
    return np.array([group[np.argmax(step_m[group])] for group in groups], int)


def _change(block: PulseBlock) -> np.ndarray:
    """(P - 1,) change of the profiles from pulse to pulse over its median, in deviations."""
    profiles = RangeCompressor.for_block(block)(block).samples
    profiles = profiles - profiles.mean(axis=0)
    power = np.sum(np.square(np.abs(profiles), dtype=float), axis=(1, 2))
    step = np.sum(np.square(np.abs(np.diff(profiles, axis=0)), dtype=float), axis=(1, 2))
    change = step / np.maximum(power[1:] + power[:-1], 1e-300)
    above = change - np.median(change)
    return above / max(1.48 * float(np.median(np.abs(above))), 1e-12)


def _heard(change: np.ndarray, between_s: np.ndarray, jumps_s: np.ndarray) -> float:
    """Least change (N,) at the times of the jumps (K,), up to a step earlier or later."""
    inside = (jumps_s >= between_s[1]) & (jumps_s <= between_s[-2])
    if np.count_nonzero(inside) < 2:
        return -math.inf
    number = np.interp(jumps_s[inside], between_s, np.arange(len(between_s)))
    near = np.clip(np.rint(number).astype(int), 1, len(between_s) - 2)[:, None] + [-1, 0, 1]
    return float(change[near].max(axis=1).min())


def _offset(change, between_s, jumps_s, interval_s) -> tuple[Hypothesis, float]:
    """The offset of the clock with which the echoes jump with the positions, and how clearly."""
    n = int(_LARGEST_OFFSET * len(between_s))
    heard = [_heard(change, between_s, jumps_s - k * interval_s) for k in range(-n, n + 1)]
    at = np.flatnonzero(heard == np.max(heard)) - n
    return clock_offset(float(np.mean(at)) * interval_s), float(np.max(heard))


def _drift(change, between_s, jumps_s) -> tuple[Hypothesis, float]:
    """The same for a clock of another rate around the middle."""
    middle_s = 0.5 * (between_s[0] + between_s[-1])
    heard = [_heard(change, between_s, middle_s + (jumps_s - middle_s) / rate)
             for rate in _RATES]
    at = np.flatnonzero(heard == np.max(heard))
    return clock_drift(float(np.mean(_RATES[at]))), float(np.max(heard))
