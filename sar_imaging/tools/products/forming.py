"""Images of files of pulses: grid chosen, blocks streamed, error verified."""

from __future__ import annotations

import argparse
import math
import time
from pathlib import Path

import numpy as np
from tqdm import tqdm

from sar_imaging.configuration.scene_grid import PLANES, GridChoice, choose_grid
from sar_imaging.geometry.earth import Datum
from sar_imaging.geometry.grids import MapGrid
from sar_imaging.imaging.image import Image
from sar_imaging.imaging.imager import plan_image
from sar_imaging.planning.memory import available_bytes
from sar_imaging.quality.verification import Verification, measure_error
from sar_imaging.signal.radar import Waveform

from .sources import Source, SourceError

_IMAGE_SHARE = 0.5  # of the memory, for the image and what is made of it
_BLOCK_SHARE = 0.1  # for the samples of a block; its profiles are resampled more finely
_VERIFIED_PIXELS = 200


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of all commands that form images of files."""
    parser.add_argument('--output', type=Path, required=True, metavar='FOLDER',
                        help='folder for the results, made when missing')
    parser.add_argument('--plane', choices=PLANES, default=PLANES[0],
                        help='a map on the ground, or the slant plane (default: %(default)s)')
    parser.add_argument('--target-db', type=float, default=-60.0, metavar='DB',
                        help='wanted error against correlation (default: %(default)g)')
    parser.add_argument('--size', type=_numbers(1, 2), metavar='M[,M]',
                        help='of the image: along x and y of a map, range and track of the slant '
                             'plane, metres')
    parser.add_argument('--spacing', type=_numbers(1), metavar='M',
                        help='of the pixels, metres')
    parser.add_argument('--centre', type=_numbers(2, 3), metavar='X,Y[,Z]',
                        help='middle of the image in the frame of the phase centres, and height '
                             'of the ground, metres (write --centre=-1,2 for negative numbers)')
    parser.add_argument('--datum', type=_numbers(3, 4), metavar='LAT,LON,HEIGHT[,HEADING]',
                        help="where the frame's origin stands on WGS 84, and the bearing of its "
                             'y axis, degrees and metres (default: what the file tells)')
    parser.add_argument('--memory', type=_numbers(1), metavar='GB',
                        help='most memory to take (default: half of what is free)')
    parser.add_argument('--aperture', type=int, metavar='N',
                        help='of a recording: number of the aperture, pulse counter // pulses per '
                             'aperture (default: the last complete one)')


def _numbers(least: int, most: int | None = None):
    """Parser of so many finite numbers with commas between them."""
    most = most or least

    def parse(text: str) -> tuple[float, ...]:
        try:
            values = tuple(float(part) for part in text.split(','))
        except ValueError:
            values = ()
        if not least <= len(values) <= most or not all(map(math.isfinite, values)):
            wanted = f'{least}' if most == least else f'{least} to {most}'
            raise argparse.ArgumentTypeError(f'{text!r} is not {wanted} numbers with commas '
                                             'between them')
        return values

    return parse


def datum_of(arguments: argparse.Namespace) -> Datum | None:
    """Datum that the arguments tell.

    Raises
    ------
    SourceError
        There is no such place.
    """
    try:
        return None if arguments.datum is None else Datum(*arguments.datum)
    except ValueError as error:
        raise SourceError(f'--datum: {error}') from error


def memory_bytes(arguments: argparse.Namespace) -> float:
    """Memory that may be taken, bytes."""
    if arguments.memory is None:
        return available_bytes() / 2
    if not arguments.memory[0] > 0:
        raise SourceError(f'--memory {arguments.memory[0]:g}; expected a positive number of GB')
    return arguments.memory[0] * 1e9


def choose(source: Source, arguments: argparse.Namespace) -> GridChoice:
    """Grid for a source: that of the arguments, of the file, or one chosen from its pulses.

    Raises
    ------
    SourceError
        The file does not tell where its scene is, and neither do the arguments.
    """
    a = arguments
    if a.centre is None and source.area_m is None:
        near, far = source.coverage().swath_m
        raise SourceError(f'{source.path} does not tell where its scene is: give --centre X,Y,Z, '
                          f'a place {near:.0f} to {far:.0f} m from the track, whose middle is '
                          f'({_place(source.track_m.mean(axis=0))}) m')
    told = source.grid
    if (told is not None and a.plane == 'ground'
            and a.centre is a.size is a.spacing is None):
        bound = choose_grid(source.coverage(), told.centre_m, spacing_m=told.spacing_m,
                            size_m=((told.n_x - 1) * told.spacing_m,
                                    (told.n_y - 1) * told.spacing_m),
                            memory_bytes=_IMAGE_SHARE * memory_bytes(a))
        return GridChoice(told, a.plane, bound.range_resolution_m, bound.azimuth_resolution_m, (
            f'{told.n_x} by {told.n_y} pixels of {told.spacing_m:g} m: the grid that the '
            'recording proposes (--size, --spacing and --centre change it)',))
    centre = (source.area_m.mean(axis=0) if a.centre is None else
              np.array([*a.centre, *([0.0] if len(a.centre) == 2 else [])]))
    size = None if a.size is None else (a.size[0], a.size[-1])
    return choose_grid(source.coverage(), centre, plane=a.plane, size_m=size,
                       area_m=None if a.centre is not None else source.area_m,
                       spacing_m=None if a.spacing is None else a.spacing[0],
                       memory_bytes=_IMAGE_SHARE * memory_bytes(a))


def _place(place) -> str:
    return ', '.join(f'{v:.1f}' for v in place)


def form(source: Source, choice: GridChoice, target_db: float, n_bytes: float, *,
         label: str = 'imaging') -> tuple[Image, float]:
    """Image of a source on a grid, and the seconds that it took.

    Parameters
    ----------
    source : Source
        Its pulses.
    choice : GridChoice
        Its pixels.
    target_db : float
        Wanted error, dB.
    n_bytes : float
        Memory that it may take.
    label : str
        Of the progress bar.

    Raises
    ------
    ValueError, MemoryError
        As `plan_image`.
    """
    start = time.perf_counter()
    block_bytes = _BLOCK_SHARE * n_bytes
    whole = source.n_bytes <= block_bytes
    imager = plan_image(choice.grid, source.radar, source.n_samples, target_db=target_db,
                        compressed=source.compressed, progress=whole)
    image = imager.new_image()
    with tqdm(total=source.n_pulses, desc=label, unit='pulse', disable=whole) as bar:
        for block in source.read(block_bytes):
            imager.accumulate(block, image)
            bar.update(block.n_pulses)
    return image, time.perf_counter() - start


def verify(source: Source, image: Image, n_bytes: float) -> Verification | str:
    """Error measured at some pixels, or why it cannot be measured."""
    raw = not source.compressed and source.radar.waveform == Waveform.STEPPED_FREQUENCY
    blocks = (source.read if raw else source.profiles)(_BLOCK_SHARE * n_bytes)
    try:
        return measure_error(image.samples, image.grid, blocks, n_pixels=_VERIFIED_PIXELS,
                             n_brightest=_VERIFIED_PIXELS, fit_scale=raw)
    except ValueError as error:
        return str(error)


def drawn_grid(choice: GridChoice) -> tuple[MapGrid, str]:
    """A map that stands for the grid in pictures, and what its axes are."""
    grid = choice.grid
    if isinstance(grid, MapGrid):
        return grid, ''
    return (MapGrid((0.0, 0.0, 0.0), grid.n_u, grid.n_v, choice.spacing_m),
            'slant plane: x away from the track, y along it')
