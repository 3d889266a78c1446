# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Tell what a file holds: when and where it was made, by what radar, how finely, how large.

Run: sar-imaging info scene.cphd
"""

from __future__ import annotations

import argparse
import dataclasses
import sys
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np

from ...files import reading
from ...formats import require
from ...formats.acquisition import date_of
from ...formats.cphd import CphdReader
from ...formats.sicd.container import SicdContainer
from ...formats.sicd.reader import Fields
from ...geometry.earth import Datum
from ...geometry.grids import MapGrid
from ...recordings import open_pulses, read_recording
from ...recordings.kinds import CPHD, GEOTIFF, RECORDING, SICD, kind_of
from ...signal.radar import RadarParameters, Waveform
from ..program import main_of

_LABEL_WIDTH = 14
_UNITS = ((1e9, 'GB'), (1e6, 'MB'), (1e3, 'kB'))


@dataclasses.dataclass(frozen=True)
class FileSummary:
    """What is told of a file.

    Parameters
    ----------
    rows : tuple of (str, str)
        Label and text.
    warnings : tuple of str
        What a person should know.
    """

    rows: tuple[tuple[str, str], ...]
    warnings: tuple[str, ...] = ()

    def __str__(self) -> str:
        return '\n'.join([*(f'{label:<{_LABEL_WIDTH}}{text}' for label, text in self.rows),
                          *(f'warning: {text}' for text in self.warnings)])


def of_recording(path: Path) -> FileSummary:
    """What a recording holds; reads through all of it."""
    recording = read_recording(path)
    truth, radar = recording.truth or {}, recording.radar
    missing = int(recording.counter.max() - recording.counter.min() + 1
                  - len(np.unique(recording.counter)))
    rows = [('what', _joined(f'recording {path.name}', truth.get('description'))),
            ('when', _when(recording.stamp_ns.min(), recording.stamp_ns.max())),
            ('where', _datum(recording.datum) if recording.datum else 'not stated'),
            ('radar', _radar(radar, compressed=truth.get('compressed', False))),
            ('resolution', f'{_length(radar.range_resolution_m)} in range'),
            ('scene', _scene(recording.grid)),
            ('channels', str(truth.get('n_channels', 'not stated'))),
            ('pulses', f'{len(recording.counter)} in {recording.n_messages} messages'),
            ('size', _bytes(sum(f.stat().st_size for f in path.iterdir() if f.is_file())))]
    warnings = []
    if missing > 0:
        warnings.append(f'{missing} pulses are missing between the first and the last')
    if recording.n_unreadable:
        warnings.append(f'{recording.n_unreadable} messages hold no pulse block')
    if recording.phase_centre_m is None:
        warnings.append('it has neither phase centres nor poses: it cannot be imaged alone')
    return FileSummary(tuple(rows), tuple(warnings))


def of_pulses(path: Path) -> FileSummary:
    """What `open_pulses` tells of a file; reads all of it."""
    source = open_pulses(path)
    return FileSummary((
        ('what', f'{source.kind} {path.name}'),
        ('when', _when(source.stamp_ns.min(), source.stamp_ns.max())),
        ('where', _datum(source.datum) if source.datum else 'not stated'),
        ('radar', _radar(source.radar, compressed=source.compressed)),
        ('resolution', f'{_length(source.radar.range_resolution_m)} in range'),
        ('scene', _scene(source.grid)), ('channels', str(source.n_channels)),
        ('pulses', f'{source.n_pulses} of {source.n_samples} samples'),
        ('size', f'{_bytes(source.n_bytes)} in memory')), source.warnings)


def of_cphd(path: Path) -> FileSummary:
    """What a CPHD file holds; reads no samples."""
    with CphdReader(path) as reader:
        collection, container = reader.collection, reader.container
        range_m, across_m = reader.resolution_m
        area = reader.area_m
        away = np.linalg.norm((reader.tx_m + reader.rx_m) / 2 - area.mean(axis=0), axis=-1)
        polarisations = ', '.join(
            f'{name} ({":".join(p)})' for name, p in zip(
                collection.channels, collection.polarisations, strict=True))
        return FileSummary((
            ('what', f'CPHD {container.version}, {collection.collector_name}, '
                     f'{collection.core_name}, {collection.mode_type.lower()}, '
                     f'{collection.collect_type.lower()}, {collection.classification}'),
            ('when', _when(reader.stamp_ns[0], reader.stamp_ns[-1])),
            ('where', _datum(reader.datum)),
            ('radar', _radar(reader.radar, compressed=reader.compressed)),
            ('range', f'{_length(away.min())} to {_length(away.max())} to the middle'),
            ('resolution', f'{_length(range_m)} in range, {_length(across_m)} across'),
            ('footprint', _footprint(area, reader.datum)),
            ('channels', f'{reader.n_channels}: {polarisations}'),
            ('pulses', f'{reader.n_pulses} of {reader.n_samples} samples, domain '
                       f'{reader.domain}, {container.sample_type}'),
            ('size', _bytes(container.n_bytes))), tuple(reader.warnings))


def of_sicd(path: Path) -> FileSummary:
    """What a SICD file tells; reads no pixels."""
    with reading(path, 'SICD'), open(path, 'rb') as file:
        return _of_sicd(path, Fields(SicdContainer(file).root))


def _of_sicd(path: Path, fields: Fields) -> FileSummary:
    rows, columns = (fields.integer(f'ImageData/Num{n}', 1) for n in ('Rows', 'Cols'))
    start = fields.date('Timeline/CollectStart')
    duration = fields.number('Timeline/CollectDuration')
    low, high = (fields.number(f'RadarCollection/TxFrequency/{n}') for n in ('Min', 'Max'))
    place = Datum(*(fields.number(f'GeoData/SCP/LLH/{n}') for n in ('Lat', 'Lon', 'HAE')))
    spacing = [fields.number(f'Grid/{axis}/SS') for axis in ('Row', 'Col')]
    width = [fields.number(f'Grid/{axis}/ImpRespWid') for axis in ('Row', 'Col')]
    return FileSummary((
        ('what', f'SICD, {fields.text("CollectionInfo/CollectorName", "UNKNOWN")}, '
                 f'{fields.text("CollectionInfo/CoreName", "UNKNOWN")}, '
                 f'{fields.text("CollectionInfo/Classification", "UNKNOWN")}'),
        ('when', f'{start:%Y-%m-%d %H:%M:%S} UTC, {duration:.3g} s'),
        ('where', _datum(place)),
        ('radar', f'{(low + high) / 2e9:.4g} GHz, bandwidth {(high - low) / 1e6:.4g} MHz'),
        ('resolution', f'{_length(width[0])} by {_length(width[1])} (-3 dB)'),
        ('image', f'{rows} by {columns} pixels of {_length(spacing[0])} by '
                  f'{_length(spacing[1])}, {fields.text("Grid/ImagePlane", "plane").lower()} '
                  f'plane, {fields.text("ImageData/PixelType", "")}'),
        ('footprint', f'{_length(rows * spacing[0])} by {_length(columns * spacing[1])}'),
        ('polarisation', fields.text('ImageFormation/TxRcvPolarizationProc', 'not stated')),
        ('size', _bytes(path.stat().st_size))))


def of_geotiff(path: Path) -> FileSummary:
    """What a GeoTIFF tells; reads no pixels."""
    rasterio = require('rasterio', 'reading GeoTIFF')
    warp = require('rasterio.warp', 'reading GeoTIFF')
    with reading(path, 'GeoTIFF'), rasterio.open(path, driver='GTiff') as file:
        warnings = [] if file.crs else ['it does not state where on the Earth it is']
        corners = [file.transform * c for c in ((0, 0), (file.width, 0),
                                                (file.width, file.height), (0, file.height))]
        where = 'not stated'
        if file.crs:
            longitudes, latitudes = warp.transform(file.crs, 'EPSG:4326',
                                                   *zip(*corners, strict=True))
            where = _degrees(latitudes, longitudes)
        steps = [float(np.hypot(file.transform.a, file.transform.d)),
                 float(np.hypot(file.transform.b, file.transform.e))]
        return FileSummary((
            ('what', f'GeoTIFF, {file.count} bands of {file.dtypes[0]}'),
            ('when', file.tags().get('TIFFTAG_DATETIME', 'not stated')),
            ('where', where),
            ('projection', 'none' if not file.crs else file.crs.to_string()[:60]),
            ('image', f'{file.height} by {file.width} pixels of {steps[1]:.4g} by '
                      f'{steps[0]:.4g} {file.crs.linear_units if file.crs else "units"}'),
            ('size', _bytes(path.stat().st_size))), tuple(warnings))


def _scene(grid: MapGrid | None) -> str:
    return 'not stated' if grid is None else (
        f'{grid.n_x} by {grid.n_y} pixels of {_length(grid.spacing_m)} around '
        f'{_point(grid.centre_m)} m')


def _joined(*texts: str | None) -> str:
    return ': '.join(text for text in texts if text)


def _when(first_ns: int, last_ns: int) -> str:
    seconds = (int(last_ns) - int(first_ns)) * 1e-9
    return f'{date_of(first_ns):%Y-%m-%d %H:%M:%S} UTC, {seconds:.3g} s'


def _datum(datum: Datum) -> str:
    heading = f', y axis at {datum.heading_deg:g} degrees' if datum.heading_deg else ''
    return (f'{_degrees([datum.latitude_deg], [datum.longitude_deg])}, height '
            f'{datum.height_m:.1f} m (ellipsoidal){heading}')


def _degrees(latitudes: Iterable[float], longitudes: Iterable[float]) -> str:
    return '; '.join(f'{abs(a):.5f} {"N" if a >= 0 else "S"} {abs(o):.5f} {"E" if o >= 0 else "W"}'
                     for a, o in zip(latitudes, longitudes, strict=True))


def _radar(radar: RadarParameters, *, compressed: bool) -> str:
    waveform = Waveform(radar.waveform).name.lower().replace('_', ' ')
    return (f'{radar.carrier_hz / 1e9:.4g} GHz, bandwidth {radar.bandwidth_hz / 1e6:.4g} MHz, '
            f'{"range profiles" if compressed else waveform}')


def _footprint(area_m: np.ndarray, datum: Datum) -> str:
    sides = np.linalg.norm(np.diff(area_m[:3], axis=0), axis=-1)
    latitudes, longitudes, _ = datum.to_geographic(area_m)
    return (f'{_length(sides[1])} by {_length(sides[0])}: {_degrees(latitudes, longitudes)}')


def _point(values: Iterable[float]) -> str:
    return '(' + ', '.join(f'{v:g}' for v in values) + ')'


def _length(metres: float) -> str:
    return f'{metres / 1e3:.4g} km' if metres >= 999.5 else f'{metres:.3g} m'


def _bytes(count: int) -> str:
    for size, unit in _UNITS:
        if count >= size:
            return f'{count / size:.3g} {unit}'
    return f'{count} bytes'


#: What tells of files of some kinds; `of_pulses` tells of all others.
SUMMARIES: dict[str, Callable[[Path], FileSummary]] = {
    RECORDING: of_recording, CPHD: of_cphd, SICD: of_sicd,
    GEOTIFF: of_geotiff}


def parser() -> argparse.ArgumentParser:
    """Command-line parser."""
    p = argparse.ArgumentParser(
        prog='sar-imaging info',
        description='Tell what a recording, a CPHD, SICD or GeoTIFF file, or a description of '
        'arrays holds, on one screen.')
    p.add_argument('file', type=Path, metavar='FILE', help='file, or folder of a recording')
    return p


def run(arguments: argparse.Namespace) -> str:
    """What the file tells."""
    return str(SUMMARIES.get(kind_of(arguments.file), of_pulses)(arguments.file))


main = main_of(parser, run)


if __name__ == '__main__':
    sys.exit(main())
