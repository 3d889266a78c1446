# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Calibrated brightness of a configuration: the quantity, the radar constant and the window."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

from ..radiometry import QUANTITIES, RadarConstant
from .constraints import Finding

NONE = 'none'
QUANTITY, FILE, WINDOW = (f'radiometry.{name}' for name in ('quantity', 'constant_file', 'window'))


def constant_of(parameters: Mapping[str, Any]) -> RadarConstant | None:
    """Radar constant that parameters of a node name; None where images stay as they are.

    Raises
    ------
    ValueError
        They contradict each other, or the file is none; the text names the parameter.
    """
    quantity, file = parameters[QUANTITY], parameters[FILE]
    if quantity not in (NONE, *QUANTITIES):
        raise ValueError(f'{QUANTITY}={quantity!r}; expected one of {NONE}, '
                         f'{", ".join(QUANTITIES)}')
    if bool(file) != (quantity != NONE):
        raise ValueError(f'{QUANTITY}={quantity} and {FILE}={file!r}; expected the file of a '
                         'radar constant with a quantity, and no file otherwise: `sar-imaging '
                         'radar-constant` measures one')
    if quantity == NONE:
        return None
    if quantity != 'rcs' and parameters.get('mode') == 'volume':
        raise ValueError(f'{QUANTITY}={quantity} in mode volume, whose cells have no area of '
                         'ground; expected rcs, the cross section of a point in each cell, or '
                         'mode image')
    if 'window' in parameters:  # a node that compresses, too
        _check_window(parameters, parameters['window'])
    try:
        return RadarConstant.load(file)
    except ValueError as error:
        raise ValueError(f'{FILE}: {error}') from error


def check_radiometry(nodes: Mapping[str, Mapping[str, Any]]) -> Iterator[Finding]:
    """What is wrong with the calibrated brightness of a configuration.

    Parameters
    ----------
    nodes : mapping
        Parameters of the nodes by name, see `parameters.Configuration`.
    """
    for name in ('backprojection', 'afbp_fusion'):
        try:
            if constant_of(nodes[name]) is not None:
                _check_window(nodes[name], nodes['range_compression']['window'])
                _check_pattern(nodes[name], nodes['backprojection'])
        except ValueError as error:
            yield Finding('error', f'{name}: {error}')


def _check_pattern(parameters: Mapping[str, Any], imager: Mapping[str, Any]) -> None:
    """Fusion takes the pattern out that backprojection has weighed by."""
    for name in ('pattern', 'azimuth_width', 'elevation_width', 'cutoff', 'pattern_file'):
        given, wanted = (values[f'antenna.{name}'] for values in (parameters, imager))
        if given != wanted:
            raise ValueError(f'antenna.{name}={given}, but images are weighed with {wanted} by '
                             'backprojection; set both alike')


def _check_window(parameters: Mapping[str, Any], window: str) -> None:
    """The area of a resolution cell depends on the window of the profiles."""
    if parameters[WINDOW] != window:
        raise ValueError(f'{WINDOW}={parameters[WINDOW]}, but range profiles have '
                         f'window={window}; set both alike')
