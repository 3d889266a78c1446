# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Look at raw pulses and say what is wrong with them: samples, times, channels, geometry.

Run: sar-imaging doctor bags/countryside --output out/doctor
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import sys
from collections.abc import Sequence
from pathlib import Path

from scipy.spatial.transform import Rotation

from sar_imaging.diagnosis.doctor import Examination, examine
from sar_imaging.diagnosis.signals import Finding
from sar_imaging.files import filling
from sar_imaging.geometry.grids import MapGrid
from sar_imaging.geometry.poses import PoseStatus
from sar_imaging.signal.pulses import PulseBlock

from ...recordings.bag_io import BagError, read_blocks
from ...recordings.kinds import CPHD, RECORDING, kind_of
from ...recordings.pulse_source import PulseSource, SourceError, joined, open_pulses
from ..arguments import add_pulses, memory_bytes
from ..program import command_parser, main_of
from . import forming
from .figures import save_signal_png

_MOST_BYTES = 512e6  # of samples that are looked at
_FAULTY, _UNTOLD = 3, 4  # exit status

_EPILOG = """\
Writes signals.png and doctor.json. Each finding says what was measured, what else would explain
it, and how sure it is. Exit status:

  0  nothing wrong was found
  3  something wrong was found
  4  nothing wrong was found, but the recording cannot tell: no image was looked at, nothing stands
     out in it (clutter alone, an empty scene), or another geometry gives a sharper one
  1  the file could not be looked at

  sar-imaging doctor my_recording --output out/doctor
  sar-imaging doctor scene.cphd --output out/doctor --centre 0 7 0 --size 6
"""


def parser() -> argparse.ArgumentParser:
    """Command-line parser."""
    p = command_parser('sar-imaging doctor', 'Say what is wrong with a recording of pulses.',
                       _EPILOG)
    add_pulses(p)
    p.add_argument('--output', type=Path, metavar='FOLDER',
                   help='folder for picture and findings, made when missing (default: none)')
    forming.add_scene_arguments(p)
    p.set_defaults(plane='ground')
    return p


def run(arguments: argparse.Namespace) -> int:
    """Examine the file, print and write what was found; returns the exit status."""
    source, block, grid, notes = read_pulses(arguments)
    if source is None:
        examination = examine(block, None)
    else:
        examination = examine(block, grid, window=source.proposed_window,
                              attitude=_attitude(source, block))
    of_cphd = source is not None and source.kind == CPHD
    findings = (*notes, *map(_of_cphd if of_cphd else lambda f: f, examination.findings))
    print(describe(block, findings, examination, grid))
    if arguments.output is not None:
        with filling(arguments.output) as folder:
            save_signal_png(folder / 'signals.png', block, title=f'{arguments.file.name}: ' + (
                ', '.join(f.fault for f in findings) or 'nothing wrong found'))
            (folder / 'doctor.json').write_text(json.dumps({
                'file': str(arguments.file), 'pulses': block.n_pulses,
                'channels': block.n_channels, 'samples': block.n_samples,
                'raw': not block.compressed, 'findings': [vars(found) for found in findings],
                'untold': examination.untold,
                'undecided': examination.diagnosis.undecided if examination.diagnosis else [],
                'focus': None if examination.diagnosis is None else
                round(examination.diagnosis.coherence, 3)}, indent=2) + '\n')
        print(f'written to {arguments.output}: signals.png, doctor.json')
    return _FAULTY if findings else _UNTOLD if examination.untold else 0


def read_pulses(arguments: argparse.Namespace) -> tuple[
        PulseSource | None, PulseBlock, MapGrid | None, tuple[Finding, ...]]:
    """Source of pulses with positions, pulses, the scene, and what prevents an image."""
    try:
        source = open_pulses(arguments.file, aperture=arguments.aperture)
    except (BagError, SourceError) as error:
        if not arguments.file.exists() or kind_of(arguments.file) != RECORDING:
            raise
        blocks = joined(read_blocks(arguments.file), _bytes(arguments))
        return (None, next(blocks), None,
                (Finding('no positions', str(error), 'record odometry with the pulses, or the '
                         'phase centres in them; without them nothing can be imaged'),))
    n_bytes = _bytes(arguments)
    block = next(joined(source.blocks(n_bytes), n_bytes))
    asked = arguments.centre is not None or arguments.size is not None
    if source.grid is not None and not asked:
        return source, block, source.grid, ()
    try:
        return source, block, forming.choose(source, arguments).grid, ()
    except (SourceError, ValueError) as error:
        print(f'the image is not looked at: {error}', file=sys.stderr)
        return source, block, None, ()


def _of_cphd(finding: Finding) -> Finding:
    """The same with what can be done about pulses that a CPHD file leaves out."""
    if finding.fault not in ('lost pulses', 'incomplete pulses'):
        return finding
    return dataclasses.replace(finding, advice='the file flags these vectors (SIGNAL) or does not '
                               'tell where they were sent; images take gaps into account, but '
                               'their sidelobes rise')


def _bytes(arguments: argparse.Namespace) -> float:
    # profiles are made of them several times, more finely sampled
    return min(_MOST_BYTES, memory_bytes(arguments) / 16)


def _attitude(source: PulseSource, block: PulseBlock) -> Rotation | None:
    """Attitude of the platform at each pulse, where poses are recorded around all of them."""
    if source.poses is None:
        return None
    offset_ns = 0 if source.alignment is None else source.alignment.time_offset_ns
    found = source.poses.sample(block.stamp_ns + offset_ns, final=True)
    return found.attitude if (found.status == PoseStatus.READY).all() else None


def describe(block: PulseBlock, findings: Sequence[Finding], examination: Examination,
             grid: MapGrid | None) -> str:
    """What a person reads."""
    looked = ['times and channels' if block.compressed else 'samples, times and channels']
    if examination.diagnosis is not None:
        looked.append(f'focus of the image (figure {examination.diagnosis.coherence:.2f})')
    channels = f'{block.n_channels} channel{"s" if block.n_channels > 1 else ""}'
    lines = [f'{block.n_pulses} pulses, {channels}, {block.n_samples} samples: '
             f'looked at {" and ".join(looked)}']
    if block.compressed:
        lines.append('these are range profiles: clipping and errors of I and Q show in raw '
                     'samples alone')
    if not block.has_positions:
        lines.append('without positions the image is not looked at')
    elif grid is None:
        lines.append('without a scene the image is not looked at: give --centre X Y Z and --size')
    lines += [f'- {finding}' for finding in findings]
    if examination.diagnosis is not None and examination.diagnosis.undecided:
        lines.append('no image of this aperture tells: '
                     f'{", ".join(examination.diagnosis.undecided)} (with it the scene is '
                     'mirrored, moved, scaled or shown at another height, and as much '
                     'in focus)')
    if not findings:
        lines.append('nothing wrong was found' if not examination.untold else
                     f'this recording cannot tell: {"; ".join(examination.untold)}')
    return '\n'.join(lines)


main = main_of(parser, run, quiet=True)

if __name__ == '__main__':
    sys.exit(main())
