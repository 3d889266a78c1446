# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Node pulse_buffer: order pulses, find gaps and duplicates, cut blocks within apertures."""

from __future__ import annotations

import dataclasses
import sys
import time
from collections.abc import Mapping
from typing import Any

from msg_conversions.pulse_block import as_received
from sar_imaging.configuration.antenna import mount_of
from sar_imaging.configuration.datum import check_fixes
from sar_imaging.configuration.positions import plain_frame
from sar_imaging.signal.positioning import PointingFinder, Positioner
from sar_imaging.signal.pulses import PulseBlock, check_frame
from sar_imaging.signal.pulses.buffer import PulseBuffer

from .antenna import POINTING_PARAMETERS
from .poses.fix_input import HEADING_BASELINE, DatumFinder
from .poses.frame_datum import DatumOutput
from .poses.pose_input import (
    BLOCK,
    PARAMETERS as POSE_PARAMETERS,
    PoseInput,
    alignment_from,
    clock_notice,
    track_from,
)
from .runtime.block_output import UNTAKEN, BlockOutput
from .runtime.health import CHANGE, Health, Part
from .runtime.inlet import UncheckedPulses
from .runtime.managed import ManagedNode, run
from .runtime.parameters import ANY_TIME, Parameter, refused
from .runtime.stage import Stage
from .runtime.step import Step

PARAMETERS = (
    Parameter('pulses_per_block', 32, 'Largest number of pulses in a published block.', 'pulses',
              1, 65_536),
    Parameter('reorder_window_pulses', 128, 'Distance over which pulses are put back in order; a '
              'pulse that is further behind is missing.', 'pulses', 0, 1_000_000),
    Parameter('flush_timeout_s', 0.5, 'Held pulses are published when no input came for this '
              'long, by the wall clock.', 's', 0.01, 3600.0, changes=ANY_TIME),
    *POSE_PARAMETERS,
    *POINTING_PARAMETERS,
    HEADING_BASELINE,
)
_WAIT_PERIOD_S = 0.05  # how often the end of a wait for poses is looked for
# Statistics of the buffer, and of what adds positions, by the counters that show them.
_PULSES = {**{f'pulses_{name}': name for name in (
    'received', 'emitted', 'missing', 'duplicate', 'late', 'corrupt', 'conflicting')},
    **{name: name for name in ('apertures_started', 'configuration_changes', 'restarts')}}
_POSES = {'pulses_emitted': 'positioned', 'pulses_without_pose': 'without_pose',
          'pulses_of_another_frame': 'other_frame', 'poses_received': 'poses',
          'poses_late': 'poses_old',
          **{name: name for name in ('pose_outliers', 'pose_gaps', 'pose_jumps',
                                     'pose_restarts')}}


class PulseBufferStep(Step):
    """Pulses as a radar delivers them to ordered blocks within apertures; see `PulseBuffer`."""

    NAME = 'pulse_buffer'
    INLET = UncheckedPulses
    PARAMETERS = PARAMETERS
    COUNTERS = ('pulses_received', 'pulses_emitted', 'apertures_started',
                'pulses_waiting_for_poses', 'poses_received',
                'fixes_received')
    FAULTS = ('pulses_missing', 'pulses_duplicate', 'pulses_late', 'pulses_corrupt', 'restarts',
              'configuration_changes', 'pulses_conflicting', UNTAKEN,
              'pulses_without_pose', 'pulses_of_another_frame', 'pulses_without_pointing',
              'poses_rejected', 'poses_late', 'pose_outliers', 'pose_gaps', 'pose_jumps',
              'pose_restarts',
              'fixes_rejected', 'fixes_without_pose', 'attitudes_unused')
    IDLE_PARAMETER = 'flush_timeout_s'

    def __init__(self, parameters: Mapping[str, Any], health: Health | Part):
        super().__init__(parameters, health)
        self._buffer = PulseBuffer(
            pulses_per_aperture=parameters['pulses_per_aperture'],
            pulses_per_block=parameters['pulses_per_block'],
            reorder_window_pulses=parameters['reorder_window_pulses'],
            positions_required=parameters['pose.source'] == BLOCK)
        self._poses = self._positioner = self._finder = None
        self._woken = False
        self._frame = plain_frame(parameters['frame_id'])
        with refused('parameter '):
            self._mount = mount_of(parameters)
        self._pointing = (PointingFinder(self._mount)
                          if self._mount is not None and not self._mount.needs_attitude else None)
        self._unpointed = ''  # why the latest pulses got no pointing
        with refused():
            check_fixes(parameters)
        self._datum = DatumOutput(parameters, health)
        if parameters['pose.source'] != BLOCK:
            self._poses = PoseInput(parameters, health, self._datum, self._pose_came)
            if self._datum.awaited and self._poses.of_fixes is None:
                self._finder = DatumFinder(parameters, health, self._datum)

    def create_outputs(self, node: ManagedNode) -> None:
        """Create the publisher of the blocks, and read lever arms from tf; see `Step`."""
        p = self.parameters
        self._output = BlockOutput(node, 'pulse_blocks', p, self.health)
        if self._datum.wanted:
            self._datum.create(node)
        if self._poses is not None:
            self._positioner = Positioner(
                track_from(p), alignment_from(p, node),
                pulses_per_aperture=p['pulses_per_aperture'], wait_s=p['pose.wait_s'],
                max_waiting_pulses=p['pose.max_waiting_pulses'],
                channel_offset_s=p['antenna.offset_s'],
                mount=self._mount if self._pointing is None else None)

    def activate(self, node: Stage) -> None:
        """Tell the datum, subscribe to poses and fixes that are needed; see `Step`."""
        if self._datum.wanted:
            self._datum.activate()
        if self._finder is not None:
            self._finder.fixes.activate(node)
        if self._poses is not None:
            self._node, self._woken = node, False
            node.repeat(_WAIT_PERIOD_S, self._look_for_ends)
            self._poses.activate(node)
            if notice := clock_notice(self.parameters):
                self.health.info(notice)

    def summary(self) -> str:
        """Settings for the log line at the start."""
        p = self.parameters
        poses = '' if self._poses is None else f' with positions from {self._poses.topic}'
        return (f'{poses} -> {self._output.topic}, {p["pulses_per_block"]} pulses per block, '
                f'{p["pulses_per_aperture"]} per aperture, reorder window '
                f'{p["reorder_window_pulses"]} pulses')

    def process(self, block: PulseBlock) -> list[PulseBlock]:
        """Buffer pulses; returns the blocks that became complete."""
        if self._poses is None:
            check_frame(block, self._frame)
        else:
            self._poses.compare(int(block.stamp_ns[-1]), self.received_s)
        return self._emitted(self._buffer.push(block))

    def publish(self, product: PulseBlock) -> None:
        """Publish a block."""
        self._output.publish(product)

    def flush(self) -> list[PulseBlock]:
        """All that is held, since the input pauses."""
        return self._emitted(self._buffer.flush())

    def collect(self) -> list[PulseBlock]:
        """Pulses whose poses came, or whose wait is over."""
        self._woken = False
        return self._emitted([])

    def skip(self, aperture: int | None) -> list[PulseBlock]:
        """Let go of all that is held, so that the next steps can forget it; see `Step`."""
        return self.flush() if aperture is not None else []

    def discard(self) -> int:
        """Begin a new sequence with the next pulse; returns the number of pulses held so far."""
        if self._pointing is not None:
            self._pointing.reset()
        return self._buffer.reset() + (self._positioner.reset() if self._positioner else 0)

    def update_counters(self) -> None:
        """Take the buffer's statistics over."""
        self.show(self._buffer.statistics, _PULSES)
        if self._positioner is None:
            return
        statistics = self._positioner.statistics
        self.show(statistics, _POSES)
        self.show(self._positioner, {'pulses_waiting_for_poses': 'waiting_pulses'})
        self.health.set('poses_rejected', statistics.poses_corrupt + self._poses.n_other_frame)
        self._update_fix_counters()
        self._poses.look()

    def _update_fix_counters(self) -> None:
        if (source := self._poses.of_fixes) is not None:
            self.health.set('attitudes_unused', source.n_attitudes_unused)
        elif (source := self._finder) is not None:
            self.health.set('fixes_without_pose', source.n_without_pose)
        if source is not None:
            self.health.set('fixes_received', source.fixes.n_received)
            self.health.set('fixes_rejected', source.fixes.n_rejected)

    def _emitted(self, blocks: list[PulseBlock]) -> list[PulseBlock]:
        self.report(events := self._buffer.take_events())
        for event in events:
            if event.kind == 'configuration':
                self.health.tell(CHANGE, event.text)
        if self._positioner is not None:
            blocks = self._located(blocks)
        blocks = [self._in_frame(block) for block in blocks]
        return [as_received(block) for block in self._pointed(blocks)]

    def _in_frame(self, block: PulseBlock) -> PulseBlock:
        """Positions from poses are in their frame; those of the pulses where the sender says."""
        return dataclasses.replace(block, frame=self._frame) if self._poses else block

    def _pointed(self, blocks: list[PulseBlock]) -> list[PulseBlock]:
        """The blocks with their pointing; those whose track has no direction are dropped."""
        if self._pointing is None:
            return blocks
        out = []
        for block in blocks:
            try:
                out.append(self._pointing(block))
                self._unpointed = ''
            except ValueError as error:
                self.health.count('pulses_without_pointing', block.n_pulses)
                if str(error) != self._unpointed:
                    self._unpointed = str(error)
                    self.health.warning('dropped pulses from '
                                        f'{int(block.counter[0])}: antenna.pointing='
                                        f'{self._mount.kind}: {error}')
        return out

    def _located(self, blocks: list[PulseBlock]) -> list[PulseBlock]:
        """The blocks, and those that waited, as far as their poses are decided."""
        located = []
        for pose in self._poses.take():
            located += self._positioner.add_pose(*pose)
        if self._finder is not None:
            self._finder.look(self._positioner.track)
        now = time.monotonic()
        for block in blocks:
            located += self._positioner.push(block, now)
        located += self._positioner.advance(now)
        self.report(self._positioner.take_events())
        return located

    def _pose_came(self) -> None:
        if self._positioner.waiting_pulses:
            self._wake()

    def _look_for_ends(self) -> None:
        if (self._positioner.waiting_pulses or self._poses.waiting
                or (self._finder is not None and self._finder.waiting)):
            self._wake()

    def _wake(self) -> None:
        if not self._woken:  # one call takes all poses that came until then
            self._woken = True
            self._node.wake()


class PulseBufferNode(Stage):
    """Publishes ordered blocks on `pulse_blocks` from what comes on `pulses`."""

    NAME = 'pulse_buffer'
    INPUT = 'pulses'
    STEPS = (PulseBufferStep,)


def main() -> int:
    """Run the node."""
    return run(PulseBufferNode)


if __name__ == '__main__':
    sys.exit(main())
