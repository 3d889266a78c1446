# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Times of pulses and poses as nanoseconds, and which pulses are used."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from .description import DescriptionError, Section, of_part

KEYS = ('file', 'variable', 'first_s', 'interval_s', 'unit_s', 'use_s', 'counter')
OF_FILES = ('file', 'variable', 'first_s', 'interval_s', 'unit_s', 'counter')
# Clocks that begin at zero are set to this moment, 14 November 2023: recordings need dates.
EPOCH_NS = 1_700_000_000_000_000_000
_LATEST_S = 9e9  # of times in int64 nanoseconds: the year 2255
_LATEST_RELATIVE_NS = 10**17  # three years; later ones count from 1970


def to_nanoseconds(values: ArrayLike, unit_s: float = 1.0) -> np.ndarray:
    """Times in a unit as int64 nanoseconds, exact for whole nanoseconds.

    Parameters
    ----------
    values : array_like
        Times.
    unit_s : float
        Their unit, seconds.

    Raises
    ------
    ValueError
        They are not finite, or later than int64 nanoseconds can be.
    """
    values = np.asarray(values)
    latest_s = float(np.abs(values.astype(np.float64)).max(initial=0.0)) * unit_s
    if not latest_s <= _LATEST_S:  # NaN, too
        raise ValueError(
            f'a time of {latest_s:.6g} s; expected finite seconds, since 1970 or since a start: '
            'give the unit of the times as unit_s, such as 1.0e-9 for nanoseconds')
    factor = unit_s * 1e9
    if values.dtype.kind in 'iu' and factor == round(factor):
        return values.astype(np.int64) * int(factor)
    return np.rint(values.astype(np.float64) * factor).astype(np.int64)


def is_relative(*times_ns: np.ndarray) -> bool:
    """True when all times count from the start of a measurement and not from 1970."""
    return all(abs(int(t)) < _LATEST_RELATIVE_NS for times in times_ns if times.size
               for t in (times.min(), times.max()))


def read_times(section: Section, n_pulses: int, variable: Callable[[str], np.ndarray]
               ) -> tuple[np.ndarray, np.ndarray]:
    """Times and counters of the pulses.

    Parameters
    ----------
    section : Section
        The part ``times``.
    n_pulses : int
        Number of pulses P in the data.
    variable : callable
        Gives the variable of a name, joined over the files.

    Returns
    -------
    time_ns : (P,) int64
        As the clock of the radar has them, nanoseconds.
    counter : (P,) int64
        Running numbers; ascending from 0 where the data have none.

    Raises
    ------
    DescriptionError
        The times do not fit the pulses or run backwards.
    """
    unit_s = section.number('unit_s', 1.0)
    if unit_s <= 0:
        raise section.error('unit_s', 'seconds, such as 1.0e-3 for times in milliseconds')
    if 'variable' in section:
        try:
            time_ns = to_nanoseconds(variable(section.text('variable')).reshape(-1), unit_s)
        except ValueError as error:  # a file without the variable, too
            raise DescriptionError(f'times: {error}') from error
        if time_ns.size != n_pulses:
            raise section.error('variable', f'one time for each of {n_pulses} pulses',
                                f'it holds {time_ns.size}; is samples.axes in the right order?')
    else:
        if 'interval_s' not in section:
            raise section.error('variable', 'the name of a variable with the times of the pulses, '
                                'or interval_s')
        interval_s = section.number('interval_s')
        if interval_s <= 0:
            raise section.error('interval_s', 'seconds from pulse to pulse')
        first_s = section.number('first_s', 0.0)
        with of_part('times'):  # refuses what is too late
            to_nanoseconds(np.array([first_s, first_s + interval_s * n_pulses]))
        # The first one apart: seconds since 1970 would round the steps to 0.2 microseconds.
        time_ns = (round(first_s * 1e9)
                   + np.rint(np.arange(n_pulses) * (interval_s * 1e9)).astype(np.int64))
    if (np.diff(time_ns) < 0).any():
        at = int(np.argmax(np.diff(time_ns) < 0))
        raise section.error('variable', 'times that ascend', f'pulse {at + 1} comes '
                            f'{(time_ns[at] - time_ns[at + 1]) * 1e-9:.6g} s before pulse {at}')
    counter = np.arange(n_pulses)
    if 'counter' in section:
        counter = variable(section.text('counter')).reshape(-1).astype(np.int64)
        if counter.size != n_pulses:
            raise section.error('counter', f'one number for each of {n_pulses} pulses',
                                f'it holds {counter.size}')
    return time_ns, counter


def used_pulses(section: Section, time_ns: np.ndarray) -> np.ndarray:
    """(P,) bool, pulses within ``use_s``, in seconds of the radar's clock; all without it."""
    interval_s = section.vector('use_s', None, size=2)
    if interval_s is None:
        return np.ones(len(time_ns), bool)
    time_s = time_ns * 1e-9
    # Half a nanosecond: times were rounded to whole ones.
    used = (time_s >= interval_s[0] - 5e-10) & (time_s <= interval_s[1] + 5e-10)
    if used.sum() < 2:
        raise section.error('use_s', 'an interval with two pulses or more, within '
                            f'{time_s[0]:.6g} to {time_s[-1]:.6g} s')
    return used
