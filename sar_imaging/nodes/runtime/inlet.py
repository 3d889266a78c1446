# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Input of a stage: how its messages are read and which pulses they hold."""

from __future__ import annotations

import functools
from typing import Any

import numpy as np

from msg_conversions import pulse_block, subaperture_image
from sar_imaging.signal.pulses import PulseBlock
from sar_imaging.signal.pulses.block import sound_pulses
from sar_imaging.signal.pulses.sequence import COUNTER_MASK, describe_range
from sar_imaging.streaming.subaperture_image import SubapertureImage


class Inlet:
    """How the items of a stage's input are read, whatever they are; each has `n_pulses`.

    Parameters
    ----------
    pulses_per_aperture : int
        Length of an aperture.

    A subclass has, beside what follows,

    - ``read(message, *, max_elements)``: the item in a message, or raises WireFormatError;
    - ``counters(item)``: those of its first and of its last pulse;
    - ``stamp_ns(item)``: its time in nanoseconds, to compare with those of others;
    - ``n_bytes(item)``: the memory that it takes while it waits;
    - ``describe(item)``: the item in words;
    - ``apertures(item)``: numbers of its apertures, one for each of its parts.
    """

    def __init__(self, pulses_per_aperture: int):
        self._length = pulses_per_aperture

    def sound(self, item: Any) -> tuple[Any, list[int]]:
        """The item without corrupt pulses, and the counters of these."""
        return item, []

    def extent(self, item: Any) -> tuple[float, float]:
        """Where an item begins in its first aperture and where it ends in its last, 0 to 1."""
        length = self.pulses_per_aperture(item)
        first, last = (counter % length for counter in self.counters(item))
        return first / length, (last + 1) / length

    def pulses_per_aperture(self, item: Any) -> int:
        """Length of an aperture."""
        return self._length

    def split(self, item: Any, parts: np.ndarray) -> tuple[Any, Any]:
        """Item of some parts and item of the others; `parts` is a mask like `apertures`."""
        return (item, None) if parts.all() else (None, item)


class PulseBlocks(Inlet):
    """Pulse blocks, raw or compressed; each pulse is a part."""

    read = staticmethod(functools.partial(pulse_block.from_message, finite=False))

    def sound(self, item: PulseBlock) -> tuple[PulseBlock, list[int]]:
        """The block without pulses that would spoil an image, and the counters of these."""
        good = sound_pulses(item.samples)
        return (item, []) if good.all() else (item.select(good), item.counter[~good].tolist())

    @staticmethod
    def counters(item: PulseBlock) -> tuple[int, int]:
        """Counters of the first and of the last pulse of a block."""
        return int(item.counter[0]), int(item.counter[-1])

    @staticmethod
    def stamp_ns(item: PulseBlock) -> int:
        """Of the first pulse."""
        return int(item.stamp_ns[0])

    @staticmethod
    def n_bytes(item: PulseBlock) -> int:
        """Memory of the samples, bytes."""
        return item.samples.nbytes

    @staticmethod
    def describe(item: PulseBlock) -> str:
        """Such as ``pulses 32..63``."""
        return f'pulses {describe_range(int(item.counter[0]), int(item.counter[-1]))}'

    def apertures(self, item: PulseBlock) -> np.ndarray:
        """(P,) number of the aperture of each pulse."""
        return item.counter // np.uint32(self._length)

    def split(self, item: PulseBlock, parts: np.ndarray
              ) -> tuple[PulseBlock | None, PulseBlock | None]:
        """Some of the pulses, and the others."""
        if parts.all() or not parts.any():
            return super().split(item, parts)
        return item.select(parts), item.select(~parts)


class UncheckedPulses(PulseBlocks):
    """The same for a step that drops corrupt pulses itself."""

    sound = Inlet.sound


class SubapertureImages(Inlet):
    """Sub-aperture images, each in one piece."""

    read = staticmethod(subaperture_image.from_message)

    @staticmethod
    def counters(item: SubapertureImage) -> tuple[int, int]:
        """Counters of its first and last pulse, whether they came or not."""
        return item.first_counter, (item.first_counter + item.length - 1) & COUNTER_MASK

    @staticmethod
    def stamp_ns(item: SubapertureImage) -> int:
        """Of its middle."""
        return item.stamp_ns

    @staticmethod
    def n_bytes(item: SubapertureImage) -> int:
        """Memory of the pixels, bytes."""
        return item.image.nbytes

    @staticmethod
    def describe(item: SubapertureImage) -> str:
        """Such as ``sub-aperture 3 of aperture 7``."""
        return f'sub-aperture {item.number} of aperture {item.aperture}'

    def apertures(self, item: SubapertureImage) -> np.ndarray:
        """(1,) number of its aperture."""
        return np.array([item.aperture])

    def pulses_per_aperture(self, item: SubapertureImage) -> int:
        """As the sender cuts them, whatever the parameter of this node is."""
        return item.pulses_per_aperture
