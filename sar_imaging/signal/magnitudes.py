# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Recognise numbers in a wrong unit by their magnitude, and name the unit that was meant.

A radar's numbers come from data sheets in gigahertz, megahertz per microsecond and microseconds.
Taken for hertz and seconds they are a thousand times or more off what any radar has.
"""

from __future__ import annotations

import math
from typing import NamedTuple


class Magnitude(NamedTuple):
    """What a quantity can be.

    Parameters
    ----------
    least, most : float
        Smallest and largest absolute value of any radar.
    unit : str
        Unit that is asked for.
    others : tuple of (str, float)
        Units of data sheets and their size in `unit`, the likeliest first.
    """

    least: float
    most: float
    unit: str
    others: tuple[tuple[str, float], ...]


_HERTZ = (('GHz', 1e9), ('MHz', 1e6), ('kHz', 1e3))
_SECONDS = (('us', 1e-6), ('ns', 1e-9), ('ms', 1e-3))
# Over-the-horizon radar to terahertz scanners; the Moon is 2.6 s away.
CARRIER = Magnitude(1e6, 2e12, 'Hz', _HERTZ)
BANDWIDTH = Magnitude(1e4, 1e12, 'Hz', (('MHz', 1e6), ('GHz', 1e9), ('kHz', 1e3)))
SAMPLE_RATE = Magnitude(1e3, 1e13, 'Hz', (('MHz', 1e6), ('GHz', 1e9), ('kHz', 1e3)))
DELAY = Magnitude(0.0, 3.0, 's', _SECONDS)
SLOPE = Magnitude(1e4, 1e20, 'Hz/s', (('MHz/us', 1e12), ('GHz/s', 1e9), ('MHz/s', 1e6)))

SPEED_OF_LIGHT = 299_792_458.0  # m/s
_FASTEST_SOUND = 2e4  # m/s; in diamond it is 1.8e4
# Waves in mud to light; sound is told in km/s, light in the ground in m/ns.
SPEED = Magnitude(10.0, SPEED_OF_LIGHT, 'm/s', (('m/ns', 1e9), ('km/s', 1e3)))


class Device(NamedTuple):
    """Magnitudes of the numbers of a radar or of a sonar."""

    carrier: Magnitude
    bandwidth: Magnitude
    sample_rate: Magnitude
    delay: Magnitude
    slope: Magnitude


_RADAR = Device(CARRIER, BANDWIDTH, SAMPLE_RATE, DELAY, SLOPE)
_OF_SOUND = (('kHz', 1e3), ('MHz', 1e6), ('GHz', 1e9))
# Sub-bottom profilers to acoustic microscopes; the farthest echo crosses 100 km of sea.
_SONAR = Device(
    Magnitude(1e2, 1e10, 'Hz', _OF_SOUND), Magnitude(10.0, 1e10, 'Hz', _OF_SOUND),
    Magnitude(10.0, 1e11, 'Hz', _OF_SOUND),
    Magnitude(0.0, 150.0, 's', (('ms', 1e-3), ('us', 1e-6), ('ns', 1e-9))),
    Magnitude(1.0, 1e18, 'Hz/s', (('kHz/ms', 1e6), ('MHz/us', 1e12), ('kHz/s', 1e3))))


def device(speed_m_per_s: float) -> Device:
    """Magnitudes of a radar's numbers, or of a sonar's where waves are as slow as sound."""
    return _SONAR if speed_m_per_s <= _FASTEST_SOUND else _RADAR


def check_magnitude(name: str, value: float, kind: Magnitude) -> None:
    """Refuse a value that no radar or sonar has.

    Raises
    ------
    ValueError
        It is too small or too large, or not positive where it must be; the text names the unit
        that was probably meant.
    """
    if kind.least <= abs(value) <= kind.most:
        return
    if value <= 0 and kind.least and kind is not SLOPE:
        raise ValueError(f'{name}={value} must be positive')
    owner = "a sonar's" if kind in _SONAR else "a radar's"
    raise ValueError(f'{name}={value:.6g} {kind.unit} is not {owner}; expected {_span(kind)}'
                     f'{probable_unit(name, value, kind)}')


def probable_unit(name: str, value: float, kind: Magnitude) -> str:
    """The end of a message: in which unit a value would make sense; empty where in none."""
    for unit, size in kind.others:
        if max(kind.least, 1e-12) <= abs(value) * size <= kind.most:
            return f'; it was probably meant in {unit}: pass {name}={_number(value * size)}'
    return ''


def _span(kind: Magnitude) -> str:
    if not kind.least:
        return f'at most {_number(kind.most)} {kind.unit}'
    return f'{_number(kind.least)} to {_number(kind.most)} {kind.unit}'


def _number(value: float) -> str:
    return f'{value:.6g}' if math.isfinite(value) else str(value)
