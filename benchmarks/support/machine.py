# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""The machine that a measurement was made on, for its results."""

from __future__ import annotations

import os
import platform

import numpy as np

from sar_imaging.tools.environment import cpu_model


def machine() -> dict[str, str | int]:
    """Processor, number of processors, system, Python and NumPy."""
    return {'cpu': cpu_model(), 'cpus': os.cpu_count(), 'system': platform.system(),
            'python': platform.python_version(), 'numpy': np.__version__}
