# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Where the imaging frame stands on the Earth, as parameters tell it, and mistakes in them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from ..geometry.earth import Datum
from .constraints import Finding, refusal

SOURCES = NONE, PARAMETERS, FIX = ('none', 'parameters', 'fix')
_NUMBERS = ('latitude_deg', 'longitude_deg', 'height_m', 'heading_deg')
_BASELINE = 'datum.heading_baseline_m'
_OF_FIXES = ('fix', 'fix_imu')  # sources of poses that fixes are
_ARMS = ('antenna.tx', 'antenna.rx', 'gnss.antenna')
_ARM_FRAMES = ('antenna.tx_frames', 'antenna.rx_frames')


def configured_datum(values: Mapping[str, Any]) -> Datum | None:
    """Datum that the parameters common to all nodes give.

    Parameters
    ----------
    values : mapping
        Parameters by name, ``datum.source`` and the four numbers of the datum among them.

    Returns
    -------
    Datum or None
        None where there is none, or where fixes will tell it.

    Raises
    ------
    ValueError
        The parameters contradict each other, or no such place exists.
    """
    source = values['datum.source']
    given = {name: values[f'datum.{name}'] for name in _NUMBERS}
    if source == PARAMETERS:
        return Datum(**given)
    ignored = [name for name, value in given.items()
               if value and not (source == FIX and name == 'heading_deg')]
    if ignored:
        told = ', '.join(f'datum.{name}={given[name]:.12g}' for name in ignored)
        why = ('datum.source is none: set datum.source to parameters, or leave them out'
               if source == NONE else
               'datum.source is fix, which tells them: leave them out, or set datum.source to '
               'parameters')
        raise ValueError(f'{told}, but {why}')
    return None


def check_fixes(values: Mapping[str, Any]) -> None:
    """Refuse uses of fixes that contradict each other, of the node that finds positions.

    Parameters
    ----------
    values : mapping
        Parameters of `pulse_buffer` by name.

    Raises
    ------
    ValueError
        The text says what to set.
    """
    datum, poses = values['datum.source'], values['pose.source']
    baseline_m = values[_BASELINE]
    if poses in _OF_FIXES and datum == NONE:
        raise ValueError(f'pose.source={poses} needs to know where the frame is: set datum.source '
                         'to parameters, or to fix, which puts its origin where the first good '
                         'fix is')
    if datum == FIX and poses == 'block':
        raise ValueError('datum.source=fix compares fixes with poses of the platform, and '
                         'pose.source=block has none: set datum.source to parameters, or '
                         'pose.source to where the poses come from')
    if baseline_m and datum != FIX:
        raise ValueError(f'{_BASELINE}={baseline_m:g} finds the heading from fixes, but '
                         f'datum.source is {datum}: set datum.source to fix, or {_BASELINE} to '
                         '0.0')
    if baseline_m and poses in _OF_FIXES:
        raise ValueError(f'{_BASELINE}={baseline_m:g} compares fixes with other poses, but '
                         f'pose.source={poses} makes the poses of the fixes: their frame has the '
                         f'heading that datum.heading_deg gives it; set {_BASELINE} to 0.0')
    if baseline_m and values['datum.heading_deg']:
        raise ValueError(f'datum.heading_deg={values["datum.heading_deg"]:g} and {_BASELINE}='
                         f'{baseline_m:g}: the heading is either given or found; set one to 0.0')
    if poses == 'fix':
        arms = [name for name in _ARMS if any(values[name])]
        arms += [name for name in _ARM_FRAMES if values[name].strip()]
        if arms:
            raise ValueError(f'{", ".join(arms)}: lever arms turn with the platform, and '
                             'pose.source=fix has no attitude: set pose.source to fix_imu, or '
                             'the lever arms to 0.0')


def check_datum(nodes: Mapping[str, Mapping[str, Any]]) -> Iterator[Finding]:
    """What is wrong with the datum of a configuration; see `parameters.Configuration`."""
    told: dict[tuple[Any, ...], list[str]] = {}
    for name, values in nodes.items():
        if 'datum.source' not in values:
            continue
        key = tuple(values[f'datum.{n}'] for n in ('source', *_NUMBERS))
        told.setdefault(key, []).append(name)
    if len(told) > 1:
        words = '; '.join(f'{source} ({", ".join(f"{v:.12g}" for v in numbers)}) in '
                          f'{", ".join(names)}' for (source, *numbers), names in told.items())
        yield Finding('error', f'datum is not the same in all nodes: {words}; set it once, in the '
                      'section /**')
    for names in told.values():
        yield from refusal(configured_datum, nodes[names[0]])
    yield from refusal(check_fixes, nodes['pulse_buffer'])


def datum_rows(values: Mapping[str, Any]) -> list[tuple[str, str, str]]:
    """Where the frame stands, in words: name, value, explanation; none without a datum."""
    source, frame = values['datum.source'], values['frame_id']
    if source == NONE:
        return []
    if source == PARAMETERS and (datum := configured_datum(values)) is not None:
        return [('datum', describe_datum(datum), f'origin of frame {frame}, and bearing of its y '
                 'axis clockwise from north')]
    heading = (f'the heading from places {values[_BASELINE]:g} m apart' if values[_BASELINE] else
               f'heading {values["datum.heading_deg"]:g} degrees')
    return [('datum', 'fix', f'the first good fix tells the origin of frame {frame}; {heading}')]


def describe_datum(datum: Datum) -> str:
    """Datum in words: degrees to a tenth of a millimetre, metres above the ellipsoid."""
    return (f'{datum.latitude_deg:.9f}, {datum.longitude_deg:.9f}, height '
            f'{datum.height_m:.3f} m, heading {datum.heading_deg:.4f}')
