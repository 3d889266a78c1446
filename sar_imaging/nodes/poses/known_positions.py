# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Phase centres before, during and after an aperture, for autofocus."""

from __future__ import annotations

import time
from collections.abc import Mapping
from typing import Any

import numpy as np

from sar_imaging.autofocus.track import PhaseCentreTrack
from sar_imaging.exploitation.obstacles.aperture_view import PulseTracks
from sar_imaging.geometry.alignment import Alignment
from sar_imaging.geometry.poses import PoseStatus, PoseTrack, PoseVerdict
from sar_imaging.signal.pulses import PulseBlock

from ..runtime.health import Health, Part
from ..runtime.stage import Stage
from .frame_datum import FrameDatum
from .pose_input import BLOCK, PoseInput, alignment_from, track_from

_PAUSE_S = 3.0  # by the wall clock: nothing more is waited for
_WAIT_PERIOD_S = 0.1
REMEMBERED = 4  # apertures whose pulses are: images may wait for autofocus


class KnownPositions:
    """The track of the poses, or of the phase centres that came with the pulses.

    Parameters
    ----------
    parameters : mapping
        Current values of `pose_input.TRACK_PARAMETERS` and of ``pulses_per_aperture``.
    health : Health or Part
        Log.
    datum : FrameDatum or None
        Datum of the imaging frame, for poses from fixes alone.
    reach_s : float
        How far before and behind an aperture the track is wanted, seconds.

    Attributes
    ----------
    pulses : PulseTracks
        The history of pulses, for whoever else asks for it.
    awaited : bool
        Whether an image waits for more: the worker is then woken from time to time.
    """

    def __init__(self, parameters: Mapping[str, Any], health: Health | Part,
                 datum: FrameDatum | None, reach_s: float):
        self._parameters, self._reach_ns = parameters, round(reach_s * 1e9)
        self._of_pulses = parameters['pose.source'] == BLOCK
        self._input: PoseInput | None = None
        self._alignment: Alignment | None = None
        self._poses: PoseTrack | None = None
        if not self._of_pulses:
            self._input = PoseInput(parameters, health, datum)
            self._poses = track_from(parameters)
        self.pulses = PulseTracks(REMEMBERED * parameters['pulses_per_aperture'], 2 * reach_s)
        self._last_input_s = time.monotonic()
        self._asked_ns = None  # first time of the aperture that was asked for last
        self.awaited = False

    @property
    def source(self) -> str:
        """Where the positions come from, in words."""
        return 'the pulses' if self._of_pulses else self._input.topic

    def configure(self, node: Stage) -> None:
        """Read lever arms, from tf where they are there."""
        if not self._of_pulses:
            self._alignment = alignment_from(self._parameters, node)

    def activate(self, node: Stage) -> None:
        """Subscribe to poses, and have the node's worker look from time to time."""
        def look() -> None:
            if self.awaited:
                self.awaited = False  # until an image waits again
                node.wake()

        node.repeat(_WAIT_PERIOD_S, look)
        if self._input is not None:
            self._input.activate(node)

    def add(self, block: PulseBlock) -> None:
        """Remember where pulses were sent."""
        self._last_input_s = time.monotonic()
        self.pulses.add(block)

    def suffices(self, pulses: PulseBlock) -> bool:
        """Whether the track reaches far enough behind pulses, or nothing more comes."""
        self._take_poses()
        if pulses.stamp_ns[0] != self._asked_ns:  # nothing is received while an image is formed
            self._asked_ns, self._last_input_s = pulses.stamp_ns[0], time.monotonic()
        if time.monotonic() - self._last_input_s > _PAUSE_S:
            return True
        end = int(pulses.stamp_ns[-1]) + self._reach_ns
        if self._of_pulses:
            latest = self.pulses.latest
            return latest is not None and int(latest.stamp_ns[-1]) >= end
        span = self._poses.span_ns
        return span is not None and span[1] >= end + self._alignment.time_offset_ns

    def around(self, pulses: PulseBlock) -> PhaseCentreTrack:
        """Track from the reach before some pulses to the reach behind them."""
        span = (int(pulses.stamp_ns[0]) - self._reach_ns, int(pulses.stamp_ns[-1])
                + self._reach_ns)
        if not self._of_pulses:
            return PhaseCentreTrack.of_poses(self._poses, self._alignment, pulses.n_channels,
                                             span, self._parameters['antenna.offset_s'])
        near = [b for b in self.pulses.unbroken()
                if b.stamp_ns[-1] >= span[0] and b.stamp_ns[0] <= span[1]]
        first = near[0].stamp_ns[0] if near else pulses.stamp_ns[-1]
        if first > pulses.stamp_ns[0]:
            near = [pulses]  # their time has been gone back to meanwhile
        return PhaseCentreTrack.of_pulses(near)

    def body(self, stamp_ns: int, offset_s: float) -> tuple[np.ndarray, np.ndarray] | None:
        """How the body is turned, and where its antenna is; None where pulses tell positions.

        Parameters
        ----------
        stamp_ns : int
            Time on the clock of the pulses, nanoseconds.
        offset_s : float
            What autofocus adds to it, seconds.

        Returns
        -------
        quaternion : (4,) float64
            x, y, z, w, from the body into the imaging frame.
        arm_m : (3,) float64
            From the body to the mean of the phase centres, imaging frame, metres.

        Raises
        ------
        ValueError
            No pose of that time is known.
        """
        if self._of_pulses:
            return None
        self._take_poses()
        alignment = self._alignment
        pose = self._poses.sample(np.array(
            [stamp_ns + alignment.time_offset_ns + round(offset_s * 1e9)]), final=True)
        if pose.status[0] != PoseStatus.READY:
            raise ValueError(f'no pose is known of {stamp_ns * 1e-9:.3f} s by the clock of the '
                             'pulses')
        arms_m = (a.mean(axis=0) for a in (alignment.tx_m, alignment.rx_m))
        return pose.attitude.as_quat()[0], pose.attitude[0].apply(0.5 * sum(arms_m))

    def _take_poses(self) -> None:
        if self._input is None:
            return
        for pose in self._input.take():
            self._last_input_s = time.monotonic()
            if self._poses.add(*pose) == PoseVerdict.RESTART:
                self._poses = self._poses.successor()
