# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""What a job made: a STAC catalogue for programs, a picture and a report for people.

``catalog.json`` is a collection. Each aperture image, strip, mosaic and pair is an item below
``items/``, with the recording and pulses, the software and its parameters, the error predicted
and measured, and links to what it was derived from.
"""

from __future__ import annotations

import collections
import datetime
import json
import math
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

import sar_imaging

from ..files import replacing
from ..formats import require
from ..formats.acquisition import date_of
from ..formats.quicklook import limits_db
from ..formats.report import ReportSection, write_report
from ..formats.stac import SAR, add_asset, footprint, radar_properties
from ..imaging.radiometry import Radiometry
from .images import StoredImage, error_db
from .job import Job
from .pieces import PieceResult
from .scans import ApertureScan, ScanLoss, all_scans, load_scans, write_text
from .storage import COHERENCE, IMAGES, MOSAIC, STRIPS, TiledArray
from .tiles import stored_looks
from .windows import Window, box, surface_points, union

CATALOGUE, ITEMS = 'catalog.json', 'items'
_PROCESSING = 'https://stac-extensions.github.io/processing/v1.2.0/schema.json'
_OUR = 'sar_imaging:'


def write_catalogue(job: Job, output: Path) -> PieceResult:
    """Write the catalogue of what is there; without a datum there is no place to tell."""
    if job.datum is None:
        return PieceResult(warnings=(
            'no STAC catalogue: neither the job nor a recording tells where on the Earth the map '
            'is; give datum',))
    scans = all_scans(output)
    makers = _Items(job, output)
    names, boxes, times = [], [], []
    for item in makers.all(scans):
        item.collection_id = _name(job)
        item.add_link(makers.link('collection', f'../{CATALOGUE}'))
        write_text(output / ITEMS / f'{item.id}.json',
                   json.dumps(item.to_dict(include_self_link=False), indent=1) + '\n')
        names.append(item.id)
        boxes.append(item.bbox)
        times += [item.common_metadata.start_datetime, item.common_metadata.end_datetime]
    if not names:
        return PieceResult(warnings=('no STAC catalogue: nothing was imaged',))
    write_text(output / CATALOGUE, json.dumps(_collection(job, names, boxes, times), indent=1)
               + '\n')
    return PieceResult(files=(CATALOGUE, *(f'{ITEMS}/{name}.json' for name in names)),
                       found={'items': len(names)})


def _collection(job: Job, names: Sequence[str], boxes: Sequence[Sequence[float]],
                times: Sequence[datetime.datetime]) -> dict[str, object]:
    """``catalog.json``, written by hand: pystac would read all items again."""
    west, south, east, north = np.array(boxes).T
    return {
        'type': 'Collection', 'stac_version': '1.1.0', 'id': _name(job),
        'description': f'Images of an archive, {job.spacing_m:g} m apart, formed by sar_imaging '
                       f'{sar_imaging.__version__}',
        'license': 'other', 'stac_extensions': [],
        'extent': {'spatial': {'bbox': [[float(west.min()), float(south.min()),
                                         float(east.max()), float(north.max())]]},
                   'temporal': {'interval': [[_text(min(times)), _text(max(times))]]}},
        'links': [{'rel': 'root', 'href': './catalog.json', 'type': 'application/json'},
                  *({'rel': 'item', 'href': f'./{ITEMS}/{name}.json',
                     'type': 'application/geo+json'} for name in names)]}


def _name(job: Job) -> str:
    return job.output.name or 'archive'


def _text(moment: datetime.datetime) -> str:
    return moment.isoformat().replace('+00:00', 'Z')


def _brightness(told: Radiometry | None) -> dict[str, object]:
    """What the squared magnitude of an image is; nothing where it is not calibrated."""
    if told is None:
        return {}
    noise = told.noise_equivalent_db
    return {f'{_OUR}quantity': told.quantity, f'{_OUR}incidence_deg': told.incidence_deg,
            f'{_OUR}noise_equivalent_db': noise if math.isfinite(noise) else None}


def _errors(figures: list[dict[str, Any]]) -> dict[str, object]:
    """Errors of the images that something is made of."""
    predicted = [f['predicted_error_db'] for f in figures if f['predicted_error_db'] is not None]
    return {f'{_OUR}predicted_error_db': max(predicted, default=None),
            f'{_OUR}measured_error_db': error_db(figures),
            f'{_OUR}checked_pixels': sum(f['n_checked'] for f in figures)}


class _Items:
    """Makes items of a job."""

    def __init__(self, job: Job, output: Path):
        self._stac = require('pystac', 'writing a STAC catalogue')
        self._job, self._output = job, output
        self._made = datetime.datetime.now(datetime.timezone.utc)

    def link(self, rel: str, href: str, media: str = 'application/json') -> Any:
        """A link as it stands in a file."""
        return self._stac.Link(rel, href, media)

    def all(self, scans: list[ApertureScan]) -> Iterator[Any]:
        """Items of images, strips, the mosaic and pairs that are there."""
        imaged = [scan for scan in scans if StoredImage.open(self._output, scan.name)]
        by_name = {scan.name: scan for scan in imaged}
        for scan in imaged:
            yield self._image(scan)
        strips: dict[str, list[ApertureScan]] = {}
        for scan in imaged:
            strips.setdefault(scan.recording, []).append(scan)
        for name, own in strips.items():
            if (self._output / STRIPS / name).is_dir():
                yield self._of_many(f'strip-{name}', 'strip', own, {
                    'zarr': f'{STRIPS}/{name}', 'power': f'strips/{name}.tif',
                    'looks': f'strips/{name}_looks.tif'})
        if (self._output / MOSAIC).is_dir() and imaged:
            yield self._of_many('mosaic', 'mosaic', imaged, {
                'zarr': MOSAIC, 'power': 'mosaic.tif', 'looks': 'mosaic_looks.tif',
                'overview': 'mosaic.png'})
        for path in sorted((self._output / COHERENCE).glob('*/coherence/.zattrs')):
            told, pair = json.loads(path.read_text()), path.parent.parent.name
            own = [by_name[name] for name in (told['first'], told['second']) if name in by_name]
            if len(own) == 2:
                yield self._of_many(f'coherence-{pair}', 'coherence', own, {
                    'zarr': f'{COHERENCE}/{pair}', 'coherence': f'coherence/{pair}.tif',
                    'phase': f'coherence/{pair}_phase.tif'})

    def _image(self, scan: ApertureScan) -> Any:
        figures = self._figures([scan])
        item = self._item(f'image-{scan.name}', 'image', [scan], {
            **radar_properties(scan.radar),
            f'{_OUR}recording': str(scan.path), f'{_OUR}recording_fingerprint': scan.fingerprint,
            f'{_OUR}aperture': scan.aperture, f'{_OUR}pulses': scan.n_pulses,
            f'{_OUR}channels': scan.n_channels,
            f'{_OUR}method': ', '.join(dict.fromkeys(f['method'] for f in figures)),
            **_errors(figures), **_brightness(scan.radiometry),
            f'{_OUR}complete_pieces': [len(figures), len(scan.division.windows)],
            f'{_OUR}warnings': list(dict.fromkeys(
                [*scan.warnings, *(text for f in figures for text in f['warnings'])]))})
        item.stac_extensions.append(SAR)
        item.add_link(self.link('derived_from', _relative(scan.path, self._output / ITEMS),
                                'application/octet-stream'))
        self._add_assets(item, {'zarr': f'{IMAGES}/{scan.name}',
                                'geotiff': f'images/{scan.name}.tif',
                                'sicd': f'images/{scan.name}.nitf'})
        return item

    def _figures(self, scans: Iterable[ApertureScan]) -> list[dict[str, Any]]:
        """What is known of the complete parts of some images."""
        return [figures for scan in scans for figures in
                StoredImage.open(self._output, scan.name).figures(self._output)]

    def _of_many(self, name: str, kind: str, scans: list[ApertureScan], assets: Mapping[str, str]
                 ) -> Any:
        """Item of what was made of several images."""
        item = self._item(name, kind, scans, {
            f'{_OUR}apertures': len(scans), f'{_OUR}pulses': sum(s.n_pulses for s in scans),
            f'{_OUR}recordings': list(dict.fromkeys(scan.recording for scan in scans)),
            **_errors(self._figures(scans))})
        for scan in scans:
            item.add_link(self.link('derived_from', f'image-{scan.name}.json',
                                    'application/geo+json'))
        self._add_assets(item, assets)
        return item

    def _item(self, name: str, kind: str, scans: list[ApertureScan],
              properties: Mapping[str, object]) -> Any:
        job = self._job
        first, last = (date_of(f(getattr(scan, which) for scan in scans))
                       for f, which in ((min, 'first_ns'), (max, 'last_ns')))
        geometry, bbox = footprint(self._corners([s.footprint_m for s in scans]))
        return self._stac.Item(
            name, geometry, bbox, first + (last - first) / 2,
            dict(properties) | {
                'created': _text(self._made), 'gsd': job.spacing_m, f'{_OUR}kind': kind,
                'processing:software': {'sar_imaging': sar_imaging.__version__},
                f'{_OUR}parameters': job.deciding(), f'{_OUR}digest': job.digest()},
            first, last, [_PROCESSING])

    def _corners(self, footprints: Iterable[tuple[tuple[float, float], ...]]) -> np.ndarray:
        """(N, 2) latitude and longitude of a footprint, or of the rectangle around several."""
        corners = np.array([corner for one in footprints for corner in one], float)
        if len(corners) > 4:
            corners = box(corners)
        latitude, longitude, _ = self._job.datum.to_geographic(surface_points(self._job, corners))
        return np.column_stack([latitude, longitude])

    def _add_assets(self, item: Any, files: Mapping[str, str]) -> None:
        for key, name in files.items():
            if (self._output / name).exists():
                add_asset(item, key, self._output / name, self._output / ITEMS)


def _relative(path: Path, folder: Path) -> str:
    return Path(os.path.relpath(path, folder)).as_posix()


PICTURE, REPORT = 'mosaic.png', 'report.html'
_PICTURE_PX = 1600  # of the longer side
_SHOWN_LOSSES = 100


def write_archive_report(output: Path, job: Job) -> tuple[str, ...]:
    """Draw the mosaic and write the report; returns the names of the files.

    Parameters
    ----------
    output : Path
        Folder of the job.
    job : Job
        The job.
    """
    scans = all_scans(output)
    told = [loss for scan in load_scans(output) for loss in scan.losses]
    known = {loss.name for loss in told}
    incomplete = [scan for scan in scans if not _is_complete(output, scan)]
    told += [ScanLoss(scan.name, scan.path, 'its image is not complete; summary.json tells why')
             for scan in incomplete if scan.name not in known]
    files, pictures = [], {}
    mosaic = union(s.window for s in scans) if scans else None
    if mosaic is not None and _power(output, mosaic, job).exists:
        draw_mosaic(output, mosaic, job, incomplete)
        files, pictures = [PICTURE], {output / PICTURE: 'Mosaic, mean in decibels; '
                                      'hatched: apertures that are lost'}
    sections = [
        ReportSection('Mosaic', pictures, _map_rows(job, mosaic)),
        ReportSection('Aperture images', rows=_image_rows(output, scans)),
        ReportSection('Losses', rows={loss.name: loss.reason for loss in told[:_SHOWN_LOSSES]},
                      lines=[] if told else ['Nothing is lost.']),
        ReportSection('Parameters',
                      rows={name: str(value) for name, value in job.deciding().items()})]
    warnings = [f'{len(told)} recordings, apertures or pieces are lost, see below'] if told else []
    write_report(output / REPORT, f'Archive {output.name}', sections, warnings)
    return (*files, REPORT)


def _is_complete(output: Path, scan: ApertureScan) -> bool:
    image = StoredImage.open(output, scan.name)
    return image is not None and image.complete(output, scan.window)


def _map_rows(job: Job, mosaic: Window | None) -> dict[str, str]:
    datum = job.datum
    rows = {'pixels': 'none' if mosaic is None else
            f'{mosaic.shape[1]} by {mosaic.shape[0]}, {job.spacing_m:g} m apart, '
            f'{mosaic.n_pixels / 1e6:.4g} million, in tiles of {job.tile}',
            'place': "not known: metres of the recordings' frame; no GeoTIFF and no STAC"
            if datum is None else
            f'{datum.latitude_deg:.6f}\N{DEGREE SIGN}, {datum.longitude_deg:.6f}\N{DEGREE SIGN}, '
            f'{datum.height_m:.1f} m above WGS 84 (origin of the frame)'}
    if job.radiometry is not None:
        rows['brightness'] = f'{job.radiometry.quantity}, gain {job.radiometry.gain_m:g} m'
    return rows | {'surface': job.surface, 'software': f'sar_imaging {sar_imaging.__version__}'}


def _image_rows(output: Path, scans: Sequence[ApertureScan]) -> dict[str, str]:
    methods: collections.Counter[str] = collections.Counter()
    predicted, measured = [], []
    n_pulses = n_images = 0
    for scan in scans:
        image = StoredImage.open(output, scan.name)
        figures = [] if image is None else image.figures(output)
        if figures:
            n_images, n_pulses = n_images + 1, n_pulses + scan.n_pulses
            methods.update({f['method'] for f in figures})
            predicted += [f['predicted_error_db'] for f in figures]
            measured.append(error_db(figures))
    return {'images': f'{n_images} of {len(scans)} apertures, {n_pulses} pulses',
            'formed by': ', '.join(f'{name}: {n}' for name, n in sorted(methods.items())),
            'error predicted': _range(predicted), 'error measured': _range(measured)}


def _range(values: Sequence[float | None]) -> str:
    known = [value for value in values if value is not None]
    if not known:
        return 'not known'
    return (f'{np.median(known):.1f} dB in the middle, {max(known):.1f} dB at most, of '
            f'{len(known)}')


def draw_mosaic(output: Path, mosaic: Window, job: Job,
                lost: Sequence[ApertureScan] = ()) -> None:
    """Draw the mosaic, reduced to some 1600 pixels, with lost apertures hatched."""
    import matplotlib
    from matplotlib.figure import Figure
    from matplotlib.patches import Polygon

    power = reduced(_power(output, mosaic, job), mosaic, _PICTURE_PX)
    with np.errstate(divide='ignore', invalid='ignore'):
        level = 10 * np.log10(power)
    level[~np.isfinite(level)] = np.nan
    black, white = limits_db(level)
    half = job.spacing_m / 2
    extent = (mosaic.column0 * job.spacing_m - half, mosaic.column1 * job.spacing_m - half,
              half - mosaic.row1 * job.spacing_m, half - mosaic.row0 * job.spacing_m)
    figure = Figure(figsize=(10, 10 * min(2.0, max(0.3, mosaic.shape[0] / mosaic.shape[1]))),
                    layout='constrained')
    axes = figure.add_subplot()
    axes.imshow(level, cmap=matplotlib.colormaps['gray'].with_extremes(bad='#404870'),
                vmin=black, vmax=white, extent=extent, interpolation='nearest')
    for scan in lost:
        axes.add_patch(Polygon(scan.footprint_m, fill=False, hatch='//', color='#e04040'))
    quantity = 'power' if job.radiometry is None else job.radiometry.quantity
    axes.set(xlabel='x (m)', ylabel='y (m)',
             title=f'mean {quantity}, {black:.0f} to {white:.0f} dB')
    with replacing(output / PICTURE) as part:
        figure.savefig(part, format='png', dpi=120)


def _power(output: Path, mosaic: Window, job: Job) -> TiledArray:
    return stored_looks(output, '', mosaic.on_tiles(job.tile), job.tile)[0]


def reduced(array: TiledArray, window: Window, most: int) -> np.ndarray:
    """(rows, columns) float64 means over squares of a window, `most` along an axis at most.

    NaN where nothing is known. One tile is in memory at a time.
    """
    factor = -(-max(window.shape) // most)
    total, count = np.zeros((2, *(-(-n // factor) for n in window.shape)))
    for tile in window.tiles(array.tile):
        if not array.has(tile):
            continue
        inside = tile.intersection(window)
        values = array.read(inside).astype(np.float64)
        cut = inside.within(window)
        starts = [_starts(part, factor) for part in cut]
        index = np.ix_(*((part.start + start) // factor
                         for part, start in zip(cut, starts, strict=True)))
        known = np.isfinite(values)
        for out, part in ((total, np.where(known, values, 0.0)), (count, known.astype(float))):
            for axis, start in enumerate(starts):
                part = np.add.reduceat(part, start, axis=axis)
            out[index] += part
    with np.errstate(invalid='ignore'):
        return total / count


def _starts(part: slice, factor: int) -> np.ndarray:
    """Where squares begin within a part, which may begin within a square."""
    first = -part.start % factor
    return np.unique(np.concatenate([[0], np.arange(first, part.stop - part.start, factor)]))
