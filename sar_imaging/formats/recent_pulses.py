"""Radar and track of images that are formed while pulses arrive."""

from __future__ import annotations

import collections

import numpy as np

from ..geometry.illumination import AntennaPattern
from ..signal.pulses import PulseBlock, concatenate
from ..signal.radar import RadarParameters
from .acquisition import Acquisition


class RecentPulses:
    """Remembers where the latest pulses were sent, for what an image of them is to be told of.

    Parameters
    ----------
    n_pulses : int
        How many to remember.
    """

    def __init__(self, n_pulses: int):
        self._n_pulses, self._n = n_pulses, 0
        self._blocks: collections.deque[PulseBlock] = collections.deque()

    @property
    def radar(self) -> RadarParameters | None:
        """Of the latest pulses; None before the first."""
        return self._blocks[-1].radar if self._blocks else None

    def add(self, block: PulseBlock) -> None:
        """Remember the pulses of a block, without their samples; another radar begins anew."""
        if not block.has_positions or not block.n_pulses:
            return
        own = PulseBlock(
            block.radar, block.compressed, block.stamp_ns.copy(), block.counter.copy(),
            np.zeros((block.n_pulses, block.n_channels, 0), np.complex64), block.tx_m.copy(),
            block.rx_m.copy(), pointing=block.pointing)
        if self._blocks and not self._blocks[-1].matches(own):
            self._blocks.clear()
            self._n = 0
        self._blocks.append(own)
        self._n += block.n_pulses
        while self._n - self._blocks[0].n_pulses >= self._n_pulses:
            self._n -= self._blocks.popleft().n_pulses

    def acquisition(self, counters: np.ndarray,
                    antenna: AntennaPattern | None = None) -> Acquisition:
        """Acquisition of the pulses with these counters, and of an antenna; see `pulses`."""
        return Acquisition.of(self.pulses(counters), antenna=antenna)

    def pulses(self, counters: np.ndarray) -> PulseBlock:
        """The pulses with these counters, in the order of their times and without samples.

        Of equal counters the latest counts.

        Raises
        ------
        ValueError
            One of them is not remembered.
        """
        wanted = np.unique(np.asarray(counters, np.int64))
        found, left = [], wanted
        for block in reversed(self._blocks):
            numbers = block.counter.astype(np.int64)
            last = len(numbers) - 1 - np.unique(numbers[::-1], return_index=True)[1]
            chosen = last[np.isin(numbers[last], left)]
            if chosen.size:
                found.append(block.select(np.sort(chosen)))
                left = np.setdiff1d(left, numbers[chosen])
        if left.size or not found:
            raise ValueError(f'{left.size or "all"} of {wanted.size} pulses are not remembered; '
                             f'expected pulses among the latest {self._n_pulses}')
        joined = concatenate(found)
        return joined.select(np.argsort(joined.stamp_ns, kind='stable'))
