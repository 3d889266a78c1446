# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Truth of a recording: its scene, radar and antenna, with which its evaluation compares."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable
from typing import Any

import numpy as np

from ..geometry.alignment import Alignment
from ..geometry.antenna import Antenna, Mount
from ..geometry.earth import Datum
from ..geometry.grids import MapGrid
from ..signal.radar import SPEED_OF_LIGHT, RadarParameters

TRUTH_VERSION = 1
_KINDS = {dict: 'mapping', list: 'list', str: 'text'}


def make_truth(*, scenario: str, description: str, scatterers: Iterable[dict[str, Any]],
               grid: MapGrid, pulses_per_aperture: int, n_pulses: int, n_channels: int,
               cut_half_width_m: tuple[float, float], radar: RadarParameters, compressed: bool,
               notes: str = '', window: str = 'none', alignment: Alignment | None = None,
               frame: str = 'map', datum: Datum | None = None) -> dict[str, Any]:
    """Describe the scene of a recording, with which its evaluation compares.

    Parameters
    ----------
    scenario, description, notes : str
        Name, one sentence, origin.
    scatterers : iterable of dict
        Each ``{'name', 'position_m': [x, y, z], 'amplitude_db'}``; metres in the imaging frame.
    grid : MapGrid
        Where to image the scene.
    pulses_per_aperture, n_pulses, n_channels : int
        Pulses per aperture, number of pulses and number of channels of the recording.
    cut_half_width_m : (2,) floats
        Half widths of the cuts for sidelobe measures, in range and azimuth, metres.
    radar : RadarParameters
        Radar parameters of the recorded samples.
    compressed : bool
        Whether those are range profiles.
    window : str
        Spectral weighting for which the measures are meant.
    alignment : Alignment, optional
        Between the pulses and the poses of `/odometry`, where positions come from those.
    frame : str
        Name of the imaging frame.
    datum : Datum, optional
        Where that frame stands on the Earth.

    Returns
    -------
    dict
        Of JSON types only.

    Examples
    --------
    >>> from sar_imaging import MapGrid, RadarParameters
    >>> from sar_imaging.recordings import make_truth
    >>> truth = make_truth(
    ...     scenario='first_flight', description='a reflector beside the track',
    ...     scatterers=[{'name': 'trihedral', 'position_m': [130.0, 4.0, 0.0],
    ...                  'amplitude_db': 0.0}],
    ...     grid=MapGrid((130.0, 0.0, 0.0), 240, 240, 0.25), pulses_per_aperture=256, n_pulses=256,
    ...     n_channels=1, cut_half_width_m=(5.0, 5.0),
    ...     radar=RadarParameters(10e9, 300e6, 400e6, first_sample_delay_s=6e-7), compressed=True)
    >>> truth['grid']['spacing_m'], truth['radar']['waveform']
    (0.25, 'LFM')
    """
    range_m, azimuth_m = cut_half_width_m
    return {
        'version': TRUTH_VERSION, 'scenario': scenario, 'description': description,
        'frame': frame, 'scatterers': list(scatterers),
        'grid': {'centre_m': list(grid.centre_m), 'n_x': grid.n_x, 'n_y': grid.n_y,
                 'spacing_m': grid.spacing_m},
        'pulses_per_aperture': pulses_per_aperture, 'n_pulses': n_pulses,
        'n_channels': n_channels,
        'cut_half_width_m': {'range': range_m, 'azimuth': azimuth_m}, 'window': window,
        'radar': radar_to_dict(radar), 'compressed': compressed, 'notes': notes,
        **({} if alignment is None else {'alignment': alignment.as_dict()}),
        **({} if datum is None else {'datum': dataclasses.asdict(datum)})}


def check_truth(truth: dict[str, Any]) -> None:
    """Refuse a truth whose numbers are none, or whose parts are of another kind.

    Raises
    ------
    ValueError
        The text names the part, what was expected and what came.
    """
    counts = {name: truth.get(name, 1) for name in ('pulses_per_aperture', 'n_pulses',
                                                    'n_channels')}
    if isinstance(grid := truth.get('grid'), dict):
        counts |= {f'grid.{name}': grid[name] for name in ('n_x', 'n_y')}
    for name, value in counts.items():
        if isinstance(value, bool) or not isinstance(value, int) or value < 1:
            raise ValueError(f'{name} is {value!r}; expected a whole number of at least 1')
    for name, kind in (('grid', dict), ('cut_half_width_m', dict), ('radar', dict),
                       ('alignment', dict), ('datum', dict), ('collection', dict),
                       ('antenna', dict), ('mount', dict), ('scatterers', list),
                       ('window', str), ('frame', str)):
        if not isinstance(truth.get(name, kind()), kind):
            raise ValueError(f'{name} is {truth[name]!r}; expected a {_KINDS[kind]}')
    if 'grid' in truth:
        grid = truth['grid']
        MapGrid(grid['centre_m'], grid['n_x'], grid['n_y'], grid['spacing_m'])
    for name, value in truth.get('cut_half_width_m', {}).items():
        if not isinstance(value, int | float) or not 0 < value < math.inf:
            raise ValueError(f'cut_half_width_m.{name} is {value!r}; expected metres')
    for scatterer in truth.get('scatterers', ()):
        place = np.array(scatterer['position_m'], float)
        if not isinstance(scatterer['name'], str) or place.shape != (3,) or not np.isfinite(
                place).all():
            raise ValueError(f'scatterer {scatterer!r}; expected a name and position_m: [x, y, z]')
    if 'alignment' in truth:
        Alignment(**truth['alignment'])


def antenna_truth(antenna: Antenna | None, mount: Mount | None = None) -> dict[str, Any]:
    """What the truth of a recording says of the antenna, of JSON types.

    Parameters
    ----------
    antenna : Antenna or None
        Its pattern; None adds nothing.
    mount : Mount, optional
        What tells where it looks, for pulses that do not state it.
    """
    return ({} if antenna is None else {'antenna': antenna.as_dict()}) | (
        {} if mount is None else {'mount': mount.as_dict()})


def radar_to_dict(radar: RadarParameters) -> dict[str, Any]:
    """Fields of the radar parameters, the waveform by its name, a speed that is not light's."""
    fields = {name: getattr(radar, name) for name in radar.__dataclass_fields__}
    if radar.propagation_speed_m_per_s == SPEED_OF_LIGHT:  # as in recordings of before
        del fields['propagation_speed_m_per_s']
    return fields | {'waveform': radar.waveform.name}
