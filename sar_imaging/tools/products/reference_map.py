# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Make a reference map of a place from one recording or several, for sar-imaging locate.

Run: sar-imaging map monday tuesday --output out/place
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np
from scipy import ndimage

from ...exploitation.obstacles import ApertureView, ObstacleDetector, ObstacleMap
from ...exploitation.registration import LookDirection, Speckle, measured_resolution_m
from ...formats.reference_map import Pass, ReferenceMap, write_reference_map
from ...geometry.grids import MapGrid
from ...imaging.image import Image
from ...recordings.pulse_source import PulseSource, SourceError, open_pulses
from ..arguments import datum_of, memory_bytes
from ..program import command_parser, main_of
from . import forming

_IMAGES = 4  # that the memory has to hold: an image, their sum, and what tells obstacles
_FLOOR_PIXELS = 9  # averaged along both axes

_EPILOG = """\
All are imaged on one grid, chosen for the first; the map has their mean power. Writes
amplitude.npy, passes.npy and map.json; obstacles.pgm and obstacles.yaml for Nav2; map.tif where
the place on the Earth is known; complex_0.npy and so on with --complex. Provisional: later
versions may write other files.

  sar-imaging map monday tuesday --output out/place
  sar-imaging locate wednesday out/place --output out/where
"""


def parser() -> argparse.ArgumentParser:
    """Command-line parser."""
    p = command_parser('sar-imaging map', 'Make a reference map of recordings.', _EPILOG)
    p.add_argument('files', type=Path, nargs='+', metavar='file',
                   help='folder of a recording (rosbag2), CPHD file, or description')
    p.add_argument('--complex', action='store_true',
                   help='keep the complex image of each recording, too, 8 bytes a pixel: one that '
                        'comes along the same track again is located to a hundredth of a cell')
    forming.add_arguments(p)
    return p


def run(arguments: argparse.Namespace) -> str:
    """Image all recordings and write their map; returns a summary for people."""
    if arguments.plane != 'ground':
        raise SourceError('maps lie on the ground: leave out --plane slant')
    made, warnings = make(arguments)
    names = write_reference_map(arguments.output, made)
    grid = made.image.grid
    return '\n'.join([
        f'{grid.n_x} by {grid.n_y} pixels of {grid.spacing_m:g} m from {len(made.passes)} passes, '
        f'{np.mean(made.seen > 0):.0%} seen', *(f'warning: {text}' for text in warnings),
        f'written to {arguments.output}: {", ".join(names)}'])


def make(arguments: argparse.Namespace) -> tuple[ReferenceMap, list[str]]:
    """The map of the recordings of the arguments, and warnings."""
    datum, choice, warnings = datum_of(arguments), None, []
    passes, obstacles = [], ObstacleMap()
    for path in arguments.files:
        source = forming.weighted(open_pulses(path, aperture=arguments.aperture, datum=datum))
        if choice is None:
            n_images = _IMAGES + len(arguments.files) * arguments.complex
            share = forming.IMAGE_SHARE / n_images
            choice, first = forming.choose(source, arguments, share), source
            datum = source.datum  # CPHD positions come in the frame of the first file
            power = np.zeros(choice.grid.shape, np.float32)
            seen = np.zeros(choice.grid.shape, np.uint16)
        _check_same(source, first)
        image, _ = forming.form(source, choice, arguments.target_db, memory_bytes(arguments) / 2,
                                label=path.name)
        power += np.square(np.abs(image.samples))
        seen += image.samples != 0
        warnings += [f'{path.name}: {text}' for text in (*source.warnings,
                                                         *image.report.warnings)]
        passes.append(_pass(source, image if arguments.complex else None, choice.grid))
        try:
            view = ApertureView.of_positions(source.track_m, source.radar)
            obstacles.add(ObstacleDetector(choice.grid, view)(image.samples), len(passes))
        except ValueError as error:
            warnings.append(f'{path.name}: no obstacles: {error}')
    mean = power / np.maximum(seen, 1)
    level = ndimage.uniform_filter(mean, _FLOOR_PIXELS)[seen > 0]
    floor = float(10 * np.log10(max(np.percentile(level, 1), 1e-30))) if level.size else -300.0
    amplitude = Image(np.sqrt(mean), choice.grid, image.carrier_hz, image.report)
    states = obstacles.states() if obstacles.grid is not None else None
    return ReferenceMap(amplitude, tuple(passes), seen, measured_resolution_m(image), floor, datum,
                        states), warnings


def _check_same(source: PulseSource, first: PulseSource) -> None:
    if source.datum != first.datum:
        raise SourceError(f'{source.path} stands at {source.datum}, {first.path} at '
                          f'{first.datum}; expected recordings in one frame')
    if source.radar.carrier_hz != first.radar.carrier_hz:
        raise SourceError(f'{source.path} is at {source.radar.carrier_hz / 1e9:.6g} GHz, '
                          f'{first.path} at {first.radar.carrier_hz / 1e9:.6g} GHz; expected '
                          'recordings of one radar')


def _pass(source: PulseSource, kept: Image | None, grid: MapGrid) -> Pass:
    middle = source.track_m.mean(axis=0)
    return Pass(source.path.name, LookDirection.between(grid.centre_m, middle),
                int(np.median(source.stamp_ns)), kept and Speckle(kept, tuple(middle)))


main = main_of(parser, run, quiet=True)

if __name__ == '__main__':
    sys.exit(main())
