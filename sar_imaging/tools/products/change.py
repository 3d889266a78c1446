# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Compare two passes over one scene: coherence, changes, phase, heights and a report.

Run: sar-imaging change first.cphd second.cphd --output out/change

Both are imaged on the same pixels, from two files of pulses, or are read from two SICD files.
"""

from __future__ import annotations

import argparse
import dataclasses
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ...exploitation.passes import PassComparison, compare_passes
from ...files import filling, write_json
from ...formats import MissingExtraError
from ...formats.geotiff import write_raster
from ...formats.report import ReportSection, write_report
from ...geometry.earth import Datum
from ...geometry.grids import MapGrid, PlaneGrid
from ...imaging.image import Image
from ...quality import focus_figure
from ...recordings.kinds import CPHD, SICD, kind_of
from ...recordings.pulse_source import PulseSource, SourceError, open_pulses
from ...signal.magnitudes import SPEED_OF_LIGHT
from ..arguments import datum_of, memory_bytes
from ..plots import save_image_png, save_values_png
from ..program import command_parser, main_of
from . import forming

_IMAGE_SHARE = forming.IMAGE_SHARE / 4  # two images, and what tells their difference
_SQUARE = 0.02  # relative difference of steps up to which a picture is drawn to scale


@dataclasses.dataclass(frozen=True, eq=False)
class Pair:
    """Two images that lie on the same pixels.

    Attributes
    ----------
    images : (2,) Image
        Images of the first file and of the second.
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
        Warnings of the files and their images.
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
    datum = datum_of(arguments)
    one = open_pulses(first, aperture=arguments.aperture, datum=datum)
    # CPHD positions are Earth-centred: they come in the frame of the first file
    frame = one.datum if second.is_file() and kind_of(second) == CPHD else None
    other = open_pulses(second, aperture=arguments.aperture, datum=datum or frame)
    if one.datum != other.datum and None not in (one.datum, other.datum):
        raise SourceError(f'{second} stands at {other.datum}, {first} at {one.datum}; expected '
                          'recordings in one frame')
    choice = forming.choose(one, arguments, _IMAGE_SHARE)
    centre = choice.grid.points().reshape(-1, 3).mean(axis=0)
    if not other.coverage().covers(centre[None]).all():
        raise SourceError(f'{second} does not cover the middle of the grid chosen for {first}, '
                          f'({centre[0]:.1f}, {centre[1]:.1f}, {centre[2]:.1f}) m: do both see '
                          'one scene, in one frame?')
    n_bytes = memory_bytes(arguments)
    images = tuple(forming.form(source, choice, arguments.target_db, n_bytes / 2, label=name)[0]
                   for name, source in (('first pass', one), ('second pass', other)))
    drawn, axes = forming.drawn_grid(choice)
    return Pair(images, (one.track_m, other.track_m), one.datum or other.datum, drawn, axes,
                choice.reasons, _warnings((one, other), images),
                one.radar.propagation_speed_m_per_s)


def _warnings(sources: tuple[PulseSource, PulseSource], images: tuple[Image, Image]
              ) -> tuple[str, ...]:
    return tuple(f'{name} pass: {text}'
                 for name, source, image in zip(('first', 'second'), sources, images, strict=True)
                 for text in (*source.warnings, *image.report.warnings))


def _of_sicd(first: Path, second: Path) -> Pair:
    from ...formats import read_sicd

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
    def turned(vector: tuple[float, float, float]) -> tuple[float, float, float]:
        return tuple(wanted.vectors_from_ecef(own.vectors_to_ecef(vector)))

    return PlaneGrid(tuple(wanted.from_ecef(own.to_ecef(grid.origin_m))), turned(grid.step_u_m),
                     turned(grid.step_v_m), grid.n_u, grid.n_v)


_PICTURES = {'first.png': 'First pass, decibels', 'second.png': 'Second pass, decibels',
             'coherence.png': 'Coherence, bias of few looks removed',
             'change.png': 'Changes over the first pass',
             'phase.png': 'Phase of the first pass minus that of the second; white: unrelated',
             'height.png': 'Height above the grid, modulo the ambiguity height'}
_SHOWN_CHANGES = 20
_HEIGHT_QUANTILES = (0.01, 0.99)  # at the ends of the colour bar

_EPILOG = """\
Two recordings or CPHD files are imaged on one grid, chosen for the first; two SICD files must lie
on the same pixels. Writes pictures, comparison.json, comparison.npz, report.html, and where the
place on the Earth is known and the extra formats is installed, comparison.tif.

  sar-imaging simulate first_pass --output out/first
  sar-imaging simulate second_pass --output out/second
  sar-imaging change out/first out/second --output out/change
"""


def parser() -> argparse.ArgumentParser:
    """Command-line parser."""
    p = command_parser('sar-imaging change', 'Compare two passes over one scene.', _EPILOG)
    p.add_argument('first', type=Path, help='recording, CPHD or SICD file, or description')
    p.add_argument('second', type=Path, help='the other pass, of the same kind')
    p.add_argument('--window', type=int, default=7, metavar='PIXELS',
                   help='averaged along both axes, odd (default: %(default)s)')
    p.add_argument('--false-alarm-rate', type=float, default=1e-4, metavar='P',
                   help='of unchanged pixels that are taken for changed (default: %(default)g)')
    p.add_argument('--remove-plane', action='store_true',
                   help='remove the constant and linear phase, which errors of the tracks leave')
    forming.add_arguments(p)
    return p


def run(arguments: argparse.Namespace) -> str:
    """Compare and write all products; returns a summary for people."""
    pair = open_pair(arguments.first, arguments.second, arguments)
    found = compare_passes(
        *pair.images, window=arguments.window, false_alarm_rate=arguments.false_alarm_rate,
        remove_plane=arguments.remove_plane, tracks_m=pair.tracks_m,
        propagation_speed_m_per_s=pair.propagation_speed_m_per_s)
    warnings, bands = [*pair.warnings, *found.warnings], _bands(found)
    with filling(arguments.output) as folder:
        pictures = save_pictures(folder, pair, found)
        np.savez_compressed(folder / 'comparison.npz', **bands)
        raster = _write_raster(folder / 'comparison.tif', bands, pair, warnings)
        write_json(folder / 'comparison.json', _figures(arguments, pair, found, warnings))
        _write_report(folder, arguments, pair, found, pictures, warnings)
    names = [*pictures, 'comparison.npz', *raster, 'comparison.json', 'report.html']
    told = [f'warning: {text}' for text in pair.warnings]
    return '\n'.join([*told, str(found), f'written to {arguments.output}: {", ".join(names)}'])


def _figures(arguments: argparse.Namespace, pair: Pair, found: PassComparison,
             warnings: list[str]) -> dict[str, Any]:
    first, second = (track.mean(axis=0) for track in pair.tracks_m)
    return found.figures() | {
        'first': str(arguments.first), 'second': str(arguments.second),
        'baseline_m': [round(float(v), 4) for v in second - first],
        'shape': list(pair.images[0].shape), 'chosen': list(pair.chosen), 'warnings': warnings}


def _bands(found: PassComparison) -> dict[str, np.ndarray]:
    """Arrays by their names, NaN where nothing is known."""
    changed = np.where(found.decidable, found.changed, np.nan).astype(np.float32)
    bands = {'coherence': found.coherence, 'changed': changed, 'phase_rad': found.phase_rad,
             'phase_noise_rad': found.phase_noise_rad}
    if _has_heights(found):
        for name in ('height_m', 'height_noise_m', 'ambiguity_height_m'):
            bands[name] = getattr(found, name)
    return bands


def _has_heights(found: PassComparison) -> bool:
    return found.height_m is not None and bool(np.isfinite(found.height_m).any())


def _write_raster(path: Path, bands: dict[str, np.ndarray], pair: Pair, warnings: list[str]
                  ) -> list[str]:
    """GeoTIFF where the place is known; what prevents it is a warning."""
    if pair.datum is None:
        return []
    try:
        write_raster(path, bands, pair.images[0].grid, pair.datum)
    except (MissingExtraError, ValueError) as error:
        warnings.append(f'no GeoTIFF: {error}')
        return []
    return [path.name]


def save_pictures(folder: Path, pair: Pair, found: PassComparison) -> list[str]:
    """Draw both images and what was found; returns the names of the files."""
    grid: MapGrid = pair.drawn
    more = f'; {pair.axes}' if pair.axes else ''
    for name, image in zip(('first', 'second'), pair.images, strict=True):
        save_image_png(folder / f'{name}.png', image.samples, grid, title=f'{name} pass{more}')
    save_values_png(folder / 'coherence.png', found.coherence, grid, colours='viridis',
                    limits=(0.0, 1.0), label='coherence',
                    title=f'{found.looks:.0f} looks in {found.window} x {found.window} '
                          f'pixels{more}')
    magnitude = np.abs(pair.images[0].samples)
    level = 20 * np.log10(np.maximum(magnitude / max(magnitude.max(), 1e-30), 1e-9))
    median = float(np.median(level))
    save_values_png(folder / 'change.png', level, grid, colours='gray', marked=found.changed,
                    limits=(median - 15.0, median + 15.0), label='first pass, dB',
                    title=f'red: changed, {found.false_alarm_rate:g} false alarms{more}')
    save_values_png(folder / 'phase.png', found.phase_rad, grid, colours='twilight',
                    limits=(-np.pi, np.pi), label='phase (rad)',
                    title='constant and linear phase '
                          + ('removed' if found.plane_removed else 'not removed') + more)
    written = ['first.png', 'second.png', 'coherence.png', 'change.png', 'phase.png']
    if _has_heights(found):
        low, high = np.nanquantile(found.height_m, _HEIGHT_QUANTILES)
        save_values_png(folder / 'height.png', found.height_m, grid, colours='cividis',
                        limits=(float(low), float(high)), label='height above the grid (m)',
                        title=f'modulo {np.nanmedian(found.ambiguity_height_m):.3g} m{more}')
        written.append('height.png')
    return written


def _write_report(folder: Path, arguments: argparse.Namespace, pair: Pair, found: PassComparison,
                  pictures: Sequence[str], warnings: Sequence[str]) -> None:
    def shown(*names: str) -> dict[Path, str]:
        return {folder / name: _PICTURES[name] for name in names if name in pictures}

    changes = {f'({c.position_m[0]:.1f}, {c.position_m[1]:.1f}, {c.position_m[2]:.1f}) m':
               f'{c.n_pixels} pixels, coherence {c.coherence:.2f}, power '
               f'{c.power_change_db:+.1f} dB' for c in found.changes[:_SHOWN_CHANGES]}
    contrast = [focus_figure(image.samples).contrast for image in pair.images]
    sections = [
        ReportSection('Changes', shown('change.png', 'coherence.png'), changes,
                [f'A pixel has changed where its coherence is lower than {found.looks:.1f} looks '
                 'and noise explain, with a probability of a false alarm of '
                 f'{found.false_alarm_rate:g}. {1 - found.decidable.mean():.1%} of the pixels are '
                 'too dark or too little coherent to tell.']),
        ReportSection('Phase and height', shown('phase.png', 'height.png'),
                lines=str(found).splitlines()),
        ReportSection('Both passes', shown('first.png', 'second.png'), {
            'first': str(arguments.first), 'second': str(arguments.second),
            'formed by': ', '.join(image.report.method for image in pair.images),
            'contrast': ', '.join(f'{value:.2f}' for value in contrast)}, pair.chosen)]
    write_report(folder / 'report.html',
                 f'Two passes: {arguments.first.name} and {arguments.second.name}', sections,
                 warnings)


main = main_of(parser, run, quiet=True)

if __name__ == '__main__':
    sys.exit(main())
