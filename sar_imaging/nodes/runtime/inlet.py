"""Input of a stage: how its messages are read and which pulses they hold."""

from __future__ import annotations

import abc
import functools

import numpy as np
from std_msgs.msg import Float32MultiArray

from msg_conversions import pulse_block, subaperture_image
from sar_imaging.signal.pulses import PulseBlock
from sar_imaging.signal.pulses.block import sound_pulses
from sar_imaging.signal.pulses.sequence import COUNTER_MASK, describe_range
from sar_imaging.streaming.subaperture_image import SubapertureImage


class Inlet(abc.ABC):
    """How the items of a stage's input are read, whatever they are.

    Parameters
    ----------
    pulses_per_aperture : int
        Length of an aperture.
    """

    def __init__(self, pulses_per_aperture: int):
        self._length = pulses_per_aperture

    @staticmethod
    @abc.abstractmethod
    def read(message: Float32MultiArray, *, max_elements: int):
        """Item in a message; raises WireFormatError when there is none."""

    @staticmethod
    @abc.abstractmethod
    def n_pulses(item) -> int:
        """Number of pulses in an item."""

    @staticmethod
    @abc.abstractmethod
    def last_counter(item) -> int:
        """Counter of the last pulse of an item."""

    @staticmethod
    @abc.abstractmethod
    def n_bytes(item) -> int:
        """Memory that an item takes while it waits."""

    @staticmethod
    @abc.abstractmethod
    def describe(item) -> str:
        """The item in words."""

    def sound(self, item) -> tuple[object, list[int]]:
        """The item without corrupt pulses, and the counters of these."""
        return item, []

    @abc.abstractmethod
    def apertures(self, item) -> np.ndarray:
        """Numbers of the apertures that an item belongs to, one for each of its parts."""

    @abc.abstractmethod
    def extent(self, item) -> tuple[float, float]:
        """Where an item begins in its aperture and where it ends, 0 to 1."""

    @staticmethod
    @abc.abstractmethod
    def moment(item) -> tuple[int, int]:
        """Counter and time in nanoseconds of an item, to compare with those of others."""

    def pulses_per_aperture(self, item) -> int:
        """Length of an aperture."""
        return self._length

    def select(self, item, parts: np.ndarray):
        """Item of some of its parts; `parts` is a mask like `apertures`, not all false."""
        return item


class PulseBlocks(Inlet):
    """Pulse blocks, raw or compressed; each pulse is a part."""

    read = staticmethod(functools.partial(pulse_block.from_message, finite=False))

    def sound(self, item: PulseBlock) -> tuple[PulseBlock, list[int]]:
        """The block without pulses that would spoil an image, and the counters of these."""
        good = sound_pulses(item.samples)
        return (item, []) if good.all() else (item.select(good), item.counter[~good].tolist())

    @staticmethod
    def n_pulses(item: PulseBlock) -> int:
        """Number of pulses in a block."""
        return item.n_pulses

    @staticmethod
    def last_counter(item: PulseBlock) -> int:
        """Counter of the last pulse of a block."""
        return int(item.counter[-1])

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

    def extent(self, item: PulseBlock) -> tuple[float, float]:
        """Where a block begins in the aperture of its first pulse, where in that of its last."""
        first, last = int(item.counter[0]) % self._length, int(item.counter[-1]) % self._length
        return first / self._length, (last + 1) / self._length

    @staticmethod
    def moment(item: PulseBlock) -> tuple[int, int]:
        """Of the first pulse."""
        return int(item.counter[0]), int(item.stamp_ns[0])

    def select(self, item: PulseBlock, parts: np.ndarray) -> PulseBlock:
        """Some of the pulses."""
        return item.select(parts)


class UncheckedPulses(PulseBlocks):
    """The same for a step that drops corrupt pulses itself."""

    sound = Inlet.sound


class SubapertureImages(Inlet):
    """Sub-aperture images, each in one piece."""

    read = staticmethod(subaperture_image.from_message)

    @staticmethod
    def n_pulses(item: SubapertureImage) -> int:
        """Number of pulses in an image."""
        return item.n_pulses

    @staticmethod
    def last_counter(item: SubapertureImage) -> int:
        """Counter of the last pulse of a sub-aperture, whether it came or not."""
        return (item.first_counter + item.length - 1) & COUNTER_MASK

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

    def extent(self, item: SubapertureImage) -> tuple[float, float]:
        """Where in its aperture it begins and ends, 0 to 1."""
        first = item.first_counter % item.pulses_per_aperture
        return first / item.pulses_per_aperture, (first + item.length) / item.pulses_per_aperture

    @staticmethod
    def moment(item: SubapertureImage) -> tuple[int, int]:
        """Its first counter; its time is that of its middle."""
        return item.first_counter, item.stamp_ns

    def pulses_per_aperture(self, item: SubapertureImage) -> int:
        """As the sender cuts them, whatever the parameter of this node is."""
        return item.pulses_per_aperture
