"""What a job made, for people: a picture of the mosaic and one HTML file."""

from __future__ import annotations

import collections
from collections.abc import Sequence
from pathlib import Path

import numpy as np

import sar_imaging
from sar_imaging.files import replacing
from sar_imaging.formats.quicklook import limits_db

from ...formats.report import Section, write_report
from ..jobs import ApertureScan, Job, Loss, Window, load_scans, union
from .aperture_images import StoredImage, error_db
from .catalogue import all_scans
from .storage import TiledArray
from .tiles import stored_looks

PICTURE, REPORT = 'mosaic.png', 'report.html'
_PICTURE_PX = 1600  # of the longer side
_SHOWN_LOSSES = 100


def write_archive_report(output: Path, job: Job, losses: Sequence[Loss] = ()) -> tuple[str, ...]:
    """Draw the mosaic and write the report; returns the names of the files.

    Parameters
    ----------
    output : Path
        Folder of the job.
    job : Job
        The job.
    losses : sequence of Loss
        What is lost, with its reason, beside recordings that the scan could not read.
    """
    scans = all_scans(output)
    told = [*(loss for scan in load_scans(output) for loss in scan.losses), *losses]
    known = {loss.name for loss in told}
    incomplete = [scan for scan in scans if not _is_complete(output, scan)]
    told += [Loss(scan.name, scan.path, 'its image is not complete; summary.json tells why')
             for scan in incomplete if scan.name not in known]
    files, pictures = [], {}
    mosaic = union(s.window for s in scans) if scans else None
    if mosaic is not None and _power(output, mosaic, job).exists:
        draw_mosaic(output, mosaic, job, incomplete)
        files, pictures = [PICTURE], {output / PICTURE: 'Mosaic, mean in decibels; '
                                      'hatched: apertures that are lost'}
    sections = [
        Section('Mosaic', pictures, _map_rows(job, mosaic)),
        Section('Aperture images', rows=_image_rows(output, scans)),
        Section('Losses', rows={loss.name: loss.reason for loss in told[:_SHOWN_LOSSES]},
                lines=[] if told else ['Nothing is lost.']),
        Section('Parameters', rows={name: str(value) for name, value in job.deciding().items()})]
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
    methods, predicted, measured = collections.Counter(), [], []
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
