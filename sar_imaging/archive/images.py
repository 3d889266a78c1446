# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Images of apertures on windows of the map: whole, tile by tile, or summed of partial images.

Pulses are streamed from the recording, with phase centres in the map's frame. The error against
correlation is measured at some random pixels while the pulses pass, so that they are read once.
Partial images keep what correlation says there; their sum compares the sum.
"""

from __future__ import annotations

import dataclasses
import json
import math
import shutil
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from ..compilation import one_thread
from ..formats.cphd import CphdError, CphdReader
from ..formats.tags import told_of
from ..geometry.illumination import AntennaPattern, Pointing
from ..imaging.correlation import correlate_profiles
from ..imaging.image import Image
from ..imaging.imager import plan_image
from ..imaging.methods import EXACT
from ..memory import granting
from ..planning.costs import DEFAULT, using
from ..radiometry import BrightnessScale
from ..recordings.bag_io import BagError, raw_messages
from ..recordings.kinds import CPHD
from ..recordings.pulse_source import PulseSource
from ..recordings.recording import each_once
from ..signal.pulses import PulseBlock, concatenate
from .division import BLOCK_SHARE, room_bytes
from .job import Job
from .pieces import ArchiveDataError, ImagePiece, PieceResult, SumPiece
from .scans import ApertureScan, write_text
from .storage import TiledArray, image_array, partial_array
from .windows import Window, window_grid

_CPHD_WORK = 4  # times the samples that may be taken while they are converted


def aperture_pulses(scan: ApertureScan, output: Path, pulses: tuple[int, int] | None = None
                    ) -> PulseSource:
    """Pulses of an aperture, or neighbouring ones of them, placed in the map's frame.

    Parameters
    ----------
    scan : ApertureScan
        The aperture.
    output : Path
        Folder with the phase centres that the scan found.
    pulses : (int, int), optional
        Index of the first pulse, by counter, and of the one after the last; all by default.

    Returns
    -------
    PulseSource
        Its blocks have some bytes of profiles at most, at least one message's or pulse's; they
        raise ArchiveDataError where the recording cannot be read, or lacks pulses that it had
        when it was scanned.
    """
    cut = slice(*(pulses or (0, scan.n_pulses)))
    pattern, looks = scan.antenna(output)
    looks = looks and looks.select(cut)

    def blocks(n_bytes: float) -> Iterator[PulseBlock]:
        n_found = 0
        try:
            for block in _joined(_placed(source, scan, cut, looks, n_bytes),
                                 n_bytes * source.n_pulses / source.profile_bytes):
                n_found += block.n_pulses
                yield block
        except (BagError, CphdError, ValueError) as error:
            raise ArchiveDataError(f'{scan.path}: {error}') from error
        if n_found != source.n_pulses:
            raise ArchiveDataError(
                f'{scan.path} has {n_found} of the {source.n_pulses} pulses of {scan.name} that '
                'were there when it was scanned: it has changed; take another output folder, or '
                'put the recording back')

    counter, stamp_ns, tx_m, rx_m = (part[cut] for part in scan.phase_centres(output))
    source = PulseSource(scan.path, scan.kind, scan.radar, scan.n_samples, scan.compressed,
                         counter, stamp_ns, tx_m, rx_m, blocks, illumination=pattern,
                         message_ns=scan.message_times(output)[cut])
    return source


def _placed(source: PulseSource, scan: ApertureScan, cut: slice, looks: Pointing | None,
            n_bytes: float) -> Iterator[PulseBlock]:
    """Blocks of some pulses, each pulse once, with phase centres of the map's frame."""
    for index, block in _cphd(scan, cut, n_bytes) if scan.kind == CPHD else _recorded(source):
        # the radar of the scan is without the range bias that poses correct
        yield dataclasses.replace(block, radar=scan.radar, frame='',
                                  stamp_ns=source.stamp_ns[index], tx_m=source.tx_m[index],
                                  rx_m=source.rx_m[index], pointing=looks and looks.select(index))


def _cphd(scan: ApertureScan, cut: slice, n_bytes: float
          ) -> Iterator[tuple[np.ndarray, PulseBlock]]:
    """Blocks and the numbers of their pulses among some, which a file has in order."""
    done = 0
    with CphdReader(scan.path, datum=scan.datum) as reader:
        for block in reader.blocks(memory_bytes=max(1, int(_CPHD_WORK * n_bytes)),
                                   start=cut.start, stop=cut.stop):
            yield np.arange(done, done + block.n_pulses), block
            done += block.n_pulses


def _recorded(source: PulseSource) -> Iterator[tuple[np.ndarray, PulseBlock]]:
    """The same of a recording, whose messages may come twice or out of order."""
    times_ns, shape = source.message_ns, (source.n_channels, source.n_samples)
    between = (int(times_ns.min()), int(times_ns.max()) + 1) if len(times_ns) else ()
    for block in each_once(raw_messages(source.path, *between), lambda block: (
            np.isin(block.counter, source.counter) & (block.samples.shape[1:] == shape))):
        yield np.searchsorted(source.counter, block.counter), block


def _joined(blocks: Iterator[PulseBlock], most: float) -> Iterator[PulseBlock]:
    """Neighbouring blocks joined, and long ones cut, up to a number of pulses."""
    most = max(1, int(most))
    waiting: list[PulseBlock] = []
    for block in blocks:
        while block.n_pulses:
            room = most - sum(b.n_pulses for b in waiting)
            waiting.append(block.select(slice(0, room)))
            block = block.select(slice(room, None))
            if sum(b.n_pulses for b in waiting) == most:
                yield concatenate(waiting)
                waiting = []
    if waiting:
        yield concatenate(waiting)


_FIGURES, _APERTURE = 'figures', 'aperture.json'
_AT_ONCE = 1 << 22  # pixels whose energy is summed at a time
_ROWS_AT_ONCE = 64  # that are scaled


@dataclasses.dataclass(frozen=True, eq=False)
class Checked:
    """Pixels of a window, and what correlation says there.

    Attributes
    ----------
    index : (K,) int64
        Numbers of pixels, row by row.
    reference : (K,) complex128
        Correlation.
    covered : (K,) bool
        Whether all profiles reach them.
    """

    index: np.ndarray
    reference: np.ndarray
    covered: np.ndarray

    @classmethod
    def of(cls, window: Window, number: int, name: str) -> Checked:
        """Some pixels of a window, the same for all pulses of an aperture."""
        seed = zlib.crc32(f'{name} {window.as_tuple}'.encode())
        index = np.random.default_rng(seed).choice(
            window.n_pixels, min(number, window.n_pixels), replace=False)
        index = np.sort(index)
        return cls(index, np.zeros(len(index), np.complex128), np.ones(len(index), bool))

    def add(self, block: PulseBlock, points_m: np.ndarray,
            illumination: AntennaPattern | None) -> None:
        """Add the pulses of a block."""
        if len(self.index):
            values, covered = correlate_profiles(block, points_m, illumination=illumination)
            self.reference[:] += values
            self.covered[:] &= covered

    def figures(self, values: np.ndarray, energy: float, n_pixels: int) -> dict[str, Any]:
        """Energies of an image: of the error and of all pixels, per pixel that has a value.

        The error of the image is their quotient. It is that of pixels that all profiles cover;
        the brightest ones are among them by chance only.

        Parameters
        ----------
        values : (K,) complex64
            Image at these pixels.
        energy, n_pixels : float, int
            Its energy, and how many of its pixels have a value.
        """
        missed = np.abs(values.astype(np.complex128) - self.reference)[self.covered] ** 2
        return {'n_checked': len(missed),
                'error_power': float(missed.mean()) if len(missed) else 0.0,
                'power': energy / n_pixels if n_pixels else 0.0, 'n_pixels': n_pixels}


def error_db(figures: list[dict[str, Any]]) -> float | None:
    """Error of an image by what was measured in its parts, dB; None where nothing was."""
    known = [f for f in figures if f['n_checked'] and f['n_pixels']]
    error = sum(f['error_power'] * f['n_pixels'] for f in known)
    power = sum(f['power'] * f['n_pixels'] for f in known)
    return 10 * math.log10(error / power) if error > 0 and power > 0 else None


def _energy(samples: np.ndarray) -> tuple[float, int]:
    """Energy of an image, and how many of its pixels have a value."""
    flat, energy, n = samples.reshape(-1), 0.0, 0
    for start in range(0, flat.size, _AT_ONCE):
        part = flat[start:start + _AT_ONCE]
        power = np.square(part.real, dtype=np.float64)
        power += np.square(part.imag, dtype=np.float64)
        energy += float(power.sum())
        n += int(np.count_nonzero(power))
    return energy, n


def form_image(piece: ImagePiece, job: Job, output: Path) -> PieceResult:
    """Form the image of a piece and write it.

    Exact backprojection streams the pulses; any other method, which the division has found
    quicker and to have room, holds them all. Plans are made with the costs that are the same
    everywhere, on one thread, so that a piece gives the same bits wherever it runs.
    """
    pulses = aperture_pulses(piece.scan, output, piece.pulses)
    checked = Checked.of(piece.window, job.checked_pixels, piece.scan.name)
    with using(DEFAULT), one_thread():
        image = _formed(pulses, job, piece.window, piece.method, checked)
    report, values = image.report, image.samples.reshape(-1)[checked.index]
    figures = checked.figures(values, *_energy(image.samples)) | {
        'method': report.method, 'predicted_error_db': report.predicted_error_db,
        'warnings': list(report.warnings)}
    array, whole, scale = _opened(piece, job, output)
    for rows in piece.window.strips(_ROWS_AT_ONCE) if scale else ():
        image.samples[rows.within(piece.window)] *= scale.factors(*rows.within(whole))
    array.write(piece.window, image.samples, whole)
    _finish(piece, output, checked, figures)
    return _result(figures)


def _formed(pulses: PulseSource, job: Job, window: Window, method: str,
            checked: Checked) -> Image:
    """Image of pulses on a window, compared with correlation on the way."""
    grid = window_grid(window, job)
    points = np.ascontiguousarray(grid.positions(*np.unravel_index(checked.index, window.shape)))
    room = room_bytes(job) - (0 if method == EXACT else 2 * pulses.profile_bytes)
    with granting(max(room, 0)):
        imager = plan_image(grid, *pulses.of_profiles(), method=method, target_db=job.target_db,
                            illumination=pulses.illumination)
        if method == EXACT:
            image = imager.new_image()
            for block in pulses.profiles(BLOCK_SHARE * room):
                imager.accumulate(block, image)
                checked.add(block, points, pulses.illumination)
            return image
        [block] = pulses.profiles(pulses.profile_bytes)
        checked.add(block, points, pulses.illumination)
        return imager(block)


def _array(piece: ImagePiece | SumPiece, job: Job, output: Path, partial: str) -> TiledArray:
    scan = piece.scan
    if not partial:
        return image_array(output, scan.name, scan.window, job.tile)
    return partial_array(output, scan.name, partial, piece.window, job.tile)


def _opened(piece: ImagePiece | SumPiece, job: Job, output: Path
            ) -> tuple[TiledArray, Window, BrightnessScale | None]:
    """Array that a piece writes, made where it is missing, all its pixels, and their scale.

    Partial images have none: their sum is scaled to the brightness that the job wants.
    """
    scan, array = piece.scan, _array(piece, job, output, piece.partial)
    whole = piece.window if piece.partial else scan.window
    array.create(np.complex64, 0, attributes={
        'window': list(whole.as_tuple), 'spacing_m': job.spacing_m, 'recording': scan.recording,
        'pulses': scan.n_pulses, 'carrier_hz': scan.radar.carrier_hz} | (
            {} if piece.partial else told_of(scan.radiometry)))
    return array, whole, None if piece.partial else scan.brightness_scale(output)


def _finish(piece: ImagePiece | SumPiece, output: Path, checked: Checked,
            figures: dict[str, Any]) -> None:
    """Write what is known of an image, which says that its samples are complete."""
    name = _figures_path(output, piece.scan.name, piece.window, piece.partial)
    scan = piece.scan
    write_text(name.parent / _APERTURE, json.dumps({
        'window': scan.window.as_tuple, 'footprint_m': scan.footprint_m,
        'parts': [part.as_tuple for part in scan.division.windows]}))
    write_text(name, json.dumps(figures | {
        'index': checked.index.tolist(), 'covered': checked.covered.tolist(),
        'reference': [[v.real, v.imag] for v in checked.reference.tolist()]}))


def _figures_path(output: Path, name: str, window: Window, partial: str = '') -> Path:
    place = '-'.join(map(str, window.as_tuple))
    return output / _FIGURES / name / (f'{partial}.{place}.json' if partial else f'{place}.json')


@dataclasses.dataclass(frozen=True)
class StoredImage:
    """What pieces that use an aperture's image know of it.

    Attributes
    ----------
    name : str
        Name of the aperture.
    window : Window
        Window of its image.
    footprint_m : ((x, y), ...) floats
        Corners of what it tells something about, metres.
    parts : tuple of Window
        Windows of the pieces that make it.
    """

    name: str
    window: Window
    footprint_m: tuple[tuple[float, float], ...]
    parts: tuple[Window, ...]

    @classmethod
    def open(cls, output: Path, name: str) -> StoredImage | None:
        """Image of an aperture; None while no part of it is complete."""
        path = output / _FIGURES / name / _APERTURE
        if not path.exists():
            return None
        told = json.loads(path.read_text())
        return cls(name, Window(*told['window']), tuple(map(tuple, told['footprint_m'])),
                   tuple(Window(*part) for part in told['parts']))

    def complete(self, output: Path, window: Window) -> bool:
        """Whether all of it that lies in a window is there."""
        return all(_figures_path(output, self.name, part).exists()
                   for part in self.parts if part.intersection(window) is not None)

    def figures(self, output: Path) -> list[dict[str, Any]]:
        """What is known of its complete parts: error and power, method, warnings."""
        paths = (_figures_path(output, self.name, part) for part in self.parts)
        return [json.loads(path.read_text()) for path in paths if path.exists()]


def sum_images(piece: SumPiece, job: Job, output: Path) -> PieceResult:
    """Add two partial images, tile by tile, and drop them."""
    parts = [_array(piece, job, output, part) for part in piece.parts]
    if all(part.exists for part in parts):
        figures = _summed(piece, parts, job, output)
    else:  # it was done, and its worker died before it could say so
        figures = json.loads(
            _figures_path(output, piece.scan.name, piece.window, piece.partial).read_text())
    for part in parts:
        if part.exists:  # renamed first: never half there
            dropped = part.path.rename(part.path.with_name(f'.{part.path.name}'))
            shutil.rmtree(dropped)
    return _result(figures)


def _summed(piece: SumPiece, parts: list[TiledArray], job: Job, output: Path
            ) -> dict[str, Any]:
    known = [json.loads(_figures_path(output, piece.scan.name, piece.window, name).read_text())
             for name in piece.parts]
    one, other = (Checked(np.array(f['index'], np.int64),
                          np.array(f['reference'], float).reshape(-1, 2) @ [1, 1j],
                          np.array(f['covered'], bool)) for f in known)
    checked = Checked(one.index, one.reference + other.reference, one.covered & other.covered)
    array, whole, scale = _opened(piece, job, output)
    values = np.empty(len(checked.index), np.complex64)
    energy, n_pixels = 0.0, 0
    for tile in piece.window.tiles(job.tile):
        window = tile.intersection(piece.window)
        samples = parts[0].read(window) + parts[1].read(window)
        more, n = _energy(samples)
        energy, n_pixels = energy + more, n_pixels + n
        _pick(values, checked.index, samples, window, piece.window)
        if scale is not None:
            samples *= scale.factors(*window.within(whole))
        array.write(window, samples, whole)
    predicted = [f['predicted_error_db'] for f in known]
    figures = checked.figures(values, energy, n_pixels) | {
        'method': ' and '.join(dict.fromkeys(f['method'] for f in known)),
        'predicted_error_db': None if None in predicted else max(predicted),
        'warnings': list(dict.fromkeys(text for f in known for text in f['warnings']))}
    _finish(piece, output, checked, figures)
    return figures


def _pick(values: np.ndarray, index: np.ndarray, samples: np.ndarray, part: Window,
          window: Window) -> None:
    """Take the pixels with some numbers of a window from a part of it."""
    row, column = np.unravel_index(index, window.shape)
    row, column = row + window.row0, column + window.column0
    held = part.holds(row, column)
    values[held] = samples[row[held] - part.row0, column[held] - part.column0]


def _result(figures: dict[str, Any]) -> PieceResult:
    return PieceResult(
        predicted_error_db=figures['predicted_error_db'],
        measured_error_db=error_db([figures]), warnings=tuple(figures['warnings']),
        found={'method': figures['method'], 'checked_pixels': figures['n_checked']})
