# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""The door to recorded pulses: `open_pulses` opens a file of any format.

What comes out tells radar, poses, frame, datum and scene alike, and gives the pulses in blocks of
bounded memory.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

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
from ..geometry.poses import PoseTable
from ..signal.positioning import without_range_bias
from ..signal.pulses import PulseBlock, concatenate
from ..signal.radar import RadarParameters
from ..signal.range_compression import RangeCompressor
from .arrays import load, truth_of
from .bag_io import BagError, split
from .description import shipped_names
from .kinds import CPHD, DESCRIPTION, RECORDING, UnknownKindError, kind_of
from .recording import Recording, placed, read_recording

_BLOCK_BYTES = 1e8  # of samples in one block
_PIECE_BYTES = 1e6  # of those in memory, from which blocks are made
_CPHD_WORK = 4  # times the samples that may be taken while they are converted


class SourceError(RuntimeError):
    """A file cannot be imaged; the text says why and what to do.

    Examples
    --------
    >>> from sar_imaging.recordings import SourceError, open_pulses
    >>> try:
    ...     open_pulses('bags/spotlight', aperture=7)
    ... except SourceError as error:
    ...     print(error)
    bags/spotlight has no aperture 7; it has 0, 1
    """


@dataclasses.dataclass(frozen=True, eq=False)
class PulseSource:
    """A file of pulses: what it tells, and its samples in blocks; made by `open_pulses`.

    Attributes
    ----------
    path : Path
        The file, or the folder of a recording.
    kind : str
        ``'recording'``, ``'CPHD'`` or ``'description'``.
    radar : RadarParameters
        Radar parameters of its samples.
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
    blocks : callable
        Gives the blocks anew, in the order recorded; takes the bytes that the samples of one may
        take, 100 MB by default.
    frame : str
        Name of the frame of the phase centres.
    datum : Datum or None
        Where that stands on the Earth.
    area_m : (N, 3) float64 or None
        Corners of the scene that the file names, metres.
    grid : MapGrid or None
        That the file proposes.
    scatterers : tuple of dict
        Known ones, each with ``name`` and ``position_m``.
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
    poses : PoseTable or None
        Poses of the platform, where the file has them beside its pulses.
    alignment : Alignment or None
        Between pulses and poses.
    proposed_window : str
        Spectral weighting that the file proposes.
    window : str
        Spectral weighting of the range profiles and images that are made of it.

    Examples
    --------
    >>> from sar_imaging.recordings import open_pulses
    >>> source = open_pulses('bags/spotlight')
    >>> for block in source.blocks():
    ...     print(block.samples.shape, block.has_positions)
    (128, 5, 384) True
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
    blocks: Callable[..., Iterator[PulseBlock]]
    frame: str = 'map'
    datum: Datum | None = None
    area_m: np.ndarray | None = None
    grid: MapGrid | None = None
    scatterers: tuple[dict[str, Any], ...] = ()
    warnings: tuple[str, ...] = ()
    cut_half_width_m: tuple[float, float] | None = None
    collection: Collection = Collection()
    aperture: int | None = None
    message_ns: np.ndarray | None = None
    illumination: AntennaPattern | None = None
    poses: PoseTable | None = None
    alignment: Alignment | None = None
    proposed_window: str = 'none'
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

    def of_profiles(self) -> tuple[RadarParameters, int]:
        """Radar parameters and number of samples of its pulses as range profiles."""
        compressor = self.compressor()
        return ((self.radar, self.n_samples) if compressor is None
                else (compressor.output_radar, compressor.n_output))

    @property
    def profile_bytes(self) -> int:
        """Memory that all its range profiles would take, bytes."""
        return 8 * self.n_pulses * self.n_channels * self.of_profiles()[1]

    def coverage(self) -> Coverage:
        """What of the scene its pulses tell something about."""
        return Coverage(*self.of_profiles(), self.tx_m, self.rx_m)

    def profiles(self, n_bytes: float = _BLOCK_BYTES) -> Iterator[PulseBlock]:
        """Its pulses as range profiles, in blocks of some bytes of samples."""
        compressor = self.compressor()
        for block in self.blocks(n_bytes):
            yield block if compressor is None else compressor(block)


def open_pulses(path: Path | str, data: Path | str | None = None, *, aperture: int | None = None,
                datum: Datum | None = None, changes: Mapping[str, object] | None = None
                ) -> PulseSource:
    """Open pulses: a bag, a CPHD file, or arrays, logs and drivers' messages by a description.

    Parameters
    ----------
    path : path
        Folder of a recording (rosbag2), CPHD file, or description in YAML, which may be the name
        of a shipped one. Arrays and logs are opened by the description of their name beside them:
        ``flight.csv`` by ``flight.yaml``.
    data : path, optional
        Of a description: folder with the files that it names, or the file of the samples; by
        default they lie beside it.
    aperture : int, optional
        Number of the aperture, the last complete one by default.
    datum : Datum, optional
        Where the frame stands instead of where the file says.
    changes : mapping, optional
        Of a description: values in place of those of the file, see `load`.

    Returns
    -------
    PulseSource

    Raises
    ------
    SourceError
        There is no such file, it has another format, or it lacks what imaging needs.
    BagError, CphdError, DescriptionError, MissingExtraError, UnknownKindError
        It cannot be read.

    Examples
    --------
    >>> from sar_imaging.recordings import open_pulses
    >>> source = open_pulses('bags/spotlight')
    >>> source.kind, source.n_pulses, source.compressed, source.frame, source.poses
    ('recording', 128, False, 'map', None)
    >>> [profiles] = source.profiles()  # compressed where they are not
    >>> profiles.compressed
    True
    """
    path, data, kind = _found(path, data)
    if kind in _OF_ONE_APERTURE:
        if aperture is not None:
            raise SourceError(f'{path}: --aperture is for recordings; a {kind} file has one')
        return _OF_ONE_APERTURE[kind](path, datum)
    with naming(path, 'cannot be used', SourceError):
        recording, blocks = _opened(path, data, kind, changes)
        warnings: list[str] = []
        wanted = _aperture(recording, (recording.truth or {}).get('pulses_per_aperture'), aperture,
                           warnings)
        return _source(kind, recording, blocks, wanted, datum, warnings)


def open_apertures(path: Path | str, *, datum: Datum | None = None) -> list[PulseSource]:
    """Open all apertures of a recording, which is read once; a CPHD file has one.

    Parameters
    ----------
    path, datum :
        As of `open_pulses`.

    Returns
    -------
    list of PulseSource
        In the order of their numbers; incomplete ones, too.

    Raises
    ------
    SourceError, BagError, CphdError, DescriptionError, MissingExtraError, UnknownKindError
        As `open_pulses`.

    Examples
    --------
    >>> from sar_imaging.recordings import open_apertures
    >>> [source.aperture for source in open_apertures('bags/spotlight')]
    [0, 1]
    """
    path, data, kind = _found(path, None)
    if kind in _OF_ONE_APERTURE:
        return [_OF_ONE_APERTURE[kind](path, datum)]
    with naming(path, 'cannot be used', SourceError):
        recording, blocks = _opened(path, data, kind)
        length = (recording.truth or {}).get('pulses_per_aperture')
        if length is None:
            return [_source(kind, recording, blocks, (0, 2**32), datum)]
        return [_source(kind, recording, blocks, (a.number * length, (a.number + 1) * length),
                        datum, number=a.number) for a in recording.apertures(length)]


def _found(path: Path | str, data: Path | str | None) -> tuple[Path, Path | None, str]:
    """Path of a file of pulses or of a description, that of its data, and its kind."""
    path, data = Path(path), None if data is None else Path(data)
    if not path.exists():
        if str(path) in shipped_names():
            return path, data, DESCRIPTION
        raise SourceError(f'{path} does not exist; expected the folder of a recording, a CPHD '
                          'file, or a description in YAML')
    described = path.with_suffix('.yaml')
    try:
        kind = kind_of(path)
    except UnknownKindError as error:
        if path.is_dir():
            raise
        if not described.is_file():
            raise UnknownKindError(
                f'{error}; arrays and logs need a description, {described.name} beside them: '
                'docs/loading.md') from error
        return described, path, DESCRIPTION
    if kind not in (RECORDING, DESCRIPTION, *_OF_ONE_APERTURE):
        raise SourceError(f'{path} is {kind}, an image; expected pulses: a recording, CPHD or a '
                          'description of arrays')
    if data is not None and kind != DESCRIPTION:
        raise SourceError(f'{path} is {kind}, which holds its data itself; expected a description '
                          f'in YAML for {data}')
    return path, data, kind


def _cphd(path: Path, datum: Datum | None) -> PulseSource:
    with CphdReader(path, datum=datum) as reader:
        counter = np.arange(reader.n_pulses)  # what lacks is among the warnings

        def blocks(n_bytes: float = _BLOCK_BYTES) -> Iterator[PulseBlock]:
            with CphdReader(path, datum=reader.datum) as again:
                yield from again.blocks(memory_bytes=max(1, int(_CPHD_WORK * n_bytes)))

        return PulseSource(
            path, CPHD, reader.radar, reader.n_samples, reader.compressed, counter,
            reader.stamp_ns, reader.tx_m, reader.rx_m, blocks, datum=reader.datum,
            area_m=reader.area_m, warnings=tuple(reader.warnings), collection=reader.collection,
            illumination=reader.illumination)


#: What opens files of one aperture, by their kind: with the path, and a datum in place of theirs.
_OF_ONE_APERTURE = {CPHD: _cphd}


def _opened(path: Path, data: Path | None, kind: str, changes: Mapping[str, object] | None = None
            ) -> tuple[Recording, Callable[[int, int], Iterable[PulseBlock]]]:
    """Index of a recording, and what gives its pulses with counters from one to another."""
    if kind == DESCRIPTION:
        return _described(path, data, changes)
    recording = read_recording(path)
    if recording.phase_centre_m is None:
        raise SourceError(f'{path}: its pulses have no phase centres, and no poses tell them')
    if not recording.uniform:
        raise BagError(f'{path} has pulses of different radars or lengths; record them apart')
    return recording, recording.blocks


def _described(path: Path, data: Path | None, changes: Mapping[str, object] | None
               ) -> tuple[Recording, Callable[[int, int], Iterable[PulseBlock]]]:
    """What a description says, as a recording of it would tell it; its pulses stay in memory."""
    loaded = load(path, data, changes=changes)
    [block] = placed([loaded.block], loaded.poses, loaded.alignment, loaded.mount)
    counter, (tx_m, rx_m) = block.counter.astype(np.int64), block.centres_m
    recording = Recording(
        path, truth_of(loaded, loaded.alignment), loaded.block.radar, block.n_samples,
        block.compressed, True, 0, 0, counter, block.stamp_ns, np.zeros_like(counter),
        np.zeros(1, np.int64), (tx_m,), (rx_m,),
        by_poses=not loaded.block.has_positions, poses=loaded.poses)

    def blocks(first: int, stop: int) -> Iterable[PulseBlock]:
        pulses = block.select((counter >= first) & (counter < stop))
        step = max(1, int(_PIECE_BYTES * pulses.n_pulses / max(pulses.samples.nbytes, 1)))
        return split(pulses, step)

    return recording, blocks


def _source(kind: str, recording: Recording,
            pulses: Callable[[int, int], Iterable[PulseBlock]], wanted: tuple[int, int],
            datum: Datum | None, warnings: Iterable[str] = (), number: int | None = None
            ) -> PulseSource:
    """Source of the pulses with some counters: the first, and the one after the last."""
    path, truth, warnings = recording.path, recording.truth or {}, list(warnings)
    if recording.n_unreadable:
        warnings.insert(0, f'{recording.n_unreadable} of {recording.n_messages} messages hold no '
                        'pulse block')
    inside = (recording.counter >= wanted[0]) & (recording.counter < wanted[1])
    counter, index = np.unique(recording.counter[inside], return_index=True)
    index = np.flatnonzero(inside)[index]  # where each pulse came first

    def blocks(n_bytes: float = _BLOCK_BYTES) -> Iterator[PulseBlock]:
        return joined(pulses(*wanted), n_bytes)

    tx_m, rx_m = (centres[index] for centres in recording.centres_m)
    grid, antenna = recording.grid, recording.antenna
    return PulseSource(
        path, kind, _geometric(recording), recording.n_samples, recording.compressed, counter,
        recording.stamp_ns[index], tx_m, rx_m, blocks, frame=truth.get('frame', 'map'),
        datum=datum or recording.datum, area_m=None if grid is None else _corners(grid), grid=grid,
        scatterers=tuple(truth.get('scatterers', ())), warnings=tuple(warnings),
        cut_half_width_m=_half_widths(truth),
        collection=Collection(**truth.get('collection', {})), aperture=number,
        message_ns=(recording.message_ns[recording.message[index]] if kind == RECORDING
                    else None),
        illumination=None if antenna is None else antenna.amplitudes(), poses=recording.poses,
        alignment=recording.alignment if recording.by_poses else None,
        proposed_window=truth.get('window', 'none'))


def _corners(grid: MapGrid) -> np.ndarray:
    """(N, 3) corners of a map, metres."""
    row, column = (np.unique([0, n - 1]) for n in grid.shape)
    return grid.positions(row[:, None], column).reshape(-1, 3)


def _geometric(recording: Recording) -> RadarParameters:
    """Radar of the pulses with phase centres: by poses, they are without the range bias."""
    if not recording.by_poses:
        return recording.radar
    return without_range_bias(recording.radar, recording.alignment)


def _half_widths(truth: dict[str, Any]) -> tuple[float, float] | None:
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
    chosen = recording.aperture(length, number).number
    numbers = np.unique(recording.counter // length)
    if number is None and len(numbers) > 1:
        warnings.append(f'aperture {chosen} of {", ".join(map(str, numbers))} is imaged '
                        '(--aperture chooses)')
    return chosen * length, (chosen + 1) * length


def joined(blocks: Iterable[PulseBlock], n_bytes: float) -> Iterator[PulseBlock]:
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


def acquisition_with_antenna(source: PulseSource, looks: Pointing | None = None) -> Acquisition:
    """Acquisition of a source, with its antenna where the file tells one.

    `looks` is what `pointing_of` said, where that was asked before.
    """
    if looks := looks or pointing_of(source):
        looks = looks.select(np.argsort(source.stamp_ns, kind='stable'))  # as an acquisition has
    return dataclasses.replace(source.acquisition(), antenna=source.illumination, pointing=looks)


def pointing_of(source: PulseSource) -> Pointing | None:
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
    for block in source.blocks():
        if block.pointing is None:
            raise SourceError(f'{source.path} tells its antenna, and pulses do not tell where '
                              'it looked; add their pointing, or the mount of the antenna, or '
                              'leave the antenna out')
        counters.append(block.counter)
        parts.append(block.pointing)
    return Pointing.join(parts).select(np.argsort(np.concatenate(counters), kind='stable'))
