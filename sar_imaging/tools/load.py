# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Turn measured data and their description in YAML into a recording.

Run: sar-imaging load DESCRIPTION [DATA] --output out/bags/mine
"""

from __future__ import annotations

import argparse
import dataclasses
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import yaml

from ..autofocus.autofocus import Autofocus, AutofocusReport
from ..autofocus.models import aligned, alignment_model
from ..diagnosis.hypotheses import distances, reach_advice
from ..files import naming
from ..geometry.alignment import Alignment
from ..geometry.grids import MapGrid
from ..geometry.illumination import AntennaPattern, Illumination
from ..geometry.poses import PoseTable
from ..recordings import DescriptionError, Loaded, load, shipped_names
from ..recordings.arrays import truth_of
from ..recordings.bag_io import check_target, split, with_progress, write_bag
from ..signal.positioning import locate
from ..signal.pulses import PulseBlock
from ..signal.range_compression import RangeCompressor
from ..yaml_text import load_yaml
from .program import command_parser, main_of

# What the alignment may be wrong by
EXPECTED_ERROR = {'time_offset_s': 0.05, 'range_bias_m': 0.2}


def estimate_alignment(block: PulseBlock, poses: PoseTable, start: Alignment,
                       grid: MapGrid) -> tuple[Alignment, AutofocusReport]:
    """Time offset and range bias from the image alone, beginning with `start`.

    A platform that does not turn shows the same image, displaced, with any lever arm: that stays
    as it is.

    Parameters
    ----------
    block : PulseBlock
        Raw pulses without positions.
    poses : PoseTable
        Poses of the platform.
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
    located = locate(block, poses, start)
    profiles = RangeCompressor.for_block(located)(located)
    report = Autofocus(grid, n_phases=0, model=lambda pulses: alignment_model(
        pulses, poses, start, **EXPECTED_ERROR)).process(profiles).report
    return (aligned(start, report.parameters) if report.accepted else start), report


def describe(report: AutofocusReport) -> str:
    """What autofocus found, and which parameter the image does not determine."""
    found = ', '.join(
        f'{name} {value:.4f}' + (' (not determined by the image)'
                                 if report.uncertainty[name] > 0.5 * EXPECTED_ERROR[name] else '')
        for name, value in report.parameters.items())
    return f'{report}; {found}'


_LOOKED_AT = 64  # pulses, spread over all
_SIDE = 9  # places along each side of the map
_DEGREES_M = 0.05  # places of degrees differ by less over a track of some kilometres


def told_of_scene(loaded: Loaded) -> tuple[str, ...]:
    """Warnings: positions that hardly differ, a scene out of reach or never lit.

    Parameters
    ----------
    loaded : Loaded
        Pulses with positions or poses.
    """
    some = loaded.block.select(slice(None, None, -(-loaded.block.n_pulses // _LOOKED_AT)))
    told: tuple[str, ...] = ()
    if loaded.poses is not None:
        some, told = _located(some, loaded)
    told += _still(some) + _out_of_reach(some, loaded.scene.grid)
    if told or loaded.antenna is None:
        return told
    return _dark(some, loaded.scene.grid, loaded.antenna.amplitudes())


def _located(block: PulseBlock, loaded: Loaded) -> tuple[PulseBlock, tuple[str, ...]]:
    """The pulses where poses say that they are, and what keeps poses from being used."""
    poses, alignment = loaded.poses, loaded.alignment
    try:
        return locate(block, poses, alignment, loaded.mount), ()
    except ValueError as error:
        told = () if loaded.warnings else (
            f'images need other poses: {error}; check their unit (unit_m), rate and outliers',)
    time_ns = poses.stamp_ns - poses.stamp_ns[0]  # which float64 holds
    at = block.stamp_ns + alignment.time_offset_ns - poses.stamp_ns[0]
    place = np.stack([np.interp(at, time_ns, axis) for axis in poses.position_m.T], axis=-1)
    place = np.repeat(place[:, None], block.n_channels, axis=1)
    return dataclasses.replace(block, tx_m=place, rx_m=place), told


def _still(block: PulseBlock) -> tuple[str, ...]:
    centre = (0.5 * np.add(*block.centres_m)).reshape(-1, 3)
    extent_m, mean = float(np.linalg.norm(np.ptp(centre, axis=0))), centre.mean(axis=0)
    wavelength_m = block.radar.wavelength_m
    if block.n_pulses < 2 or extent_m > wavelength_m / 2:
        return ()
    degrees = 0 < extent_m < _DEGREES_M and (np.abs(mean[:2]) > 1).all() and abs(mean[0]) <= 180
    return (f'all positions lie within {extent_m:.3g} m, less than half of the wavelength of '
            f'{wavelength_m:.3g} m: nothing is resolved across the line of sight; '
            + (f'{mean[0]:.4f} and {mean[1]:.4f} may be degrees of latitude and longitude, which '
               'have to be converted to metres east and north' if degrees else
               'expected positions in metres of an antenna that moves'),)


def _out_of_reach(block: PulseBlock, grid: MapGrid) -> tuple[str, ...]:
    radar, n = block.radar, block.n_samples
    if not block.compressed:
        compressor = RangeCompressor.for_block(block.select(slice(0, 1)))
        radar, n = compressor.output_radar, compressor.n_output
    start_m = radar.range_start_m
    stop_m = start_m + n * radar.sample_spacing_m
    near_m, far_m = distances(block, grid)
    if near_m < stop_m and far_m > start_m:
        return ()
    profiles = dataclasses.replace(
        block, radar=radar, compressed=True,
        samples=np.zeros((*block.samples.shape[:2], n), np.complex64))
    advice = reach_advice(profiles, grid)
    return (f'the scene lies {near_m:.4g} to {far_m:.4g} m from the radar, whose samples hold '
            f'ranges from {start_m:.4g} to {stop_m:.4g} m: its image would be empty. '
            + (f'{advice[0].upper()}{advice[1:]}. ' if advice else '')
            + 'Check scene.centre_m, and the positions: their unit (unit_m), frame and height',)


def _dark(block: PulseBlock, grid: MapGrid, pattern: AntennaPattern) -> tuple[str, ...]:
    rows, columns = (np.unique(np.linspace(0, n - 1, _SIDE).astype(int)) for n in grid.shape)
    places = grid.positions(rows[:, None], columns).reshape(-1, 3)
    illumination = Illumination.of_pulses(pattern, block.pointing, *block.centres_m)
    if illumination.amplitude(places).any():
        return ()
    assert block.pointing is not None  # which patterns come with
    looks = block.pointing.boresight[0].round(2) + 0.0  # no -0.00
    return ('the antenna never looks at the scene, whose image would be empty: at the first pulse '
            f'it looks towards ({looks[0]:.2f}, {looks[1]:.2f}, {looks[2]:.2f}); check '
            'antenna.pointing (side, boresight, target) and scene.centre_m',)


_DESCRIPTION = """\
Turn measured data into a recording (rosbag2). A description in YAML says where samples, times and
poses are and what the radar sends; docs/loading.md lists its keys. Each number in it may be the
name of a variable of the data file. `sar-imaging evaluate` and `sar-imaging image` image the
recording.
"""


def parser() -> argparse.ArgumentParser:
    """Command-line parser."""
    p = command_parser('load', _DESCRIPTION)
    p.add_argument('description', help='YAML file, or the name of a shipped one: '
                   f'{", ".join(shipped_names())}')
    p.add_argument('data', type=Path, nargs='?',
                   help='folder with the files that the description names, or the file of the '
                        'samples (default: the folder of the description)')
    p.add_argument('--output', type=Path, metavar='FOLDER',
                   help='bag folder to make (default: out/bags/ and the name of the recording)')
    p.add_argument('--set', action='append', default=[], metavar='KEY=VALUE', dest='changes',
                   help='another value for a key, such as alignment.time_offset_s=9.28; may be '
                        'given several times')
    p.add_argument('--estimate-alignment', action='store_true',
                   help='estimate time offset and range bias from the image, beginning with those '
                        'of the description')
    p.add_argument('--force', action='store_true', help='replace an existing bag')
    return p


def _changes(pairs: Sequence[str]) -> dict[str, object]:
    out = {}
    for pair in pairs:
        key, separator, value = pair.partition('=')
        try:
            out[key] = load_yaml(value)
        except yaml.YAMLError:
            separator = ''
        if not separator:
            raise DescriptionError(f'--set {pair}: expected KEY=VALUE, such as times.first_s=0.5')
    return out


def _write(arguments: argparse.Namespace) -> str:
    if arguments.output is not None:
        check_target(arguments.output, overwrite=arguments.force)
    loaded = load(arguments.description, arguments.data, changes=_changes(arguments.changes))
    output = arguments.output or Path('out/bags') / _folder(loaded.name)
    check_target(output, overwrite=arguments.force)
    with naming(arguments.description, 'makes no recording', DescriptionError):
        return _write_loaded(loaded, output, arguments)


def _folder(name: str) -> str:
    """A name of a folder, nothing else that a description of somebody else may tell."""
    if Path(name).name != name or not name.isprintable():
        raise DescriptionError(f'name: {name!r} is no name of a folder; give one by --output')
    return name


def _write_loaded(loaded: Loaded, output: Path, arguments: argparse.Namespace) -> str:
    for text in (*loaded.warnings, *told_of_scene(loaded)):
        print(f'warning: {text}', file=sys.stderr)
    alignment, poses = loaded.alignment, loaded.poses
    if arguments.estimate_alignment:
        if poses is None:
            raise DescriptionError('--estimate-alignment: expected poses on a clock of their own; '
                                   'this recording has the phase centres of its pulses')
        alignment, report = estimate_alignment(loaded.block, poses, alignment, loaded.scene.grid)
        print(describe(report))
    block = loaded.block
    count = write_bag(output, with_progress(split(block), block.n_pulses),
                      truth_of(loaded, alignment), overwrite=arguments.force, poses=poses)
    told = '' if poses is None else f', {len(poses.stamp_ns)} poses'
    return f'{output}: {block.n_pulses} pulses in {count} messages{told}'


main = main_of(parser, _write)

if __name__ == '__main__':
    sys.exit(main())
