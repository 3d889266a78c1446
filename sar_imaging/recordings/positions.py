# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Positions of the radar at its pulses, given without a clock of their own."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np

from .description import Section

KEYS = ('file', 'variable', 'variables', 'unit_m', 'frame', 'steps_m', 'centre_m', 'line', 'arc')
_ONE_OF = ('variable', 'variables', 'steps_m', 'line', 'arc')
FRAMES = ('z_up', 'y_up', 'ned')
# Rows: axes x, y, z of the imaging frame in those of the data.
TO_Z_UP = {'z_up': np.eye(3), 'y_up': np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]),
           'ned': np.array([[0, 1.0, 0], [1, 0, 0], [0, 0, -1]])}


def read_positions(section: Section, pulse_shape: tuple[int, ...], data: Any) -> np.ndarray:
    """Positions of a description.

    Parameters
    ----------
    section : Section
        The part ``positions``.
    pulse_shape : tuple of int
        Lengths of the axes that together count the pulses.
    data : DataFiles
        Files with the variables.

    Returns
    -------
    (P, 3) float64
        Of the radar at each pulse, metres, z up.

    Raises
    ------
    DescriptionError
        The positions do not fit the pulses.
    """
    given = [key for key in _ONE_OF if key in section]
    if len(given) != 1:
        raise section.error(given[1] if given else 'variable',
                            f'exactly one of {", ".join(_ONE_OF)}')
    n_pulses = int(np.prod(pulse_shape))
    if given[0] in ('variable', 'variables'):
        position_m = _stored(section, given[0], data)
        if len(position_m) != n_pulses:
            raise section.error(given[0], f'one position for each of {n_pulses} pulses',
                                f'it holds {len(position_m)}')
        return (read_unit(section) * position_m
                @ TO_Z_UP[section.choice('frame', FRAMES, 'z_up')].T)
    return {'steps_m': _raster, 'line': _line, 'arc': _arc}[given[0]](section, pulse_shape)


def read_unit(section: Section) -> float:
    """Unit of stored positions, metres.

    Raises
    ------
    DescriptionError
        It is not positive.
    """
    unit_m = section.number('unit_m', 1.0)
    if unit_m <= 0:
        raise section.error('unit_m', 'metres, such as 0.001 for positions in millimetres')
    return unit_m


def _stored(section: Section, key: str, data: Any) -> np.ndarray:
    # float64 before any difference is taken: a range is kilometres and a phase millimetres.
    if key == 'variable':
        position_m = data.real(section.text('variable')).astype(np.float64)
        if position_m.ndim != 2 or position_m.shape[1] != 3:
            raise section.error('variable', 'an array of shape (pulses, 3)',
                                f'its shape is {position_m.shape}: store it transposed'
                                if position_m.shape[:1] == (3,) else
                                f'its shape is {position_m.shape}')
    else:
        names = section.raw('variables')
        if not isinstance(names, list) or len(names) != 3:
            raise section.error('variables', 'the names of x, y and z')
        axes = [data.real(str(name)).reshape(-1).astype(np.float64) for name in names]
        if len({axis.size for axis in axes}) > 1:
            raise section.error('variables', 'x, y and z of one length',
                                f'they hold {", ".join(str(a.size) for a in axes)} numbers')
        position_m = np.stack(axes, axis=-1)
    if not np.isfinite(position_m).all():
        raise section.error(key, 'finite positions', 'it holds NaN or infinity')
    return position_m


def _raster(section: Section, pulse_shape: tuple[int, ...]) -> np.ndarray:
    """Equal steps along each axis that counts pulses, about a centre."""
    steps_m = section.vectors('steps_m')
    if len(steps_m) != len(pulse_shape):
        raise section.error('steps_m', f'a step [x, y, z] for each of {len(pulse_shape)} axes '
                            'pulse of samples.axes')
    counts = [np.arange(n) - (n - 1) / 2 for n in pulse_shape]
    places = np.array(list(itertools.product(*counts))).reshape(-1, len(counts))
    return section.vector('centre_m', np.zeros(3)) + places @ steps_m


def _line(section: Section, pulse_shape: tuple[int, ...]) -> np.ndarray:
    ends = section.section('line', ('first_m', 'last_m'))
    first, last = ends.vector('first_m'), ends.vector('last_m')
    return np.linspace(first, last, int(np.prod(pulse_shape)))


def _arc(section: Section, pulse_shape: tuple[int, ...]) -> np.ndarray:
    """Equal angles on a horizontal circle about a centre, counted from x towards y."""
    arc = section.section('arc', ('radius_m', 'first_deg', 'last_deg'))
    first, last = (np.radians(arc.number(key)) for key in ('first_deg', 'last_deg'))
    angle, radius_m = np.linspace(first, last, int(np.prod(pulse_shape))), arc.number('radius_m')
    circle = radius_m * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=-1)
    return circle + section.vector('centre_m', np.zeros(3))
