"""Pulses of an aperture, streamed from its recording, with phase centres in the map's frame."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from sar_imaging.formats.cphd import CphdError, CphdReader
from sar_imaging.signal.pulses import PulseBlock, concatenate
from sar_imaging.signal.range_compression import RangeCompressor

from ...exchange.kinds import CPHD
from ...recordings.bag_io import BagError, deserialise, raw_messages
from ..jobs import ApertureScan, ArchiveDataError

_CPHD_WORK = 4  # times the samples that may be taken while they are converted


class AperturePulses:
    """Pulses of an aperture, or neighbouring ones of them, as range profiles.

    Parameters
    ----------
    scan : ApertureScan
        The aperture.
    output : Path
        Folder with the phase centres that the scan found.
    pulses : (int, int), optional
        Index of the first pulse, by counter, and of the one after the last; all by default.

    Attributes
    ----------
    counter, stamp_ns, tx_m, rx_m : arrays (P,), (P,), (P, C, 3), (P, C, 3)
        Of these pulses, ascending counters; times in nanoseconds, places in metres.
    radar : RadarParameters
        Of the profiles.
    n_samples : int
        Their length.
    illumination : AntennaPattern or None
        Of the recording's antenna; the profiles then have their pointing, in the map's frame.
    """

    def __init__(self, scan: ApertureScan, output: Path,
                 pulses: tuple[int, int] | None = None):
        cut = slice(*(pulses or (0, scan.n_pulses)))
        found = scan.phase_centres(output)
        self.scan, self._first = scan, cut.start
        self.counter, self.stamp_ns, self.tx_m, self.rx_m = (part[cut] for part in found)
        self.illumination, looks = scan.antenna(output)
        self._pointing = None if looks is None else looks.select(cut)
        self._times_ns = _message_times(output / scan.centres, cut)
        self._compressor = None if scan.compressed else RangeCompressor(scan.radar,
                                                                        scan.n_samples)
        self.radar, self.n_samples = (
            (scan.radar, scan.n_samples) if self._compressor is None else
            (self._compressor.output_radar, self._compressor.n_output))

    @property
    def n_pulses(self) -> int:
        """Number of pulses P."""
        return len(self.counter)

    @property
    def pulse_bytes(self) -> int:
        """Memory of the profiles of one pulse, bytes."""
        return 8 * self.tx_m.shape[1] * self.n_samples

    @property
    def profile_bytes(self) -> int:
        """Memory of all their profiles, bytes."""
        return self.n_pulses * self.pulse_bytes

    def profiles(self, n_bytes: float) -> Iterator[PulseBlock]:
        """Range profiles in blocks of some bytes at most, at least one message's or pulse's.

        Raises
        ------
        ArchiveDataError
            The recording cannot be read, or lacks pulses that it had when it was scanned.
        """
        n_found = 0
        try:
            for block in _joined(self._placed(n_bytes), n_bytes / self.pulse_bytes):
                n_found += block.n_pulses
                yield block if self._compressor is None else self._compressor(block)
        except (BagError, CphdError, ValueError) as error:
            raise ArchiveDataError(f'{self.scan.path}: {error}') from error
        if n_found != self.n_pulses:
            raise ArchiveDataError(
                f'{self.scan.path} has {n_found} of the {self.n_pulses} pulses of '
                f'{self.scan.name} that were there when it was scanned: it has changed; take '
                'another output folder, or put the recording back')

    def _placed(self, n_bytes: float) -> Iterator[PulseBlock]:
        """Blocks of these pulses, each pulse once, with phase centres of the map's frame."""
        blocks = self._cphd(n_bytes) if self.scan.kind == CPHD else self._recorded()
        for index, block in blocks:
            # the radar of the scan is without the range bias that poses correct
            looks = None if self._pointing is None else self._pointing.select(index)
            yield dataclasses.replace(block, radar=self.scan.radar, frame='',
                                      stamp_ns=self.stamp_ns[index], tx_m=self.tx_m[index],
                                      rx_m=self.rx_m[index], pointing=looks)

    def _cphd(self, n_bytes: float) -> Iterator[tuple[np.ndarray, PulseBlock]]:
        """Blocks and the numbers of their pulses among these, which a file has in order."""
        done = 0
        with CphdReader(self.scan.path, datum=self.scan.datum) as reader:
            for block in reader.blocks(memory_bytes=max(1, int(_CPHD_WORK * n_bytes)),
                                       start=self._first, stop=self._first + self.n_pulses):
                yield np.arange(done, done + block.n_pulses), block
                done += block.n_pulses

    def _recorded(self) -> Iterator[tuple[np.ndarray, PulseBlock]]:
        """The same of a recording, whose messages may come twice or out of order."""
        scan, missing = self.scan, np.ones(self.n_pulses, bool)
        for _, cdr in raw_messages(scan.path, *self._times_ns):
            try:
                block = deserialise(cdr)
            except Exception:  # damaged bytes fail in many ways; the scan has counted them
                continue
            if block.samples.shape[1:] != (scan.n_channels, scan.n_samples):
                continue
            counter = block.counter.astype(np.int64)
            index = np.minimum(np.searchsorted(self.counter, counter), self.n_pulses - 1)
            new = (self.counter[index] == counter) & missing[index]
            new[new] = _first_of_each(index[new])
            if new.any():
                missing[index[new]] = False
                yield index[new], block if new.all() else block.select(new)


def _message_times(path: Path, pulses: slice) -> tuple[int, int] | tuple[()]:
    """When the first message with some pulses was recorded, and after the last; or nothing."""
    with np.load(path) as file:
        times = file['message_ns'][pulses] if 'message_ns' in file else ()
    return (int(np.min(times)), int(np.max(times)) + 1) if len(times) else ()


def _first_of_each(index: np.ndarray) -> np.ndarray:
    """(N,) bool true for the first of equal numbers."""
    out = np.zeros(len(index), bool)
    out[np.unique(index, return_index=True)[1]] = True
    return out


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
