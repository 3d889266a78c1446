# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Poses of a platform from files: CSV, TUM trajectories, OptiTrack exports, arrays, bags.

`poses_around` and `told_of_poses` compare them with the pulses that they are for.
"""

from __future__ import annotations

import csv
import dataclasses
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from ..files import reading
from ..geometry.alignment import Alignment
from ..geometry.poses import PoseTable
from ..numpy_files import check_memory
from ..signal.pulses import PulseBlock
from .data_files import DataFiles, numbers, read_table
from .description import DescriptionError, Section, of_part
from .driver_bags import read_bag_poses
from .positions import FRAMES, TO_Z_UP, read_unit
from .times import to_nanoseconds

KEYS = ('file', 'format', 'frame', 'unit_s', 'unit_m', 'columns', 'times', 'positions',
        'quaternions', 'quaternion_order', 'level', 'body', 'topic')
FORMATS = ('arrays', 'csv', 'tum', 'optitrack', 'bag')
_NAMES = {'time': ('time', 't', 'timestamp', 'stamp', 'time_s', 'seconds', 'sec'),
          **{a: (a, f'p{a}', f'pos_{a}', f'position_{a}', f'{a}_m', f't{a}') for a in 'xyz'},
          **{f'q{a}': (f'q{a}', f'q_{a}', f'quat_{a}', f'quaternion_{a}', f'orientation_{a}')
             for a in 'xyzw'}}
_ANGLES = ('roll', 'pitch', 'yaw', 'heading', 'rx', 'ry', 'rz', 'euler')
_QUATERNION = tuple(f'q{a}' for a in 'xyzw')
_UNITS_M = {'Meters': 1.0, 'Centimeters': 1e-2, 'Millimeters': 1e-3}
_BYTES_PER_CHARACTER = 8  # of a table of numbers, as Python reads it


def read_poses(section: Section, folder: Path, data: DataFiles) -> PoseTable:
    """Poses of a description.

    Parameters
    ----------
    section : Section
        The part ``poses``.
    folder : Path
        Where files of relative names lie.
    data : DataFiles
        Files of the samples, for poses that stand in them.

    Returns
    -------
    PoseTable
        In the order of time, z up.

    Raises
    ------
    DescriptionError
        File and description do not fit.
    """
    file = section.text('file', None)
    path = None if file is None else folder / file
    if path is not None and not path.exists():
        raise section.error('file', f'a file in {folder}')
    if path is None or path.is_dir():
        kind, found = _read(section, path, data)
    else:
        with reading(path, 'poses', DescriptionError):
            kind, found = _read(section, path, data)
    if 'unit_m' in section:
        found = dataclasses.replace(found, position_m=found.position_m * read_unit(section))
    if section.flag('level'):
        found = dataclasses.replace(found, quaternion=_level(len(found.stamp_ns)))
    frame = section.choice('frame', FRAMES, 'y_up' if kind == 'optitrack' else 'z_up')
    return _checked(_z_up(found, frame), path.name if path else 'poses')


def _read(section: Section, path: Path | None, data: DataFiles) -> tuple[str, PoseTable]:
    """Format of the poses, and these as the file has them."""
    kind = (section.choice('format', FORMATS) if 'format' in section
            else _guess(section, path))
    if kind == 'arrays':
        return kind, _arrays(section, data if path is None else DataFiles([path]))
    if path is None:
        raise section.error('file', f'the file, as format={kind} needs one')
    if kind == 'bag':
        return kind, read_bag_poses(path, section.text('topic', None))
    check_memory(str(path.name), _BYTES_PER_CHARACTER * path.stat().st_size)
    return kind, {'csv': _csv, 'tum': _tum, 'optitrack': _optitrack}[kind](section, path)


def _guess(section: Section, path: Path | None) -> str:
    if path is None or path.suffix in ('.npz', '.npy', '.mat', '.h5', '.hdf5'):
        return 'arrays'
    if path.is_dir() or path.suffix in ('.bag', '.mcap', '.db3'):
        return 'bag'
    if path.suffix in ('.tum', '.txt'):
        return 'tum'
    if path.suffix == '.csv':
        with path.open(errors='replace') as file:
            return 'optitrack' if file.readline().startswith('Format Version') else 'csv'
    raise section.error('file', 'a known type of file', f'add format: {", ".join(FORMATS)}')


def _level(n: int) -> np.ndarray:
    return np.tile([0.0, 0.0, 0.0, 1.0], (n, 1))


def _stamps(section: Section, values: np.ndarray) -> np.ndarray:
    """(N,) int64 nanoseconds of stored times."""
    with of_part('poses'):
        return to_nanoseconds(values, section.number('unit_s', 1.0))


def _arrays(section: Section, data: DataFiles) -> PoseTable:
    time_ns = _stamps(section, data.real(section.text('times')).reshape(-1))
    position_m = data.real(section.text('positions')).astype(np.float64)
    if position_m.shape != (time_ns.size, 3):
        raise section.error('positions', f'shape ({time_ns.size}, 3), one position for each time',
                            f'its shape is {position_m.shape}')
    if 'quaternions' not in section:
        return PoseTable(time_ns, position_m, _level(time_ns.size))
    quaternion = data.real(section.text('quaternions')).astype(np.float64)
    if quaternion.shape != (time_ns.size, 4):
        raise section.error('quaternions', f'shape ({time_ns.size}, 4)',
                            f'its shape is {quaternion.shape}')
    if section.choice('quaternion_order', ('xyzw', 'wxyz'), 'xyzw') == 'wxyz':
        quaternion = np.roll(quaternion, -1, axis=1)
    return PoseTable(time_ns, position_m, quaternion)


def _csv(section: Section, path: Path) -> PoseTable:
    header, rows = read_table(path)
    wanted = section.section('columns', tuple(_NAMES))
    place = {}
    for key, usual in _NAMES.items():
        names = (wanted.text(key),) if key in wanted else usual
        found = [i for i, name in enumerate(header) if name in names or name.lower() in usual
                 and key not in wanted]
        if found:
            place[key] = found[0]
        elif key in wanted or key not in _QUATERNION:
            raise DescriptionError(f'{path.name} has no column {" or ".join(names[:3])}; it has '
                                   f'{", ".join(header)}: name it in poses.columns.{key}'
                                   + _of_degrees(header))
    turned = all(key in place for key in _QUATERNION)
    angles = [name for name in header if name.lower().split('_')[0] in _ANGLES]
    if angles and not turned and not section.flag('level'):
        raise DescriptionError(
            f'{path.name}: the attitude is in {", ".join(angles)}; expected a quaternion qx, qy, '
            'qz, qw: convert it (scipy.spatial.transform.Rotation.from_euler), or ignore it by '
            'poses.level: true')
    return PoseTable(
        _stamps(section, rows[:, place['time']]),
        rows[:, [place[a] for a in 'xyz']],
        rows[:, [place[key] for key in _QUATERNION]] if turned else _level(len(rows)))


def _of_degrees(header: list[str]) -> str:
    """Advice on columns of latitude and longitude."""
    if not any(name.lower().startswith(('lat', 'lon')) for name in header):
        return ''
    return '; latitude and longitude are degrees, convert them to metres east and north before'


def _tum(section: Section, path: Path) -> PoseTable:
    lines = [line for line in path.read_text().splitlines()
             if line.strip() and not line.startswith('#')]
    rows = numbers(path, lines, None, 8, expected='time x y z qx qy qz qw between blanks; '
                   'poses.format: csv reads tables with column names')
    return PoseTable(_stamps(section, rows[:, 0]), rows[:, 1:4],
                     rows[:, 4:8])


def _optitrack(section: Section, path: Path) -> PoseTable:
    """Rigid body of a CSV export of Motive; rows without a tracked body are left out."""
    with path.open(newline='', encoding='utf-8-sig') as file:
        rows = [row for row in csv.reader(file) if row]
    first = next((i for i, row in enumerate(rows) if row[0] == 'Frame'), None)
    if first is None or first < 3:
        raise DescriptionError(f'{path.name} has no row "Frame, Time (Seconds), ..."; expected a '
                               'CSV export of Motive')
    told = dict(zip(rows[0][::2], rows[0][1::2], strict=False))
    unit_m = _UNITS_M.get(told.get('Length Units', told.get('Units Type', 'Meters')))
    if unit_m is None or told.get('Rotation Type', 'Quaternion') != 'Quaternion':
        raise DescriptionError(f'{path.name}: expected lengths in {", ".join(_UNITS_M)} and '
                               'rotations as quaternions; export it from Motive so')
    kinds, names, quantities, axes = rows[1], rows[2], rows[first - 1], rows[first]
    bodies = dict.fromkeys(name for kind, name in zip(kinds, names, strict=False)
                           if kind == 'Rigid Body' and name)
    body = section.text('body', None) or next(iter(bodies), None)
    if body not in bodies:
        raise section.error('body', f'one of the rigid bodies {", ".join(bodies) or "(none)"} of '
                            f'{path.name}')
    place = {(quantity, axis): i for i, (kind, name, quantity, axis)
             in enumerate(zip(kinds, names, quantities, axes, strict=False))
             if kind == 'Rigid Body' and name == body}
    columns = [1, *(place[('Position', a)] for a in 'XYZ'),
               *(place[('Rotation', a)] for a in 'XYZW')]
    tracked = [[row[i] for i in columns] for row in rows[first + 1:]
               if len(row) > max(columns) and all(row[i] for i in columns)]
    if not tracked:
        raise DescriptionError(f'{path.name}: {body} was never tracked')
    table = np.array(tracked, np.float64)
    return PoseTable(to_nanoseconds(table[:, 0]), unit_m * table[:, 1:4], table[:, 4:])


def _z_up(poses: PoseTable, frame: str) -> PoseTable:
    if frame == 'z_up':
        return poses
    turn = Rotation.from_matrix(TO_Z_UP[frame])
    # The body's axes follow: of NED they are forward, right, down and become forward, left, up.
    body = turn if frame == 'y_up' else Rotation.from_matrix(np.diag([1.0, -1.0, -1.0]))
    attitude = turn * Rotation.from_quat(poses.quaternion) * body.inv()
    return dataclasses.replace(poses, position_m=poses.position_m @ TO_Z_UP[frame].T,
                               quaternion=attitude.as_quat())


def _checked(poses: PoseTable, name: str) -> PoseTable:
    if len(poses.stamp_ns) < 2:
        raise DescriptionError(f'{name} has {len(poses.stamp_ns)} poses; expected two or more')
    for what, values in (('positions', poses.position_m), ('quaternions', poses.quaternion)):
        if not np.isfinite(values).all():
            raise DescriptionError(f'{name}: {what} hold NaN or infinity; leave these rows out')
    norm = np.linalg.norm(poses.quaternion, axis=1)
    if (np.abs(norm - 1) > 0.01).any():
        at = int(np.abs(norm - 1).argmax())
        raise DescriptionError(f'{name}: quaternion {at} has the norm {norm[at]:.4g}; expected 1 '
                               '(use poses.level: true where there are none)')
    order = np.argsort(poses.stamp_ns, kind='stable')
    return poses.select(order)


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
