# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""ROS 2 nodes that turn pulses into images; they hold no mathematics.

`radar_driver`, `pulse_buffer`, `range_compression`, `backprojection`, `afbp_fusion`,
`moving_targets` and `localization` are the programs, `sar_pipeline` all stages in one process.
What they share is in `runtime` (life cycle, queues, parameters, diagnostics), `poses` (odometry
and tf), `antenna` and `images` (grid, focus, topics).
"""

import os
import signal
import sys

EXECUTABLES = ('radar_driver', 'pulse_buffer', 'range_compression', 'backprojection',
               'afbp_fusion', 'sar_pipeline', 'moving_targets', 'localization')


def _end_quietly(*_: object) -> None:
    """Ctrl-C while the libraries are still being loaded: nothing has begun that must be ended."""
    os._exit(0)


# Only where a node is what was started: `python -m` puts '-m' here until the module runs.
if (os.path.basename(sys.argv[0]) in ('-m', *EXECUTABLES)
        and signal.getsignal(signal.SIGINT) is signal.default_int_handler):
    signal.signal(signal.SIGINT, _end_quietly)

# Threads of a kernel that wait for the next one would spin otherwise: half of the processor time
# of short kernels, which the other nodes and the middleware need. Read when the first one runs.
os.environ.setdefault('OMP_WAIT_POLICY', 'passive')
