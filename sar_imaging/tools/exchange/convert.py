# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Convert between recordings and files of other programs, such as a recording to CPHD.

Run: sar-imaging convert bags/countryside scene.cphd --datum 47.0 8.0 450.0
"""

from __future__ import annotations

import argparse
import dataclasses
import itertools
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from ...files import naming
from ...formats import read_sicd, write_geotiff
from ...formats.cphd import Collection, CphdError, CphdReader, write_cphd
from ...geometry.antenna import Antenna
from ...geometry.earth import Datum
from ...geometry.grids import MapGrid
from ...geometry.illumination import AntennaPattern
from ...recordings.bag_io import (
    BagError,
    check_target,
    split,
    with_progress,
    write_bag,
)
from ...recordings.kinds import (
    CPHD,
    GEOTIFF,
    RECORDING,
    SICD,
    UnknownKindError,
    kind_of,
    kind_of_target,
)
from ...recordings.recording import Recording, read_recording
from ...recordings.truth import antenna_truth, make_truth
from ...signal.pulses import PulseBlock
from ..arguments import add_datum, datum_of
from ..program import command_parser, main_of

_TOLD = ('collector_name', 'core_name', 'classification', 'release_info', 'mode_type')
_PIXELS_PER_RESOLUTION = 2
_CUT_RESOLUTIONS = 10.0  # half width of cuts through reflectors, in evaluations


def recording_to_cphd(source: Path, target: Path, arguments: argparse.Namespace) -> str:
    """All pulses of a recording as one CPHD file.

    Raises
    ------
    BagError
        The recording cannot be read, or does not state where it was made or what it shows.
    CphdError
        Its pulses are no CPHD.
    """
    recording = read_recording(source)
    datum = datum_of(arguments) or recording.datum
    if datum is None:
        raise BagError(f'{source} does not state where on the Earth its frame stands; add --datum '
                       'LATITUDE LONGITUDE HEIGHT')
    with naming(source, 'cannot be converted', BagError):
        collection = Collection(**(recording.truth or {}).get('collection', {}))
        scene = _scene(arguments, recording)
    if recording.n_unreadable:
        raise BagError(f'{source}: {recording.n_unreadable} of {recording.n_messages} messages '
                       'hold no pulse block')
    blocks, n_pulses = recording.blocks(), len(np.unique(recording.counter))
    first = next(blocks)
    antenna = None if recording.antenna is None else recording.antenna.amplitudes()
    warning = '' if antenna is None or first.pointing is not None else (
        '\nwarning: written without its antenna: pulses do not tell where it looked')
    _write_cphd(source, target, with_progress(itertools.chain([first], blocks), n_pulses),
                arguments, datum, scene, collection, None if warning else antenna)
    return f'{target}: {n_pulses} pulses{warning}'


def cphd_to_recording(source: Path, target: Path, arguments: argparse.Namespace) -> str:
    """All pulses of a CPHD file as a recording of one aperture."""
    check_target(target.resolve(), overwrite=arguments.force)
    with _reader(source, arguments) as reader:
        range_m, across_m = reader.resolution_m
        collection = reader.collection
        truth = make_truth(
            scenario=collection.core_name, description=f'Pulses of {source.name}, CPHD',
            scatterers=[], grid=reader.map_grid(), pulses_per_aperture=reader.n_vectors,
            n_pulses=reader.n_pulses, n_channels=reader.n_channels,
            cut_half_width_m=(_CUT_RESOLUTIONS * range_m, _CUT_RESOLUTIONS * across_m),
            radar=reader.radar, compressed=reader.compressed, notes='; '.join(reader.warnings),
            datum=reader.datum)
        truth['collection'] = dataclasses.asdict(collection)
        truth |= antenna_truth(None if reader.illumination is None
                               else Antenna.of(reader.illumination))
        messages = (message for block in reader.blocks() for message in split(block))
        count = write_bag(target, with_progress(messages, reader.n_pulses), truth,
                          overwrite=arguments.force)
        return _report(target, f'{reader.n_pulses} pulses in {count} messages', reader)


def cphd_to_cphd(source: Path, target: Path, arguments: argparse.Namespace) -> str:
    """A CPHD file of other version, domain, type of samples, or names."""
    with _reader(source, arguments) as reader:
        _write_cphd(source, target, with_progress(reader.blocks(), reader.n_pulses), arguments,
                    reader.datum, reader.map_grid(), reader.collection, reader.illumination)
        return _report(target, f'{reader.n_pulses} pulses', reader)


def sicd_to_geotiff(source: Path, target: Path, arguments: argparse.Namespace) -> str:
    """A complex image on a level plane as the map of its levels, dB."""
    _check_target(target, arguments)
    product = read_sicd(source)
    place = write_geotiff(target, product.image, datum_of(arguments) or product.datum)
    return f'{target}: {product.image.shape[0]} by {product.image.shape[1]} pixels, {place.crs}'


def _write_cphd(source: Path, target: Path, blocks: Iterator[PulseBlock],
                arguments: argparse.Namespace, datum: Datum, scene: MapGrid,
                collection: Collection, antenna: AntennaPattern | None) -> None:
    _check_target(target, arguments)
    with naming(source, 'cannot be written as CPHD', CphdError):
        write_cphd(target, blocks, datum, scene, collection=_named(collection, arguments),
                   domain=arguments.domain, sample_type=arguments.sample_type, antenna=antenna,
                   overwrite=arguments.force)


def _check_target(target: Path, arguments: argparse.Namespace) -> None:
    if target.exists() and not arguments.force:
        raise BagError(f'{target} exists already; choose another path or add --force')


def _reader(source: Path, arguments: argparse.Namespace) -> CphdReader:
    return CphdReader(source, datum=datum_of(arguments), channels=arguments.channels)


def _report(target: Path, text: str, reader: CphdReader) -> str:
    return '\n'.join([f'{target}: {text}', *(f'warning: {w}' for w in reader.warnings)])


def _named(collection: Collection, arguments: argparse.Namespace) -> Collection:
    given = {name: getattr(arguments, name) for name in _TOLD}
    return dataclasses.replace(collection, **{k: v for k, v in given.items() if v is not None})


def _scene(arguments: argparse.Namespace, recording: Recording) -> MapGrid:
    if arguments.scene is not None:
        x, y, z, width, height = arguments.scene
        spacing = recording.radar.range_resolution_m / _PIXELS_PER_RESOLUTION
        return MapGrid.from_size((x, y, z), width, height, spacing)
    if recording.grid is None:
        raise BagError(f'{recording.path} does not state what it shows; add --scene X Y Z WIDTH '
                       'HEIGHT')
    return recording.grid


#: What each pair of kinds is converted by: called with both paths and the arguments, returns what
#: was written, as a line for people.
CONVERSIONS: dict[tuple[str, str], Callable[[Path, Path, argparse.Namespace], str]] = {
    (RECORDING, CPHD): recording_to_cphd,
    (CPHD, RECORDING): cphd_to_recording,
    (CPHD, CPHD): cphd_to_cphd,
    (SICD, GEOTIFF): sicd_to_geotiff,
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
    p = command_parser('sar-imaging convert', _DESCRIPTION)
    p.add_argument('file', type=Path, metavar='FILE', help='file, or folder of a recording')
    p.add_argument('target', type=Path, metavar='TARGET', help='file or folder to make')
    p.add_argument('--force', action='store_true', help='replace an existing file or recording')
    add_datum(p)
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


main = main_of(parser, run)

if __name__ == '__main__':
    sys.exit(main())
