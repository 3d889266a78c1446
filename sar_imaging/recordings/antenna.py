# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""The antenna of a description: its pattern, and where it looks."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping

import numpy as np

from ..geometry.antenna import Antenna, Mount
from ..geometry.illumination import Pointing
from ..signal.pulses import PulseBlock
from .description import Section, of_part

OUTWARD = 'outward'  # along the arm of positions.arc
_FIELDS = tuple(f.name for f in dataclasses.fields(Antenna))
# What a kind cannot do without, beside what has a usual value.
_NEEDS = {'platform': '', 'track': 'side', 'point': 'target_m', 'rotation': 'rate_deg_per_s'}
KEYS = (*_FIELDS, 'pointing')


def read_antenna(section: Section) -> tuple[Antenna, Mount | str]:
    """Pattern, and mount or ``'outward'``.

    Raises
    ------
    DescriptionError
        One of them is missing or makes no sense.
    """
    with of_part('antenna'):
        antenna = Antenna.from_dict({name: section.raw(name) for name in _FIELDS
                                     if name in section})
        pointing = section.raw('pointing', meaning=f'{OUTWARD}, or a kind, one of '
                               f'{", ".join(_NEEDS)}')
        if isinstance(pointing, Mapping):
            lacking = _NEEDS.get(pointing.get('kind', ''))
            if lacking and lacking not in pointing:
                raise section.error('pointing', f'{lacking} of the kind {pointing["kind"]}')
        mount = pointing if pointing == OUTWARD else Mount.from_dict(pointing)
    return antenna, mount


def with_pointing(block: PulseBlock, mount: Mount | str, section: Section,
                  arc_centre_m: Callable[[], np.ndarray] | None) -> PulseBlock:
    """The block, whose positions are known, with its pointing.

    Parameters
    ----------
    block : PulseBlock
        All pulses, with positions.
    mount : Mount or str
        As `read_antenna` gives it.
    section : Section
        The part ``antenna``, for messages.
    arc_centre_m : callable or None
        Gives the (3,) centre of the arc, metres; None where positions are no arc.

    Raises
    ------
    DescriptionError
        The pointing does not follow from the positions.
    """
    centre = block.phase_centre_m
    with of_part('antenna.pointing'):
        if isinstance(mount, Mount):
            pointing = mount.pointing(block.stamp_ns, centre)
        elif arc_centre_m is None:
            raise section.error('pointing', f'{OUTWARD} with positions on an arc alone')
        else:
            pointing = Pointing(centre - arc_centre_m())
    return dataclasses.replace(block, pointing=pointing)
