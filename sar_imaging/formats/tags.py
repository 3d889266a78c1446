# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Our image as text that files carry along: grid, carrier, datum and report, all to the bit."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from ..files import told
from ..geometry.earth import Datum
from ..geometry.grids import Grid, MapGrid, PlaneGrid
from ..imaging.image import Image, Report
from ..imaging.radiometry import Radiometry
from ..numpy_files import check_memory
from ..radiometry import QUANTITIES

_GRIDS = {grid.__name__: grid for grid in (MapGrid, PlaneGrid)}
_VERSION = 1


def image_to_text(image: Image, datum: Datum) -> str:
    """Everything of an image but its samples, as JSON.

    A grid that is no map and no plane is left out.
    """
    kind, plan = type(image.grid).__name__, image.report.plan
    report = dataclasses.replace(image.report, plan=None if plan is None else str(plan))
    told = image.grid if isinstance(image.grid, MapGrid | PlaneGrid) and kind in _GRIDS else None
    grid = None if told is None else {'type': kind, **dataclasses.asdict(told)}
    return json.dumps({'version': _VERSION, 'carrier_hz': image.carrier_hz,
                       'stamp_ns': image.stamp_ns, 'counters': _ranges(image.counters),
                       'datum': dataclasses.asdict(datum), 'grid': grid,
                       'report': dataclasses.asdict(report),
                       'radiometry': image.radiometry and dataclasses.asdict(image.radiometry)})


def quantity_of(image: Image) -> str:
    """What the levels of an image are, in a word or two."""
    return 'amplitude' if image.radiometry is None else image.radiometry.quantity


def told_of(told: Radiometry | None) -> dict[str, str]:
    """Tags about calibrated brightness, for any program; none where there is none.

    The unit is that of the squared magnitude.
    """
    return {} if told is None else {
        'QUANTITY': told.quantity, 'QUANTITY_MEANING': QUANTITIES[told.quantity],
        'UNIT': told.unit, 'NOISE_EQUIVALENT_DB': f'{told.noise_equivalent_db:.3f}',
        'INCIDENCE_DEG': f'{told.incidence_deg:.3f}'}


def image_from_text(text: str, samples: np.ndarray, *,
                    resampled: bool = False) -> tuple[Image, Datum]:
    """Image and datum of samples and the text that belongs to them.

    Samples that were interpolated to other pixels need not have the shape of the grid.

    Raises
    ------
    ValueError
        The text was not written by `image_to_text`, or is of an image of another shape.
    """
    try:
        tag = json.loads(text)
        if tag['version'] != _VERSION:
            raise ValueError(f'version {tag["version"]}; expected {_VERSION}')
        datum = Datum(**tag['datum'])
        report = Report(**tag['report'] | {'warnings': tuple(tag['report']['warnings'])})
        grid = _grid(tag['grid'])
        check_memory('its list of pulses', 8 * sum(last - first + 1
                                                   for first, last in tag['counters']))
        counters = np.concatenate([np.zeros(0, np.int64), *(
            np.arange(first, last + 1) for first, last in tag['counters'])])
        scaled = tag.get('radiometry')  # files of 0.2.0 have none
        image = Image(samples, grid, float(tag['carrier_hz']), report, int(tag['stamp_ns']),
                      counters, scaled and Radiometry(**scaled))
    except (LookupError, TypeError, AttributeError, ValueError, ArithmeticError,
            RecursionError) as error:
        raise ValueError(f'the tag of the image cannot be understood: {told(error)}') from error
    if grid.shape != samples.shape and not resampled:
        raise ValueError(f'the tag tells of a grid {grid.shape}, the file holds {samples.shape}')
    return image, datum


def _grid(told: Mapping[str, Any]) -> Grid:
    if told is None:
        raise ValueError('the image lay on no map and no plane; its positions are not in the tag')
    return _GRIDS[told['type']](**{name: value for name, value in told.items() if name != 'type'})


def _ranges(counters: Iterable[int]) -> list[list[int]]:
    """First and last of each run of consecutive counters."""
    counters = np.asarray(counters, np.int64)
    if not len(counters):
        return []
    breaks = np.flatnonzero(np.diff(counters) != 1)
    return [[int(first), int(last)] for first, last in zip(
        counters[np.r_[0, breaks + 1]], counters[np.r_[breaks, len(counters) - 1]], strict=True)]
