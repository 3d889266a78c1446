"""Profiles and phase centres of an aperture, kept while it is being filled."""

from __future__ import annotations

import numpy as np

from ..geometry.illumination import Pointing
from ..signal.pulses import PulseBlock
from .aperture_sequence import Aperture

_SAME_PLACE = 0.1  # of an aperture, within which a leg begins where another did


class AperturePulses(Aperture):
    """An aperture that keeps its pulses, so that its sub-apertures can be imaged again.

    Parameters
    ----------
    number, length : int
        As for `Aperture`.
    example : PulseBlock
        Any block of the same configuration.
    memory : list of array
        Samples of apertures that are no longer needed, to be used again; taken from.

    Attributes
    ----------
    next : int
        First pulse of those that may still come.
    """

    def __init__(self, number: int, length: int, example: PulseBlock, memory: list):
        super().__init__(number, length)
        self._radar = example.radar
        n, channels, samples = len(self.seen), *example.samples.shape[1:]
        self.memory = memory.pop() if memory else np.empty((length, channels, samples),
                                                           np.complex64)
        self.tx_m, self.rx_m = np.zeros((2, n, channels, 3))
        # boresight and up, where the pulses tell them
        self._looks = None if example.pointing is None else np.zeros((2, n, 3))
        self.next = 0

    def keep(self, block: PulseBlock) -> None:
        """Keep pulses that did not come before."""
        position = self.position(block)
        self.memory[position] = block.samples
        self.tx_m[position], self.rx_m[position] = block.tx_m, block.rx_m
        if self._looks is not None:
            self._looks[:, position] = block.pointing.boresight, block.pointing.up
        self.mark(block)

    @property
    def known(self) -> np.ndarray:
        """(K,) int64 counters of the pulses that came, ascending."""
        return self.first + np.flatnonzero(self.seen)

    def part(self, number: int, length: int) -> slice | None:
        """Sub-aperture of this many pulses, the last may have fewer; None beyond the last."""
        start, stop = number * length, min((number + 1) * length, len(self.seen))
        return slice(start, stop) if start < stop else None

    def block(self, part: slice) -> PulseBlock:
        """Pulses of a part that came; a view where all did."""
        index = part if self.seen[part].all() else part.start + np.flatnonzero(self.seen[part])
        counter = (self.first + np.arange(len(self.seen)))[index].astype(np.uint32)
        return PulseBlock(self._radar, True, self.stamp_ns[index], counter, self.memory[index],
                          self.tx_m[index], self.rx_m[index], pointing=self._pointing(index))

    def _pointing(self, index) -> Pointing | None:
        return None if self._looks is None else Pointing.of_unit_vectors(
            *self._looks[:, index])

    def begins_like(self, other: AperturePulses, n_pulses: int) -> bool:
        """Whether so many pulses lie, on average, where the first of another aperture do."""
        first, before = (a.rx_m[:n_pulses, 0][a.seen[:n_pulses]] for a in (self, other))
        track = other.rx_m[other.seen, 0]
        return (len(first) > 0 < len(before)
                and np.linalg.norm(first.mean(axis=0) - before.mean(axis=0))
                < _SAME_PLACE * np.linalg.norm(track[-1] - track[0]))
