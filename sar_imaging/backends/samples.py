# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Samples of the host or a device: their way there, range compression, and who takes them."""

from __future__ import annotations

import dataclasses
import logging
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np

from ..device_arrays import on_device, to_host
from ..signal.pulses import PulseBlock
from . import AUTO, CUDA, backend as find_backend
from .device import DeviceError, device_backend, require_device

if TYPE_CHECKING:
    from ..signal.range_compression import RangeCompressor
    from .protocol import Backend

_logger = logging.getLogger(__name__)


def compress(compressor: RangeCompressor, block: PulseBlock,
             backend: str | Backend = AUTO) -> PulseBlock:
    """Range profiles of a block, by the processor or on a CUDA device.

    Parameters
    ----------
    compressor : RangeCompressor
        Planned for such blocks.
    block : PulseBlock
        Raw pulses of the host or the device.
    backend : str or Backend
        ``'cuda'``: on the device, where the profiles stay; samples of the host go there piece by
        piece, while others are compressed. ``'auto'``: where the samples lie, but those of the
        host on the device where their way there and back is worth it. Anything else: by the
        processor; samples of the device are refused.

    Returns
    -------
    PulseBlock
        See `RangeCompressor`.

    Raises
    ------
    ValueError
        As `RangeCompressor` says.
    DeviceError
        ``'cuda'`` was asked for, and the device is missing, fails or lacks memory.

    Examples
    --------
    >>> from sar_imaging import RangeCompressor
    >>> from sar_imaging.backends.samples import compress
    >>> from sar_imaging.simulation import SCENARIOS
    >>> raw = next(SCENARIOS['psf_raw']().blocks())
    >>> profiles = compress(RangeCompressor.for_block(raw), raw)
    >>> profiles.samples.shape
    (25, 5, 193)
    """
    there = on_device(block.samples)
    if backend == CUDA:
        return _entry('compress')(compressor, block)
    if backend != AUTO and there:
        check_device_arrays(backend)
    if backend == AUTO and (there or _worth_the_way(compressor, block)):
        try:
            found = _entry('compress')(compressor, block)
            return found if there else dataclasses.replace(found, samples=to_host(found.samples))
        except DeviceError as error:
            _logger.warning(f'{error}; the processor computes')
            block = dataclasses.replace(block, samples=to_host(block.samples))
    return compressor(block)


def to_device(samples: np.ndarray) -> Any:
    """Copy samples of the host to the CUDA device, through page-locked memory.

    Parameters
    ----------
    samples : (P, C, N) complex64, or (P, C, N, 2) integer
        Samples, or their real and imaginary parts as a radar's converter gives them: these are
        converted on the device, so that int16 travels with half the bytes of complex64.

    Returns
    -------
    (P, C, N) complex64 array of CuPy
        For a `PulseBlock`, whose profiles and images then stay on the device.

    Raises
    ------
    DeviceError
        There is no device that works, or it lacks memory.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging.backends import DeviceError
    >>> from sar_imaging.backends.samples import to_device
    >>> pairs = np.zeros((16, 1, 1024, 2), np.int16)  # I and Q of a converter
    >>> try:
    ...     shape = to_device(pairs).shape
    ... except DeviceError:  # no device here
    ...     shape = pairs.shape[:3]
    >>> shape
    (16, 1, 1024)
    """
    return _entry('to_device')(samples)


def check_device_arrays(backend: str | Backend) -> None:
    """Check that a backend takes samples that lie on a CUDA device.

    Raises
    ------
    ValueError
        It does not say so: it has no true attribute ``DEVICE_ARRAYS``.
    """
    if not getattr(find_backend(backend), 'DEVICE_ARRAYS', False):
        raise ValueError(f'the samples lie on a CUDA device, where backend={backend!r} does not '
                         f'reach them; use backend={CUDA!r} or {AUTO!r}, or copy them to the host '
                         'with samples.get()')


def _entry(name: str) -> Callable[..., Any]:
    """A function of the device's backend; DeviceError where there is no device that works."""
    return getattr(require_device(), name)


def _worth_the_way(compressor: RangeCompressor, block: PulseBlock) -> bool:
    """Whether a device compresses samples of the host sooner, profiles brought back."""
    if device_backend() is None:
        return False
    from .automatic import sooner_there

    n_echoes = block.n_pulses * block.n_channels
    n_samples = n_echoes * (block.n_samples + compressor.n_output)
    return sooner_there({'profile_bin': n_samples}, n_samples, 'range compression')
