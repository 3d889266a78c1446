"""Convert between recordings and files of other programs, such as a recording to CPHD.

Run: sar-imaging convert bags/countryside scene.cphd --datum 47.0 8.0 450.0
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from ..ending import run_command
from . import conversions
from .kinds import CPHD, GEOTIFF, RECORDING, SICD, UnknownKindError, kind_of, kind_of_target

#: What each pair of kinds is converted by: called with both paths and the arguments, returns what
#: was written, as a line for people.
CONVERSIONS: dict[tuple[str, str], Callable[[Path, Path, argparse.Namespace], str]] = {
    (RECORDING, CPHD): conversions.recording_to_cphd,
    (CPHD, RECORDING): conversions.cphd_to_recording,
    (CPHD, CPHD): conversions.cphd_to_cphd,
    (SICD, GEOTIFF): conversions.sicd_to_geotiff,
}

_DESCRIPTION = """\
Convert FILE to TARGET. The kind of FILE is seen from its content, that of TARGET from the end of
its name: .cphd, .tif, or none for the folder of a recording.
"""


def run(arguments: argparse.Namespace) -> str:
    """Convert as the arguments say; returns a line about what was written.

    Raises
    ------
    UnknownKindError
        There is no conversion between the two kinds.
    """
    kinds = kind_of(arguments.file), kind_of_target(arguments.target)
    convert = CONVERSIONS.get(kinds)
    if convert is None:
        known = ', '.join(f'{a} to {b}' for a, b in CONVERSIONS)
        raise UnknownKindError(f'{arguments.file} is {kinds[0]}, which cannot be converted to '
                               f'{kinds[1]}; these can: {known}')
    return convert(arguments.file, arguments.target, arguments)


def parser() -> argparse.ArgumentParser:
    """Command-line parser."""
    p = argparse.ArgumentParser(prog='sar-imaging convert', description=_DESCRIPTION,
                                formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument('file', type=Path, metavar='FILE', help='file, or folder of a recording')
    p.add_argument('target', type=Path, metavar='TARGET', help='file or folder to make')
    p.add_argument('--force', action='store_true', help='replace an existing file or recording')
    p.add_argument('--datum', type=float, nargs='+', metavar='NUMBER',
                   help='latitude and longitude in degrees, ellipsoidal height in metres and, '
                        'optionally, heading of the frame in degrees: where its origin stands, '
                        'instead of what FILE tells')
    p.add_argument('--channels', nargs='+', metavar='NAME',
                   help='channels of a CPHD file; all of them by default')
    written = p.add_argument_group('CPHD files that are written')
    written.add_argument('--domain', choices=('FX', 'TOA'),
                         help='phase histories (FX) or range profiles (TOA); by default as the '
                              'pulses are')
    written.add_argument('--sample-type', choices=('CF8', 'CI4', 'CI2'), default='CF8',
                         help='floats, or integers of 16 or 8 bits (default: %(default)s)')
    for name, text in (('collector-name', 'of the sensor'), ('core-name', 'of the collection'),
                       ('classification', 'marking'), ('release-info', 'marking'),
                       ('mode-type', 'SPOTLIGHT, STRIPMAP or DYNAMIC STRIPMAP')):
        written.add_argument(f'--{name}', metavar='TEXT', help=text)
    written.add_argument('--scene', type=float, nargs=5,
                         metavar=('X', 'Y', 'Z', 'WIDTH', 'HEIGHT'),
                         help='middle and size of the area to image, metres, instead of what a '
                              'recording tells')
    return p


def main(argv: Sequence[str] | None = None) -> int:
    """Run the program; returns its exit status."""
    arguments = parser().parse_args(argv)
    return run_command(lambda: run(arguments))


if __name__ == '__main__':
    sys.exit(main())
