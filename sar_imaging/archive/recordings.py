# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Recordings of a job: found in folders, lists and STAC catalogues, and scanned once each.

A scan tells the apertures of a recording with their footprints, phase centres, antenna and
brightness on the map, and how their images are divided; or why they are lost.
"""

from __future__ import annotations

import dataclasses
import glob
import hashlib
import os
import re
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from ..configuration.scene_grid import Coverage
from ..files import read_text, replacing, told
from ..formats import MissingExtraError, require
from ..formats.cphd import CphdError, CphdReader
from ..geometry.earth import Datum
from ..radiometry import BrightnessScale, KnotResponse
from ..recordings.bag_io import BagError, read_truth
from ..recordings.kinds import CPHD, RECORDING, UnknownKindError, kind_of
from ..recordings.pulse_source import (
    PulseSource as Source,
    SourceError,
    open_apertures,
    pointing_of,
)
from .division import DividedPulses, UndividableError, divide_aperture
from .job import Job, JobError
from .pieces import ArchiveDataError, PieceResult, ScanPiece
from .scans import (
    SCANS,
    ApertureScan,
    RecordingScan,
    ScanLoss,
    antenna_arrays,
    bring_to_disk,
    scale_arrays,
    scan_file,
    turned,
    write_scan,
)
from .windows import Window, box, inside, lattice_grid, surface_points

_MOST_CATALOGUE_BYTES = 2**26
_BAG_FILES = ('.mcap', '.db3')


def find_recordings(job: Job) -> dict[str, Path]:
    """Recordings of a job by their names in the archive, sorted by path, each once.

    Of a folder, all recordings and files ``*.cphd`` below it are taken, and folders with nothing
    in them or with the samples of a recording that was never completed: they are lost, and shall
    be told. A glob and a list take whatever they name.

    Raises
    ------
    JobError
        Something named does not exist, is no catalogue, or nothing is found.
    """
    found: dict[str, Path] = {}
    for pattern in job.recordings:
        some = list(_named(pattern, job.output))
        if not some:
            raise JobError(f'recordings: {pattern} holds no recording; expected folders of '
                           'rosbag2 or files *.cphd; name another folder, glob or catalogue')
        for path in some:
            found.setdefault(os.path.realpath(path), path)
    return _with_names(sorted(found.values(), key=str))


def with_datum(job: Job, recordings: dict[str, Path]) -> Job:
    """The job with the datum of the first recording that tells one, where it has none itself."""
    if job.datum is not None:
        return job
    for name, path in recordings.items():
        try:
            datum = _datum(path)
        except (BagError, CphdError, UnknownKindError, OSError, ValueError):
            continue  # lost, as its scan will tell
        if datum is not None:
            return dataclasses.replace(job, datum=datum, datum_from=name)
    return job


def _datum(path: Path) -> Datum | None:
    kind = kind_of(path)
    if kind == RECORDING:
        fields = (read_truth(path) or {}).get('datum')
        return None if fields is None else Datum(**fields)
    if kind == CPHD:
        with CphdReader(path) as reader:
            return reader.datum
    return None


def _named(pattern: str, output: Path) -> Iterator[Path]:
    """What a pattern names."""
    path = Path(pattern)
    if path.is_dir():
        yield from [path] if _is_recording(path) else _below(path, {output.resolve()})
    elif path.suffix.lower() == '.json' and path.is_file():
        yield from _of_catalogue(path)
    elif path.exists():
        yield path
    elif glob.has_magic(pattern):
        yield from map(Path, glob.glob(pattern, recursive=True))
    else:
        raise JobError(f'recordings: {pattern} does not exist; expected a folder, a file, a glob '
                       'or a STAC catalogue; correct the path')


def _is_recording(path: Path) -> bool:
    return (path / 'metadata.yaml').is_file()


def _below(folder: Path, seen: set[Path]) -> Iterator[Path]:
    """Recordings below a folder but folders `seen`, such as the job's output or by links."""
    for path in folder.iterdir():
        if path.name.startswith('.'):
            continue
        if path.is_dir():
            if (real := path.resolve()) in seen:
                continue
            seen.add(real)
            inside = list(path.iterdir())
            if (not inside or _is_recording(path)
                    or any(p.suffix.lower() in _BAG_FILES for p in inside)):
                yield path
            else:
                yield from _below(path, seen)
        elif path.suffix.lower() == '.cphd':
            yield path


def _of_catalogue(path: Path) -> Iterator[Path]:
    """Files of pulses that the items of a STAC catalogue have as assets."""
    try:
        pystac = require('pystac', 'reading a STAC catalogue', 'archive')
    except MissingExtraError as error:
        raise JobError(str(error)) from error

    class Local(pystac.stac_io.DefaultStacIO):  # type: ignore[name-defined]  # optional library
        def read_text_from_href(self, href: str) -> str:
            if '://' in href:
                raise ValueError(f'it leads to {href}; expected files on a disk')
            return read_text(href, _MOST_CATALOGUE_BYTES)

    try:
        entry = pystac.read_file(str(path), stac_io=Local())
        items = [entry] if isinstance(entry, pystac.Item) else list(
            entry.get_items(recursive=True))
        assets = [(item.id, href) for item in items for asset in item.assets.values()
                  if _is_of_pulses(href := asset.get_absolute_href(), asset)]
    except Exception as error:  # pystac has several, and those of JSON and of files besides
        raise JobError(f'recordings: {path} is no STAC catalogue that can be read '
                       f'({told(error)}); expected a catalogue, collection or item whose links '
                       'lead to files; correct it, or name folders') from error
    for item, href in assets:
        if '://' in href:
            raise JobError(f'recordings: item {item} of {path} lies at {href}; expected files on '
                           'a disk; download them, or mount where they lie')
        yield Path(href)


def _is_of_pulses(href: str, asset: Any) -> bool:
    """Whether an asset is a recording or CPHD, and no image made of it."""
    return (href.lower().endswith('.cphd') or 'cphd' in (asset.media_type or '')
            or 'recording' in (asset.roles or ()) or _is_recording(Path(href)))


def _with_names(paths: list[Path]) -> dict[str, Path]:
    """Names that are unique and fit for files: of the path, with as many folders as that takes."""
    def name(path: Path, depth: int) -> str:
        own = path.stem if path.suffix.lower() == '.cphd' else path.name
        text = '_'.join([*path.absolute().parts[-depth:-1], own])
        return re.sub(r'[^\w.-]+', '_', text).strip('.') or 'recording'

    depths = dict.fromkeys(paths, 1)
    while True:
        names = {path: name(path, depth) for path, depth in depths.items()}
        count = Counter(text.lower() for text in names.values())
        same = [path for path, text in names.items() if count[text.lower()] > 1]
        longer = [path for path in same if depths[path] < len(path.absolute().parts)]
        if not longer:  # what is still the same differs in characters that names cannot have
            for number, path in enumerate(same):
                names[path] = f'{names[path]}_{number}'
            return {text: path for path, text in names.items()}
        depths.update({path: depths[path] + 1 for path in longer})


_FINE, _COARSE = 257, 33  # places along either side: of the area, and at which coverage is asked
_EDGE = 1e-6  # of the sides of an area, within which a place is on its edge


class OutOfSightError(ValueError):
    """An aperture tells nothing about the map; the text says why."""


def moved(points_m: np.ndarray, own: Datum | None, wanted: Datum | None) -> np.ndarray:
    """(..., 3) points of one frame in another, metres; the same where either stands nowhere."""
    if own is None or wanted is None or own == wanted:
        return points_m
    return wanted.from_ecef(own.to_ecef(points_m))


def footprint(source: Source, coverage: Coverage, job: Job, *, alone: bool) -> np.ndarray:
    """Footprint of an aperture: the area that is told, as far as its pulses see it.

    - The area: that of the recording, within that of the job; where either tells none, the other.
    - Ranges: those that all its profiles cover.
    - Along the track, of a recording with several apertures: what is nearest to this one, as far
      as the distance between pulses is unambiguous.

    Parameters
    ----------
    source : Source
        The aperture.
    coverage : Coverage
        Coverage of its range profiles, in the map's frame.
    job : Job
        With the map's frame.
    alone : bool
        Whether the recording has no other aperture.

    Returns
    -------
    (N, 2) float64
        Corners in the map's frame, counter-clockwise, metres.

    Raises
    ------
    OutOfSightError
        Nobody tells the area, or nothing of it is seen.
    """
    hull = _area(source, job)
    places = np.concatenate([hull, _raster(hull, _FINE)])
    places = places[_within(places, hull)]
    whole = alone
    if job.area_m is not None:
        places, whole = _clipped(places, job.area_m), False
    if not alone:
        near = _nearest(places, coverage, job)
        places, whole = places[near], whole or bool(near.all())
    corners = hull if whole else box(places)
    places = np.concatenate([corners, _raster(corners, _COARSE)])
    places = places[_within(places, corners)]
    seen = coverage.covers(surface_points(job, places))
    if not seen.any():
        near, far = coverage.swath_m
        distance = np.linalg.norm(coverage.centres_m.mean(axis=(0, 1))
                                  - surface_points(job, places).mean(axis=0))
        raise OutOfSightError(
            f'no profile reaches its area: they cover {near:.0f} to {far:.0f} m, and it lies '
            f'{distance:.0f} m away; check height_m and area_m of the job, and the datum')
    return corners if seen.all() else box(places[seen])


def _raster(hull: np.ndarray, n: int) -> np.ndarray:
    """(n * n, 2) places on the box around some corners."""
    low, high = hull.min(axis=0), hull.max(axis=0)
    axes = (np.linspace(a, b, n) for a, b in zip(low, high, strict=True))
    return np.stack(np.meshgrid(*axes), axis=-1).reshape(-1, 2)


def _area(source: Source, job: Job) -> np.ndarray:
    """(N, 2) corners of the area, counter-clockwise, metres of the map's frame."""
    if source.area_m is not None:
        points = moved(source.area_m, source.datum, job.datum)[:, :2]
        try:
            return points[ConvexHull(points).vertices]
        except (QhullError, ValueError) as error:
            raise OutOfSightError(
                'the area that it names is a line or a point; correct it in the recording, or '
                'leave it out') from error
    if job.area_m is None:
        raise OutOfSightError('it does not state where its scene is; add area_m to the job')
    return box(np.array(job.area_m).reshape(2, 2))


def _within(points: np.ndarray, hull: np.ndarray) -> np.ndarray:
    """(N,) bool which points lie in a convex polygon, counter-clockwise."""
    return inside(hull, *points.T, _EDGE * float(np.ptp(hull, axis=0).max()))


def _clipped(places: np.ndarray, area_m: Sequence[float]) -> np.ndarray:
    """Places within the job's area; those beyond its edges are moved onto them."""
    low, high = np.array(area_m[:2]), np.array(area_m[2:])
    if (places.max(axis=0) < low).any() or (places.min(axis=0) > high).any():
        raise OutOfSightError('it lies beyond the area_m of the job; enlarge that, or leave it '
                              'out')
    return np.clip(places, low, high)


def _nearest(places: np.ndarray, coverage: Coverage, job: Job) -> np.ndarray:
    """(N,) bool which places are abeam of the aperture, as far as they are unambiguous."""
    track = coverage.centres_m.mean(axis=1)
    along = (track[-1] - track[0])[:2]
    length = np.linalg.norm(along)
    if length == 0.0:
        return np.ones(len(places), bool)
    distance = (places - track.mean(axis=0)[:2]) @ (along / length)
    middle = surface_points(job, places[[np.abs(distance).argmin()]])[0]
    reach = coverage.unambiguous_m(middle) / 2
    near = np.abs(distance) <= reach * (1 + _EDGE)
    # a spotlight looks ahead or behind: what it names is all unambiguous then
    return near if near.any() and np.ptp(distance) > 2 * reach else np.ones(len(places), bool)


def brightness_scale(job: Job, pulses: DividedPulses, window: Window) -> BrightnessScale | None:
    """Scale of the image of an aperture; None where the job wants none.

    Profiles that are compressed here have no window; those of the recording have that of the job.

    Raises
    ------
    ValueError
        The pulses resolve no area, or are too few.
    """
    wanted = job.radiometry
    if wanted is None:
        return None
    response = KnotResponse.of(
        lattice_grid(window, job), pulses.radar, pulses.tx_m, pulses.rx_m,
        pattern=pulses.illumination, pointing=pulses.pointing,
        weighting='none' if pulses.raw_samples else wanted.window)
    return BrightnessScale.of(response, wanted.constant, wanted.quantity)


_LEAST_SHARE = 0.5  # of the pulses of an aperture
_SUMMED_BYTES = 2**16  # at either end of a file
_PARABOLA = 0.25  # of the resolution, by which the Earth may drop below the map's plane


def scan_piece(piece: ScanPiece, job: Job, output: Path) -> PieceResult:
    """Scan a recording and keep what it told.

    Raises
    ------
    ArchiveDataError
        Nothing of it can be imaged; the text says why.
    OSError
        The output cannot be written, or the recording not be read for now.
    """
    scan = scan_recording(piece.path, piece.recording, job, output)
    write_scan(output, scan)  # reports tell losses, too
    if not scan.apertures:
        raise ArchiveDataError(scan.losses[0].reason)
    warnings = [f'{loss.name}: {loss.reason}' for loss in scan.losses]
    for aperture in scan.apertures:
        warnings += [f'{aperture.name}: {text}' for text in aperture.warnings]
    return PieceResult(
        warnings=tuple(warnings),
        files=(scan_file(scan.name), *(aperture.centres for aperture in scan.apertures)),
        found={'apertures': len(scan.apertures), 'losses': len(scan.losses)})


def scan_recording(path: Path, name: str, job: Job, output: Path) -> RecordingScan:
    """Read through a recording once, and write the phase centres of its apertures.

    Parameters
    ----------
    path : Path
        Recording or CPHD file.
    name : str
        Name of it in the archive.
    job : Job
        With the datum of the map's frame, see `finding.with_datum`.
    output : Path
        Folder of the job.

    Returns
    -------
    RecordingScan
        Whatever is wrong with the recording is among its losses.

    Raises
    ------
    OSError
        The phase centres cannot be written, or the recording not be read for now.
    MissingExtraError
        A library that its format needs is not installed.
    """
    try:
        sources = open_apertures(path)
        fingerprint = _fingerprint(path)
    except MissingExtraError:
        raise
    except (SourceError, UnknownKindError) as error:
        return _lost(name, path, f'{_line(error)}; add what is missing, or leave it out')
    except (FileNotFoundError, PermissionError, BagError, CphdError) as error:
        return _lost(name, path, f'{_line(error)}; recover the file, or leave it out')
    except OSError:
        raise
    except Exception as error:  # damaged files fail in many ways
        return _lost(name, path, f'{path} is damaged ({type(error).__name__}: {_line(error)}); '
                     'recover the file, or leave it out')
    apertures, losses = [], []
    longest = max(source.n_pulses for source in sources)
    for source in sources:
        own = name if source.aperture is None else f'{name}_aperture-{source.aperture:03d}'
        try:
            apertures.append(_aperture(source, own, name, job, output, fingerprint,
                                       alone=len(sources) == 1, longest=longest))
        except (OutOfSightError, UndividableError, SourceError, BagError, ValueError) as error:
            losses.append(ScanLoss(own, path, _told(error)))
    return RecordingScan(name, tuple(apertures), tuple(losses))


def _lost(name: str, path: Path, reason: str) -> RecordingScan:
    return RecordingScan(name, losses=(ScanLoss(name, path, reason),))


def _line(error: Exception) -> str:
    return ' '.join(str(error).split()).rstrip('.') or type(error).__name__


def _told(error: Exception) -> str:
    """Why an aperture cannot be imaged, and what to do."""
    reason = _line(error)
    return reason if ';' in reason else f'{reason}; correct the recording, or leave it out'


def _aperture(source: Source, name: str, recording: str, job: Job, output: Path,
              fingerprint: str, *, alone: bool, longest: int) -> ApertureScan:
    """Scan of one aperture, its phase centres written.

    Raises
    ------
    ValueError
        It cannot be imaged.
    """
    warnings = list(source.warnings)
    own = _own_datum(source, job, warnings)
    _check_pulses(source, longest, warnings)
    tx_m, rx_m = (moved(centres, own, job.datum) for centres in (source.tx_m, source.rx_m))
    if not (np.isfinite(tx_m).all() and np.isfinite(rx_m).all()):
        raise OutOfSightError(
            'its phase centres are no numbers; recover its poses, or leave it out')
    radar, n_samples = source.of_profiles()
    raw = 0 if source.compressed else source.n_samples
    coverage = Coverage(radar, n_samples, tx_m, rx_m)
    corners = footprint(source, coverage, job, alone=alone)
    window = Window.around(corners, job.spacing_m)
    looks = turned(pointing_of(source), own, job.datum)
    pulses = DividedPulses(radar, n_samples, tx_m, rx_m, raw, source.illumination, looks)
    division = divide_aperture(job, pulses, window)
    scale = brightness_scale(job, pulses, window)
    warnings += _drop_warning(job, window.grid(job.spacing_m, job.height_m).centre_m)
    centres = f'{SCANS}/{name}.npz'
    _write_centres(output / centres, source, tx_m, rx_m,
                   antenna_arrays(source.illumination, looks) | scale_arrays(scale))
    return ApertureScan(
        name=name, path=source.path.absolute(), recording=recording, aperture=source.aperture,
        fingerprint=fingerprint, kind=source.kind, radar=source.radar, n_pulses=source.n_pulses,
        n_channels=source.n_channels, n_samples=source.n_samples, compressed=source.compressed,
        first_ns=int(source.stamp_ns.min()), last_ns=int(source.stamp_ns.max()), datum=own,
        footprint_m=tuple(map(tuple, corners.tolist())), window=window,
        centre_m=tuple(coverage.centres_m.mean(axis=(0, 1)).tolist()),
        reads_bytes=source.n_bytes, division=division, centres=centres,
        warnings=tuple(warnings), radiometry=scale and scale.radiometry)


def _own_datum(source: Source, job: Job, warnings: list[str]) -> Datum | None:
    """Datum of an aperture's frame."""
    if source.datum is None and job.datum is not None:
        if job.datum_from:
            raise OutOfSightError(
                f'it has no datum, and the map has that of {job.datum_from}; add one to the '
                'recording, or a datum to the job where both stand in one frame')
        warnings.append('has no datum; its frame is taken for that of the job')
        return job.datum
    return source.datum


def _check_pulses(source: Source, longest: int, warnings: list[str]) -> None:
    n, missing = source.n_pulses, source.missing
    if n < max(2, _LEAST_SHARE * longest):
        raise OutOfSightError(f'it has {n} pulses, others of the recording have {longest}; '
                              f'expected at least {max(2, round(_LEAST_SHARE * longest))}; '
                              'recover the rest, or leave it out')
    if missing:
        warnings.append(f'{missing} of its {n + missing} pulses are missing')
    elif n < longest:
        warnings.append(f'has {n} pulses, others of the recording have {longest}')


def _drop_warning(job: Job, middle: Sequence[float]) -> list[str]:
    """What the roundness of the Earth does to pixels on a plane."""
    if job.surface != 'plane' or job.datum is None:
        return []
    _, _, height = job.datum.to_geographic(np.asarray(middle))
    above = float(height) - job.datum.height_m - job.height_m
    # layover displaces a pixel by about its height above the ground
    if above <= _PARABOLA * job.spacing_m:
        return []
    return [f'the plane of the map is {above:.2f} m above the ellipsoid here, which displaces '
            'what lies on the ground by about as much: surface: ellipsoid follows it']


def _write_centres(path: Path, source: Source, tx_m: np.ndarray, rx_m: np.ndarray,
                   more: Mapping[str, np.ndarray]) -> None:
    """Write counters, times, phase centres and more in the map's frame, all or nothing."""
    path.parent.mkdir(parents=True, exist_ok=True)
    times = np.zeros(0, np.int64) if source.message_ns is None else source.message_ns
    with replacing(path) as part:
        with open(part, 'wb') as file:
            np.savez(file, counter=source.counter, stamp_ns=source.stamp_ns, tx_m=tx_m,
                     rx_m=rx_m, message_ns=times, **more)
        bring_to_disk(part)


def _fingerprint(path: Path) -> str:
    """SHA-256 of the sizes of a recording's files, and of how each begins and ends."""
    files = sorted(p for p in path.iterdir() if p.is_file()) if path.is_dir() else [path]
    found = hashlib.sha256()
    for file in files:
        size = file.stat().st_size
        found.update(f'{file.name} {size}\n'.encode())
        with open(file, 'rb') as opened:
            found.update(opened.read(_SUMMED_BYTES))
            opened.seek(max(0, size - _SUMMED_BYTES))
            found.update(opened.read(_SUMMED_BYTES))
    return found.hexdigest()
