# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""What a description tells of the scene: where to image, what stands there."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from ..geometry.earth import Datum
from ..geometry.grids import MapGrid
from ..signal.windows import parse_window
from .description import Section, of_part

KEYS = ('centre_m', 'size_m', 'spacing_m', 'scatterers', 'cut_m', 'window', 'frame', 'datum',
        'pulses_per_aperture')
_MARGIN_M = 1.0  # of a grid around scatterers, beside a tenth of their extent
_MOST_PIXELS = 1e10  # 80 GB of image; a slip of the unit has more
_PIXELS = 500  # of such a grid along its longer side


@dataclasses.dataclass(frozen=True)
class Scene:
    """Where and what to image.

    Attributes
    ----------
    grid : MapGrid
        Map.
    scatterers : list of dict
        Each with ``name``, ``position_m`` and ``amplitude_db``.
    cut_m : tuple of float
        Half widths over which sidelobes are measured, in range and azimuth, metres.
    window : str
        Spectral weighting.
    frame : str
        Name of the imaging frame.
    datum : Datum or None
        Where that stands on the Earth.
    pulses_per_aperture : int or None
        None for all pulses.
    """

    grid: MapGrid
    scatterers: list[dict[str, Any]]
    cut_m: tuple[float, float]
    window: str
    frame: str
    datum: Datum | None
    pulses_per_aperture: int | None


def read_scene(section: Section) -> Scene:
    """Scene of a description.

    Raises
    ------
    DescriptionError
        It has neither a grid nor scatterers, or one of them makes no sense.
    """
    scatterers = _scatterers(section)
    with of_part('scene'):
        grid = _grid(section, np.array([s['position_m'] for s in scatterers]).reshape(-1, 3))
        datum = None
        if 'datum' in section:
            names = [field.name for field in dataclasses.fields(Datum)]
            given = section.section('datum', names)
            datum = Datum(**{name: given.number(name) for name in names if name in given})
    try:
        parse_window(section.text('window', 'none'))
    except ValueError as error:
        raise section.error('window', 'a window', str(error)) from error
    cut_m = section.vector('cut_m', np.ones(2), size=2)
    return Scene(grid, scatterers, (float(cut_m[0]), float(cut_m[1])),
                 section.text('window', 'none'), section.text('frame', 'map'), datum,
                 section.integer('pulses_per_aperture', None))


def _scatterers(section: Section) -> list[dict[str, Any]]:
    """A variable with positions, or names with [x, y, z] or [x, y, z, dB]."""
    value = section.raw('scatterers', {})
    if isinstance(value, dict):
        given = section.section('scatterers', tuple(value))
        named = {name: given.array(name).reshape(-1) for name in value}
        for name, numbers in named.items():
            if numbers.size not in (3, 4):
                raise given.error(name, '[x, y, z] or [x, y, z, level in dB]')
    else:
        named = {f'reflector_{i}': place
                 for i, place in enumerate(section.vectors('scatterers'), 1)}
    return [{'name': name, 'position_m': place[:3].tolist(),
             'amplitude_db': float(place[3]) if place.size == 4 else 0.0}
            for name, place in named.items()]


def _check_pixels(section: Section, size_m: np.ndarray, spacing_m: float) -> None:
    if not 0 < spacing_m <= size_m.min() / 2:
        raise section.error('spacing_m', 'metres from pixel to pixel, at most half of '
                            f'{size_m.min():g} m, the shorter side of the map')
    n_pixels = np.prod(size_m / spacing_m + 1)
    if n_pixels > _MOST_PIXELS:
        raise section.error('spacing_m', f'a map of at most {_MOST_PIXELS:g} pixels',
                            f'{size_m[0]:g} m by {size_m[1]:g} m have {n_pixels:.3g}')


def _grid(section: Section, places_m: np.ndarray) -> MapGrid:
    if 'size_m' not in section and not len(places_m):
        raise section.error('size_m', 'the size [x, y] of the map in metres, or scatterers',
                            'give centre_m, size_m and spacing_m of the scene')
    if 'size_m' in section:
        size = section.vector('size_m', size=2)
        if not (size > 0).all():
            raise section.error('size_m', 'positive lengths [x, y] in metres')
        centre, spacing = section.vector('centre_m'), section.number('spacing_m')
    else:
        low, high = places_m.min(axis=0), places_m.max(axis=0)
        size = 1.2 * (high - low)[:2] + 2 * _MARGIN_M
        centre, spacing = (low + high) / 2, float(size.max()) / _PIXELS
    centre = section.vector('centre_m', centre)
    _check_pixels(section, size, section.number('spacing_m', spacing))
    grid = MapGrid.from_size(tuple(centre.tolist()), float(size[0]), float(size[1]),
                             section.number('spacing_m', spacing))
    rows, columns = grid.to_pixels(places_m[:, 0], places_m[:, 1])
    if not np.all((rows >= 0) & (rows < grid.n_y) & (columns >= 0) & (columns < grid.n_x)):
        raise section.error('size_m', 'a map with all scatterers',
                            f'they stand at {places_m[:, :2].tolist()}')
    return grid
