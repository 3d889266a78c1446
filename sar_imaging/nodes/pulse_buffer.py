"""Node pulse_buffer: orders pulses, finds gaps and duplicates, cuts blocks within apertures."""

from __future__ import annotations

import sys
from collections.abc import Mapping

from sar_imaging.signal.pulse_buffer import PulseBuffer
from sar_imaging.signal.pulses import PulseBlock

from .block_output import BlockOutput
from .health import Health, Part
from .managed import ManagedNode, run
from .parameters import ANY_TIME, Parameter
from .stage import Stage
from .step import Step

PARAMETERS = (
    Parameter('pulses_per_block', 32, 'Largest number of pulses in a published block.', 'pulses',
              1, 65_536),
    Parameter('reorder_window_pulses', 128, 'Distance over which pulses are put back in order; a '
              'pulse that is further behind is missing.', 'pulses', 0, 1_000_000),
    Parameter('flush_timeout_s', 0.5, 'Held pulses are published when no input came for this '
              'long, by the wall clock.', 's', 0.01, 3600.0, changes=ANY_TIME),
)


class PulseBufferStep(Step):
    """Pulses as a radar delivers them to ordered blocks within apertures; see `PulseBuffer`."""

    NAME = 'pulse_buffer'
    PARAMETERS = PARAMETERS
    COUNTERS = ('pulses_received', 'pulses_emitted', 'apertures_started',
                'configuration_changes')
    FAULTS = ('pulses_missing', 'pulses_duplicate', 'pulses_late', 'pulses_corrupt', 'restarts')
    IDLE_PARAMETER = 'flush_timeout_s'

    def __init__(self, parameters: Mapping[str, object], health: Health | Part):
        super().__init__(parameters, health)
        self._buffer = PulseBuffer(
            pulses_per_aperture=parameters['pulses_per_aperture'],
            pulses_per_block=parameters['pulses_per_block'],
            reorder_window_pulses=parameters['reorder_window_pulses'])

    def create_outputs(self, node: ManagedNode) -> None:
        """Create the publisher of the blocks; see `Step`."""
        self._output = BlockOutput(node, 'pulse_blocks', self.parameters)

    def summary(self) -> str:
        """Settings for the log line at the start."""
        return (f' -> {self._output.topic}, {self.parameters["pulses_per_block"]} pulses per '
                f'block, {self.parameters["pulses_per_aperture"]} per aperture, reorder window '
                f'{self.parameters["reorder_window_pulses"]} pulses')

    def process(self, block: PulseBlock) -> list[PulseBlock]:
        """Buffer pulses; returns the blocks that became complete."""
        return self._emitted(self._buffer.push(block))

    def publish(self, product: PulseBlock) -> None:
        """Publish a block."""
        self._output.publish(product)

    def flush(self) -> list[PulseBlock]:
        """All that is held, since the input pauses."""
        return self._emitted(self._buffer.flush())

    def skip(self, aperture: int | None) -> list[PulseBlock]:
        """Let go of all that is held, so that the next steps can forget it; see `Step`."""
        return self.flush() if aperture is not None else []

    def discard(self) -> int:
        """Begin a new sequence with the next pulse; returns the number of pulses held so far."""
        return self._buffer.reset()

    def update_counters(self) -> None:
        """Take the buffer's statistics over."""
        s = self._buffer.statistics
        for key in ('received', 'emitted', 'missing', 'duplicate', 'late', 'corrupt'):
            self.health.set(f'pulses_{key}', getattr(s, key))
        for key in ('apertures_started', 'configuration_changes', 'restarts'):
            self.health.set(key, getattr(s, key))

    def _emitted(self, blocks: list[PulseBlock]) -> list[PulseBlock]:
        self.report(self._buffer.take_events())
        return blocks


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
