"""Compare two passes over one scene: coherence, changes, phase, heights and a report.

Run: sar-imaging change first.cphd second.cphd --output out/change
"""

from __future__ import annotations

import argparse
import json
import logging
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from sar_imaging.exploitation.passes import PassComparison, compare_passes
from sar_imaging.files import filling
from sar_imaging.formats import MissingExtraError
from sar_imaging.formats.raster import write_raster
from sar_imaging.geometry.grids import MapGrid
from sar_imaging.quality import focus_figure

from ..ending import run_command
from ..plots import save_image_png, save_values_png
from . import forming
from .pairs import Pair, open_pair
from .report import Section, write_report

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
    p = argparse.ArgumentParser(
        prog='sar-imaging change', description='Compare two passes over one scene.',
        epilog=_EPILOG, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument('first', type=Path, help='recording, CPHD or SICD file')
    p.add_argument('second', type=Path, help='the other pass, of the same kind')
    p.add_argument('--window', type=int, default=7, metavar='PIXELS',
                   help='averaged along both axes, odd (default: %(default)s)')
    p.add_argument('--false-alarm-rate', type=float, default=1e-4, metavar='P',
                   help='of unchanged pixels that are taken for changed (default: %(default)g)')
    p.add_argument('--remove-plane', action='store_true',
                   help='remove the constant and linear phase, which errors of the tracks leave')
    forming.add_arguments(p)
    return p


def main(argv: Sequence[str] | None = None) -> int:
    """Run the program; returns its exit status."""
    arguments = parser().parse_args(argv)
    logging.basicConfig(level=logging.ERROR)
    return run_command(lambda: run(arguments))


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
        figures = _figures(arguments, pair, found, warnings)
        (folder / 'comparison.json').write_text(
            json.dumps(figures, indent=2, allow_nan=False) + '\n')
        _write_report(folder, arguments, pair, found, pictures, warnings)
    names = [*pictures, 'comparison.npz', *raster, 'comparison.json', 'report.html']
    told = [f'warning: {text}' for text in pair.warnings]
    return '\n'.join([*told, str(found), f'written to {arguments.output}: {", ".join(names)}'])


def _figures(arguments, pair: Pair, found: PassComparison, warnings: list[str]) -> dict:
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
        bands |= {'height_m': found.height_m, 'height_noise_m': found.height_noise_m,
                  'ambiguity_height_m': found.ambiguity_height_m}
    return bands


def _has_heights(found: PassComparison) -> bool:
    return found.height_m is not None and bool(np.isfinite(found.height_m).any())


def _write_raster(path: Path, bands: dict, pair: Pair, warnings: list[str]) -> list[str]:
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


def _write_report(folder: Path, arguments, pair: Pair, found: PassComparison,
                  pictures: Sequence[str], warnings: Sequence[str]) -> None:
    def shown(*names: str) -> dict[Path, str]:
        return {folder / name: _PICTURES[name] for name in names if name in pictures}

    changes = {f'({c.position_m[0]:.1f}, {c.position_m[1]:.1f}, {c.position_m[2]:.1f}) m':
               f'{c.n_pixels} pixels, coherence {c.coherence:.2f}, power '
               f'{c.power_change_db:+.1f} dB' for c in found.changes[:_SHOWN_CHANGES]}
    contrast = [focus_figure(image.samples).contrast for image in pair.images]
    sections = [
        Section('Changes', shown('change.png', 'coherence.png'), changes,
                [f'A pixel has changed where its coherence is lower than {found.looks:.1f} looks '
                 'and noise explain, with a probability of a false alarm of '
                 f'{found.false_alarm_rate:g}. {1 - found.decidable.mean():.1%} of the pixels are '
                 'too dark or too little coherent to tell.']),
        Section('Phase and height', shown('phase.png', 'height.png'),
                lines=str(found).splitlines()),
        Section('Both passes', shown('first.png', 'second.png'), {
            'first': str(arguments.first), 'second': str(arguments.second),
            'formed by': ', '.join(image.report.method for image in pair.images),
            'contrast': ', '.join(f'{value:.2f}' for value in contrast)}, pair.chosen)]
    write_report(folder / 'report.html',
                 f'Two passes: {arguments.first.name} and {arguments.second.name}', sections,
                 warnings)


if __name__ == '__main__':
    sys.exit(main())
