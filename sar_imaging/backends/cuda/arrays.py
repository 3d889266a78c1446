# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""The array library and the compiler of kernels, and what they tell of the device.

`xp` is CuPy on a device, and NumPy in Numba's simulator of one (``NUMBA_ENABLE_CUDASIM=1``), which
runs the kernels without a device, slowly. No other module of this backend tells the two apart.
"""

from __future__ import annotations

import functools
import importlib
import warnings
from collections.abc import Callable
from typing import Any, ParamSpec, TypeVar

import numpy as np
from numba import config

from ...memory import available_bytes, granted_bytes
from ..device import DeviceError
from ..simulated import SimulatedArray

SIMULATED = bool(config.ENABLE_CUDASIM)
_INSTALL = "backend='cuda' needs CuPy and numba-cuda: pip install 'sar_imaging[cuda]'"
_P = ParamSpec('_P')
_R = TypeVar('_R')
_OTHER = "use backend='cpu', or 'auto' for whatever there is"

try:
    with warnings.catch_warnings():
        warnings.simplefilter('ignore')  # Numba's own copy is named deprecated
        from numba import cuda
    if SIMULATED:
        xp = np
        _as_float = _as_int = None
        _FAILURES: tuple[type[Exception], ...] = ()
        _OUT_OF_MEMORY: tuple[type[Exception], ...] = ()
    else:
        xp = importlib.import_module('cupy')  # an extra
        _as_float, _as_int = cuda.libdevice.int_as_float, cuda.libdevice.float_as_int
        _OUT_OF_MEMORY = (xp.cuda.memory.OutOfMemoryError,)
        _FAILURES = (xp.cuda.runtime.CUDARuntimeError, xp.cuda.driver.CUDADriverError,
                     xp.cuda.cufft.CuFFTError, xp.cuda.compiler.CompileException,
                     cuda.cudadrv.error.CudaSupportError, cuda.cudadrv.driver.CudaAPIError,
                     cuda.cudadrv.error.NvvmError)
        # Both libraries use the same stream: nothing has to wait for its arrays.
        config.CUDA_ARRAY_INTERFACE_SYNC = False
        config.CUDA_LOW_OCCUPANCY_WARNINGS = False  # of small images, at each launch
except ImportError as error:
    raise DeviceError(f'{_INSTALL} ({str(error).splitlines()[0]})') from error


def require_device() -> None:
    """Refuse a machine without a device that works.

    Raises
    ------
    DeviceError
        There is none, its driver fails, or the compiler of its kernels does.
    """
    if not SIMULATED:
        try:
            if not xp.cuda.runtime.getDeviceCount():
                raise DeviceError(f'the CUDA driver finds no device; {_OTHER}')
            _run_first_kernel()
        # A compiler that does not fit NumPy or the driver raises whatever it likes.
        except Exception as error:
            if isinstance(error, DeviceError):
                raise
            raise DeviceError(f'the CUDA device cannot be used ({error}); {_OTHER}') from error


@functools.cache
def _run_first_kernel() -> None:
    """Have the device fill an array with a compiled kernel."""
    cuda.jit(_fill)[1, 1](xp.zeros(1, np.int32))
    synchronise()


def _fill(array: np.ndarray) -> None:
    array[0] = 1


def reports_failures(work: Callable[_P, _R]) -> Callable[_P, _R]:
    """Have a function raise `DeviceError` where the device fails, whichever library tells."""
    @functools.wraps(work)
    def reporting(*arguments: _P.args, **options: _P.kwargs) -> _R:
        try:
            return work(*arguments, **options)
        except _OUT_OF_MEMORY as error:
            raise DeviceError(f'out of device memory: {error}; {free_bytes() / 1e6:.0f} MB are '
                              'free') from error
        except _FAILURES as error:
            raise DeviceError(f'the CUDA device failed: {error}') from error

    return reporting


def device_name() -> str:
    """Name of the device."""
    if SIMULATED:
        return 'simulator'
    return xp.cuda.runtime.getDeviceProperties(xp.cuda.Device().id)['name'].decode()


def synchronise() -> None:
    """Wait until the device has done what it was given."""
    if not SIMULATED:
        xp.cuda.Device().synchronize()


def free_bytes() -> int:
    """Memory of the device that can be had, bytes: what is free and what CuPy keeps unused.

    Or what `memory.granting` grants.
    """
    if SIMULATED or granted_bytes():
        return available_bytes()
    return xp.cuda.runtime.memGetInfo()[0] + xp.get_default_memory_pool().free_bytes()


def check_memory(n_bytes: int, what: str, remedy: str) -> None:
    """Refuse what the device's memory cannot hold.

    Raises
    ------
    DeviceError
        It needs more than there is.
    """
    free = free_bytes()
    if n_bytes > free:
        raise DeviceError(f'{what} needs {n_bytes / 1e6:.3f} MB of device memory, '
                          f'{free / 1e6:.3f} MB are free; {remedy}')


def kernel(*, registers: int | None = None) -> Callable[[Callable[..., Any]], Any]:
    """Decorate a kernel; `registers` of a thread at most, that more threads may run at once."""
    return cuda.jit if SIMULATED or registers is None else cuda.jit(max_registers=registers)


def function(work: Callable[..., Any]) -> Callable[..., Any]:
    """Decorate what kernels call; in the simulator it stays a function, which is quicker."""
    return work if SIMULATED else cuda.jit(device=True)(work)


def pairs(array: np.ndarray) -> np.ndarray:
    """The elements of a contiguous complex64 array one by one, as `load_pair` takes them.

    A compiler loads the parts of a complex number one after the other. Here they are 64 bits.
    """
    flat = array.reshape(-1)
    return flat if SIMULATED else flat.view(np.int64)


@function
def load_pair(values, at):
    """Real and imaginary part of an element of `pairs`, float32."""
    if SIMULATED:
        return values[at].real, values[at].imag
    bits = values[at]
    return _as_float(np.int32(bits)), _as_float(np.int32(bits >> 32))


@function
def store_pair(values, at, real, imag):
    """Set an element of `pairs`."""
    if SIMULATED:
        values[at] = complex(real, imag)
    else:
        values[at] = (np.int64(_as_int(imag)) << 32) | np.int64(np.uint32(_as_int(real)))


def launch(work: Any, blocks: int | tuple[int, ...], threads: int | tuple[int, ...],
           *arguments: Any) -> None:
    """Run a kernel on the present stream; no block, no work.

    Tuples among the arguments hold numbers alone: of arrays of CuPy in a tuple Numba does not know
    the type, though it takes tuples and named ones.
    """
    if not np.all(np.atleast_1d(blocks)):
        return
    if SIMULATED:
        work[blocks, threads](*arguments)
    else:
        stream = xp.cuda.get_current_stream().ptr
        work[blocks, threads, cuda.external_stream(stream) if stream else 0](*arguments)


def on_device(array: object) -> bool:
    """Whether somebody gave an array that lies in the device's memory."""
    return isinstance(array, SimulatedArray if SIMULATED else xp.ndarray)


def taken(array: Any) -> np.ndarray:
    """An array that somebody gave as this backend works on it: in the simulator, NumPy's."""
    return array.values if SIMULATED and on_device(array) else array


def given(array: np.ndarray) -> Any:
    """An array of this backend as others get it: one of the device, in the simulator, too."""
    return SimulatedArray(array) if SIMULATED and not on_device(array) else array


def complex_samples(samples: np.ndarray) -> np.ndarray:
    """Samples (..., N) complex64 on the device; pairs of integers (..., N, 2) are converted there.

    Half the bytes travel so, where a radar delivers int16.
    """
    samples = taken(samples)
    if samples.dtype.kind != 'i':
        return xp.ascontiguousarray(xp.asarray(samples), dtype=np.complex64)
    pairs = xp.ascontiguousarray(xp.asarray(samples).astype(np.float32))
    return pairs.view(np.complex64)[..., 0]
