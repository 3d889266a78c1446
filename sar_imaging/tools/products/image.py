# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Image a recording or a CPHD file: picture, SICD, GeoTIFF, measured error and a report.

Run: sar-imaging image bags/countryside --output out/countryside
"""

from __future__ import annotations

import argparse
import dataclasses
import math
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from sar_imaging.configuration.scene_grid import GridChoice
from sar_imaging.files import filling, write_json
from sar_imaging.formats import (
    require,
    write_geotiff,
    write_quicklook,
    write_sicd,
    write_stac_item,
)
from sar_imaging.geometry.grids import MapGrid
from sar_imaging.imaging.image import Image
from sar_imaging.quality import focus_figure, measure_scatterer
from sar_imaging.signal.magnitudes import SPEED_OF_LIGHT

from ...formats.report import ReportSection, write_report
from ...recordings.pulse_source import (
    PulseSource,
    SourceError,
    acquisition_with_antenna,
    open_pulses,
)
from ..arguments import add_pulses, datum_of
from ..plots import save_image_png
from ..program import command_parser, main_of
from . import brightness, forming, volume
from .figures import save_acquisition_png

FORMATS = ('png', 'geotiff', 'sicd', 'kml', 'stac')
FILES = {'png': 'image.png', 'geotiff': 'image.tif', 'sicd': 'image.nitf', 'kml': 'overlay.png',
         'stac': 'image.json'}
_NEEDS = {'geotiff': ('rasterio', 'writing GeoTIFF'), 'sicd': ('sarkit.sicd', 'writing SICD'),
          'kml': ('rasterio', 'writing KML'), 'stac': ('pystac', 'writing a STAC item')}
_MAPS = ('geotiff', 'kml')  # formats that hold images on level planes only

_EPILOG = """\
Writes image.npy (complex64), the formats asked for, quality.json and report.html. What the file
does not state is chosen, and the report says what was chosen and how to change it. The window of a
recording weighs its image, unless SICD is asked for, which describes images without one.

  sar-imaging image bags/countryside --output out/countryside
  sar-imaging image scene.cphd --output out/scene --format sicd,geotiff,png
  sar-imaging image scene.cphd --output out/part --centre 120 -40 --size 200 --spacing 0.25

With --height it images a volume and writes cloud.ply (x, y, z, intensity in dB above the median),
volume.png, volume.npy and quality.json:

  sar-imaging image bags/scan --output out/scan --height 1.2 --threshold 30
"""


def parser() -> argparse.ArgumentParser:
    """Command-line parser."""
    p = command_parser('sar-imaging image', 'Image a recording (rosbag2 folder) or a CPHD file.',
                       _EPILOG)
    add_pulses(p)
    p.add_argument('--format', type=_formats, default=('png',), metavar='NAME[,NAME]',
                   help=f'of the image: {", ".join(FORMATS)} (default: png)')
    forming.add_arguments(p)
    brightness.add_arguments(p)
    volume.add_arguments(p)
    return p


def _formats(text: str) -> tuple[str, ...]:
    names = tuple(dict.fromkeys(text.lower().split(',')))
    unknown = [name for name in names if name not in FORMATS]
    if unknown:
        raise argparse.ArgumentTypeError(f'there is no format {", ".join(unknown)}; use '
                                         f'{", ".join(FORMATS)}')
    return names


def run(arguments: argparse.Namespace) -> str:
    """Image the file and write all products; returns a summary for people."""
    source = open_pulses(arguments.file, aperture=arguments.aperture,
                         datum=datum_of(arguments))
    if 'sicd' not in arguments.format:  # which describes responses without a window
        source = forming.weighted(source)
    if arguments.height is not None:
        return volume.run(arguments, source)
    _check_formats(arguments, source)
    constant = brightness.constant_of(arguments)
    choice = forming.choose(source, arguments)
    formed = forming.form_and_verify(source, choice, arguments)
    image, quality, calibration = formed.image, describe(formed), {}
    if constant is not None:
        response = brightness.respond(source, choice)
        image, quality['brightness'] = brightness.calibrate_image(
            response, image, arguments.brightness, constant)
        calibration = {'response': response, 'constant': constant}
    with filling(arguments.output) as folder:
        written = write_products(folder, arguments.format, source, choice, image, calibration)
        write_json(folder / 'quality.json', quality)
        _write_report(folder, source, choice, image, quality)
    names = ', '.join([*written, 'image.npy', 'quality.json', 'report.html'])
    return '\n'.join([
        f'{image.shape[1]} by {image.shape[0]} pixels of {choice.spacing_m:g} m in '
        f'{formed.seconds:.1f} s by {image.report.method}', f'error: {_errors(quality)}',
        *(f'warning: {text}' for text in quality['warnings']),
        f'written to {arguments.output}: {names}'])


def _check_formats(arguments: argparse.Namespace, source: PulseSource) -> None:
    """Refuse before the work what cannot be written after it."""
    placed = [name for name in arguments.format if name in _NEEDS]
    if placed and source.datum is None:
        raise SourceError(f'{source.path} does not state where on the Earth it is, which '
                          f'{" and ".join(placed)} need: give --datum LATITUDE LONGITUDE HEIGHT')
    maps = [name for name in arguments.format if name in _MAPS]
    if arguments.plane == 'slant' and maps:
        raise SourceError(f'{" and ".join(maps)} hold maps; leave out --plane slant, or the '
                          f'format {" and ".join(maps)}')
    for name in placed:
        require(*_NEEDS[name])


def write_products(folder: Path, formats: Sequence[str], source: PulseSource, choice: GridChoice,
                   image: Image, calibration: Mapping[str, object]) -> list[str]:
    """Write the image in some formats, and always a picture; returns the names of the files.

    Pictures of calibrated images show the quantity's own decibels. `calibration` is what
    `write_sicd` takes for scale factors.
    """
    quantity = None if image.radiometry is None else image.radiometry.quantity
    np.save(folder / 'image.npy', image.samples)
    grid, axes = forming.drawn_grid(choice)
    known = source.scatterers if isinstance(choice.grid, MapGrid) else ()
    title = forming.title_of(source)
    save_image_png(folder / FILES['png'], image.samples, grid, truth=known,
                   title=f'{title}; {axes}' if axes else title, quantity=quantity)
    written = [FILES['png']]
    files = {name: folder / FILES[name] for name in ('png', *formats)}
    if 'geotiff' in files:
        write_geotiff(files['geotiff'], image, source.datum)
        written.append(FILES['geotiff'])
    if 'sicd' in files:
        write_sicd(files['sicd'], image, source.datum, acquisition_with_antenna(source),
                   classification=source.collection.classification, **calibration)
        written.append(FILES['sicd'])
    if 'kml' in files:
        overlay = write_quicklook(files['kml'], image, source.datum)
        written += [path.name for path in overlay]
        files |= {'kml': overlay[-1], 'overlay': overlay[0]}  # which the former shows
    if 'stac' in files:
        write_stac_item(files['stac'], image, source.datum, source.acquisition(),
                        {name: path for name, path in files.items() if name != 'stac'})
        written.append(FILES['stac'])
    return written


def describe(formed: forming.Formed) -> dict[str, Any]:
    """Contents of quality.json."""
    source, choice, image = formed.source, formed.choice, formed.image
    quality, report, focus = formed.figures(), image.report, focus_figure(image.samples)
    warnings = quality['warnings']
    if source.missing:
        warnings.append(f'{source.missing} pulses are missing between the first and the last')
    if focus.at_noise_level:
        warnings.append('nothing in the image stands out from noise: are place and height of the '
                        'scene right? sar-imaging doctor looks for other mistakes')
    return quality | {
        'format': source.kind, 'pulses_missing': source.missing, 'plane': choice.plane,
        'spacing_m': choice.spacing_m, 'window': source.window,
        'resolution_m': {'range': choice.range_resolution_m,
                         'azimuth': choice.azimuth_resolution_m},
        'datum': None if source.datum is None else dataclasses.asdict(source.datum),
        'reason': report.reason, 'errors_db': dict(report.errors_db),
        'focus': {'peak_over_median_db': round(focus.peak_over_median_db, 2),
                  'entropy': round(focus.entropy, 4), 'contrast': round(focus.contrast, 4),
                  'at_noise_level': focus.at_noise_level},
        'scatterers': _scatterers(source, choice, image)}


def _scatterers(source: PulseSource, choice: GridChoice, image: Image) -> list[dict[str, Any]]:
    """Known scatterers on a map, measured."""
    if source.cut_half_width_m is None or not isinstance(choice.grid, MapGrid):
        return []
    range_m, azimuth_m = source.cut_half_width_m
    wavenumber = 4 * math.pi * image.carrier_hz / source.radar.propagation_speed_m_per_s
    return [measure_scatterer(
        image.samples, choice.grid, s['position_m'], aperture_centre_m=source.track_m.mean(axis=0),
        wavenumber_rad_per_m=wavenumber, cut_half_width_range_m=range_m,
        cut_half_width_azimuth_m=azimuth_m, name=s['name'],
        neighbours_m=[o['position_m'] for o in source.scatterers if o is not s]).as_json()
        for s in source.scatterers]


def _errors(quality: dict[str, Any]) -> str:
    predicted, measured = quality['predicted_error_db'], quality['measured_error']
    return (('not predicted' if predicted is None else f'{predicted:.1f} dB predicted')
            + (', not measured' if measured is None or measured['error_db'] is None
               else f', {measured["error_db"]:.1f} dB measured')
            + f', {quality["target_db"]:g} dB wanted')


def _write_report(folder: Path, source: PulseSource, choice: GridChoice, image: Image,
                  quality: dict[str, Any]) -> None:
    drawing = folder / 'acquisition.png'
    rows, columns = image.shape
    corners = choice.grid.positions(np.array([0, 0, rows - 1, rows - 1]),
                                    np.array([0, columns - 1, columns - 1, 0]))
    save_acquisition_png(drawing, source.track_m, corners)
    errors = {f'predicted: {cause}': f'{error:.1f} dB'
              for cause, error in quality['errors_db'].items()}
    sections = [
        ReportSection('Image', {folder / FILES['png']: 'Amplitude, decibels'}, {
            'pixels': f'{columns} by {rows}, {choice.spacing_m:g} m apart, {choice.plane} plane',
            'resolution (peak to null)': f'{choice.range_resolution_m:.3g} m in range, '
                                         f'{choice.azimuth_resolution_m:.3g} m along the track',
            'formed by': f'{image.report.method}: {image.report.reason}',
            'time': f'{quality["seconds"]:.2f} s',
            'place': 'not known' if source.datum is None else
            f'{source.datum.latitude_deg:.6f}\N{DEGREE SIGN}, '
            f'{source.datum.longitude_deg:.6f}\N{DEGREE SIGN}, '
            f'{source.datum.height_m:.1f} m above WGS 84 (origin of the frame)'},
            quality['chosen']),
        ReportSection('Acquisition', {drawing: 'Track and image'}, radar_rows(source, corners)),
        ReportSection('Error against time-domain correlation', rows={
            'wanted, predicted, measured': _errors(quality), **errors,
            **_measured_rows(quality['measured_error'])})]
    write_report(folder / 'report.html', f'SAR image of {source.path.name}', sections,
                 quality['warnings'])
    drawing.unlink()


def _measured_rows(measured: dict[str, Any] | None) -> dict[str, str]:
    if measured is None:
        return {}
    told = {'measured over the image': ('error_db', 'n_pixels'),
            'measured on the brightest pixels': ('brightest_error_db', 'n_brightest')}
    return {name: f'{measured[error]:.1f} dB ({measured[number]} pixels)'
            for name, (error, number) in told.items() if measured[error] is not None}


def radar_rows(source: PulseSource, corners_m: np.ndarray) -> dict[str, str]:
    """Radar and geometry for a table."""
    radar, track = source.radar, source.track_m
    sight = corners_m.mean(axis=0) - track.mean(axis=0)
    distance = float(np.linalg.norm(sight))
    seconds = float(source.stamp_ns.max() - source.stamp_ns.min()) * 1e-9
    length = float(np.linalg.norm(np.diff(track, axis=0), axis=1).sum())
    along = track[-1] - track[0]
    squint = round(math.degrees(math.asin(np.clip(
        along @ sight / max(np.linalg.norm(along) * distance, 1e-9), -1, 1))), 1)
    near, far = source.coverage().swath_m
    rows = {
        'file': f'{source.path.name} ({source.kind})',
        'carrier, bandwidth': f'{radar.carrier_hz / 1e9:.6g} GHz, '
                              f'{radar.bandwidth_hz / 1e6:.6g} MHz',
        'waveform': f'{radar.waveform.name}, '
                    + ('range profiles' if source.compressed else 'raw pulses'),
        'pulses, channels, samples': f'{source.n_pulses}, {source.n_channels}, '
                                     f'{source.n_samples}',
        'duration': f'{seconds:.3g} s' + (
            f', {(source.n_pulses - 1) / seconds:.4g} pulses per second' if seconds else ''),
        'track': f'{length:.4g} m' + (f', {length / seconds:.4g} m/s' if seconds else ''),
        'range to the middle': f'{distance:.5g} m, profiles cover {near:.5g} to {far:.5g} m',
        'grazing angle': f'{math.degrees(math.asin(np.clip(-sight[2] / distance, -1, 1))):.1f}'
                         '\N{DEGREE SIGN}' if distance else '',
        'squint': f'{squint + 0.0:+.1f}\N{DEGREE SIGN} forward of broadside'}
    if radar.propagation_speed_m_per_s != SPEED_OF_LIGHT:
        rows['speed of the waves'] = f'{radar.propagation_speed_m_per_s:g} m/s'
    return rows


main = main_of(parser, run, quiet=True)

if __name__ == '__main__':
    sys.exit(main())
