# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Find implausible positions and times without an image, and jumps that echoes do not share.

No platform has a track like the ones that `track_doubts` names. Between the rows of a raster, or
the steps of a slider, the platform jumps, and so does what the radar hears. Both clocks are right
where positions and echoes jump between the same pulses. An image hardly tells this: with another
clock most pulses of a row stay in a row, and the image is doubled.
"""

from __future__ import annotations

import math

import numpy as np

from ..signal.pulses import PulseBlock
from ..signal.range_compression import RangeCompressor
from .hypotheses import Hypothesis, clock_drift, clock_offset
from .signals import LIKELY, Finding, median_around

_FASTEST_M_PER_S = 15e3  # above what orbits the Earth
_FEWEST = 16  # pulses that tell a pattern
_REGULAR = 0.15  # deviation of steps from their neighbours
_JUMP = 5.0  # median steps
_MOST_JUMPS = 0.05  # of all steps
_HEARD, _UNHEARD = 8.0, 3.0  # deviations of the change from pulse to pulse, over its median
_LARGEST_OFFSET = 0.4  # of the aperture
_RATES = np.linspace(0.75, 1.25, 201)
_FEWEST_PULSES = 32
_MOST_CENTRES, _CURVE_DEGREE = 4096, 8
_WIDE, _BESIDE = 2.0, 0.5  # wavelengths, and share of the width that no curve explains


def track_doubts(block: PulseBlock) -> tuple[str, ...]:
    """Find what is odd about positions and times, each with what it probably means.

    Parameters
    ----------
    block : PulseBlock
        Pulses of one aperture with phase centres, in order.

    Returns
    -------
    tuple of str
        Empty for tracks that look right.

    Examples
    --------
    >>> import dataclasses
    >>> from sar_imaging import concatenate
    >>> from sar_imaging.diagnosis import track_doubts
    >>> from sar_imaging.simulation import SCENARIOS
    >>> block = concatenate(list(SCENARIOS['psf']().blocks()))
    >>> track_doubts(block)
    ()
    >>> wrong = dataclasses.replace(block, tx_m=1000 * block.tx_m, rx_m=1000 * block.rx_m)
    >>> for doubt in track_doubts(wrong):
    ...     print(doubt)
    the phase centres move at 200 km/s, faster than a satellite; are they in millimetres, ...
    """
    if not block.has_positions or block.n_pulses < 2:
        return ()
    return tuple(filter(None, (_at_rest(block), _times(block), _speed(block), _degrees(block),
                               _left_out(block))))


def at_rest(block: PulseBlock) -> bool:
    """Whether all pulses and channels have the same phase centre; an array needs no motion."""
    return not (np.ptp(block.phase_centre_m, axis=0).any()
                or np.ptp(np.add(*block.centres_m)[0], axis=0).any())


def fills_a_plane(block: PulseBlock) -> bool:
    """Whether pulses and channels lie beside any curve, as those of a raster or upright array do.

    They then resolve heights, or what else lies across their longest side.
    """
    centres = (np.add(*block.centres_m) / 2).reshape(-1, 3)
    centres = centres[::-(-len(centres) // _MOST_CENTRES)]
    centres = centres - centres.mean(axis=0)
    along, across = (centres @ np.linalg.svd(centres, full_matrices=False)[2][:2].T).T
    if np.ptp(across) < _WIDE * block.radar.wavelength_m:
        return False
    curve = np.polynomial.Polynomial.fit(along, across, _CURVE_DEGREE)
    return bool(np.std(across - curve(along)) > _BESIDE * np.std(across))


def _at_rest(block: PulseBlock) -> str:
    if not at_rest(block):
        return ''
    return (f'the phase centres of all {block.n_pulses} pulses are the same: there is no '
            'synthetic aperture; interpolate the poses at the times of the pulses, or give the '
            'lever arm of an antenna that turns around the point that the poses are of')


def _times(block: PulseBlock) -> str:
    if np.ptp(block.stamp_ns) or not np.ptp(block.counter):
        return ''
    return (f'all {block.n_pulses} pulses have the time {block.stamp_ns[0]} ns; whole seconds '
            'are too coarse: give every pulse its own time in nanoseconds')


def _steps(block: PulseBlock) -> tuple[np.ndarray, np.ndarray]:
    """Distance and time from pulse to pulse, metres and seconds."""
    return (np.linalg.norm(np.diff(block.phase_centre_m, axis=0), axis=1),
            np.diff(block.stamp_ns) * 1e-9)


def _speed(block: PulseBlock) -> str:
    distance, seconds = _steps(block)
    if seconds.sum() <= 0:
        return ''
    speed = float(distance.sum() / seconds.sum())
    if speed <= _FASTEST_M_PER_S:
        return ''
    return (f'the phase centres move at {speed / 1e3:.4g} km/s, faster than a satellite; are '
            'they in millimetres, or the times not in nanoseconds?')


def _degrees(block: PulseBlock) -> str:
    centres = block.phase_centre_m
    extent = float(np.ptp(centres[:, :2], axis=0).max())
    largest = np.abs(centres[:, :2]).max(axis=0)
    small = 0 < extent < 0.25 * block.radar.wavelength_m
    if (block.n_pulses < _FEWEST or not small or largest.max() < 0.5 or largest.max() > 180
            or extent > 1e-3 * largest.max()):
        return ''
    return (f'the phase centres move by {extent:.2g} in x and y, less than a wavelength, around '
            f'({centres[0, 0]:.5g}, {centres[0, 1]:.5g}); are these degrees of longitude and '
            'latitude? Convert them to metres in a local frame (east, north, up)')


def _left_out(block: PulseBlock) -> str:
    """Positions that advance by two pulses, or stand still for one, at regular intervals."""
    distance, seconds = _steps(block)
    if block.n_pulses < _FEWEST or np.ptp(seconds) > 0.3 * np.median(seconds):
        return ''
    around = median_around(distance)
    ratio = distance / np.where(around > 0, around, 1.0)
    still = distance == 0
    still[0] = still[-1] = False
    double = np.abs(ratio - 2) < 2 * _REGULAR
    for odd, what in ((still, 'are those of the pulse before: positions were repeated'),
                      (double, 'advance by two pulses at once: positions were left out')):
        others = np.abs(ratio[~(odd | double)] - 1) < _REGULAR
        at = np.flatnonzero(odd)
        if len(at) < 3 or len(at) > 0.4 * len(odd) or others.mean() < 0.8:
            continue
        gaps = np.diff(at)
        if np.mean(np.abs(gaps - np.median(gaps)) <= 1) > 0.8:
            n = int(np.median(gaps))
            return (f'{len(at)} of {len(odd)} positions, '
                    f'{f"one in {n}" if n > 1 else "one after another"}, {what}; '
                    'pulses and positions drift apart: give every pulse its own position')
    return ''


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


def _offset(change: np.ndarray, between_s: np.ndarray, jumps_s: np.ndarray, interval_s: float
            ) -> tuple[Hypothesis, float]:
    """The offset of the clock with which the echoes jump with the positions, and how clearly."""
    n = int(_LARGEST_OFFSET * len(between_s))
    heard = [_heard(change, between_s, jumps_s - k * interval_s) for k in range(-n, n + 1)]
    at = np.flatnonzero(heard == np.max(heard)) - n
    return clock_offset(float(np.mean(at)) * interval_s), float(np.max(heard))


def _drift(change: np.ndarray, between_s: np.ndarray, jumps_s: np.ndarray
           ) -> tuple[Hypothesis, float]:
    """The same for a clock of another rate around the middle."""
    middle_s = 0.5 * (between_s[0] + between_s[-1])
    heard = [_heard(change, between_s, middle_s + (jumps_s - middle_s) / rate)
             for rate in _RATES]
    at = np.flatnonzero(heard == np.max(heard))
    return clock_drift(float(np.mean(_RATES[at]))), float(np.max(heard))
