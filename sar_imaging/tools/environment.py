# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Print what a report of a fault tells of a machine: versions, processor, ROS, device, variables.

Run: python -m sar_imaging.tools.environment
"""

from __future__ import annotations

import argparse
import contextlib
import importlib.metadata
import importlib.util
import os
import platform
import re
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import sar_imaging
from sar_imaging.memory import available_bytes

from .program import command_parser, main_of

_DESCRIPTION = """\
Print what a report of a fault needs: versions of this package and of the libraries that it uses,
processor, memory, ROS, CUDA device, and the variables of the environment that change what it does.
Paste it into the report; read it first, since paths may tell your name.
"""
#: Distributions that the package needs, and those of its extras.
REQUIRED = 'numpy', 'scipy', 'numba', 'pyyaml', 'tqdm'
OPTIONAL = ('matplotlib', 'rosbags', 'sarkit', 'rasterio', 'pyproj', 'pystac', 'dask',
            'distributed', 'bokeh', 'zarr', 'h5py', 'cupy-cuda13x', 'numba-cuda')
_VARIABLES = re.compile('SAR_IMAGING_|NUMBA_|OMP_|ROS_|RMW_|FASTRTPS_|FASTDDS_|CYCLONEDDS_')


def parser() -> argparse.ArgumentParser:
    """Command line of this program."""
    return command_parser('sar-imaging env', _DESCRIPTION)


def run(_: argparse.Namespace) -> str:
    """The description, a line for each thing."""
    rows = {'sar_imaging': f'{sar_imaging.__version__} in {Path(sar_imaging.__file__).parent}',
            'Python': f'{platform.python_version()}, {sys.executable}',
            'system': f'{platform.platform()}',
            'processor': f'{cpu_model()}, {_usable_processors()} of {os.cpu_count()} processors '
                         f'usable, {available_bytes() / 1e9:.1f} GB of memory free',
            'kernels': _kernels(), 'ROS': _ros(), 'device': _device()}
    rows |= {'libraries': _versions(REQUIRED), 'extras': _versions(OPTIONAL)}
    rows['variables'] = ', '.join(f'{name}={value}' for name, value in sorted(os.environ.items())
                                  if _VARIABLES.match(name)) or 'none'
    width = max(map(len, rows))
    return '\n'.join(f'{name:{width}}  {text}' for name, text in rows.items())


def cpu_model() -> str:
    """Name of the processor."""
    try:
        for line in Path('/proc/cpuinfo').read_text().splitlines():
            if line.startswith(('model name', 'Model')):
                return line.split(':', 1)[1].strip()
    except OSError:
        pass  # not Linux
    return platform.processor() or platform.machine()


def _usable_processors() -> int | None:
    return len(os.sched_getaffinity(0)) if hasattr(os, 'sched_getaffinity') else os.cpu_count()


def _kernels() -> str:
    try:
        import llvmlite.binding
        import numba
    except ImportError as error:
        return f'none: {error}'
    config: Any = numba.config  # whose names it makes
    return (f'compiled for {llvmlite.binding.get_host_cpu_name()}, '
            f'{config.NUMBA_NUM_THREADS} threads'
            + ('' if _threads_may_share_them() else '; no OpenMP: install libgomp1 before several '
               'threads of a process form images at once, which ends it otherwise'))


def _threads_may_share_them() -> bool:
    """Whether Numba has a layer whose parallel loops bear several callers at once."""
    for pool in ('omppool', 'tbbpool'):
        with contextlib.suppress(ImportError):  # as where the library that it needs is not there
            importlib.import_module(f'numba.np.ufunc.{pool}')
            return True
    return False


def _ros() -> str:
    if importlib.util.find_spec('rclpy') is None:
        return 'rclpy is not installed: nodes do not run, all else does'
    from rclpy.utilities import get_rmw_implementation_identifier

    return (f'{os.environ.get("ROS_DISTRO", "no ROS_DISTRO")}, '
            f'{get_rmw_implementation_identifier()}')


def _device() -> str:
    from sar_imaging.backends.device import DeviceError, require_device

    try:
        return require_device().device_name()
    except DeviceError as error:
        return f'none: {error}'


def _versions(names: Iterable[str]) -> str:
    return ', '.join(f'{name} {_version(name)}' for name in names)


def _version(name: str) -> str:
    try:
        return importlib.metadata.version(name)
    except importlib.metadata.PackageNotFoundError:
        return 'not installed'


main = main_of(parser, run)

if __name__ == '__main__':
    raise SystemExit(main())
