"""Jobs and scans in the output folder: JSON that is complete or absent."""

from __future__ import annotations

import dataclasses
import json
import os
import shutil
from pathlib import Path

import sar_imaging
from sar_imaging.files import NEW, naming, replacing, told
from sar_imaging.geometry.earth import Datum
from sar_imaging.imaging.radiometry import Radiometry
from sar_imaging.signal.radar import RadarParameters, Waveform

from .job import Brightness, Job, JobError, Products
from .scans import ApertureScan, Division, Loss, RecordingScan
from .windows import Window

JOB_FILE = 'job.json'
SCANS = 'scans'


def write_text(path: Path, text: str) -> None:
    """Write a file, all of it or nothing; the folder is made."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as part:
        part.write_text(text)
        bring_to_disk(part)


def remove_parts(output: Path) -> None:
    """Remove what killed processes left half done: new files, and in Zarr chunks and arrays.

    Nobody may be writing into the folder meanwhile. Other files are left alone.
    """
    for folder, names, files in os.walk(output):
        stored = any(part.endswith('.zarr') for part in Path(folder).relative_to(output).parts)
        for name in names:
            if name.startswith(NEW) or stored and name.startswith('.'):  # arrays dropped
                shutil.rmtree(Path(folder, name))
        for name in files:
            if stored and name.endswith('.partial'):
                Path(folder, name).unlink(missing_ok=True)


def bring_to_disk(path: Path) -> None:
    """Wait until a file, or the names in a folder, would survive a failure of power."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def write_job(job: Job) -> None:
    """Write ``job.json`` into the job's output folder: the job, its digest and the version."""
    fields = dataclasses.asdict(job) | {'output': str(job.output)}
    text = json.dumps({'version': sar_imaging.__version__, 'digest': job.digest(), 'job': fields},
                      indent=1)
    write_text(job.output / JOB_FILE, text + '\n')


def load_job(output: Path) -> Job:
    """The job of an output folder, whatever folder it was moved to.

    Raises
    ------
    JobError
        The folder has none, or it cannot be read.
    """
    path = Path(output) / JOB_FILE
    try:
        fields = json.loads(path.read_text())['job']
        datum, area = fields['datum'], fields['area_m']
        products, scaled = fields['products'], fields.get('radiometry')
        return Job(**fields | {
            'recordings': tuple(fields['recordings']), 'output': Path(output),
            'datum': None if datum is None else Datum(**datum),
            'area_m': None if area is None else tuple(area),
            'radiometry': scaled and Brightness(**scaled),
            'products': Products(**products | {'images': tuple(products['images'])})})
    except (OSError, KeyError, TypeError, ValueError) as error:
        raise JobError(f'{path} holds no job of an archive ({told(error)}); expected the output '
                       'folder of one; name another folder') from error


def scan_file(recording: str) -> str:
    """File of a recording's scan below the output folder."""
    return f'{SCANS}/{recording}.json'


def write_scan(output: Path, scan: RecordingScan) -> None:
    """Write what the scan of a recording told."""
    text = json.dumps(dataclasses.asdict(scan), default=str, indent=1)
    write_text(output / scan_file(scan.name), text + '\n')


def load_scan(output: Path, recording: str) -> RecordingScan:
    """What the scan of a recording told.

    Raises
    ------
    JobError
        It was not scanned, or what is stored is damaged.
    """
    path = Path(output) / scan_file(recording)
    with naming(path, 'is no scan of a recording; remove it, and the next run makes it', JobError):
        if not path.is_file():
            raise ValueError('there is no such file')
        told = json.loads(path.read_text())
        losses = (Loss(loss['name'], loss['path'] and Path(loss['path']), loss['reason'])
                  for loss in told['losses'])
        return RecordingScan(told['name'], tuple(map(_aperture, told['apertures'])),
                             tuple(losses))


def load_scans(output: Path) -> list[RecordingScan]:
    """What all scans of an output folder told, by the names of the recordings."""
    names = sorted(path.stem for path in (Path(output) / SCANS).glob('*.json'))
    return [load_scan(output, name) for name in names]


def _aperture(fields: dict) -> ApertureScan:
    radar, division, datum = fields['radar'], fields['division'], fields['datum']
    scaled = fields.get('radiometry')
    return ApertureScan(**fields | {
        'path': Path(fields['path']),
        'radar': RadarParameters(**radar | {'waveform': Waveform(radar['waveform'])}),
        'datum': None if datum is None else Datum(**datum),
        'centre_m': tuple(fields['centre_m']),
        'footprint_m': tuple(map(tuple, fields['footprint_m'])),
        'window': Window(**fields['window']), 'warnings': tuple(fields['warnings']),
        'radiometry': scaled and Radiometry(**scaled),
        'division': Division(**division | {
            'windows': tuple(Window(**w) for w in division['windows']),
            'pulses': tuple(map(tuple, division['pulses']))})})
