# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Node radar_driver: raw messages of a radar's driver to pulses."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_srvs.srv import Trigger

from msg_conversions.radar_frames import (
    FRAME_TYPES,
    INFO_TYPES,
    LATCHED_INFO,
    read_frame,
    read_info,
    short_name,
)
from sar_imaging.recordings import DescriptionError, read_description
from sar_imaging.recordings.frames import FrameConverter, FrameError
from sar_imaging.recordings.samples import AXES, KEYS as SAMPLE_KEYS
from sar_imaging.signal.pulses import PulseBlock

from .runtime.block_output import UNTAKEN, BlockOutput
from .runtime.input_watch import CAUSES, InputWatch
from .runtime.managed import ManagedNode, run
from .runtime.parameters import ConfigurationError, Parameter, refused
from .runtime.stage import COMMON_PARAMETERS

PARAMETERS = (
    Parameter('description_file', '', 'Description of the radar in YAML, see docs/drivers.md.'),
    Parameter('message_type', 'std_msgs/msg/Float32MultiArray', 'Type of the messages on '
              f'radar_frames; its last part is one of {", ".join(FRAME_TYPES)}.'),
    Parameter('info_type', '', 'Type of the messages on radar_info, whose last part is one of '
              f'{", ".join(INFO_TYPES)}; empty where the description tells all.'),
    *(p for p in COMMON_PARAMETERS if p.name == 'queue_depth'),
)
_PATIENCE_S = 5.0  # that frames may pause


class RadarDriverNode(ManagedNode):
    """Publishes pulses on `pulses` from the frames on `radar_frames`.

    The pulses have no positions: `pulse_buffer` computes them, with the lever arms and times of
    the channels that this node logs at the first frame.
    """

    NAME = 'radar_driver'

    def __init__(self) -> None:
        super().__init__(
            parameters=PARAMETERS,
            counters=('frames_received', 'frames_converted', 'pulses_published'),
            faults=('frames_incomplete', 'frames_rejected', 'frames_missing', UNTAKEN))
        self._watch: InputWatch | None = None
        self._converter: FrameConverter | None = None
        self.create_service(Trigger, '~/reset', self._reset, callback_group=self.service_group)

    def configure(self) -> None:
        """Read the description, find the types of the messages; see `ManagedNode`."""
        p = self.parameters
        self._frame_class = _message_class('message_type', p['message_type'], FRAME_TYPES)
        self._info_class = (_message_class('info_type', p['info_type'], INFO_TYPES)
                            if p['info_type'] else None)
        path = Path(p['description_file'])
        if not p['description_file']:
            raise ConfigurationError('parameter description_file is empty; name the description '
                                     'of the radar, see docs/drivers.md')
        with refused('description_file: ', DescriptionError):
            top = read_description(path)
            self._converter = FrameConverter(top, path.parent)
            section = top.section('samples', SAMPLE_KEYS)
            sizes = section.section('sizes', AXES)
            self._sizes = {key: sizes.integer(key) for key in ('channel', 'sample')
                           if key in sizes}
            self._axes = section.raw('axes', None)
        self._told = self._doubted = False
        self._output = BlockOutput(self, 'pulses', p, self.health)

    def activate(self) -> None:
        """Subscribe; see `ManagedNode`."""
        p = self.parameters
        reliable = FRAME_TYPES[short_name(p['message_type'])].reliable
        qos = QoSProfile(depth=p['queue_depth'], reliability=ReliabilityPolicy.RELIABLE
                         if reliable else ReliabilityPolicy.BEST_EFFORT)
        self.activity.callback(self._end_watch)
        frames = self.create_input(self._frame_class, 'radar_frames', self._receive, qos)
        names = frames.topic_name
        package, _, short = p['message_type'].rpartition('/')
        self._watch = InputWatch(
            self, frames.topic_name, f'{package.removesuffix("/msg")}/msg/{short}',
            frames.qos_profile, patience_s=lambda: _PATIENCE_S,
            advice='remap radar_frames, or correct the parameter message_type',
            sender='the driver of the radar')
        if self._info_class is not None:
            # Of what is latched the last one before the start counts; others only now and then.
            latched = short_name(p['info_type']) in LATCHED_INFO
            info = self.create_input(
                self._info_class, 'radar_info', self._receive_info, QoSProfile(
                    depth=p['queue_depth'], durability=DurabilityPolicy.TRANSIENT_LOCAL
                    if latched else DurabilityPolicy.VOLATILE))
            names += f', {info.topic_name}'
        self.health.info(f'ready: {names} -> {self._output.topic}')

    def _end_watch(self) -> None:
        self._watch = None
        self.health.forget_causes()

    def publish_diagnostics(self) -> None:
        """Publish the counters, and why no frames come; see `ManagedNode`."""
        if self._watch is not None:
            self.health.causes_of(CAUSES, self._watch.look())
        self.health.publish(self.state)

    def _reset(self, request: Trigger.Request, response: Trigger.Response
               ) -> Trigger.Response:
        if self._converter is not None:
            self._converter.restart()
        response.success, response.message = True, 'the pulses of the next frame begin at 0'
        return response

    def _receive_info(self, message: Any) -> None:
        try:
            told = read_info(message, self.parameters['info_type'])
        except FrameError as error:
            self.health.count('frames_rejected')
            self.health.warning(f'a message of radar_info is of no use: {error}')
            return
        if self._converter.tell(told):
            self.health.info('radar_info: ' + ', '.join(f'{k}={v}' for k, v in told.items()))

    def _receive(self, message: Any) -> None:
        received_ns = self.get_clock().now().nanoseconds
        self.health.count('frames_received')
        watch = self._watch
        if watch is not None:
            watch.arrived()
        try:
            frame = read_frame(message, self.parameters['message_type'], self._sizes, self._axes)
            block = self._converter.convert(frame, received_ns)
        except (FrameError, DescriptionError) as error:
            self.health.count('frames_rejected')
            self.health.tell('last_rejection', str(error))
            self.health.warning(f'rejected a frame: {error}')
            return
        except Exception as error:
            self.report_error(error, 'error at a frame, the node continues')
            return
        self.health.set('frames_missing', self._converter.statistics.missing)
        if block is None:
            self.health.count('frames_incomplete')
            self.health.warning(f'left out the frame of {frame.stamp_ns * 1e-9:.6f} s: the driver '
                                'lost packets of it')
            return
        self.health.count('frames_converted')
        self._tell_of_channels(block)
        self._tell_of_doubts()
        self.health.count('pulses_published', block.n_pulses)
        self._output.publish(block)

    def _tell_of_channels(self, block: PulseBlock) -> None:
        """Log, once, what `pulse_buffer` has to know."""
        if self._told:
            return
        self._told, array = True, self._converter.array
        lists = {'antenna.tx': array.tx_m.reshape(-1), 'antenna.rx': array.rx_m.reshape(-1),
                 'antenna.offset_s': array.offset_s}
        self.health.info(
            f'{block.n_channels} channels of {block.n_samples} samples; pulse_buffer needs '
            + ', '.join(f'{name}: {values.round(12).tolist()}'
                        for name, values in lists.items()))
        for text in array.doubts(block.radar.wavelength_m):
            self.health.warning(text)

    def _tell_of_doubts(self) -> None:
        """Warn, once, where frames contradict the description."""
        if self._doubted:
            return
        for text in self._converter.doubts():
            self._doubted = True
            self.health.warning(text)


def _message_class(parameter: str, name: str, known: Mapping[str, object]) -> type:
    """Class of a message type such as ``'xwr_msgs/msg/IQ'``."""
    package, _, short = name.rpartition('/')
    if short not in known or not package:
        raise ConfigurationError(f'parameter {parameter}={name!r}; expected the full name of a '
                                 f'type such as package/msg/{next(iter(known))}, the last part '
                                 f'one of {", ".join(known)}')
    package = package.removesuffix('/msg')
    try:
        return getattr(importlib.import_module(f'{package}.msg'), short)
    except (ImportError, AttributeError) as error:
        raise ConfigurationError(
            f'parameter {parameter}={name!r}: this Python has no such messages ({error}); source '
            f'the workspace in which {package} was built') from error


def main() -> int:
    """Run the node."""
    return run(RadarDriverNode)


if __name__ == '__main__':
    sys.exit(main())
