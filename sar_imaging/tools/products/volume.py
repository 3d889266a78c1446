# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Volume of a recording: point cloud, picture and measured error; `image --height` runs it."""

from __future__ import annotations

import argparse
import dataclasses
import math
from typing import Any

import numpy as np

from sar_imaging.configuration.scene_grid import PIXEL_BYTES, GridChoice
from sar_imaging.exploitation.bright_cells import LEVELS, BrightCells, bright_cells
from sar_imaging.files import filling, write_json
from sar_imaging.formats import write_ply
from sar_imaging.geometry.grids import VolumeGrid
from sar_imaging.imaging.image import error_in_words
from sar_imaging.radiometry import RadarConstant
from sar_imaging.radiometry.scale import RCS

from ...recordings.pulse_source import PulseSource, SourceError
from ..arguments import memory_bytes
from . import brightness, forming
from .figures import save_volume_png


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of volumes."""
    group = parser.add_argument_group('volumes, of phase centres in two dimensions')
    group.add_argument('--height', type=float, metavar='M',
                       help='image level layers from the height of the image up to so many metres '
                            'above it, and write the bright cells as a point cloud')
    group.add_argument('--height-step', type=float, metavar='M',
                       help='from layer to layer (default: --spacing)')
    group.add_argument('--threshold', type=float, default=20.0, metavar='DB',
                       help='least power of a point above the median of the volume (default: '
                            '%(default)g)')
    group.add_argument('--points', type=int, default=100_000, metavar='N',
                       help='most points of the cloud: the brightest (default: %(default)s)')


def run(arguments: argparse.Namespace, source: PulseSource) -> str:
    """Image the volume and write all products; returns a summary for people.

    Raises
    ------
    SourceError
        An argument makes no sense for a volume.
    ValueError, MemoryError
        As `plan_image`; the volume does not fit.
    """
    constant = _constant(arguments)
    choice = choose(source, arguments, memory_bytes(arguments))
    formed = forming.form_and_verify(source, choice, arguments)
    image, measured = formed.image, formed.measured
    calibration: dict[str, Any] = {}
    if constant is not None:
        image, calibration = brightness.calibrate_volume(source, image, constant)
    cells = bright_cells(image.samples, image.grid, threshold_db=arguments.threshold,
                         most=arguments.points)
    quality = describe(formed, cells, arguments.threshold) | calibration
    with filling(arguments.output) as folder:
        np.save(folder / 'volume.npy', image.samples)
        write_ply(folder / 'cloud.ply', cells.points_m,
                  {'intensity': cells.level_db(image.radiometry)},
                  f'radar volume; intensity: {LEVELS[constant is not None]}')
        save_volume_png(
            folder / 'volume.png', image.samples, image.grid, cells,
            threshold_db=arguments.threshold, truth=source.scatterers,
            title=forming.title_of(source))
        write_json(folder / 'quality.json', quality)
    n_z, n_y, n_x = image.shape
    error = 'not measured' if isinstance(measured, str) else f'{measured.error_db:.1f} dB measured'
    return '\n'.join([
        f'{n_x} by {n_y} by {n_z} cells in {formed.seconds:.1f} s by {image.report.method}',
        f'{error_in_words(image.report.predicted_error_db)}, {error}, '
        f'{arguments.target_db:g} dB wanted',
        f'{len(cells.points_m)} points, {cells.n_above} cells are {arguments.threshold:g} dB or '
        'more above the median', *(f'warning: {text}' for text in quality['warnings']),
        f'written to {arguments.output}: volume.png, cloud.ply, volume.npy, quality.json'])


def _constant(arguments: argparse.Namespace) -> RadarConstant | None:
    if arguments.brightness not in (None, RCS):
        raise SourceError(f'--brightness {arguments.brightness}: cells of a volume have no area '
                          f'of ground; use {RCS}, the cross section of a point in each cell')
    return brightness.constant_of(arguments)


def choose(source: PulseSource, arguments: argparse.Namespace, n_bytes: float) -> GridChoice:
    """Layers above the map that an image would have.

    Raises
    ------
    SourceError
        An argument makes no sense for a volume.
    MemoryError
        It does not fit.
    """
    a = arguments
    for name, value in (('--height', a.height), ('--height-step', a.height_step)):
        if value is not None and not (math.isfinite(value) and value > 0):
            raise SourceError(f'{name} {value:g}: expected a positive number of metres')
    if not math.isfinite(a.threshold):
        raise SourceError(f'--threshold {a.threshold:g}: expected a number of decibels')
    if a.points < 1:
        raise SourceError(f'--points {a.points}: expected at least one')
    if a.plane != 'ground':
        raise SourceError(f'--plane {a.plane}: the layers of a volume are level; leave it out')
    if set(a.format) != {'png'}:
        raise SourceError(f'--format {",".join(a.format)}: a volume becomes a point cloud and a '
                          'picture; leave it out')
    ground = forming.choose(source, a)
    grid = VolumeGrid.above(ground.grid, a.height, a.height_step)
    needed, allowed = PIXEL_BYTES * math.prod(grid.shape), forming.IMAGE_SHARE * n_bytes
    if needed > allowed:
        cells = ' by '.join(map(str, reversed(grid.shape)))
        raise MemoryError(f'{cells} cells take {needed / 1e9:.2g} GB, {allowed / 1e9:.2g} GB are '
                          'allowed; ask for a smaller --size or --height, a larger --spacing or '
                          '--height-step, or allow more --memory')
    low_m = ground.grid.z_m
    step_m = float(grid.steps_m[0, 2])
    return dataclasses.replace(ground, grid=grid, reasons=(
        *ground.reasons, f'{grid.n_z} layers from z = {low_m:g} m to '
        f'{low_m + (grid.n_z - 1) * step_m:g} m, {step_m:g} m apart (--centre, --height and '
        '--height-step change it)'))


def describe(formed: forming.Formed, cells: BrightCells, threshold_db: float) -> dict[str, Any]:
    """Contents of quality.json."""
    quality, found = formed.figures(), len(cells.points_m)
    if not found:
        quality['warnings'].append(
            f'nothing is {threshold_db:g} dB above the median: are place and height of the scene '
            'right? --threshold changes it')
    return quality | {
        'threshold_db': threshold_db, 'points': found, 'cells_above_threshold': cells.n_above,
        'brightest_db': round(float(cells.intensity_db[0]), 2) if found else None,
        'brightest_m': cells.points_m[0].tolist() if found else None}
