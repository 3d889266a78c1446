"""Give ordered pulses their pointing, by how the antenna is mounted."""

from __future__ import annotations

import dataclasses

import numpy as np

from ..geometry.illumination import Mount
from .pulses import PulseBlock

_BEFORE = 16  # pulses of the block before, which tell the direction of the track, too


class PointingFinder:
    """Pointing of blocks that come one after the other with their positions.

    Parameters
    ----------
    mount : Mount
        One that needs no attitude.
    """

    def __init__(self, mount: Mount):
        self._mount = mount
        self._last: tuple[int, np.ndarray] | None = None  # counter, and centres up to there

    def __call__(self, block: PulseBlock) -> PulseBlock:
        """The block with its pointing, which replaces any that it has.

        Raises
        ------
        ValueError
            The platform does not move, so that its track has no direction.
        """
        before = np.empty((0, 3))
        if self._last is not None and int(block.counter[0]) == self._last[0] + 1:
            before = self._last[1]
        n = len(before)
        centre = np.concatenate([before, block.phase_centre_m])
        self._last = int(block.counter[-1]), centre[-_BEFORE:]
        # times before a block matter to no mount
        stamp_ns = np.concatenate([np.full(n, block.stamp_ns[0]), block.stamp_ns])
        pointing = self._mount.pointing(stamp_ns, centre).select(slice(n, None))
        return dataclasses.replace(block, pointing=pointing)

    def reset(self) -> None:
        """Forget the pulses before."""
        self._last = None
