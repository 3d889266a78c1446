# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""What scans of recordings tell: apertures with their antennas, or why something is lost.

They are kept in the output folder beside the job, as JSON that is complete or absent; phase
centres, antennas and brightness stand in arrays.
"""

from __future__ import annotations

import dataclasses
import itertools
import json
import os
import shutil
import typing
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

import sar_imaging

from ..files import NEW, naming, replacing, told
from ..geometry.earth import Datum
from ..geometry.illumination import AntennaPattern, PatternCut, Pointing
from ..imaging.radiometry import Radiometry
from ..radiometry import BrightnessScale
from ..signal.radar import RadarParameters
from .job import Job, JobError
from .windows import Window

_CUTS = ('azimuth', 'elevation')


def turned(looks: Pointing | None, own: Datum | None, wanted: Datum | None) -> Pointing | None:
    """Pointing in another frame; the same where either frame stands nowhere."""
    if looks is None or own is None or wanted is None or own == wanted:
        return looks
    return Pointing(*(wanted.vectors_from_ecef(own.vectors_to_ecef(axes))
                      for axes in (looks.boresight, looks.up)))


def antenna_arrays(pattern: AntennaPattern | None, looks: Pointing | None
                   ) -> dict[str, np.ndarray]:
    """An antenna as arrays of a file, to the bit; none where there is no antenna."""
    if pattern is None:
        return {}
    arrays = {'boresight': looks.boresight, 'up': looks.up}
    for name in _CUTS:
        cut = getattr(pattern, name)
        arrays[name] = np.array([cut.start, cut.step, *cut.amplitude])
    return arrays


def antenna_of_arrays(arrays: Mapping[str, np.ndarray]
                      ) -> tuple[AntennaPattern | None, Pointing | None]:
    """What `antenna_arrays` wrote: the pattern, and where it looked at each pulse."""
    if _CUTS[0] not in arrays:
        return None, None
    cuts = (PatternCut(float(v[0]), float(v[1]), v[2:]) for v in map(arrays.__getitem__, _CUTS))
    return (AntennaPattern(*cuts),
            Pointing.of_unit_vectors(arrays['boresight'], arrays['up']))


_SCALE = 'scale_root', 'scale_rows', 'scale_columns'


def scale_arrays(scale: BrightnessScale | None) -> dict[str, np.ndarray]:
    """A scale as arrays of a file, to the bit; none where there is none."""
    return {} if scale is None else dict(zip(_SCALE, (scale.root, *scale.knots), strict=True))


@dataclasses.dataclass(frozen=True)
class ScanLoss:
    """Something of an archive that no image is made of.

    Attributes
    ----------
    name : str
        Recording, aperture or piece.
    path : Path or None
        Path of the recording, where there is one.
    reason : str
        One line.
    """

    name: str
    path: Path | None
    reason: str


@dataclasses.dataclass(frozen=True)
class RecordingScan:
    """What the scan of a recording told.

    Attributes
    ----------
    name : str
        Name of the recording.
    apertures : tuple of ApertureScan
        Those that can be imaged.
    losses : tuple of ScanLoss
        Those that cannot, or the recording itself.
    """

    name: str
    apertures: tuple[ApertureScan, ...] = ()
    losses: tuple[ScanLoss, ...] = ()


@dataclasses.dataclass(frozen=True)
class Division:
    """How the image of an aperture is divided into pieces.

    Attributes
    ----------
    windows : tuple of Window
        Parts of its window, each of which reads the pulses; they touch and do not overlap.
    pulses : tuple of (int, int)
        Parts of its pulses, ascending: first index and the one after the last. With several,
        their images are summed in a fixed binary tree, window by window.
    seconds : float
        Predicted, of the longest piece, on one core.
    total_seconds : float
        Predicted, of all its pieces, on one core.
    memory_bytes : int
        Predicted, of the largest piece: image, what forms it, and blocks of pulses.
    method : str
        By which the pieces are imaged.
    """

    windows: tuple[Window, ...]
    pulses: tuple[tuple[int, int], ...]
    seconds: float
    total_seconds: float
    memory_bytes: int
    method: str = ''


@dataclasses.dataclass(frozen=True)
class ApertureScan:
    """One aperture of a recording, as everything after the scan needs it.

    Attributes
    ----------
    name : str
        Unique within the archive, fit for file names: ``'flight-012_aperture-003'``.
    path : Path
        Recording.
    recording : str
        Its name in the archive: ``'flight-012'``, the name of its strip.
    aperture : int or None
        Number that `open_pulses` takes; None for a file with one.
    fingerprint : str
        Fingerprint of the recording: sizes of its files and a checksum of their first and last
        bytes.
    kind : str
        ``'recording'`` or ``'CPHD'``.
    radar : RadarParameters
        Radar parameters of its samples.
    n_pulses, n_channels, n_samples : int
        Sizes.
    compressed : bool
        Whether these are range profiles.
    first_ns, last_ns : int
        Times of the first and the last pulse, nanoseconds.
    datum : Datum or None
        Datum of the recording; its phase centres in `centres` are in the map's frame already.
    footprint_m : ((x, y), ...) floats
        Corners of what it tells something about, in the map's frame, metres.
    window : Window
        Pixels of its image, on the map's lattice.
    centre_m : (3,) floats
        Mean phase centre in the map's frame, metres.
    reads_bytes : int
        Bytes of its samples on disk.
    division : Division
        How its image is made.
    centres : str
        File of its phase centres below the output folder: ``'scans/NAME.npz'``.
    warnings : tuple of str
        What a person should know.
    radiometry : Radiometry or None
        What the squared magnitude of its image is, where the job wants calibrated brightness.
    """

    name: str
    path: Path
    recording: str
    aperture: int | None
    fingerprint: str
    kind: str
    radar: RadarParameters
    n_pulses: int
    n_channels: int
    n_samples: int
    compressed: bool
    first_ns: int
    last_ns: int
    datum: Datum | None
    footprint_m: tuple[tuple[float, float], ...]
    window: Window
    centre_m: tuple[float, float, float]
    reads_bytes: int
    division: Division
    centres: str
    warnings: tuple[str, ...] = ()
    radiometry: Radiometry | None = None

    def message_times(self, output: Path) -> np.ndarray:
        """(P,) int64 times at which messages with the pulses were recorded; none of CPHD."""
        with np.load(output / self.centres) as file:
            return file['message_ns']

    def antenna(self, output: Path) -> tuple[AntennaPattern | None, Pointing | None]:
        """Pattern and pointing of the antenna in the map's frame; None where nobody tells."""
        with np.load(output / self.centres) as file:
            return antenna_of_arrays(file)

    def brightness_scale(self, output: Path) -> BrightnessScale | None:
        """What samples of its image are multiplied by; None where they stay as they are."""
        if self.radiometry is None:
            return None
        with np.load(output / self.centres) as file:
            root, *knots = (file[name] for name in _SCALE)
        return BrightnessScale(root, tuple(knots), self.radiometry)

    def phase_centres(self, output: Path) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Counters (P,), times (P,) ns, and phase centres tx and rx (P, C, 3) in the map's frame.

        Ascending counters; float64 metres; from the file that the scan wrote.
        """
        with np.load(output / self.centres) as file:
            return file['counter'], file['stamp_ns'], file['tx_m'], file['rx_m']


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
        job = restored(Job, json.loads(path.read_text())['job'])
    except (OSError, KeyError, TypeError, ValueError) as error:
        raise JobError(f'{path} holds no job of an archive ({told(error)}); expected the output '
                       'folder of one; name another folder') from error
    return dataclasses.replace(job, output=Path(output))


def restored(kind: Any, value: Any) -> Any:
    """A value of some type again, of what JSON made of its dataclasses, tuples and paths."""
    if value is None:
        return None
    kinds = [part for part in typing.get_args(kind) if part is not type(None)]
    if typing.get_origin(kind) is tuple:
        every = itertools.repeat(kinds[0]) if kinds[-1] is ... else kinds
        return tuple(restored(part, item) for part, item in zip(every, value, strict=False))
    if kinds:  # one of several, None among them
        return restored(kinds[0], value)
    if dataclasses.is_dataclass(kind):
        hints = typing.get_type_hints(kind)
        return kind(**{name: restored(hints[name], part) for name, part in value.items()})
    return value if kind in (int, float, bool, str) else kind(value)


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
        return restored(RecordingScan, json.loads(path.read_text()))


def load_scans(output: Path) -> list[RecordingScan]:
    """What all scans of an output folder told, by the names of the recordings."""
    names = sorted(path.stem for path in (Path(output) / SCANS).glob('*.json'))
    return [load_scan(output, name) for name in names]


def all_scans(output: Path) -> list[ApertureScan]:
    """Scans of all apertures of a job, in the order of their names."""
    found = (scan for recording in load_scans(output) for scan in recording.apertures)
    return sorted(found, key=lambda scan: scan.name)
