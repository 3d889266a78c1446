# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Samples of measured data as (pulses, channels, samples): layout, I/Q order and sign."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..names import advice_on
from ..numpy_files import check_memory
from .data_files import DataFiles
from .description import DescriptionError, Section

KEYS = ('file', 'variable', 'axes', 'iq', 'conjugate', 'scale', 'remove_background', 'dtype',
        'sizes', 'header_bytes', 'sha256', 'topic')
OF_FILES = ('variable', 'dtype', 'header_bytes', 'sha256')
AXES = ('pulse', 'tx', 'rx', 'channel', 'sample', 'iq')
IQ = ('complex', 'pairs', 'iiqq', 'qqii', 'real')
DTYPES = ('int16', 'int32', 'uint16', 'float32', 'float64', 'complex64', 'complex128')
_BLOCK = 2**22  # samples converted at once: double precision for a part only


def read_samples(section: Section, data: DataFiles) -> tuple[np.ndarray, tuple[int, ...], int]:
    """Samples of a description.

    Parameters
    ----------
    section : Section
        Its part ``samples``.
    data : DataFiles
        The files that it names.

    Returns
    -------
    samples : (P, C, N) complex64
        Channel ``n_receivers * transmitter + receiver`` where the data have both.
    pulse_shape : tuple of int
        Lengths of the axes that together count the pulses.
    n_receivers : int
        Receivers of each transmitter; all channels where the data have no axes of their own.

    Raises
    ------
    DescriptionError
        File and description do not fit.
    """
    axes = _axes(section)
    _check_content(section, data.paths)
    if 'dtype' in section:
        array = np.concatenate([_raw(section, path, axes) for path in data.paths]
                               ) if len(data.paths) > 1 else _raw(section, data.paths[0], axes)
    else:
        array = data.joined(section.text('variable', 'samples'), axes.index('pulse'))
    if array.ndim != len(axes):
        raise section.error('axes', f'{array.ndim} axes for the shape {array.shape}',
                            f'known are {", ".join(AXES)}, the first changes slowest')
    if not array.size:
        raise DescriptionError(f'{data.paths[0].name} holds no samples: its shape is '
                               f'{array.shape}')
    order = [i for label in AXES for i, a in enumerate(axes) if a == label]
    shape = dict.fromkeys(AXES, 1)
    for label, size in zip(axes, array.shape, strict=True):
        shape[label] *= size
    pulse_shape = tuple(n for n, label in zip(array.shape, axes, strict=True) if label == 'pulse')
    n_channels = shape['tx'] * shape['rx'] * shape['channel']
    numbers = array.transpose(order).reshape(shape['pulse'], n_channels, -1)
    return (_complex(section, numbers, 'iq' in axes), pulse_shape,
            shape['rx'] if 'rx' in axes else n_channels)


def _axes(section: Section) -> list[str]:
    axes = section.raw('axes', meaning='what each axis of the array counts, such as [pulse, '
                       'sample]')
    if not isinstance(axes, list):
        raise section.error('axes', f'a list of {", ".join(AXES)}')
    for label in axes:
        if label not in AXES:
            raise section.error('axes', f'a list of {", ".join(AXES)}',
                                f'{label}: {advice_on(label, AXES)}')
    for label in ('pulse', 'sample'):
        if label not in axes:
            raise section.error('axes', f'an axis {label}')
    if len(set(axes) - {'pulse'}) != len(axes) - axes.count('pulse'):
        raise section.error('axes', 'each axis once; only pulse may come several times')
    if 'channel' in axes and {'tx', 'rx'} & set(axes):
        raise section.error('axes', 'either channel, or tx and rx')
    return axes


def _check_content(section: Section, paths: Sequence[Path]) -> None:
    wanted = section.text('sha256', None)
    if wanted is None:
        return
    check_memory(paths[0].name, sum(path.stat().st_size for path in paths))
    found = hashlib.sha256(b''.join(path.read_bytes() for path in paths)).hexdigest()
    if found != wanted.lower():
        raise section.error('sha256', f'the file that the description was made for, not one with '
                            f'{found[:12]}...',
                            'its scene may be another: leave the key out to load it all the same')


def _raw(section: Section, path: Path, axes: list[str]) -> np.ndarray:
    """Numbers of a file without a header that tells their layout."""
    dtype = np.dtype(section.choice('dtype', DTYPES)).newbyteorder('<')
    sizes = section.section('sizes', AXES)
    for label in AXES:
        if label in sizes and (label == 'pulse' or label not in axes):
            raise sizes.error(label, 'the sizes of all axes but pulse',
                              'the length of the file tells the pulses'
                              if label == 'pulse' else f'{label} is not in samples.axes')
    known = [sizes.integer(a) for a in axes if a != 'pulse']
    if axes.count('pulse') != 1 or axes[0] != 'pulse':
        raise section.error('axes', 'pulse first, once, in files whose length tells its size')
    parts = 2 if _paired(section) and 'iq' not in axes else 1
    pulse_bytes = int(np.prod(known, dtype=np.int64)) * parts * dtype.itemsize
    header = section.integer('header_bytes', 0, least=0)
    try:
        n_bytes = path.stat().st_size - header
    except OSError as error:
        raise DescriptionError(f'{path} cannot be read: {error}') from error
    if n_bytes < pulse_bytes or n_bytes % pulse_bytes:
        raise DescriptionError(
            f'{path.name} holds {n_bytes} bytes of samples; expected a multiple of {pulse_bytes}, '
            f'one pulse of {" x ".join(map(str, known))}{" x 2" * (parts - 1)} {dtype.name}: '
            'check samples.sizes, samples.dtype and samples.iq')
    check_memory(path.name, n_bytes)
    known[[a for a in axes if a != 'pulse'].index('sample')] *= parts
    return np.fromfile(path, dtype, offset=header).reshape(-1, *known)


def read_scale(section: Section) -> float:
    """Factor for all samples.

    Raises
    ------
    DescriptionError
        It is 0.
    """
    scale = section.number('scale', 1.0)
    if scale == 0:
        raise section.error('scale', 'a factor other than 0', 'it would remove all samples')
    return scale


def _paired(section: Section) -> bool:
    return section.choice('iq', IQ, 'complex') in ('pairs', 'iiqq', 'qqii')


def _complex(section: Section, numbers: np.ndarray, own_axis: bool) -> np.ndarray:
    """(P, C, N) complex64 of the numbers (P, C, n) as converters write them."""
    convention = section.choice('iq', IQ, 'complex')
    if own_axis and convention != 'pairs':
        raise section.error('iq', 'pairs for data with an axis iq')
    is_complex = numbers.dtype.kind == 'c'
    if is_complex != (convention == 'complex'):
        raise section.error('iq', 'complex for complex numbers' if is_complex else
                            f'pairs, iiqq, qqii or real for {numbers.dtype} numbers')
    group = {'pairs': 2, 'iiqq': 4, 'qqii': 4}.get(convention, 1)
    if numbers.shape[-1] % group:
        raise section.error('iq', f'a multiple of {group} numbers for each ramp, not '
                            f'{numbers.shape[-1]}')
    n = numbers.shape[-1] // min(group, 2)
    check_memory('the samples', 8 * numbers.shape[0] * numbers.shape[1] * n)
    scale, conjugate = read_scale(section), section.flag('conjugate')
    out = np.empty((*numbers.shape[:2], n), np.complex64)
    step = max(1, _BLOCK // max(1, numbers.shape[1] * n))
    for first in range(0, len(numbers), step):
        part = slice(first, first + step)
        values = decode_iq(numbers[part], convention)
        if conjugate:
            # Whole numbers know no negative zero; adding 0 turns it.
            values = values.conj() if is_complex else values.conj() + 0.0
        with np.errstate(over='ignore'):  # infinities are told by pulse
            out[part] = values if scale == 1.0 else values * scale
    return out


def decode_iq(numbers: np.ndarray, convention: str) -> np.ndarray:
    """Complex samples of numbers as converters write them.

    Parameters
    ----------
    numbers : (..., n) array
        Complex, or numbers in the order of the convention along the last axis.
    convention : str
        ``'complex'``; ``'pairs'``: I, Q of each sample; ``'iiqq'``: I, I, Q, Q of two samples,
        ``'qqii'``: Q, Q, I, I; ``'real'``.

    Returns
    -------
    (..., N) complex128 or complex64
    """
    if convention == 'complex':
        return numbers
    if convention == 'real':
        return numbers.astype(np.complex128)
    if convention == 'pairs':
        in_phase, quadrature = numbers[..., 0::2], numbers[..., 1::2]
    else:
        fours = numbers.reshape(*numbers.shape[:-1], -1, 2, 2)
        in_phase, quadrature = (fours[..., i, :].reshape(*numbers.shape[:-1], -1)
                                for i in ((0, 1) if convention == 'iiqq' else (1, 0)))
    return in_phase + 1j * quadrature.astype(np.float64)
