"""Node pulse_buffer: orders pulses, finds gaps and duplicates, cuts blocks within apertures."""

from __future__ import annotations

import sys

from std_msgs.msg import Float32MultiArray

from msg_conversions.pulse_block import to_message
from sar_imaging.signal.pulse_buffer import PulseBuffer
from sar_imaging.signal.pulses import PulseBlock

from .managed import run
from .parameters import ANY_TIME, Parameter
from .stage import Stage

PARAMETERS = (
    Parameter('pulses_per_aperture', 1024, 'Length of an aperture; the same in backprojection.',
              'pulses', 1, 2**31 - 1),
    Parameter('pulses_per_block', 32, 'Largest number of pulses in a published block.', 'pulses',
              1, 65_536),
    Parameter('reorder_window_pulses', 128, 'Distance over which pulses are put back in order; a '
              'pulse that is further behind is missing.', 'pulses', 0, 1_000_000),
    Parameter('flush_timeout_s', 0.5, 'Held pulses are published when no input came for this '
              'long, by the wall clock.', 's', 0.01, 3600.0, changes=ANY_TIME),
)


class PulseBufferNode(Stage):
    """Publishes ordered blocks on `pulse_blocks` from what comes on `pulses`."""

    NAME = 'pulse_buffer'
    IDLE_PARAMETER = 'flush_timeout_s'

    def __init__(self):
        super().__init__(
            input_topic='pulses', parameters=PARAMETERS,
            counters=('pulses_received', 'pulses_emitted', 'apertures_started',
                      'configuration_changes'),
            faults=('pulses_missing', 'pulses_duplicate', 'pulses_late', 'pulses_corrupt',
                    'restarts'))

    def configure(self) -> None:
        """Create the buffer and the output; see `ManagedNode.configure`."""
        super().configure()
        self._buffer = PulseBuffer(
            pulses_per_aperture=self.parameters['pulses_per_aperture'],
            pulses_per_block=self.parameters['pulses_per_block'],
            reorder_window_pulses=self.parameters['reorder_window_pulses'])
        self._output = self.create_output(Float32MultiArray, 'pulse_blocks', self.stream_qos())

    def summary(self) -> str:
        """Settings for the log line at the start."""
        return (f' -> {self._output.topic_name}, {self.parameters["pulses_per_block"]} pulses per '
                f'block, {self.parameters["pulses_per_aperture"]} per aperture, reorder window '
                f'{self.parameters["reorder_window_pulses"]} pulses')

    def process(self, block: PulseBlock) -> None:
        """Buffer pulses and publish the blocks that became complete."""
        self._publish(self._buffer.push(block))

    def idle(self) -> None:
        """Publish what is held, since the input pauses."""
        self._publish(self._buffer.flush())

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

    def _publish(self, blocks: list[PulseBlock]) -> None:
        self.report(self._buffer.take_events())
        for block in blocks:
            self._output.publish(to_message(block))


def main() -> int:
    """Run the node."""
    return run(PulseBufferNode)


if __name__ == '__main__':
    sys.exit(main())
