# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Pulses, apertures and phase centres of a recording: its index, and its pulses in place."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from ..geometry.alignment import Alignment
from ..geometry.antenna import Antenna, Mount
from ..geometry.earth import Datum
from ..geometry.grids import MapGrid
from ..geometry.poses import PoseTable
from ..geometry.track import mean_centres
from ..signal.positioning import PointingFinder, locate
from ..signal.pulses import PulseBlock
from ..signal.radar import RadarParameters
from .bag_io import BagError, deserialise, raw_messages, read_poses, read_truth


@dataclasses.dataclass(frozen=True)
class RecordedAperture:
    """Pulses of a recording that make one image.

    Parameters
    ----------
    number : int
        ``counter // pulses_per_aperture``.
    n_pulses : int
        Different pulses of it in the recording.
    first_ns, last_ns : int
        Times of its first and last pulse, nanoseconds.
    last_message : int
        Index of the message with its last pulse.
    """

    number: int
    n_pulses: int
    first_ns: int
    last_ns: int
    last_message: int


@dataclasses.dataclass(frozen=True)
class Recording:
    """Index of a recording: its pulses, messages and apertures, without the samples.

    Parameters
    ----------
    path : Path
        Bag folder.
    truth : dict or None
        What `recordings.make_truth` stored with it.
    radar : RadarParameters
        Radar parameters of its first readable message.
    n_samples : int
        Samples of its pulses, of that message.
    compressed : bool
        Whether these are range profiles.
    uniform : bool
        Whether all messages are of the same radar, channels and samples.
    n_messages : int
        Messages on `/pulses`.
    n_unreadable : int
        Of these, messages that hold no pulse block.
    counter : (P,) int64
        Pulse counters, in the order recorded.
    stamp_ns : (P,) int64
        Pulse times, nanoseconds.
    message : (P,) int64
        Index of the message of each pulse.
    message_ns : (M,) int64
        Times at which the messages were recorded, nanoseconds.
    tx_m, rx_m : tuple of (p, C, 3) float64, or None
        Phase centres of the pulses of each readable message, metres, theirs or by the poses
        recorded with them; None when the recording has neither.
    by_poses : bool
        Whether they come from poses.
    poses : PoseTable or None
        Those recorded with the pulses.

    Examples
    --------
    >>> from sar_imaging.recordings import read_recording
    >>> recording = read_recording('bags/spotlight')
    >>> for aperture in recording.apertures(recording.truth['pulses_per_aperture']):
    ...     print(f'aperture {aperture.number}: {aperture.n_pulses} pulses')
    aperture 0: 128 pulses
    aperture 1: 128 pulses
    """

    path: Path
    truth: dict[str, Any] | None
    radar: RadarParameters
    n_samples: int
    compressed: bool
    uniform: bool
    n_messages: int
    n_unreadable: int
    counter: np.ndarray
    stamp_ns: np.ndarray
    message: np.ndarray
    message_ns: np.ndarray
    tx_m: tuple[np.ndarray, ...] | None
    rx_m: tuple[np.ndarray, ...] | None
    by_poses: bool = False
    poses: PoseTable | None = None

    @functools.cached_property
    def phase_centre_m(self) -> np.ndarray | None:
        """(P, 3) float64 mean phase centres, metres; None where they are not known."""
        if self.tx_m is None or self.rx_m is None:
            return None
        return np.concatenate([mean_centres(*m) for m in zip(self.tx_m, self.rx_m, strict=True)])

    @functools.cached_property
    def centres_m(self) -> tuple[np.ndarray, np.ndarray]:
        """(P, C, 3) float64 phase centres tx and rx of uniform recordings, metres.

        Raises
        ------
        ValueError
            They are not known.
        """
        if self.tx_m is None or self.rx_m is None:
            raise self._unplaced()
        return np.concatenate(self.tx_m), np.concatenate(self.rx_m)

    def _unplaced(self) -> ValueError:
        return ValueError(f'{self.path}: its pulses have no phase centres, and no poses tell them')

    @property
    def grid(self) -> MapGrid | None:
        """Grid that the truth proposes."""
        if self.truth is None:
            return None
        grid = self.truth['grid']
        return MapGrid(grid['centre_m'], grid['n_x'], grid['n_y'], grid['spacing_m'])

    @property
    def datum(self) -> Datum | None:
        """Where the imaging frame stands on the Earth, where the recording tells.

        Raises
        ------
        BagError
            What it tells is no datum.
        """
        fields = (self.truth or {}).get('datum')
        try:
            return None if fields is None else Datum(**fields)
        except (TypeError, ValueError) as error:
            raise BagError(f'{self.path}: the datum of the recording: {error}') from error

    @property
    def alignment(self) -> Alignment:
        """How the pulses lie to the poses; nothing apart where the recording does not tell."""
        return Alignment(**(self.truth or {}).get('alignment', {}))

    @property
    def antenna(self) -> Antenna | None:
        """Pattern of the antenna, where the recording tells.

        Raises
        ------
        BagError
            What it tells is no antenna.
        """
        return self._told('antenna', Antenna)

    @property
    def mount(self) -> Mount | None:
        """What tells where the antenna looks, where the pulses do not state it.

        Raises
        ------
        BagError
            What it tells is no mount.
        """
        return self._told('mount', Mount)

    def _told(self, name: str, kind: Any) -> Any:
        fields = (self.truth or {}).get(name)
        try:
            return None if fields is None else kind.from_dict(fields)
        except ValueError as error:
            raise BagError(f'{self.path}: the {name} of the recording: {error}') from error

    def blocks(self, first: int = 0, stop: int = 2**32) -> Iterator[PulseBlock]:
        """Its pulses in the order recorded, each once, with phase centres and pointing.

        Parameters
        ----------
        first, stop : int
            Counters of the first pulse, and after the last one.

        Raises
        ------
        BagError
            The poses do not tell where all pulses were sent.
        """
        wanted = (self.counter >= first) & (self.counter < stop)
        times = self.message_ns[self.message[wanted]]
        if not times.size:
            return
        messages = raw_messages(self.path, int(times.min()), int(times.max()) + 1)
        pulses = each_once(messages, lambda block: (block.counter >= first)
                           & (block.counter.astype(np.int64) < stop))
        try:
            yield from placed(pulses, self.poses, self.alignment, self.mount)
        except ValueError as error:
            raise BagError(f'{self.path}: {error}') from error

    def apertures(self, pulses_per_aperture: int) -> list[RecordedAperture]:
        """Apertures in the order of their numbers."""
        numbers = self.counter // pulses_per_aperture
        out = []
        for number in np.unique(numbers):
            index = np.flatnonzero(numbers == number)
            stamps = self.stamp_ns[index]
            out.append(RecordedAperture(int(number), np.unique(self.counter[index]).size,
                                int(stamps.min()), int(stamps.max()),
                                int(self.message[index[self.counter[index].argmax()]])))
        return out

    def aperture(self, pulses_per_aperture: int, number: int | None = None) -> RecordedAperture:
        """Aperture of a number; without one the last complete, else that with most pulses.

        Raises
        ------
        ValueError
            There is none of this number.
        """
        found = {aperture.number: aperture for aperture in self.apertures(pulses_per_aperture)}
        if number is None:
            complete = [a for a in found.values() if a.n_pulses == pulses_per_aperture]
            return complete[-1] if complete else max(found.values(), key=lambda a: a.n_pulses)
        if number not in found:
            raise ValueError(f'{self.path} has no aperture {number}; it has '
                             f'{", ".join(map(str, found))}')
        return found[number]

    def phase_centre_at(self, stamp_ns: int) -> np.ndarray:
        """(3,) float64 phase centre at a time, interpolated between pulses, metres.

        Raises
        ------
        ValueError
            None is known.
        """
        if self.phase_centre_m is None:
            raise self._unplaced()
        order = np.argsort(self.stamp_ns, kind='stable')
        # nanoseconds since 1970 do not fit a float64, those since the first pulse do
        seconds = (self.stamp_ns[order] - self.stamp_ns[order[0]]) * 1e-9
        at = (stamp_ns - int(self.stamp_ns[order[0]])) * 1e-9
        return np.array([np.interp(at, seconds, axis) for axis in self.phase_centre_m[order].T])


def read_recording(path: Path | str) -> Recording:
    """Read through a recording once and index it.

    Parameters
    ----------
    path : path
        Bag folder.

    Returns
    -------
    Recording
        Its index.

    Raises
    ------
    BagError
        The folder is no bag with `/pulses`, or no message holds a pulse block.

    Examples
    --------
    >>> from sar_imaging.recordings import read_recording
    >>> recording = read_recording('bags/psf')
    >>> recording.n_messages, len(recording.counter), recording.compressed
    (8, 200, True)
    >>> recording.grid.shape
    (401, 81)
    """
    truth = read_truth(path)
    poses = read_poses(path)
    counter, stamp_ns, message, message_ns, centres = [], [], [], [], []
    first, uniform, problem = None, True, None
    for index, (time_ns, cdr) in enumerate(raw_messages(path)):
        message_ns.append(time_ns)
        try:
            block = deserialise(cdr)
        except Exception as error:  # damaged bytes fail in many ways; nodes have to live with them
            problem = error
            continue
        first = first or block.select(slice(0, 1))
        uniform = uniform and block.matches(first)
        counter.append(block.counter.astype(np.int64))
        stamp_ns.append(block.stamp_ns)
        message.append(np.full(block.n_pulses, index))
        if block.has_positions:
            centres.append((block.tx_m, block.rx_m))
        elif poses is not None and truth is not None and 'alignment' in truth:
            try:
                block = locate(block, poses, Alignment(**truth['alignment']))
            except ValueError as error:
                raise BagError(f'{path} has pulses without poses around them: {error}') from error
            centres.append((block.tx_m, block.rx_m))
    if first is None:
        raise BagError(f'{path}: none of {len(message_ns)} messages holds a pulse block'
                       + (f'; the last one: {problem}' if problem else ''))
    known = len(centres) == len(counter)
    tx_m, rx_m = zip(*centres, strict=True) if known else (None, None)
    return Recording(
        Path(path), truth, first.radar, first.n_samples, first.compressed, uniform,
        len(message_ns), len(message_ns) - len(counter), np.concatenate(counter),
        np.concatenate(stamp_ns), np.concatenate(message), np.array(message_ns, np.int64), tx_m,
        rx_m, by_poses=known and not first.has_positions, poses=poses)


def each_once(messages: Iterable[tuple[int, bytes]], wanted: Callable[[PulseBlock], np.ndarray]
              ) -> Iterator[PulseBlock]:
    """Blocks of the pulses that are wanted, (p,) bool of a block; what comes again is left out."""
    seen: set[int] = set()
    for _, cdr in messages:
        try:
            block = deserialise(cdr)
        except Exception:  # damaged bytes fail in many ways; they were counted
            continue
        new = np.zeros(block.n_pulses, bool)
        new[np.unique(block.counter, return_index=True)[1]] = True
        new &= wanted(block) & [counter not in seen for counter in block.counter.tolist()]
        if new.any():
            seen.update(block.counter[new].tolist())
            yield block if new.all() else block.select(new)


def placed(blocks: Iterable[PulseBlock], poses: PoseTable | None,
           alignment: Alignment | None, mount: Mount | None = None) -> Iterator[PulseBlock]:
    """Blocks with the phase centres that poses tell, and the pointing that a mount tells.

    Parameters
    ----------
    blocks : iterable of PulseBlock
        In the order of their pulses. Phase centres that they have stay.
    poses : PoseTable or None
        Poses of the platform, for blocks without phase centres.
    alignment : Alignment or None
        Between the two; None where nothing is apart.
    mount : Mount, optional
        Mount of the antenna.

    Raises
    ------
    ValueError
        A pulse has no pose, or the track has no direction, which the mount needs.
    """
    by_attitude = mount is not None and mount.needs_attitude
    finder = None if mount is None or by_attitude else PointingFinder(mount)
    for block in blocks:
        if poses is not None and not block.has_positions:
            block = locate(block, poses, alignment or Alignment(), mount if by_attitude else None)
        yield block if finder is None else finder(block)
