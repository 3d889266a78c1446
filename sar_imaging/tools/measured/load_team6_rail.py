"""Convert a rail recording of team 5 or 6 (UWB radar, motion capture) to a rosbag2 recording.

Run: python -m sar_imaging.tools.measured.load_team6_rail FOLDER --output out/bags/team6_rail

The radar's pulses and the poses of motion capture come on clocks of their own: the bag has raw
pulses without positions on `/pulses` and `nav_msgs/Odometry` on `/odometry`.
"""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import sys
import zipfile
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from sar_imaging.autofocus.alignment_model import aligned, alignment_model
from sar_imaging.autofocus.autofocus import Autofocus, AutofocusReport
from sar_imaging.geometry.alignment import Alignment
from sar_imaging.geometry.grids import MapGrid
from sar_imaging.signal.positioning import locate
from sar_imaging.signal.pulses import PulseBlock
from sar_imaging.signal.radar import SPEED_OF_LIGHT, RadarParameters, Waveform
from sar_imaging.signal.range_compression import RangeCompressor
from sar_imaging.signal.uwb import subtract_background

from ..recordings.bag_io import BagError, check_target, make_truth, write_bag
from ..recordings.recorded_poses import RecordedPoses
from ..recordings.writing import run_writing, split, with_progress

CARRIER_HZ = 3.95e9
BANDWIDTH_HZ = 1.5e9  # 3.1 to 4.6 GHz within this and a little beyond
START_NS = 1_700_000_000_000_000_000
SAMPLE_SCALE = 1e-4  # samples reach 120000, which fit a float32 but make awkward images
POSES_AROUND_S = 3.0  # kept before the first and after the last pulse
ALIGNMENTS = ('nominal', 'fitted', 'estimated')
# What the alignment may be wrong by, for autofocus
EXPECTED_ERROR = {'time_offset_s': 0.05, 'range_bias_m': 0.2}
_MARGIN_M = 1.0  # of a grid around its reflectors
_STEP_S = 0.25  # between the places whose distance tells motion from the jitter of motion capture
_AT_REST_M_PER_S = 0.02
_EDGE_S = 0.5  # the platform starts and stops
_SHARE = 0.9  # of the path within the interval, and of the interval in which the platform moves


@dataclasses.dataclass(frozen=True)
class Recording:
    """How one rail recording is laid out.

    Attributes
    ----------
    name, team : str
        Of the recording, and who made it.
    file : str
        Name of its file.
    moving_s : (2,) floats or None
        When the platform moves, on the radar's clock, seconds; before and after it stands still.
        The file's own `moving_s` goes before it; None where every file has that.
    alignments : dict
        Names of the fields with time offset, range bias and, where there is one, lever arm, for
        each kind of alignment that came with it.
    grid : MapGrid
        Where to image.
    """

    name: str
    team: str
    file: str
    moving_s: tuple[float, float] | None
    alignments: dict[str, tuple[str, str, str | None]]
    grid: MapGrid


TEAM_6 = Recording(
    'team6_rail', 'team 6', 'team6_rail_trial6.npz', (4.2, 8.1),
    {'nominal': ('nominal_time_offset_s', 'nominal_range_bias_m', None),
     'fitted': ('fit_time_offset_s', 'fit_range_bias_m', 'fit_lever_arm_m')},
    MapGrid.from_size((1.75, 1.4, 0.04), 6.5, 8.4, 0.02))
TEAM_5 = Recording(
    'team5_rail', 'team 5', 'team5_rail_pass_a.npz', None,
    {'nominal': ('reference_time_offset_s', 'reference_range_bias_m', None)},
    MapGrid.from_size((-0.5, 2.5, 0.067), 5.0, 7.0, 0.03))
RECORDINGS = (TEAM_6, TEAM_5)
FILE, GRID = TEAM_6.file, TEAM_6.grid

_DESCRIPTION = """\
Convert a rail recording of the Beaver Works summer institute 2019 (team 6, or pass A of team 5) to
a rosbag2 recording of raw passband pulses and odometry. Only the pulses of the moving platform are
kept, without what is the same in all of them (the antennas' direct path). The quaternions of
motion capture are not used: what axes they refer to is not known, and the rail keeps the platform
level.
"""


def recording_in(folder: Path) -> Recording:
    """Which recording a folder holds.

    Raises
    ------
    BagError
        It holds none.
    """
    for recording in RECORDINGS:
        if (Path(folder) / recording.file).is_file():
            return recording
    raise BagError(f'{folder} holds no {" and no ".join(r.file for r in RECORDINGS)}; pass the '
                   'folder with a recording')


def read_folder(folder: Path) -> tuple[PulseBlock, RecordedPoses]:
    """Read a recording: pulses of the moving platform, and poses around them.

    Parameters
    ----------
    folder : Path
        With the file of one of `RECORDINGS`.

    Returns
    -------
    block : PulseBlock
        Real passband samples ``(P, 1, N)`` without positions, times on the radar's clock.
    poses : RecordedPoses
        On the clock of motion capture, level.

    Raises
    ------
    BagError
        The file is not there or not of this kind.
    """
    with _opened(folder) as (recording, data):
        _check_moving(data, recording)
        return _pulses(data, recording), _poses(data, recording)


@contextlib.contextmanager
def _opened(folder: Path) -> Iterator[tuple[Recording, dict[str, np.ndarray]]]:
    """The recording and its arrays; what they lack is told with the file's name."""
    recording = recording_in(folder)
    file = Path(folder) / recording.file
    try:
        with np.load(file) as data:
            arrays = dict(data)
    except (ValueError, OSError, zipfile.BadZipFile) as error:
        raise BagError(f'{file} cannot be read: {error}') from error
    try:
        yield recording, arrays
    except (KeyError, TypeError, ValueError) as error:
        raise BagError(f'{file} is not the {recording.team} recording: {error}') from error


def _nanoseconds(time_s) -> np.ndarray:
    return START_NS + np.rint(np.asarray(time_s, float) * 1e9).astype(np.int64)


def _moving(data, recording: Recording) -> np.ndarray:
    time_s = data['scan_time_s']
    first, last = data.get('moving_s', recording.moving_s)
    return (time_s >= first) & (time_s <= last)


def _check_moving(data, recording: Recording) -> None:
    """Another pass of the rail moves at other times, and its pulses at rest spoil the image."""
    first, last = data.get('moving_s', recording.moving_s)
    pulse_s = data['scan_time_s']
    time_s = np.arange(pulse_s[0], pulse_s[-1], _STEP_S)
    mocap_s = data['mocap_time_s'] - float(data[recording.alignments['nominal'][0]])
    place_m = np.stack([np.interp(time_s, mocap_s, p) for p in data['mocap_pos_m'].T], axis=-1)
    step_m = np.linalg.norm(np.diff(place_m, axis=0), axis=1)
    middle_s = (time_s[1:] + time_s[:-1]) / 2
    moves = step_m > _AT_REST_M_PER_S * _STEP_S
    # The file's own interval may be a part of the pass; the known one is meant to be all of it.
    near = ((middle_s > first - _EDGE_S) & (middle_s < last + _EDGE_S)) | ('moving_s' in data)
    inside = (middle_s > first + _EDGE_S) & (middle_s < last - _EDGE_S)
    if not moves.any():
        raise BagError('the platform stands still while the radar sends, as motion capture and '
                       'the nominal time offset have it; pass a recording of a moving platform')
    if (step_m[near].sum() < _SHARE * step_m[moves].sum()
            or np.mean(moves[inside]) < _SHARE):
        seen = middle_s[moves]
        raise BagError(
            f'the pulses of {first:g} to {last:g} s would be imaged, but the platform moves from '
            f'{seen[0]:.1f} to {seen[-1]:.1f} s of the radar clock: this is another pass; store '
            'its interval in the file as moving_s, two numbers')


def _pulses(data, recording: Recording) -> PulseBlock:
    moving = _moving(data, recording)
    radar = RadarParameters(
        CARRIER_HZ, BANDWIDTH_HZ, SPEED_OF_LIGHT / (2 * float(data['range_bin_m'])),
        2 * float(data['range_start_m']) / SPEED_OF_LIGHT, waveform=Waveform.PASSBAND)
    samples = SAMPLE_SCALE * data['scan'][moving][:, None].astype(np.complex128)
    counter = np.arange(int(moving.sum()))
    return subtract_background(PulseBlock(
        radar, False, _nanoseconds(data['scan_time_s'][moving]), counter, samples))


def _around(data, recording: Recording) -> np.ndarray:
    """(N,) bool, which poses of the file are around the pulses."""
    time_s = data['mocap_time_s']
    pulse_s = (data['scan_time_s'][_moving(data, recording)]
               + float(data[recording.alignments['nominal'][0]]))
    return (time_s > pulse_s[0] - POSES_AROUND_S) & (time_s < pulse_s[-1] + POSES_AROUND_S)


def _poses(data, recording: Recording) -> RecordedPoses:
    around = _around(data, recording)
    position_m = np.asarray(data['mocap_pos_m'], float)[around]
    level = np.tile([0.0, 0.0, 0.0, 1.0], (len(position_m), 1))
    return RecordedPoses(_nanoseconds(data['mocap_time_s'][around]), position_m, level)


def read_alignment(folder: Path, kind: str) -> Alignment:
    """Alignment values that came with a recording, ``'nominal'`` or ``'fitted'``.

    The fitted ones were found with the surveyed reflectors, and team 5 has none; the nominal ones
    have no lever arm.
    """
    with _opened(folder) as (recording, data):
        if kind not in recording.alignments:
            raise BagError(f'the {recording.team} recording has no {kind} alignment; use '
                           f'{" or ".join(recording.alignments)} or estimated')
        offset, bias, arm = recording.alignments[kind]
        arm_m = np.zeros((1, 3)) if arm is None else data[arm][None]
        return Alignment(tx_m=arm_m, rx_m=arm_m, time_offset_s=float(data[offset]),
                         range_bias_m=float(data[bias]))


def read_reflectors(folder: Path) -> np.ndarray:
    """(K, 3) float64 surveyed positions of the corner reflectors, metres."""
    with _opened(folder) as (_, data):
        return np.asarray(data['reflector_pos_m'], float)


def scene_grid(recording: Recording, reflectors_m: np.ndarray) -> MapGrid:
    """The recording's own grid, or one about the reflectors where they lie elsewhere."""
    grid = recording.grid
    rows, columns = grid.to_pixels(reflectors_m[:, 0], reflectors_m[:, 1])
    if np.all((rows >= 0) & (rows < grid.n_y) & (columns >= 0) & (columns < grid.n_x)):
        return grid
    low_m, high_m = reflectors_m.min(axis=0), reflectors_m.max(axis=0)
    size_x_m, size_y_m = np.maximum((high_m - low_m)[:2] + 2 * _MARGIN_M,
                                    grid.spacing_m * np.array([grid.n_x - 1, grid.n_y - 1]))
    return MapGrid.from_size(tuple((low_m + high_m) / 2), size_x_m, size_y_m, grid.spacing_m)


def read_attitudes(folder: Path) -> np.ndarray:
    """(N, 4) float64 quaternions x, y, z, w at the poses that `read_folder` returns.

    What axes they refer to is not known; imaging does not use them.
    """
    with _opened(folder) as (recording, data):
        return np.asarray(data['mocap_quat_xyzw_raw'], float)[_around(data, recording)]


def estimate_alignment(block: PulseBlock, poses: RecordedPoses, start: Alignment,
                       grid: MapGrid = GRID) -> tuple[Alignment, AutofocusReport]:
    """Time offset and range bias from the image alone, beginning with `start`.

    The rail does not turn the platform, so that another lever arm displaces the image and does
    not change it: no image can tell it, and it stays as it is.

    Parameters
    ----------
    block : PulseBlock
        Raw pulses without positions.
    poses : RecordedPoses
        Of the platform.
    start : Alignment
        What to begin with.
    grid : MapGrid
        Where to image.

    Returns
    -------
    Alignment, AutofocusReport
        The alignment is `start` where autofocus did not accept what it found. A parameter whose
        uncertainty is as large as `EXPECTED_ERROR` has not been determined.
    """
    track = poses.track()
    located = locate(block, track, start)
    profiles = RangeCompressor.for_block(located)(located)
    report = Autofocus(grid, n_phases=0, model=lambda pulses: alignment_model(
        pulses, track, start, **EXPECTED_ERROR)).process(profiles).report
    return (aligned(start, report.parameters) if report.accepted else start), report


def rail_truth(recording: Recording, block: PulseBlock, reflectors_m: np.ndarray,
               grid: MapGrid, alignment: Alignment, kind: str) -> dict:
    """Truth of a recording: the surveyed reflectors, and the alignment to image with."""
    return make_truth(
        scenario=recording.name, description=f'{recording.team.capitalize()} rail: UWB radar on '
        f'a rail, poses of motion capture on another clock, {kind} alignment',
        scatterers=[{'name': f'reflector_{i + 1}', 'position_m': place.tolist(),
                     'amplitude_db': 0.0} for i, place in enumerate(reflectors_m)],
        grid=grid,
        pulses_per_aperture=block.n_pulses, n_pulses=block.n_pulses, n_channels=1,
        cut_half_width_m=(1.0, 1.0), radar=block.radar, compressed=False, alignment=alignment,
        notes='Measured, not simulated. MIT licence, Beaver Works Summer Institute UAS-SAR 2019.')


def _estimates(report: AutofocusReport) -> str:
    return ', '.join(
        f'{name} {value:.4f}' + (' (not determined by the image)'
                                 if report.uncertainty[name] > 0.5 * EXPECTED_ERROR[name] else '')
        for name, value in report.parameters.items())


def parser() -> argparse.ArgumentParser:
    """Command-line parser."""
    p = argparse.ArgumentParser(prog='load_team6_rail', description=_DESCRIPTION,
                                formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument('folder', type=Path, help='folder with '
                   f'{" or ".join(r.file for r in RECORDINGS)}')
    p.add_argument('--output', type=Path, default=Path('out/bags/team6_rail'), metavar='FOLDER',
                   help='bag folder to make (default: %(default)s)')
    p.add_argument('--alignment', choices=ALIGNMENTS, default='nominal',
                   help='which values of time offset, range bias and lever arm the nodes shall '
                        'use: nominal, fitted with the survey, or estimated from the image alone '
                        '(default: %(default)s)')
    p.add_argument('--wrong-by', type=float, default=0.0, metavar='SECONDS',
                   help='make the time offset wrong by so much, to try autofocus on '
                        '(default: %(default)s)')
    p.add_argument('--force', action='store_true', help='replace an existing bag')
    return p


def main(argv: Sequence[str] | None = None) -> int:
    """Run the program; returns its exit status."""
    arguments = parser().parse_args(argv)

    def write() -> str:
        check_target(arguments.output, overwrite=arguments.force)
        recording = recording_in(arguments.folder)
        block, poses = read_folder(arguments.folder)
        reflectors_m = read_reflectors(arguments.folder)
        grid = scene_grid(recording, reflectors_m)
        if grid != recording.grid:
            print('the reflectors lie outside the grid of the known pass: imaging around them')
        if arguments.alignment == 'estimated':
            nominal = read_alignment(arguments.folder, 'nominal')
            alignment, report = estimate_alignment(block, poses, nominal, grid)
            print(f'{report}; {_estimates(report)}')
        else:
            alignment = read_alignment(arguments.folder, arguments.alignment)
        alignment = dataclasses.replace(
            alignment, time_offset_s=alignment.time_offset_s + arguments.wrong_by)
        truth = rail_truth(recording, block, reflectors_m, grid, alignment, arguments.alignment)
        count = write_bag(arguments.output, with_progress(split(block), block.n_pulses), truth,
                          overwrite=arguments.force, poses=poses)
        return (f'{arguments.output}: {block.n_pulses} pulses in {count} messages, '
                f'{len(poses.stamp_ns)} poses, {arguments.alignment} alignment')

    return run_writing(write)


if __name__ == '__main__':
    sys.exit(main())
