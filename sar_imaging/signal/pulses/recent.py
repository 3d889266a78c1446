# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""The one history of pulses while they arrive: where the latest ones were sent."""

from __future__ import annotations

import collections

import numpy as np

from .block import PulseBlock, concatenate


class RecentPulses:
    """Remembers where the latest pulses were sent, for what an image of them is to be told of.

    One thread adds pulses, any thread may ask for them.

    Parameters
    ----------
    n_pulses : int
        How many to remember.
    span_s : float
        How long before the latest one, too, seconds.
    """

    def __init__(self, n_pulses: int, span_s: float = 0.0):
        self._n_pulses, self._span_ns, self._n = n_pulses, round(1e9 * span_s), 0
        self._blocks: collections.deque[PulseBlock] = collections.deque()

    @property
    def latest(self) -> PulseBlock | None:
        """The latest block, without its samples; None before the first."""
        return self._blocks[-1] if self._blocks else None

    def add(self, block: PulseBlock) -> None:
        """Remember the pulses of a block, without their samples."""
        if block.tx_m is None or block.rx_m is None or not block.n_pulses:
            return
        self._blocks.append(PulseBlock(
            block.radar, block.compressed, block.stamp_ns.copy(), block.counter.copy(),
            np.zeros((block.n_pulses, block.n_channels, 0), np.complex64), block.tx_m.copy(),
            block.rx_m.copy(), pointing=block.pointing))
        self._n += block.n_pulses
        latest_ns = block.stamp_ns[-1]
        while (self._n - self._blocks[0].n_pulses >= self._n_pulses and not
               latest_ns - self._span_ns < self._blocks[0].stamp_ns[-1] <= latest_ns):
            self._n -= self._blocks.popleft().n_pulses

    def unbroken(self) -> list[PulseBlock]:
        """Blocks since times last went back, or the number of channels changed."""
        found: list[PulseBlock] = []
        for block in reversed(list(self._blocks)):
            if found and (block.stamp_ns[-1] >= found[-1].stamp_ns[0]
                          or block.n_channels != found[-1].n_channels):
                break
            found.append(block)
        return found[::-1]

    def pulses(self, counters: np.ndarray, near_ns: int | None = None) -> PulseBlock:
        """The pulses with these counters, in the order of their times and without samples.

        Parameters
        ----------
        counters : (P,) integers
            Of the pulses.
        near_ns : int, optional
            Where counters began anew, those of blocks nearest to this time count, nanoseconds;
            by default the latest.

        Raises
        ------
        ValueError
            One of them is not remembered, or they are of several radars.
        """
        wanted = np.unique(np.asarray(counters, np.int64))
        found, left, blocks = [], wanted, list(self._blocks)[::-1]
        if near_ns is not None:
            blocks.sort(key=lambda b: abs(int(b.stamp_ns[b.n_pulses // 2]) - near_ns))
        for block in blocks:
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
