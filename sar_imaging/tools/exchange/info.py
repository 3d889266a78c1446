"""Tell what a file holds: when and where it was made, by what radar, how finely, how large.

Run: sar-imaging info scene.cphd
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from ..ending import run_command
from . import summaries
from .kinds import CPHD, GEOTIFF, RECORDING, SICD, kind_of

#: What tells of a file of each kind.
SUMMARIES: dict[str, Callable[[Path], summaries.Summary]] = {
    RECORDING: summaries.of_recording, CPHD: summaries.of_cphd, SICD: summaries.of_sicd,
    GEOTIFF: summaries.of_geotiff}


def parser() -> argparse.ArgumentParser:
    """Command-line parser."""
    p = argparse.ArgumentParser(
        prog='sar-imaging info',
        description='Tell what a recording, a CPHD, SICD or GeoTIFF file holds, on one screen.')
    p.add_argument('file', type=Path, metavar='FILE', help='file, or folder of a recording')
    return p


def main(argv: Sequence[str] | None = None) -> int:
    """Run the program; returns its exit status."""
    path = parser().parse_args(argv).file
    return run_command(lambda: str(SUMMARIES[kind_of(path)](path)))


if __name__ == '__main__':
    sys.exit(main())
