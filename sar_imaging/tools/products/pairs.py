"""Two images of one scene, from two files of pulses or two SICD files, on the same pixels."""

from __future__ import annotations

import argparse
import dataclasses
from pathlib import Path

import numpy as np

from sar_imaging.configuration.scene_grid import GridChoice
from sar_imaging.geometry.earth import Datum
from sar_imaging.geometry.grids import MapGrid, PlaneGrid
from sar_imaging.imaging.image import Image
from sar_imaging.signal.magnitudes import SPEED_OF_LIGHT

from ..exchange.kinds import SICD, kind_of
from . import forming
from .sources import Source, SourceError, open_source

_IMAGE_SHARE = forming.IMAGE_SHARE / 4  # two images, and what tells their difference
_SQUARE = 0.02  # relative difference of steps up to which a picture is drawn to scale


@dataclasses.dataclass(frozen=True, eq=False)
class Pair:
    """Two images that lie on the same pixels.

    Attributes
    ----------
    images : (2,) Image
        Of the first file and of the second.
    tracks_m : (2,) arrays (P, 3) float64
        Mean phase centres, frame of the grid, metres.
    datum : Datum or None
        Where that frame stands.
    drawn : MapGrid
        That pictures are drawn on.
    axes : str
        What its axes are, where they are not those of the frame.
    chosen : tuple of str
        Why the grid is this one.
    warnings : tuple of str
        Of the files and their images.
    propagation_speed_m_per_s : float
        Speed of the waves.
    """

    images: tuple[Image, Image]
    tracks_m: tuple[np.ndarray, np.ndarray]
    datum: Datum | None
    drawn: MapGrid
    axes: str
    chosen: tuple[str, ...]
    warnings: tuple[str, ...]
    propagation_speed_m_per_s: float = SPEED_OF_LIGHT


def open_pair(first: Path, second: Path, arguments: argparse.Namespace) -> Pair:
    """Images of two files.

    Files of pulses are imaged on one grid, chosen for the first; SICD files have to lie on the
    same pixels already.

    Raises
    ------
    SourceError
        One is SICD and the other is not, or their frames or pixels differ.
    ValueError, MemoryError
        As `plan_image` and `read_sicd`.
    """
    images = [path.is_file() and kind_of(path) == SICD for path in (first, second)]
    if images[0] != images[1]:
        raise SourceError(f'{first} and {second}: one is SICD, the other is not; compare two '
                          'files of one kind')
    return _of_sicd(first, second) if images[0] else _of_pulses(first, second, arguments)


def _of_pulses(first: Path, second: Path, arguments: argparse.Namespace) -> Pair:
    datum = forming.datum_of(arguments)
    one = open_source(first, aperture=arguments.aperture, datum=datum)
    # CPHD positions are Earth-centred: they come in the frame of the first file
    frame = one.datum if second.is_file() else None
    other = open_source(second, aperture=arguments.aperture, datum=datum or frame)
    if one.datum != other.datum and None not in (one.datum, other.datum):
        raise SourceError(f'{second} stands at {other.datum}, {first} at {one.datum}; expected '
                          'recordings in one frame')
    choice = forming.choose(one, arguments, _IMAGE_SHARE)
    centre = choice.grid.points().reshape(-1, 3).mean(axis=0)
    if not other.coverage().covers(centre[None]).all():
        raise SourceError(f'{second} does not cover the middle of the grid chosen for {first}, '
                          f'({centre[0]:.1f}, {centre[1]:.1f}, {centre[2]:.1f}) m: do both see '
                          'one scene, in one frame?')
    n_bytes = forming.memory_bytes(arguments)
    images = tuple(forming.form(source, choice, arguments.target_db, n_bytes / 2, label=name)[0]
                   for name, source in (('first pass', one), ('second pass', other)))
    drawn, axes = forming.drawn_grid(choice)
    return Pair(images, (one.track_m, other.track_m), one.datum or other.datum, drawn, axes,
                choice.reasons, _warnings(choice, (one, other), images),
                one.radar.propagation_speed_m_per_s)


def _warnings(choice: GridChoice, sources: tuple[Source, Source], images) -> tuple[str, ...]:
    return tuple(f'{name} pass: {text}'
                 for name, source, image in zip(('first', 'second'), sources, images, strict=True)
                 for text in (*source.warnings, *image.report.warnings))


def _of_sicd(first: Path, second: Path) -> Pair:
    from sar_imaging.formats import read_sicd

    one, other = read_sicd(first), read_sicd(second)
    grid = one.image.grid
    moved = _in_frame(other.image.grid, other.datum, one.datum)
    steps = np.linalg.norm(grid.steps_m, axis=1)
    square = abs(steps[0] / steps[1] - 1) < _SQUARE
    drawn = MapGrid((0.0, 0.0, 0.0), grid.n_u, grid.n_v, float(steps[1]))
    axes = 'columns and rows of the SICD' + ('' if square else ', rows not to scale')
    track = one.datum.from_ecef(other.datum.to_ecef(other.acquisition.centre_m))
    return Pair((one.image, dataclasses.replace(other.image, grid=moved)),
                (one.acquisition.centre_m, track), one.datum, drawn, axes, (), ())


def _in_frame(grid: PlaneGrid, own: Datum, wanted: Datum) -> PlaneGrid:
    """The same pixels in the frame of another datum."""
    def turned(vector):
        return tuple(wanted.vectors_from_ecef(own.vectors_to_ecef(vector)))

    return PlaneGrid(tuple(wanted.from_ecef(own.to_ecef(grid.origin_m))), turned(grid.step_u_m),
                     turned(grid.step_v_m), grid.n_u, grid.n_v)
