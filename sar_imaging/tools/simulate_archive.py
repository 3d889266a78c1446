# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Simulate an archive: recordings of a strip of ground, some of them broken, with its truth.

Run: sar-imaging simulate archive --output out/archive
"""

from __future__ import annotations

import argparse
import dataclasses
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from sar_imaging.files import replacing
from sar_imaging.formats.cphd import Collection, write_cphd
from sar_imaging.geometry.earth import Datum
from sar_imaging.signal.pulses import PulseBlock
from sar_imaging.simulation.survey import Survey, SurveyRecording

from ..recordings.bag_io import BagError, write_bag
from ..recordings.truth import make_truth
from .program import command_parser, main_of

TRUTH_FILE = 'archive.json'
FORMATS = ('bag', 'cphd')
BROKEN = ('truncated', 'no-poses', 'empty', 'foreign')
_MESSAGE_BYTES = 1e6

_EPILOG = """\
Writes FOLDER/flight-0000 and so on, and FOLDER/archive.json: the survey's frame, its reflectors
in that frame and on the Earth, and which recordings are broken, and how:

  truncated  the second half of its samples is cut off
  no-poses   its pulses have no phase centres
  empty      a folder or file without anything
  foreign    another kind of file

The same command gives the same bytes on every machine.

  sar-imaging simulate archive --output out/archive
  sar-imaging simulate archive --output out/large --recordings 16 --lines 4 --pixels 10240 \\
      --overlap 0.2 --reflectors 20 --clutter 0 --broken 0
"""


def write_archive(survey: Survey, folder: Path, *, file_format: str = 'bag', broken: int = 0,
                  progress: bool = False) -> dict[str, Any]:
    """Write the recordings of a survey.

    Samples are simulated and written message by message.

    Parameters
    ----------
    survey : Survey
        What was flown.
    folder : Path
        To make.
    file_format : {'bag', 'cphd'}
        File format of the recordings.
    broken : int
        How many of them are broken, each kind in turn; never the first one.
    progress : bool
        Show progress on standard error.

    Returns
    -------
    dict
        What ``archive.json`` holds.

    Raises
    ------
    BagError
        The folder exists and is not empty, or more is to be broken than there is.

    Examples
    --------
    >>> from pathlib import Path
    >>> from sar_imaging.simulation.survey import Survey
    >>> from sar_imaging.tools.simulate_archive import write_archive
    >>> truth = write_archive(Survey(n_recordings=2, pixels=32), Path('flights'))
    >>> sorted(path.name for path in Path('flights').iterdir())
    ['archive.json', 'flight-0000', 'flight-0001']
    """
    if folder.exists() and any(folder.iterdir()):
        raise BagError(f'{folder} exists and is not empty; choose another folder')
    if not 0 <= broken < survey.n_recordings:
        raise BagError(f'broken={broken}; expected less than the {survey.n_recordings} recordings '
                       'and at least 0')
    how = _broken(survey.n_recordings, broken)
    folder.mkdir(parents=True, exist_ok=True)
    recordings = []
    for recording in tqdm(survey.recordings(), total=survey.n_recordings, unit='recording',
                          disable=not progress):
        name = recording.name + ('.cphd' if file_format == 'cphd' else '')
        state = how.get(recording.number, '')
        _write(recording, folder / name, file_format, state)
        recordings.append({'name': name, 'broken': state, 'pass': recording.flown,
                           'line': recording.line, 'along': recording.along,
                           'datum': dataclasses.asdict(recording.datum)})
    points = survey.reflectors_m()
    truth = {'survey': dataclasses.asdict(survey), 'recordings': recordings,
             'reflectors_m': points.tolist(),
             'reflectors_geographic': np.stack(survey.datum.to_geographic(points), 1).tolist()}
    (folder / TRUTH_FILE).write_text(json.dumps(truth, indent=1) + '\n')
    return truth


def _broken(n_recordings: int, n: int) -> dict[int, str]:
    """Numbers of the broken recordings, evenly spread, and how they are broken."""
    numbers = [1 + (2 * i + 1) * (n_recordings - 1) // (2 * n) for i in range(n)]
    return {number: BROKEN[i % len(BROKEN)] for i, number in enumerate(numbers)}


def _write(recording: SurveyRecording, path: Path, file_format: str, state: str) -> None:
    if state == 'foreign':
        path.write_text('This is no recording.\n')
    elif state == 'empty':
        path.touch() if file_format == 'cphd' else path.mkdir()
    elif file_format == 'cphd':
        write_cphd(path, _blocks(recording), recording.datum, recording.grid,
                   collection=Collection(collector_name='SIMULATED', core_name=recording.name))
        if state == 'truncated':
            _cut(path)
        elif state == 'no-poses':  # CPHD cannot be without; all of them are not a number
            _without_positions(path)
    else:
        blocks = _blocks(recording)
        if state == 'no-poses':
            blocks = (dataclasses.replace(b, tx_m=None, rx_m=None) for b in blocks)
        write_bag(path, blocks, _truth(recording))
        if state == 'truncated':
            _cut(next(path.glob('*.mcap')))


def _cut(path: Path) -> None:
    """Leave the first half of a file."""
    with open(path, 'r+b') as file:
        file.truncate(path.stat().st_size // 2)


def _without_positions(path: Path) -> None:
    """Overwrite the parameters of all vectors of a CPHD file with what is no number."""
    with open(path, 'r+b') as file:
        header = file.read(2000).split(b'\n')
        fields = dict(line.split(b' := ') for line in header if b' := ' in line)
        file.seek(int(fields[b'PVP_BLOCK_BYTE_OFFSET']))
        file.write(b'\xff' * int(fields[b'PVP_BLOCK_SIZE']))


def _blocks(recording: SurveyRecording) -> Iterator[PulseBlock]:
    survey = recording.survey
    pulse_bytes = 8 * survey.n_channels * survey.n_samples
    return recording.blocks(max(1, int(_MESSAGE_BYTES // pulse_bytes)))


def _truth(recording: SurveyRecording) -> dict[str, Any]:
    survey = recording.survey
    half = 8 * survey.spacing_m
    return make_truth(
        scenario=recording.name, description=f'Recording {recording.number} of a survey',
        scatterers=[{'name': s.name, 'position_m': list(s.position_m),
                     'amplitude_db': round(s.amplitude_db, 9)} for s in recording.reflectors()],
        grid=recording.grid, pulses_per_aperture=survey.pulses_per_aperture,
        n_pulses=survey.pulses_per_aperture * survey.apertures, n_channels=survey.n_channels,
        cut_half_width_m=(half, half), radar=survey.radar, compressed=True,
        datum=recording.datum, notes='Invented; looks along +x, flies along +y')


def parser() -> argparse.ArgumentParser:
    """Command-line parser."""
    p = command_parser('sar-imaging simulate archive', 'Simulate an archive of recordings.',
                       _EPILOG)
    default = Survey()
    p.add_argument('--output', type=Path, required=True, metavar='FOLDER', help='to make')
    p.add_argument('--format', choices=FORMATS, default=FORMATS[0],
                   help='of the recordings (default: %(default)s)')
    for option, name, text in (
            ('--recordings', 'n_recordings', 'recordings, all passes together'),
            ('--apertures', 'apertures', 'apertures of a recording'),
            ('--lines', 'lines', 'parallel lines of flight'),
            ('--passes', 'passes', 'times that the ground is flown over'),
            ('--channels', 'n_channels', 'channels of the radar'),
            ('--pixels', 'pixels', 'sides of the square of an aperture'),
            ('--spacing', 'spacing_m', 'of the pixels, metres; the resolution is two of them'),
            ('--overlap', 'overlap', 'of neighbouring squares, as a share of their sides'),
            ('--reflectors', 'reflectors', 'in a cell of the ground'),
            ('--clutter', 'clutter', 'weaker scatterers in a cell of the ground'),
            ('--seed', 'seed', 'of ground and noise')):
        value = getattr(default, name)
        p.add_argument(option, dest=name, type=type(value), default=value, metavar='N',
                       help=f'{text} (default: {value})')
    p.add_argument('--datum', type=float, nargs=3, metavar='N',
                   default=(default.datum.latitude_deg, default.datum.longitude_deg,
                            default.datum.height_m),
                   help='latitude, longitude and height of the middle of the first square '
                        '(default: %(default)s)')
    p.add_argument('--surface', choices=('plane', 'ellipsoid'), default=default.surface,
                   help='the ground: the plane through the first square or the rounded Earth '
                        '(default: %(default)s)')
    p.add_argument('--broken', type=int, metavar='N',
                   help='broken recordings (default: 4 of 100)')
    p.add_argument('--force', action='store_true', help='replace an archive simulated before')
    return p


def _run(arguments: argparse.Namespace) -> str:
    names = {field.name for field in dataclasses.fields(Survey)} - {'datum'}
    survey = Survey(datum=Datum(*arguments.datum),
                    **{name: getattr(arguments, name) for name in names})
    broken = survey.n_recordings // 25 if arguments.broken is None else arguments.broken
    folder = arguments.output
    replaced = arguments.force and (folder / TRUTH_FILE).is_file() and all(
        part.name.startswith('flight-') or part.name == TRUTH_FILE for part in folder.iterdir())
    if not replaced and folder.exists() and any(folder.iterdir()):
        raise BagError(f'{folder} exists and is not empty; choose another folder'
                       + ('; it holds more than an archive' if arguments.force else ''))
    folder.parent.mkdir(parents=True, exist_ok=True)
    with replacing(folder, folder=True) as part:
        truth = write_archive(survey, part, file_format=arguments.format, broken=broken,
                              progress=sys.stderr.isatty())
    return (f'{folder}: {survey.n_recordings} recordings, {broken} of them broken, of '
            f'{survey.pixels} by {survey.pixels} pixels of {survey.spacing_m:g} m for each of '
            f'{survey.apertures} aperture(s); {survey.n_bytes / 1e6:.3g} MB of samples, '
            f'{len(truth["reflectors_m"])} reflectors')


main = main_of(parser, _run)

if __name__ == '__main__':
    sys.exit(main())
