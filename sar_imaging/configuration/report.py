# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Derived quantities as lines of text: name, value, and an explanation without radar terms."""

from __future__ import annotations

import math
from collections.abc import Iterator

from ..signal.radar import Waveform
from .derived import Derived, is_phase_history
from .settings import Acquisition, Imaging, Machine

Row = tuple[str, str, str]  # name, value, meaning


def rows(acquisition: Acquisition, imaging: Imaging, machine: Machine,
         derived: Derived) -> list[Row]:
    """Name, value with unit, and meaning of what an operator wants to know.

    Parameters
    ----------
    acquisition, imaging, machine
        The configuration.
    derived : Derived
        What `derive` made of it.

    Returns
    -------
    list of (name, value, meaning)
    """
    return [*_geometry_rows(acquisition, imaging, derived),
            *_pulse_rows(acquisition, derived),
            *_load_rows(imaging, machine, derived),
            *((f'memory of {m.node}', f'{m.n_bytes / 1e6:.0f} MB', f'at most, = {m.formula}')
              for m in derived.memory)]


def lines(table: list[Row]) -> list[str]:
    """Rows as aligned lines."""
    name, value = (max(len(row[i]) for row in table) for i in range(2))
    return [f'{a:{name}}  {b:>{value}}  {c}'.rstrip() for a, b, c in table]


def _geometry_rows(a: Acquisition, imaging: Imaging, d: Derived) -> Iterator[Row]:
    scene = d.scene
    yield ('wavelength', f'{1e3 * a.radar.wavelength_m:.3g} mm',
           'positions within an aperture should be right to a tenth of it')
    yield ('range to the scene', _metres(scene.range_m),
           f'distance from the radar; nearest pixel {_metres(scene.near_m)}, farthest '
           f'{_metres(scene.far_m)}')
    yield ('range window', f'{_metres(d.window_m[0])} to {_metres(d.window_m[1])}',
           'ranges whose echoes are recorded completely; pixels elsewhere stay dark')
    if is_phase_history(a):
        yield ('unambiguous depth', _metres(d.unambiguous_depth_m),
               'a deeper scene is folded onto itself')
    yield ('range resolution', f'{d.range_width_m:.3g} m',
           'points closer than this, one behind the other, merge (width at -3 dB on the ground, '
           f'window {imaging.window})')
    yield ('azimuth resolution', f'{d.azimuth_width_m:.3g} m',
           'points closer than this, side by side, merge (width at -3 dB)')
    yield ('pixel spacing', f'{imaging.grid.spacing_m:g} m',
           f'{0.5 * min(d.range_null_m, d.azimuth_null_m):.3g} m or less loses no point between '
           f'pixels: half of the null spacing, {d.range_null_m:.3g} m in range and '
           f'{d.azimuth_null_m:.3g} m in azimuth')
    yield ('aperture', _metres(d.aperture_m),
           f'distance flown for one image: {imaging.pulses_per_aperture} pulses in '
           f'{d.aperture_s:.3g} s, {math.degrees(d.aperture_rad):.3g} degrees seen from the scene')


def _pulse_rows(a: Acquisition, d: Derived) -> Iterator[Row]:
    yield 'pulse spacing', _metres(d.pulse_spacing_m), 'distance flown from pulse to pulse'
    yield ('scene in direction', f'{d.needed_direction:.3g}',
           'directions that the scene' + (' in the beam' if a.beamwidth_rad else '')
           + ' takes, as cosine of the angle to the flight')
    yield ('unambiguous direction', f'{d.unambiguous_direction:.3g}',
           'directions that pulses at this spacing separate; in a wider scene every point '
           f'appears again {_metres(d.ambiguity_m)} away in azimuth')
    yield ('PRF', _hertz(a.prf_hz),
           f'pulses per second; at least {_hertz(d.least_prf_hz)}, or points appear twice'
           + ('' if a.compressed or a.radar.waveform != Waveform.LFM else
              f'; at most {_hertz(d.largest_prf_hz)}, or recordings overlap the next pulse'))
    yield ('unambiguous range', _metres(d.unambiguous_range_m),
           'echoes from farther away arrive after the next pulse was sent')


def _load_rows(imaging: Imaging, machine: Machine, d: Derived) -> Iterator[Row]:
    shape = (imaging.volume or imaging.grid).shape
    yield ('input', f'{d.input_rate / 1e6:.3g} MB/s',
           f'into the nodes, in messages of {d.block_bytes / 1e6:.2g} MB; after '
           f'range_compression {d.profile_rate / 1e6:.3g} MB/s, in messages of '
           f'{d.profile_block_bytes / 1e6:.2g} MB')
    yield ('image', ' x '.join(map(str, reversed(shape))),
           f'{"pixels" if imaging.volume is None else "cells"}, {d.n_pixels / 1e6:.3g} million')
    yield ('exact imaging', f'{d.imaging_s:.3g} s',
           f'of work for an image; a new one is due every {d.aperture_s:.3g} s (at '
           f'{machine.rate_per_s / 1e9:.3g}e9 pixels x pulses x channels per second, '
           f'{machine.rate_source})')
    if d.obstacle_map_s:
        yield ('obstacle map', f'{d.obstacle_map_s:.3g} s',
               'of work for a map, in a thread of its own, while obstacle_map or obstacles has a '
               'subscriber')


def _metres(value: float) -> str:
    value = round(value, 9)  # the range of phase zero need not be exactly 0
    return f'{value / 1e3:.4g} km' if 1e4 <= value < math.inf else f'{value:.4g} m'


def _hertz(value: float) -> str:
    return f'{value / 1e3:.4g} kHz' if value >= 1e4 else f'{value:.4g} Hz'
