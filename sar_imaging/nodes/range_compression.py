# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Node range_compression: turn raw pulse blocks into range profiles."""

from __future__ import annotations

import dataclasses
import math
import sys
from collections.abc import Mapping
from typing import Any

from msg_conversions.pulse_block import as_received
from sar_imaging.backends.samples import compress
from sar_imaging.device_arrays import to_host
from sar_imaging.signal.background import BackgroundFilter
from sar_imaging.signal.calibration import ChannelCalibration
from sar_imaging.signal.pulses import PulseBlock, check_frame
from sar_imaging.signal.range_compression import RANGE_FILTERS, RangeCompressor
from sar_imaging.signal.windows import WINDOW_NAMES, parse_window

from .runtime.block_output import UNTAKEN, BlockOutput
from .runtime.health import Health, Part
from .runtime.managed import ManagedNode, run
from .runtime.parameters import ANY_TIME, BACKEND, Parameter, backend_of, one_of
from .runtime.stage import Stage
from .runtime.step import Step

LARGEST_RANGE_M = 1e8


def _calibration(path: str) -> ChannelCalibration | None:
    """Calibration of the file named; raises `CalibrationError` (a ValueError) when it is bad."""
    return ChannelCalibration.load(path) if path else None


PARAMETERS = (
    Parameter('window', 'none', f'Weighting over the band: {", ".join(WINDOW_NAMES)}; also '
              'taylor:NBAR:SIDELOBE_DB and kaiser:BETA.', check=parse_window, changes=ANY_TIME),
    Parameter('range_filter', 'equalised', 'Filter for LFM pulses: equalised (the response is '
              "the window's alone) or matched (least loss of signal to noise).",
              check=one_of(*RANGE_FILTERS), changes=ANY_TIME),
    Parameter('oversampling', 2.0, 'Range samples per null spacing c/2B of the output.',
              'samples per cell', 1.0, 16.0, changes=ANY_TIME),
    Parameter('near_range', 0.0, 'Profiles begin at this distance (half the two-way path).', 'm',
              0.0, LARGEST_RANGE_M, changes=ANY_TIME),
    Parameter('far_range', 0.0, 'Profiles end at this distance; 0.0: where the samples do.', 'm',
              0.0, LARGEST_RANGE_M, changes=ANY_TIME),
    Parameter('calibration_file', '', 'YAML file with amplitude, phase and delay of each channel, '
              'as the tool calibrate writes it; empty: none.', check=_calibration,
              changes=ANY_TIME),
    Parameter('background_s', 0.0, 'Time constant of the moving average over the pulses that is '
              'subtracted as static background, such as the direct path; 0.0: none.', 's', 0.0,
              86_400.0, changes=ANY_TIME),
    BACKEND,
)


class RangeCompressionStep(Step):
    """Raw pulse blocks to range profiles; see `RangeCompressor`."""

    NAME = 'range_compression'
    PARAMETERS = PARAMETERS
    COUNTERS = ('blocks_compressed', 'plans_made')
    FAULTS = ('pulses_corrupt', UNTAKEN)

    def __init__(self, parameters: Mapping[str, Any], health: Health | Part):
        super().__init__(parameters, health)
        self._plan: RangeCompressor | None = None
        self._planned_for: tuple[Any, ...] | None = None
        self._background: BackgroundFilter | None = None
        self._backend = backend_of(parameters)

    def create_outputs(self, node: ManagedNode) -> None:
        """Create the publisher of the profiles; see `Step`."""
        self._output = BlockOutput(node, 'range_profiles', self.parameters, self.health)

    def summary(self) -> str:
        """Settings for the log line at the start."""
        seconds = self.parameters['background_s']
        background = f', background averaged over {seconds:g} s subtracted' if seconds else ''
        return (f' -> {self._output.topic}, window {self.parameters["window"]}, '
                f'{self.parameters["oversampling"]:g} samples per null spacing{background}')

    def process(self, block: PulseBlock) -> list[PulseBlock]:
        """Range profiles of a block."""
        check_frame(block, self.parameters['frame_id'])
        found = compress(self._plan_for(block), self._without_background(block), self._backend)
        profiles = as_received(dataclasses.replace(found, samples=to_host(found.samples)))
        self.health.count('blocks_compressed')
        return [profiles]

    def publish(self, product: PulseBlock) -> None:
        """Publish profiles."""
        self._output.publish(product)

    def discard(self) -> int:
        """Forget the background; nothing else is underway."""
        self._background = None
        return 0

    def _without_background(self, block: PulseBlock) -> PulseBlock:
        time_constant_s = self.parameters['background_s']
        if not time_constant_s:
            self._background = None
            return block
        if self._background is None or self._background.time_constant_s != time_constant_s:
            self._background = BackgroundFilter(time_constant_s)
        return self._background(block)

    def _plan_for(self, block: PulseBlock) -> RangeCompressor:
        """Plan for blocks like this one; made anew when the radar or a parameter changed."""
        settings = [self.parameters[p.name] for p in PARAMETERS if p.name not in (
            'background_s', BACKEND.name)]
        key = (block.radar, block.n_samples, block.compressed, *settings)
        if key != self._planned_for:
            self._plan, self._planned_for = self._planned(block), key
            self.health.count('plans_made')
            radar, output = block.radar, self._plan.output_radar
            self.health.info(
                f'planned for {"profiles" if block.compressed else radar.waveform.name} at '
                f'{radar.carrier_hz / 1e9:.6g} GHz, {radar.bandwidth_hz / 1e6:.6g} MHz: '
                f'{block.n_samples} samples to {self._plan.n_output}, '
                f'{output.sample_spacing_m:.4g} m apart, loss of signal to noise '
                f'{self._plan.snr_loss_db:.2f} dB')
        return self._plan

    def _planned(self, block: PulseBlock) -> RangeCompressor:
        settings = {name: self.parameters[name] for name in ('window', 'range_filter',
                                                             'oversampling')}
        near, far = self.parameters['near_range'], self.parameters['far_range']
        return RangeCompressor.for_block(
            block, **settings, calibration=_calibration(self.parameters['calibration_file']),
            range_window_m=(near, far or math.inf) if near or far else None)


class RangeCompressionNode(Stage):
    """Publishes range profiles on `range_profiles` from what comes on `pulse_blocks`."""

    NAME = 'range_compression'
    INPUT = 'pulse_blocks'
    STEPS = (RangeCompressionStep,)


def main() -> int:
    """Run the node."""
    return run(RangeCompressionNode)


if __name__ == '__main__':
    sys.exit(main())
