"""Convert the team 6 rail recording (UWB radar, motion capture) to a rosbag2 recording.

Run: python -m sar_imaging.tools.load_team6_rail FOLDER --output out/bags/team6_rail

The radar's pulses and the poses of motion capture come on clocks of their own: the bag has raw
pulses without positions on `/pulses` and `nav_msgs/Odometry` on `/odometry`.
"""

from __future__ import annotations

import argparse
import sys
import zipfile
from collections.abc import Sequence
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

from .bag_io import BagError, check_target, make_truth, write_bag
from .recorded_poses import RecordedPoses
from .writing import run_writing, split, with_progress

FILE = 'team6_rail_trial6.npz'
CARRIER_HZ = 3.95e9
BANDWIDTH_HZ = 1.5e9  # 3.1 to 4.6 GHz within this and a little beyond
MOVING_S = (4.2, 8.1)  # of the radar's clock; before and after, the platform stands still
START_NS = 1_700_000_000_000_000_000
SAMPLE_SCALE = 1e-4  # samples reach 120000, which fit a float32 but make awkward images
POSES_AROUND_S = 1.0  # kept before the first and after the last pulse
ALIGNMENTS = ('nominal', 'fitted', 'estimated')
GRID = MapGrid.from_size((1.75, 1.4, 0.04), 6.5, 8.4, 0.02)
# What the alignment may be wrong by, for autofocus
EXPECTED_ERROR = {'time_offset_s': 0.05, 'range_bias_m': 0.2}

_DESCRIPTION = """\
Convert the team 6 rail recording of the Beaver Works summer institute 2019 to a rosbag2 recording
of raw passband pulses and odometry. Only the pulses of the moving platform are kept, without what
is the same in all of them (the antennas' direct path). The quaternions of motion capture are not
used: what axes they refer to is not known, and the rail keeps the platform level.
"""


def read_folder(folder: Path) -> tuple[PulseBlock, RecordedPoses]:
    """Read the recording: pulses of the moving platform, and poses around them.

    Parameters
    ----------
    folder : Path
        With team6_rail_trial6.npz.

    Returns
    -------
    block : PulseBlock
        Real passband samples ``(225, 1, 960)`` without positions, times on the radar's clock.
    poses : RecordedPoses
        On the clock of motion capture, level.

    Raises
    ------
    BagError
        The file is not there or not of this kind.
    """
    data = _load(Path(folder))
    try:
        return _pulses(data), _poses(data)
    except (KeyError, ValueError) as error:
        raise BagError(f'{Path(folder) / FILE} is not the team 6 recording: {error}') from error


def _load(folder: Path) -> dict[str, np.ndarray]:
    file = folder / FILE
    if not file.is_file():
        raise BagError(f'{folder} holds no {FILE}; pass the folder with the recording')
    try:
        with np.load(file) as data:
            return dict(data)
    except (ValueError, OSError, zipfile.BadZipFile) as error:
        raise BagError(f'{file} cannot be read: {error}') from error


def _nanoseconds(time_s) -> np.ndarray:
    return START_NS + np.rint(np.asarray(time_s, float) * 1e9).astype(np.int64)


def _moving(data) -> np.ndarray:
    time_s = data['scan_time_s']
    return (time_s >= MOVING_S[0]) & (time_s <= MOVING_S[1])


def _pulses(data) -> PulseBlock:
    moving = _moving(data)
    radar = RadarParameters(
        CARRIER_HZ, BANDWIDTH_HZ, SPEED_OF_LIGHT / (2 * float(data['range_bin_m'])),
        2 * float(data['range_start_m']) / SPEED_OF_LIGHT, waveform=Waveform.PASSBAND)
    samples = SAMPLE_SCALE * data['scan'][moving][:, None].astype(np.complex128)
    counter = np.arange(int(moving.sum()))
    return subtract_background(PulseBlock(
        radar, False, _nanoseconds(data['scan_time_s'][moving]), counter, samples))


def _around(data) -> np.ndarray:
    """(N,) bool, which poses of the file are around the pulses."""
    time_s = data['mocap_time_s']
    pulse_s = data['scan_time_s'][_moving(data)] + float(data['nominal_time_offset_s'])
    return (time_s > pulse_s[0] - POSES_AROUND_S) & (time_s < pulse_s[-1] + POSES_AROUND_S)


def _poses(data) -> RecordedPoses:
    around = _around(data)
    position_m = np.asarray(data['mocap_pos_m'], float)[around]
    level = np.tile([0.0, 0.0, 0.0, 1.0], (len(position_m), 1))
    return RecordedPoses(_nanoseconds(data['mocap_time_s'][around]), position_m, level)


def read_alignment(folder: Path, kind: str) -> Alignment:
    """Alignment values that came with the recording, ``'nominal'`` or ``'fitted'``.

    The fitted ones were found with the surveyed reflectors; the nominal ones have no lever arm.
    """
    data = _load(Path(folder))
    try:
        if kind == 'nominal':
            arm = np.zeros((1, 3))
            offset, bias = data['nominal_time_offset_s'], data['nominal_range_bias_m']
        else:
            arm = data['fit_lever_arm_m'][None]
            offset, bias = data['fit_time_offset_s'], data['fit_range_bias_m']
    except KeyError as error:
        raise BagError(f'{Path(folder) / FILE} is not the team 6 recording: {error}') from error
    return Alignment(tx_m=arm, rx_m=arm, time_offset_s=float(offset), range_bias_m=float(bias))


def read_reflectors(folder: Path) -> np.ndarray:
    """(2, 3) float64 surveyed positions of the corner reflectors, metres."""
    return np.asarray(_load(Path(folder))['reflector_pos_m'], float)


def read_attitudes(folder: Path) -> np.ndarray:
    """(N, 4) float64 quaternions x, y, z, w at the poses that `read_folder` returns.

    What axes they refer to is not known; imaging does not use them.
    """
    data = _load(Path(folder))
    try:
        return np.asarray(data['mocap_quat_xyzw_raw'], float)[_around(data)]
    except KeyError as error:
        raise BagError(f'{Path(folder) / FILE} is not the team 6 recording: {error}') from error


def estimate_alignment(block: PulseBlock, poses: RecordedPoses,
                       start: Alignment) -> tuple[Alignment, AutofocusReport]:
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

    Returns
    -------
    Alignment, AutofocusReport
        The alignment is `start` where autofocus did not accept what it found. A parameter whose
        uncertainty is as large as `EXPECTED_ERROR` has not been determined.
    """
    track = poses.track()
    located = locate(block, track, start)
    profiles = RangeCompressor.for_block(located)(located)
    report = Autofocus(GRID, n_phases=0, model=lambda pulses: alignment_model(
        pulses, track, start, **EXPECTED_ERROR)).process(profiles).report
    return (aligned(start, report.parameters) if report.accepted else start), report


def team6_truth(block: PulseBlock, reflectors_m: np.ndarray, alignment: Alignment,
                kind: str) -> dict:
    """Truth of the recording: the surveyed reflectors, and the alignment to image with."""
    return make_truth(
        scenario='team6_rail', description='Team 6 rail: UWB radar on a rail, poses of motion '
        f'capture on another clock, {kind} alignment',
        scatterers=[{'name': f'reflector_{i + 1}', 'position_m': place.tolist(),
                     'amplitude_db': 0.0} for i, place in enumerate(reflectors_m)],
        grid=GRID,
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
    p.add_argument('folder', type=Path, help=f'folder with {FILE}')
    p.add_argument('--output', type=Path, default=Path('out/bags/team6_rail'), metavar='FOLDER',
                   help='bag folder to make (default: %(default)s)')
    p.add_argument('--alignment', choices=ALIGNMENTS, default='nominal',
                   help='which values of time offset, range bias and lever arm the nodes shall '
                        'use: nominal, fitted with the survey, or estimated from the image alone '
                        '(default: %(default)s)')
    p.add_argument('--force', action='store_true', help='replace an existing bag')
    return p


def main(argv: Sequence[str] | None = None) -> int:
    """Run the program; returns its exit status."""
    arguments = parser().parse_args(argv)

    def write() -> str:
        check_target(arguments.output, overwrite=arguments.force)
        block, poses = read_folder(arguments.folder)
        if arguments.alignment == 'estimated':
            nominal = read_alignment(arguments.folder, 'nominal')
            alignment, report = estimate_alignment(block, poses, nominal)
            print(f'{report}; {_estimates(report)}')
        else:
            alignment = read_alignment(arguments.folder, arguments.alignment)
        truth = team6_truth(block, read_reflectors(arguments.folder), alignment,
                            arguments.alignment)
        count = write_bag(arguments.output, with_progress(split(block), block.n_pulses), truth,
                          overwrite=arguments.force, poses=poses)
        return (f'{arguments.output}: {block.n_pulses} pulses in {count} messages, '
                f'{len(poses.stamp_ns)} poses, {arguments.alignment} alignment')

    return run_writing(write)


if __name__ == '__main__':
    sys.exit(main())
