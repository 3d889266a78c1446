# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Whether there is a CUDA device, found out without importing anything of CUDA."""

from __future__ import annotations

import functools
import importlib
import importlib.util
import logging
from pathlib import Path
from types import ModuleType

_logger = logging.getLogger(__name__)
#: What drivers put there: on Linux, in its subsystem for Windows, and on Jetson boards.
_NODES = tuple(map(Path, ('/dev/nvidiactl', '/dev/dxg', '/dev/nvhost-gpu', '/dev/nvgpu')))


class DeviceError(RuntimeError):
    """A device is missing, fails, or lacks memory; a processor can do the same work.

    Examples
    --------
    >>> from sar_imaging.backends import DeviceError, backend
    >>> try:
    ...     chosen = backend('cuda').__name__
    ... except DeviceError:  # no device here: the processor
    ...     chosen = backend('cpu').__name__
    >>> chosen in ('sar_imaging.backends.cuda', 'sar_imaging.backends.cpu')
    True
    """


@functools.cache
def device_backend() -> ModuleType | None:
    """The backend of the CUDA device; None where there is no device that works.

    Nothing is imported where no driver shows a device or CuPy is not installed. A device that is
    there and fails is told of in one line, once.
    """
    if not any(node.exists() for node in _NODES) or importlib.util.find_spec('cupy') is None:
        return None
    try:
        return require_device()
    except DeviceError as error:
        _logger.warning(f'{error}; the processor computes')
        return None


def require_device() -> ModuleType:
    """The backend of the CUDA device.

    Raises
    ------
    DeviceError
        There is no device that works, or its libraries are missing.
    """
    importlib.import_module('.cuda.arrays', __package__).require_device()
    return importlib.import_module('.cuda', __package__)
