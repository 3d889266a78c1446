# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Find a recording in a reference map: by how much its poses are wrong, and how surely.

Run: sar-imaging locate recording MAP --output out/where
"""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from ...exploitation.localization import farthest, nearest
from ...exploitation.registration import (
    LookDirection,
    Registration,
    measured_resolution_m,
    register,
)
from ...files import filling, write_json
from ...formats.reference_map import read_reference_map
from ...recordings.pulse_source import SourceError, open_pulses
from ..arguments import add_pulses, datum_of, memory_bytes
from ..program import command_parser, main_of
from . import forming

_EPILOG = """\
Writes location.json: translation and rotation that take the poses of the recording into the frame
of the map, their covariance, the probability of a false match; or why it is not known.
Provisional: later versions may write another file.

  sar-imaging map monday --output out/place
  sar-imaging locate tuesday out/place --output out/where
"""


def parser() -> argparse.ArgumentParser:
    """Command-line parser."""
    p = command_parser('sar-imaging locate', 'Find a recording in a reference map.', _EPILOG)
    add_pulses(p)
    p.add_argument('map', type=Path, help='folder that sar-imaging map wrote')
    p.add_argument('--search', type=float, default=30.0, metavar='M',
                   help='farthest translation, metres (default: %(default)g)')
    p.add_argument('--rotation', type=float, default=5.0, metavar='DEG',
                   help='greatest rotation, degrees (default: %(default)g)')
    p.add_argument('--heights', type=float, default=2.0, metavar='M',
                   help='root mean square of heights over the ground (default: %(default)g)')
    forming.add_arguments(p)
    return p


def run(arguments: argparse.Namespace) -> str:
    """Image the recording, look for it and write the answer; returns a summary for people."""
    if arguments.plane != 'ground':
        raise SourceError('maps lie on the ground: leave out --plane slant')
    reference = read_reference_map(arguments.map)
    source = forming.weighted(open_pulses(arguments.file, aperture=arguments.aperture,
                                          datum=datum_of(arguments)))
    if None not in (source.datum, reference.datum) and source.datum != reference.datum:
        raise SourceError(f'{source.path} stands at {source.datum}, the map at {reference.datum}; '
                          'expected one frame')
    choice = forming.choose(source, arguments)
    image, _ = forming.form(source, choice, arguments.target_db, memory_bytes(arguments))
    radar_m, cell_m = source.track_m.mean(axis=0), measured_resolution_m(image)
    look = LookDirection.between(choice.grid.centre_m, radar_m)
    found = register(image, reference.image, search_m=arguments.search,
                     search_deg=arguments.rotation, look=look,
                     reference_look=farthest((one.look for one in reference.passes), look),
                     speckle=nearest(reference.speckle, choice.grid.centre_m, radar_m, cell_m),
                     resolution_m=cell_m, height_std_m=arguments.heights)
    with filling(arguments.output) as folder:
        write_json(folder / 'location.json', describe(found))
    return f'{found}\nwritten to {arguments.output}: location.json'


def describe(found: Registration) -> dict[str, Any]:
    """Contents of location.json."""
    def numbers(values: Iterable[float]) -> list[float | None]:
        return [float(v) if math.isfinite(v) else None for v in values]

    return {'accepted': found.accepted, 'refusal': found.refusal,
            'translation_m': numbers(found.translation_m),
            'rotation_rad': numbers([found.rotation_rad])[0],
            'pivot_m': numbers(found.pivot_m),
            'covariance': [numbers(row) for row in found.covariance],
            'false_match_probability': found.false_match_probability, 'overlap': found.overlap,
            'coherence': found.coherence,
            'candidates': [{'translation_m': list(c.translation_m),
                            'rotation_rad': c.rotation_rad, 'overlap': c.overlap,
                            'chance': c.chance} for c in found.candidates]}


main = main_of(parser, run, quiet=True)

if __name__ == '__main__':
    sys.exit(main())
