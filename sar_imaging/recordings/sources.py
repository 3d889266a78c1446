"""Files of pulses, whatever their format: what they tell, and their pulses in bounded memory."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import numpy as np

from ..configuration.scene_grid import Coverage
from ..files import naming
from ..formats import Acquisition
from ..formats.acquisition import UNKNOWN
from ..formats.cphd import Collection, CphdReader
from ..geometry.alignment import Alignment
from ..geometry.earth import Datum
from ..geometry.grids import MapGrid
from ..geometry.illumination import AntennaPattern, Pointing
from ..signal.positioning import PointingFinder, locate, without_range_bias
from ..signal.pulses import PulseBlock, concatenate
from ..signal.radar import RadarParameters
from ..signal.range_compression import RangeCompressor
from .bag_io import BagError, deserialise, raw_messages, read_poses
from .kinds import CPHD, RECORDING, kind_of
from .recording import Recording, read_recording

_CPHD_WORK = 4  # times the samples that may be taken while they are converted


class SourceError(RuntimeError):
    """A file cannot be imaged; the text says why and what to do."""


@dataclasses.dataclass(frozen=True, eq=False)
class Source:
    """A file of pulses.

    Attributes
    ----------
    path : Path
        The file, or the folder of a recording.
    kind : str
        ``'recording'`` or ``'CPHD'``.
    radar : RadarParameters
        Of its samples.
    n_samples : int
        Samples of a pulse.
    compressed : bool
        Whether these are range profiles.
    counter : (P,) int64
        Numbers of the pulses, ascending.
    stamp_ns : (P,) int64
        Their times, nanoseconds.
    tx_m, rx_m : (P, C, 3) float64
        Their phase centres, metres.
    datum : Datum or None
        Where the frame of the phase centres stands.
    area_m : (N, 3) float64 or None
        Corners of the scene that the file names, metres.
    grid : MapGrid or None
        That the file proposes.
    scatterers : tuple of dict
        Known ones, each with ``name`` and ``position_m``.
    read : callable
        Gives the blocks anew, in the order recorded, for a number of bytes that the samples of
        one may take.
    warnings : tuple of str
        What a person should know.
    cut_half_width_m : (2,) floats or None
        For measuring the scatterers: half widths of cuts in range and azimuth, metres.
    collection : Collection
        Names, polarisations and marking.
    aperture : int or None
        Its number, where `open_apertures` found it among those of a recording.
    message_ns : (P,) int64 or None
        Of a recording: when the message of each pulse was recorded, nanoseconds.
    illumination : AntennaPattern or None
        Pattern of the antenna, where the file tells; its pulses then have their pointing.
    window : str
        Spectral weighting of its range profiles and images; see `forming.weighted`.
    """

    path: Path
    kind: str
    radar: RadarParameters
    n_samples: int
    compressed: bool
    counter: np.ndarray
    stamp_ns: np.ndarray
    tx_m: np.ndarray
    rx_m: np.ndarray
    datum: Datum | None
    area_m: np.ndarray | None
    grid: MapGrid | None
    scatterers: tuple[dict, ...]
    read: Callable[[float], Iterator[PulseBlock]]
    warnings: tuple[str, ...] = ()
    cut_half_width_m: tuple[float, float] | None = None
    collection: Collection = Collection()
    aperture: int | None = None
    message_ns: np.ndarray | None = None
    illumination: AntennaPattern | None = None
    window: str = 'none'

    @property
    def n_pulses(self) -> int:
        """Number of pulses P."""
        return len(self.counter)

    @property
    def n_channels(self) -> int:
        """Number of channels C."""
        return self.tx_m.shape[1]

    @property
    def n_bytes(self) -> int:
        """Memory that all samples would take, bytes."""
        return 8 * self.n_pulses * self.n_channels * self.n_samples

    @property
    def track_m(self) -> np.ndarray:
        """(P, 3) float64 mean phase centres in the order of time, metres."""
        order = np.argsort(self.stamp_ns, kind='stable')
        return 0.5 * (self.tx_m + self.rx_m).mean(axis=1)[order]

    @property
    def missing(self) -> int:
        """Pulses between the first and the last that are not in the file."""
        return int(self.counter[-1] - self.counter[0] + 1 - self.n_pulses)

    def acquisition(self) -> Acquisition:
        """What files of its image tell of its pulses, names and polarisation."""
        names, told = self.collection, {':'.join(p) for p in self.collection.polarisations}
        fields = dict(
            radar=self.radar, stamp_ns=self.stamp_ns, tx_m=self.tx_m.mean(axis=1),
            rx_m=self.rx_m.mean(axis=1), collector=names.collector_name,
            illuminator=names.illuminator_name,
            name='' if names.core_name == UNKNOWN else names.core_name)
        try:  # one of all channels, which SICD knows
            return Acquisition(**fields, polarisation=told.pop() if len(told) == 1 else UNKNOWN)
        except ValueError:
            return Acquisition(**fields)

    def compressor(self) -> RangeCompressor | None:
        """Range compression of its pulses; None for range profiles."""
        return None if self.compressed else RangeCompressor(self.radar, self.n_samples,
                                                            window=self.window)

    def coverage(self) -> Coverage:
        """What of the scene its pulses tell something about."""
        compressor = self.compressor()
        radar, n = ((self.radar, self.n_samples) if compressor is None
                    else (compressor.output_radar, compressor.n_output))
        return Coverage(radar, n, self.tx_m, self.rx_m)

    def profiles(self, n_bytes: float) -> Iterator[PulseBlock]:
        """Its pulses as range profiles, in blocks of some bytes of samples."""
        compressor = self.compressor()
        for block in self.read(n_bytes):
            yield block if compressor is None else compressor(block)


def open_source(path: Path | str, *, aperture: int | None = None,
                datum: Datum | None = None) -> Source:
    """Open a recording or a CPHD file.

    Parameters
    ----------
    path : path
        Folder of a recording (rosbag2), or file.
    aperture : int, optional
        Of a recording: number of the aperture, the last complete one by default.
    datum : Datum, optional
        Where the frame stands instead of where the file says.

    Returns
    -------
    Source

    Raises
    ------
    SourceError
        There is no such file, it has another format, or it lacks what imaging needs.
    BagError, CphdError, MissingExtraError, UnknownKindError
        It cannot be read.

    Examples
    --------
    >>> from sar_imaging.recordings import open_source
    >>> source = open_source('bags/spotlight')
    >>> source.kind, source.n_pulses, source.compressed
    ('recording', 128, False)
    >>> [profiles] = source.profiles(n_bytes=1e9)  # compressed where they are not
    >>> profiles.compressed
    True
    """
    path = Path(path)
    if _kind(path) == RECORDING:
        with naming(path, 'cannot be used', SourceError):
            return _recording(path, aperture, datum)
    if aperture is not None:
        raise SourceError(f'{path}: --aperture is for recordings; a CPHD file has one')
    return _cphd(path, datum)


def open_apertures(path: Path | str, *, datum: Datum | None = None) -> list[Source]:
    """Open all apertures of a recording, which is read once; a CPHD file has one.

    Parameters
    ----------
    path, datum :
        As of `open_source`.

    Returns
    -------
    list of Source
        In the order of their numbers; incomplete ones, too.

    Raises
    ------
    SourceError, BagError, CphdError, MissingExtraError, UnknownKindError
        As `open_source`.
    """
    path = Path(path)
    if _kind(path) == CPHD:
        return [_cphd(path, datum)]
    with naming(path, 'cannot be used', SourceError):
        return _apertures(path, datum)


def _apertures(path: Path, datum: Datum | None) -> list[Source]:
    recording = _located_recording(path)
    length = (recording.truth or {}).get('pulses_per_aperture')
    if length is None:
        return [_of_recording(recording, (0, 2**32), datum)]
    return [_of_recording(recording, (a.number * length, (a.number + 1) * length), datum,
                          number=a.number) for a in recording.apertures(length)]


def _kind(path: Path) -> str:
    """Kind of a file of pulses."""
    if not path.exists():
        raise SourceError(f'{path} does not exist; expected the folder of a recording or a CPHD '
                          'file')
    kind = kind_of(path)
    if kind not in (RECORDING, CPHD):
        raise SourceError(f'{path} is {kind}, an image; expected pulses: a recording or CPHD')
    return kind


def _cphd(path: Path, datum: Datum | None) -> Source:
    with CphdReader(path, datum=datum) as reader:
        counter = np.arange(reader.n_pulses)  # what lacks is among the warnings

        def read(n_bytes: float) -> Iterator[PulseBlock]:
            with CphdReader(path, datum=reader.datum) as again:
                yield from again.blocks(memory_bytes=max(1, int(_CPHD_WORK * n_bytes)))

        return Source(path, CPHD, reader.radar, reader.n_samples, reader.compressed, counter,
                      reader.stamp_ns, reader.tx_m, reader.rx_m, reader.datum, reader.area_m,
                      None, (), read, tuple(reader.warnings), None, reader.collection,
                      illumination=reader.illumination)


def _recording(path: Path, aperture: int | None, datum: Datum | None) -> Source:
    recording = _located_recording(path)
    warnings = []
    wanted = _aperture(recording, (recording.truth or {}).get('pulses_per_aperture'), aperture,
                       warnings)
    return _of_recording(recording, wanted, datum, warnings)


def _located_recording(path: Path) -> Recording:
    recording = read_recording(path)
    if recording.phase_centre_m is None:
        raise SourceError(f'{path}: its pulses have no phase centres, and no poses tell them')
    if not recording.uniform:
        raise BagError(f'{path} has pulses of different radars or lengths; record them apart')
    return recording


def _of_recording(recording: Recording, wanted: tuple[int, int], datum: Datum | None,
                  warnings: Iterable[str] = (), number: int | None = None) -> Source:
    """Source of the pulses with some counters: the first, and the one after the last."""
    path, truth, warnings = recording.path, recording.truth or {}, list(warnings)
    if recording.n_unreadable:
        warnings.insert(0, f'{recording.n_unreadable} of {recording.n_messages} messages hold no '
                        'pulse block')
    inside = (recording.counter >= wanted[0]) & (recording.counter < wanted[1])
    counter, index = np.unique(recording.counter[inside], return_index=True)
    index = np.flatnonzero(inside)[index]  # where each pulse came first
    message_ns = recording.message_ns[recording.message[index]]
    times = int(message_ns.min()), int(message_ns.max()) + 1

    def read(n_bytes: float) -> Iterator[PulseBlock]:
        return _chunks(_located(recording, wanted, times), n_bytes)

    tx_m, rx_m = (centres[index] for centres in recording.centres_m)
    grid = recording.grid
    area = None if grid is None else _corners(grid)
    return Source(path, RECORDING, _geometric(recording), recording.n_samples,
                  recording.compressed, counter, recording.stamp_ns[index], tx_m, rx_m,
                  datum or recording.datum, area, grid, tuple(truth.get('scatterers', ())), read,
                  tuple(warnings), _half_widths(truth),
                  Collection(**truth.get('collection', {})), number, message_ns,
                  recording.antenna and recording.antenna.amplitudes())


def _corners(grid: MapGrid) -> np.ndarray:
    """(N, 3) corners of a map, metres."""
    row, column = (np.unique([0, n - 1]) for n in grid.shape)
    return grid.positions(row[:, None], column).reshape(-1, 3)


def _geometric(recording: Recording) -> RadarParameters:
    """Radar of the pulses with phase centres: by poses, they are without the range bias."""
    if not recording.by_poses:
        return recording.radar
    return without_range_bias(recording.radar, Alignment(**recording.truth['alignment']))


def _half_widths(truth: dict) -> tuple[float, float] | None:
    told = truth.get('cut_half_width_m')
    return None if told is None else (told['range'], told['azimuth'])


def _aperture(recording: Recording, length: int | None, number: int | None,
              warnings: list[str]) -> tuple[int, int]:
    """First counter, and the one after the last, of the pulses to image."""
    if length is None:
        if number is not None:
            raise SourceError(f'{recording.path} does not state the length of its apertures; '
                              '--aperture needs it')
        return 0, 2**32
    apertures = recording.apertures(length)
    numbers = [a.number for a in apertures]
    if number is None:
        complete = [a.number for a in apertures if a.n_pulses == length]
        number = complete[-1] if complete else max(apertures, key=lambda a: a.n_pulses).number
        if len(numbers) > 1:
            warnings.append(f'aperture {number} of {", ".join(map(str, numbers))} is imaged '
                            '(--aperture chooses)')
    if number not in numbers:
        raise SourceError(f'{recording.path} has no aperture {number}; it has '
                          f'{", ".join(map(str, numbers))}')
    return number * length, (number + 1) * length


def _located(recording: Recording, wanted: tuple[int, int], times: tuple[int, int]
             ) -> Iterator[PulseBlock]:
    """Blocks of some pulses with phase centres, each pulse once."""
    poses = read_poses(recording.path)
    track = None if poses is None else poses.track()
    alignment = Alignment(**(recording.truth or {}).get('alignment', {}))
    mount = recording.mount
    by_attitude = mount is not None and mount.needs_attitude
    finder = None if mount is None or by_attitude else PointingFinder(mount)
    seen: set[int] = set()
    for _, cdr in raw_messages(recording.path, *times):
        try:
            block = deserialise(cdr)
        except Exception:  # damaged bytes fail in many ways; they were counted
            continue
        counters = block.counter.astype(np.int64)
        new = (counters >= wanted[0]) & (counters < wanted[1])
        new &= [int(c) not in seen for c in counters]
        if not new.any():
            continue
        seen.update(counters[new].tolist())
        block = block if new.all() else block.select(new)
        if not block.has_positions:
            try:
                block = locate(block, track, alignment, mount if by_attitude else None)
            except ValueError as error:
                raise BagError(f'{recording.path}: {error}') from error
        yield block if finder is None else finder(block)


def _chunks(blocks: Iterator[PulseBlock], n_bytes: float) -> Iterator[PulseBlock]:
    """Neighbouring blocks joined up to a number of bytes."""
    waiting: list[PulseBlock] = []
    for block in blocks:
        if waiting and (sum(b.samples.nbytes for b in waiting) + block.samples.nbytes > n_bytes
                        or not waiting[0].matches(block)):
            yield concatenate(waiting)
            waiting = []
        waiting.append(block)
    if waiting:
        yield concatenate(waiting)


_BLOCK_BYTES = 1e8  # of samples that are read for their pointing


def lit_acquisition(source: Source, looks: Pointing | None = None) -> Acquisition:
    """Acquisition of a source, with its antenna where the file tells one.

    `looks` is what `pointing_of` said, where that was asked before.
    """
    return dataclasses.replace(source.acquisition(), antenna=source.illumination,
                               pointing=_by_time(source, looks or pointing_of(source)))


def _by_time(source: Source, looks: Pointing | None) -> Pointing | None:
    """Pointing in the order of an acquisition."""
    return None if looks is None else looks.select(np.argsort(source.stamp_ns, kind='stable'))


def pointing_of(source: Source) -> Pointing | None:
    """Pointing of the pulses of a source, in the order of their counters.

    None where the file tells no antenna. Its samples are read through once.

    Raises
    ------
    SourceError
        It tells an antenna, and some pulses do not tell where that looked.
    """
    if source.illumination is None:
        return None
    counters, parts = [], []
    for block in source.read(_BLOCK_BYTES):
        if block.pointing is None:
            raise SourceError(f'{source.path} tells its antenna, and pulses do not tell where '
                              'it looked; add their pointing, or the mount of the antenna, or '
                              'leave the antenna out')
        counters.append(block.counter)
        parts.append(block.pointing)
    return Pointing.join(parts).select(np.argsort(np.concatenate(counters), kind='stable'))
