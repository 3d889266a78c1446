"""Do pulses and poses fit together? Poses around the pulses, and what a person should know."""

from __future__ import annotations

import numpy as np

from ..geometry.alignment import Alignment
from ..geometry.poses import PoseTable
from ..signal.pulses import PulseBlock
from .description import DescriptionError

POSES_AROUND_NS = 3_000_000_000  # kept before the first and after the last pulse
_AT_REST_M_PER_S = 0.02
_STEP_S = 0.25  # between places whose distance tells motion from the jitter of motion capture
_MOST_STEPS = 100_000
_MOST_NAMED = 3  # departures of poses
_MOST_AT_REST = 0.2  # share of the pulses
_WIDEST_GAP_S = 0.2  # of PoseTrack and of the nodes, unless they are told another one
_UNITS = (1e-9, 1e-6, 1e-3, 1e3, 1e6, 1e9)
_LEAST_SHARE = 0.01  # of the poses' time, that pulses in the right unit take


def poses_around(poses: PoseTable, pulses: PulseBlock, alignment: Alignment) -> PoseTable:
    """Poses from some seconds before the first pulse to some after the last.

    Raises
    ------
    DescriptionError
        There are none before the first or after the last; the text says what would fit.
    """
    first, last = pulses.stamp_ns[[0, -1]] + alignment.time_offset_ns
    ends = poses.stamp_ns[[0, -1]]
    if ends[0] > first or ends[1] < last:
        raise DescriptionError(
            f'the pulses need poses from {first * 1e-9:.6f} to {last * 1e-9:.6f} s of the clock '
            f'of the poses; there are poses from {ends[0] * 1e-9:.6f} to {ends[1] * 1e-9:.6f} s: '
            + _what_fits(pulses.stamp_ns[[0, -1]] * 1e-9, ends * 1e-9, alignment.time_offset_s))
    near = (poses.stamp_ns > first - POSES_AROUND_NS) & (poses.stamp_ns < last + POSES_AROUND_NS)
    # One on either side, however far away.
    near[np.searchsorted(poses.stamp_ns, first, 'right') - 1] = True
    near[np.searchsorted(poses.stamp_ns, last)] = True
    return poses.select(near)


def _what_fits(pulse_s: np.ndarray, pose_s: np.ndarray, offset_s: float) -> str:
    """Advice for (2,) ends of pulses and poses, seconds, each by its own clock."""
    for unit in _UNITS:
        first_s, last_s = unit * pulse_s + offset_s
        if (pose_s[0] <= first_s and last_s <= pose_s[1]
                and last_s - first_s > _LEAST_SHARE * np.ptp(pose_s)):
            return (f'{unit:g} times those of the pulses, or {1 / unit:g} times those of the '
                    'poses, would fit; correct times.unit_s, times.interval_s or poses.unit_s')
    lasts_s, there_s = np.ptp(pulse_s), np.ptp(pose_s)
    if lasts_s > there_s:
        return (f'the pulses last {lasts_s:.6g} s, the poses {there_s:.6g} s; correct '
                'times.unit_s or times.interval_s, or shorten times.use_s')
    return ('correct alignment.time_offset_s (clock of the poses minus clock of the pulses; '
            f'{pose_s[0] - pulse_s[0]:.6f} to {pose_s[1] - pulse_s[1]:.6f} s would fit) or '
            'times.first_s')


def told_of_poses(pulses: PulseBlock, poses: PoseTable, alignment: Alignment) -> tuple[str, ...]:
    """Warnings where the platform rests, whose pulses spoil the image, and where poses lack."""
    return (_departures(poses) + _gaps(pulses, poses, alignment)
            + _motion(pulses, poses, alignment))


def _departures(poses: PoseTable) -> tuple[str, ...]:
    found = poses.track().take_departures()
    told = tuple(str(departure) for departure in found[:_MOST_NAMED])
    more = len(found) - len(told)
    return (*told, f'{more} more departures of poses follow these') if more else told


def _gaps(pulses: PulseBlock, poses: PoseTable, alignment: Alignment) -> tuple[str, ...]:
    after = np.searchsorted(poses.stamp_ns, pulses.stamp_ns + alignment.time_offset_ns, 'right')
    after = np.clip(after, 1, len(poses.stamp_ns) - 1)
    gap_s = (poses.stamp_ns[after] - poses.stamp_ns[after - 1]) * 1e-9
    without = gap_s > _WIDEST_GAP_S
    if not without.any():
        return ()
    return (f'{int(without.sum())} of {pulses.n_pulses} pulses lie between poses that are up to '
            f'{gap_s.max():.3g} s apart; expected {_WIDEST_GAP_S:g} s or less, or they get no '
            'position: take poses at a higher rate, or leave these pulses out by times.use_s',)


def _motion(pulses: PulseBlock, poses: PoseTable, alignment: Alignment) -> tuple[str, ...]:
    time_s = (pulses.stamp_ns - pulses.stamp_ns[0]) * 1e-9
    pose_s = (poses.stamp_ns - pulses.stamp_ns[0] - alignment.time_offset_ns) * 1e-9
    step_s = max(_STEP_S, time_s[-1] / _MOST_STEPS)
    at = np.arange(time_s[0], time_s[-1], step_s)
    if at.size < 4:
        return ()
    place = np.stack([np.interp(at, pose_s, axis) for axis in poses.position_m.T], axis=-1)
    moves = np.linalg.norm(np.diff(place, axis=0), axis=1) > _AT_REST_M_PER_S * step_s
    if not moves.any():
        return ('the platform stands still while the radar sends; check '
                'alignment.time_offset_s and the poses',)
    if np.mean(~moves) <= _MOST_AT_REST:
        return ()
    first_s = pulses.stamp_ns[0] * 1e-9
    begin, end = at[:-1][moves][0] + first_s, at[1:][moves][-1] + first_s
    return (f'the platform rests for {100 * np.mean(~moves):.0f} % of the pulses and moves from '
            f'{begin:.1f} to {end:.1f} s of the radar clock: times.use_s: [{begin:.1f}, '
            f'{end:.1f}] keeps those',)
