# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Images of files of pulses: grid chosen, blocks streamed, error verified."""

from __future__ import annotations

import argparse
import dataclasses
import math
import sys
import time
from typing import Any

import numpy as np
from tqdm import tqdm

from sar_imaging.configuration.scene_grid import PLANES, GridChoice, choose_grid
from sar_imaging.geometry.grids import MapGrid
from sar_imaging.imaging.image import Image
from sar_imaging.imaging.imager import plan_image
from sar_imaging.quality.verification import Verification, measure_error
from sar_imaging.signal.radar import Waveform

from ...recordings.pulse_source import PulseSource, SourceError
from ..arguments import add_aperture, add_datum, add_memory, add_output, check_count, memory_bytes

IMAGE_SHARE = 0.5  # of the memory, for the image and what is made of it
_BLOCK_SHARE = 0.1  # for the samples of a block; its profiles are resampled more finely
_VERIFIED_PIXELS = 200


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of all commands that form images of files."""
    add_output(parser)
    parser.add_argument('--plane', choices=PLANES, default=PLANES[0],
                        help='a map on the ground, or the slant plane (default: %(default)s)')
    parser.add_argument('--target-db', type=float, default=-60.0, metavar='DB',
                        help='wanted error against correlation (default: %(default)g)')
    add_datum(parser)
    add_scene_arguments(parser)


def add_scene_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments that say which pulses and which scene are looked at."""
    parser.add_argument('--size', type=float, nargs='+', metavar='M',
                        help='of the image: along x and y of a map, range and track of the slant '
                             'plane, or one number for both, metres')
    parser.add_argument('--spacing', type=float, metavar='M', help='of the pixels, metres')
    parser.add_argument('--centre', type=float, nargs='+', metavar='X',
                        help='middle of the image in the frame of the phase centres (x, y) and '
                             'height of the ground (z, 0 by default), metres')
    add_memory(parser)
    add_aperture(parser)


def choose(source: PulseSource, arguments: argparse.Namespace,
           share: float = IMAGE_SHARE) -> GridChoice:
    """Grid for a source: that of the arguments, of the file, or one chosen from its pulses.

    An image may take some share of the memory.

    Raises
    ------
    SourceError
        The file does not state where its scene is, and neither do the arguments.
    """
    a = arguments
    check_count('--centre', a.centre, 2, 3, 'x, y and z')
    check_count('--size', a.size, 1, 2, 'both sides')
    if a.centre is None and source.area_m is None:
        near, far = source.coverage().swath_m
        raise SourceError(f'{source.path} does not state where its scene is: give --centre X Y Z, '
                          f'a place {near:.0f} to {far:.0f} m from the track, whose middle is '
                          f'({_place(source.track_m.mean(axis=0))}) m')
    told = source.grid
    if (told is not None and a.plane == 'ground'
            and a.centre is a.size is a.spacing is None):
        bound = choose_grid(source.coverage(), told.centre_m, spacing_m=told.spacing_m,
                            size_m=((told.n_x - 1) * told.spacing_m,
                                    (told.n_y - 1) * told.spacing_m),
                            memory_bytes=share * memory_bytes(a))
        return GridChoice(told, a.plane, bound.range_resolution_m, bound.azimuth_resolution_m, (
            f'{told.n_x} by {told.n_y} pixels of {told.spacing_m:g} m: the grid that the '
            'recording proposes (--size, --spacing and --centre change it)',))
    centre = (source.area_m.mean(axis=0) if a.centre is None else
              np.array([*a.centre, *([0.0] if len(a.centre) == 2 else [])]))
    size = None if a.size is None else (a.size[0], a.size[-1])
    return choose_grid(source.coverage(), centre, plane=a.plane, size_m=size,
                       area_m=None if a.centre is not None else source.area_m,
                       spacing_m=a.spacing,
                       memory_bytes=share * memory_bytes(a))


def _place(place: np.ndarray) -> str:
    return ', '.join(f'{v:.1f}' for v in place)


def weighted(source: PulseSource) -> PulseSource:
    """The source with the window that its file proposes, as the nodes take it.

    Range profiles and CPHD files keep the weighting that they have.

    Parameters
    ----------
    source : PulseSource
        Opened without a window.
    """
    if source.compressed:
        return source
    return dataclasses.replace(source, window=source.proposed_window)


def form(source: PulseSource, choice: GridChoice, target_db: float, n_bytes: float, *,
         label: str = 'imaging') -> tuple[Image, float]:
    """Image of a source on a grid, and the seconds that it took.

    Parameters
    ----------
    source : PulseSource
        Its pulses.
    choice : GridChoice
        Its pixels.
    target_db : float
        Wanted error, dB.
    n_bytes : float
        Memory that it may take.
    label : str
        Label of the progress bar.

    Raises
    ------
    ValueError, MemoryError
        As `plan_image`.
    """
    start = time.perf_counter()
    block_bytes = _BLOCK_SHARE * n_bytes
    whole = source.n_bytes <= block_bytes
    imager = plan_image(choice.grid, source.radar, source.n_samples, target_db=target_db,
                        compressed=source.compressed, progress=whole, weighting=source.window,
                        illumination=source.illumination)
    image = imager.new_image()
    with tqdm(total=source.n_pulses, desc=label, unit='pulse', disable=whole) as bar:
        for block in source.blocks(block_bytes):
            imager.accumulate(block, image)
            bar.update(block.n_pulses)
    return image, time.perf_counter() - start


def verify(source: PulseSource, image: Image, n_bytes: float) -> Verification | str:
    """Error measured at some pixels, or why it cannot be measured."""
    raw = not source.compressed and source.radar.waveform == Waveform.STEPPED_FREQUENCY
    # The spectra of raw pulses have no window.
    spectra = raw and source.window == 'none'
    blocks = (source.blocks if spectra else source.profiles)(_BLOCK_SHARE * n_bytes)
    try:
        return measure_error(image.samples, image.grid, blocks, n_pixels=_VERIFIED_PIXELS,
                             n_brightest=_VERIFIED_PIXELS, fit_scale=raw, progress=True,
                             illumination=source.illumination)
    except ValueError as error:
        return str(error)


@dataclasses.dataclass(frozen=True, eq=False)
class Formed:
    """An image of a source, and how it came to be.

    Attributes
    ----------
    source : PulseSource
        Its pulses.
    choice : GridChoice
        Its pixels.
    image : Image
    seconds : float
        That it took.
    measured : Verification or str
        Its error, or why that could not be measured.
    """

    source: PulseSource
    choice: GridChoice
    image: Image
    seconds: float
    measured: Verification | str

    def figures(self) -> dict[str, Any]:
        """What quality.json says of every image."""
        report, source, measured = self.image.report, self.source, self.measured
        warnings = [*source.warnings, *report.warnings]
        if isinstance(measured, str):
            warnings.append(f'the error could not be measured: {measured}')
        elif measured.error_db > report.target_db:
            warnings.append(f'the error measured, {measured.error_db:.1f} dB, misses the wanted '
                            f'{report.target_db:g} dB')
        return {
            'file': str(source.path), 'pulses': source.n_pulses, 'channels': source.n_channels,
            'shape': list(self.image.shape), 'chosen': list(self.choice.reasons),
            'grid': {'type': type(self.image.grid).__name__,
                     **dataclasses.asdict(self.image.grid)},
            'method': report.method, 'target_db': report.target_db,
            'predicted_error_db': report.predicted_error_db,
            'measured_error': None if isinstance(measured, str) else {
                name: value if math.isfinite(value) else None
                for name, value in dataclasses.asdict(measured).items()},
            'seconds': round(self.seconds, 3), 'warnings': warnings}


def form_and_verify(source: PulseSource, choice: GridChoice,
                    arguments: argparse.Namespace) -> Formed:
    """Image of a source as the arguments ask for; tells why the grid is this one."""
    for reason in choice.reasons:
        print(reason, file=sys.stderr)
    arguments.output.mkdir(parents=True, exist_ok=True)
    n_bytes = memory_bytes(arguments)
    image, seconds = form(source, choice, arguments.target_db, n_bytes)
    return Formed(source, choice, image, seconds, verify(source, image, n_bytes))


def title_of(source: PulseSource) -> str:
    """Title of pictures."""
    radar = source.radar
    return (f'{source.path.name}: {source.n_pulses} pulses, {radar.carrier_hz / 1e9:.4g} GHz, '
            f'{radar.bandwidth_hz / 1e6:.4g} MHz')


def drawn_grid(choice: GridChoice) -> tuple[MapGrid, str]:
    """A map that stands for the grid in pictures, and what its axes are."""
    grid = choice.grid
    if isinstance(grid, MapGrid):
        return grid, ''
    return (MapGrid((0.0, 0.0, 0.0), grid.n_u, grid.n_v, choice.spacing_m),
            'slant plane: x away from the track, y along it')
