"""Scan a recording: its apertures, their footprints and phase centres on the map, or why not."""

from __future__ import annotations

import hashlib
import time
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from sar_imaging.configuration.scene_grid import Coverage
from sar_imaging.files import replacing
from sar_imaging.formats import MissingExtraError
from sar_imaging.formats.cphd import CphdError
from sar_imaging.geometry.earth import Datum

from ....exchange.kinds import UnknownKindError
from ....products.antenna import pointing_of
from ....products.sources import Source, SourceError, open_apertures
from ....recordings.bag_io import BagError
from ..antennas import antenna_arrays, turned
from ..apertures import UndividableError, divide_aperture
from ..job import Job
from ..pieces import ArchiveDataError, PieceResult, ScanPiece
from ..prediction import Pulses
from ..scans import ApertureScan, Loss, RecordingScan, scale_arrays
from ..stored import SCANS, bring_to_disk, scan_file, write_scan
from .brightness import brightness_scale
from .footprint import OutOfSightError, footprint, moved

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
    start = time.perf_counter()
    scan = scan_recording(piece.path, piece.recording, job, output)
    write_scan(output, scan)  # reports tell losses, too
    if not scan.apertures:
        raise ArchiveDataError(scan.losses[0].reason)
    warnings = [f'{loss.name}: {loss.reason}' for loss in scan.losses]
    for aperture in scan.apertures:
        warnings += [f'{aperture.name}: {text}' for text in aperture.warnings]
    return PieceResult(
        piece.key, time.perf_counter() - start, warnings=tuple(warnings),
        files=(scan_file(scan.name), *(aperture.centres for aperture in scan.apertures)),
        found={'apertures': len(scan.apertures), 'losses': len(scan.losses)})


def scan_recording(path: Path, name: str, job: Job, output: Path) -> RecordingScan:
    """Read through a recording once, and write the phase centres of its apertures.

    Parameters
    ----------
    path : Path
        Recording or CPHD file.
    name : str
        Of it in the archive.
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
            losses.append(Loss(own, path, _told(error)))
    return RecordingScan(name, tuple(apertures), tuple(losses))


def _lost(name: str, path: Path, reason: str) -> RecordingScan:
    return RecordingScan(name, losses=(Loss(name, path, reason),))


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
    compressor = source.compressor()
    radar, n_samples, raw = ((source.radar, source.n_samples, 0) if compressor is None else
                             (compressor.output_radar, compressor.n_output, source.n_samples))
    coverage = Coverage(radar, n_samples, tx_m, rx_m)
    seen = footprint(source, coverage, job, alone=alone)
    looks = turned(pointing_of(source), own, job.datum)
    pulses = Pulses(radar, n_samples, tx_m, rx_m, raw, source.illumination, looks)
    division = divide_aperture(job, pulses, seen.window)
    scale = brightness_scale(job, pulses, seen.window)
    middle = seen.window.grid(job.spacing_m, job.height_m).centre_m
    warnings += _drop_warning(job, middle)
    centres = f'{SCANS}/{name}.npz'
    _write_centres(output / centres, source, tx_m, rx_m,
                   antenna_arrays(source.illumination, looks) | scale_arrays(scale))
    stamps = source.stamp_ns
    return ApertureScan(
        name=name, path=source.path.absolute(), recording=recording, aperture=source.aperture,
        fingerprint=fingerprint, kind=source.kind, radar=source.radar, n_pulses=source.n_pulses,
        n_channels=source.n_channels, n_samples=source.n_samples, compressed=source.compressed,
        first_ns=int(stamps.min()), last_ns=int(stamps.max()), datum=own,
        footprint_m=seen.corners_m, window=seen.window,
        centre_m=tuple(coverage.centres_m.mean(axis=(0, 1)).tolist()),
        range_m=float(np.median(np.linalg.norm(coverage.centres_m - middle, axis=-1))),
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


def _drop_warning(job: Job, middle) -> list[str]:
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
