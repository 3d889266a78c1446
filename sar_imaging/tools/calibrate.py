# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Estimate the channel calibration of a radar from a recording and save it as YAML.

Run: python -m sar_imaging.tools.calibrate BAG --reflector 12.0 3.0 0.0 --output channels.yaml
     python -m sar_imaging.tools.calibrate BAG --output channels.yaml      (over the scene)
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from sar_imaging.exploitation.calibration import (
    balance_channels,
    calibrate_at_reflector,
    find_reflector,
)
from sar_imaging.geometry.grids import MapGrid
from sar_imaging.signal.calibration import ChannelCalibration
from sar_imaging.signal.pulses import PulseBlock, concatenate
from sar_imaging.signal.range_compression import RangeCompressor

from ..recordings import open_pulses
from .program import command_parser, main_of

MOST_PIXELS = 200_000  # of the scene to balance over; coarser pixels above

_EPILOG = """\
The file goes to the parameter calibration_file of range_compression, or into RangeCompressor and
plan_image. Phases are in degrees at the carrier, delays in seconds; all are relative to the
mean of the channels. Exit status: 0 when the file was written, 1 with a reason when not.
"""


class CalibrationFailed(RuntimeError):
    """A calibration cannot be estimated from this recording."""


def calibrate(block: PulseBlock, grid: MapGrid, *, reflector_m: ArrayLike | None = None,
              find: bool = False, delays: bool = True) -> tuple[ChannelCalibration, str]:
    """Estimate the errors of the channels of one aperture.

    Parameters
    ----------
    block : PulseBlock
        Raw or compressed pulses with phase centres.
    grid : MapGrid
        The scene.
    reflector_m : (3,) array_like, optional
        Place of a strong reflector, metres.
    find : bool
        Look for the strongest reflector on the grid.
    delays : bool
        False leaves delays at zero: right where they are smaller than a tenth of a cell, the
        scatter of an estimate from a poor scene.

    Returns
    -------
    ChannelCalibration
    str
        How it was estimated, for people.

    Raises
    ------
    CalibrationFailed
        The block has no phase centres, or one channel.
    ValueError
        There is no echo, or none near the place given.
    """
    if not block.has_positions:
        raise CalibrationFailed('the recording has pulses without phase centres; place them first')
    if block.n_channels < 2:
        raise CalibrationFailed('the recording has one channel: nothing to calibrate')
    profiles = RangeCompressor.for_block(block, window='hamming')(block)
    points = _pixels(grid)
    if find:
        reflector_m = find_reflector(profiles, points)
    if reflector_m is not None:
        calibration = calibrate_at_reflector(profiles, reflector_m)
        how = 'reflector at ({:.3f}, {:.3f}, {:.3f}) m'.format(*np.asarray(reflector_m))
    else:
        result = balance_channels(profiles, points)
        calibration = result.calibration
        how = (f'balanced over the scene by {result.method}, coherence {result.coherence:.2f}, '
               f'brightest pixel {result.peak_gain_db:+.2f} dB')
    if not delays:
        calibration = ChannelCalibration(calibration.amplitude, calibration.phase_rad,
                                         np.zeros(calibration.n_channels))
    return calibration, how


def _pixels(grid: MapGrid) -> np.ndarray:
    """(n_y, n_x, 3) positions of the grid, thinned out to `MOST_PIXELS`."""
    step = max(1, int(np.ceil(np.sqrt(grid.n_x * grid.n_y / MOST_PIXELS))))
    return grid.points()[::step, ::step]


def parser() -> argparse.ArgumentParser:
    """Command-line parser."""
    p = command_parser('calibrate', 'Estimate amplitude, phase and delay of the channels of a '
                       'recording, at a strong reflector or balanced over the scene of its truth.',
                       _EPILOG)
    p.add_argument('bag', type=Path, help='folder of a recording (rosbag2), or description')
    p.add_argument('--output', type=Path, required=True, metavar='FILE', help='YAML file to write')
    source = p.add_mutually_exclusive_group()
    source.add_argument('--reflector', type=float, nargs=3, metavar=('X', 'Y', 'Z'),
                        help='place of a strong reflector, metres')
    source.add_argument('--find-reflector', action='store_true',
                        help='use the strongest reflector of the scene')
    p.add_argument('--no-delays', action='store_true', help='amplitudes and phases only')
    p.add_argument('--aperture', type=int, default=0, metavar='N',
                   help='number of the aperture to use (default: %(default)s)')
    return p


def run(arguments: argparse.Namespace) -> str:
    """Estimate and write the calibration; returns a summary for people."""
    block, grid = _read(arguments.bag, arguments.aperture)
    calibration, how = calibrate(block, grid, reflector_m=arguments.reflector,
                                 find=arguments.find_reflector, delays=not arguments.no_delays)
    calibration.save(arguments.output)
    cells = calibration.delay_s * block.radar.bandwidth_hz
    return '\n'.join([how, *(
        f'channel {number}: amplitude {g:.3f}, phase {phase:+.1f} degrees, delay {late:+.3f} '
        'resolution cells' for number, (g, phase, late) in enumerate(zip(
            calibration.amplitude, np.degrees(calibration.phase_rad), cells, strict=True))),
        f'written: {arguments.output}'])


def _read(path: Path, aperture: int) -> tuple[PulseBlock, MapGrid]:
    """Pulses of one aperture of a recording, and the grid that it proposes."""
    source = open_pulses(path, aperture=aperture)
    if source.grid is None:
        raise CalibrationFailed(f'{path} proposes no grid, whose pixels calibration works with')
    return concatenate(list(source.blocks())), source.grid


main = main_of(parser, run)

if __name__ == '__main__':
    sys.exit(main())
