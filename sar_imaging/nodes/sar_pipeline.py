# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Node sar_pipeline: turn pulses into images in one process, without messages in between."""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

from .afbp_fusion import FusionStep
from .backprojection import SUBAPERTURES, BackprojectionStep
from .images.autofocus import PHASE_GRADIENT
from .pulse_buffer import PulseBufferStep
from .range_compression import RangeCompressionStep
from .runtime.managed import fail, run
from .runtime.parameters import ConfigurationError, merged_arguments
from .runtime.stage import Stage
from .runtime.step import Step


class SarPipelineNode(Stage):
    """The steps of the separate nodes in a row, with the same parameters, topics and images."""

    NAME = 'sar_pipeline'
    INPUT = 'pulses'
    STEPS = (PulseBufferStep, RangeCompressionStep, BackprojectionStep, FusionStep)

    def steps(self) -> tuple[type[Step], ...]:
        """Without fusion where backprojection makes the images itself."""
        p, name = self.parameters, PHASE_GRADIENT.name
        if p[name] and (p['mode'] != SUBAPERTURES or p['subapertures.sliding']):
            raise ConfigurationError(
                f'{name} is not possible here: it works on fused images of apertures that do not '
                f'slide; set mode {SUBAPERTURES} without sliding, or use autofocus.track_error in '
                'mode image')
        return self.STEPS if self.parameters['mode'] == SUBAPERTURES else self.STEPS[:-1]


def main() -> int:
    """Run the node; parameter files may have the sections of the separate nodes."""
    with tempfile.TemporaryDirectory() as folder:
        try:
            arguments = merged_arguments(sys.argv, SarPipelineNode.NAME,
                                         [step.NAME for step in SarPipelineNode.STEPS],
                                         Path(folder))
        except ConfigurationError as error:
            return fail(SarPipelineNode.NAME, error)
        return run(SarPipelineNode, arguments)


if __name__ == '__main__':
    sys.exit(main())
