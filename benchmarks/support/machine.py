"""The machine that a measurement was made on, for its results."""

from __future__ import annotations

import os
import pathlib
import platform

import numpy as np


def cpu_model() -> str:
    """Name of the processor."""
    try:
        for line in pathlib.Path('/proc/cpuinfo').read_text().splitlines():
            if line.startswith('model name'):
                return line.split(':', 1)[1].strip()
    except OSError:
        pass  # not Linux
    return platform.processor() or platform.machine()


def machine() -> dict[str, str | int]:
    """Processor, number of processors, system, Python and NumPy."""
    return {'cpu': cpu_model(), 'cpus': os.cpu_count(), 'system': platform.system(),
            'python': platform.python_version(), 'numpy': np.__version__}
