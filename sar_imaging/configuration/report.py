"""Derived quantities as lines of text: name, value, formula."""

from __future__ import annotations

import math

from ..signal.radar import Waveform
from .derived import Derived, is_phase_history
from .settings import Acquisition, Imaging, Machine


def rows(acquisition: Acquisition, imaging: Imaging, machine: Machine,
         derived: Derived) -> list[tuple[str, str, str]]:
    """Name, value with unit, and formula of what an operator wants to know.

    Parameters
    ----------
    acquisition, imaging, machine
        The configuration.
    derived : Derived
        What `derive` made of it.

    Returns
    -------
    list of (name, value, formula)
    """
    return [*_geometry_rows(acquisition, imaging, derived),
            *_pulse_rows(acquisition, derived),
            *_load_rows(imaging, machine, derived),
            *((f'memory of {m.node}', f'{m.n_bytes / 1e6:.0f} MB', f'at most: {m.formula}')
              for m in derived.memory)]


def lines(table: list[tuple[str, str, str]]) -> list[str]:
    """Rows as aligned lines."""
    name, value = (max(len(row[i]) for row in table) for i in range(2))
    return [f'{a:{name}}  {b:>{value}}  {c}'.rstrip() for a, b, c in table]


def _geometry_rows(a: Acquisition, imaging: Imaging, d: Derived):
    scene = d.scene
    yield 'wavelength', f'{1e3 * a.radar.wavelength_m:.3g} mm', 'c / f'
    yield ('range to the scene', _metres(scene.range_m),
           f'{_metres(scene.near_m)} to {_metres(scene.far_m)} over grid and aperture')
    yield ('range window', f'{_metres(d.window_m[0])} to {_metres(d.window_m[1])}',
           f'where {d.n_profile} samples of a profile hold whole responses')
    if is_phase_history(a):
        yield ('unambiguous depth', _metres(d.unambiguous_depth_m), 'N c / 2 B')
    yield ('range resolution', f'{d.range_width_m:.3g} m',
           f'width at -3 dB on the ground, window {imaging.window}; c / (2 B cos psi) = '
           f'{d.range_null_m:.3g} m')
    yield ('azimuth resolution', f'{d.azimuth_width_m:.3g} m',
           f'width at -3 dB; lambda / (4 sin(angle / 2)) = {d.azimuth_null_m:.3g} m')
    yield ('pixel spacing', f'{imaging.grid.spacing_m:g} m',
           f'half of the resolution: {0.5 * min(d.range_null_m, d.azimuth_null_m):.3g} m')
    yield ('aperture', _metres(d.aperture_m),
           f'{imaging.pulses_per_aperture} pulses, {d.aperture_s:.3g} s, '
           f'{math.degrees(d.aperture_rad):.3g} degrees seen from the scene')


def _pulse_rows(a: Acquisition, d: Derived):
    yield 'pulse spacing', _metres(d.pulse_spacing_m), 'v / PRF'
    yield ('scene in direction', f'{d.needed_direction:.3g}',
           'direction cosines of grid' + (' and beam' if a.beamwidth_rad else ''))
    yield ('unambiguous direction', f'{d.unambiguous_direction:.3g}',
           f'lambda PRF / 2 v; scatterers repeat every {_metres(d.ambiguity_m)} in azimuth')
    yield ('PRF', _hertz(a.prf_hz),
           f'{_hertz(d.least_prf_hz)} (2 v directions / lambda)'
           + ('' if a.compressed or a.radar.waveform != Waveform.LFM else
              f' to {_hertz(d.largest_prf_hz)} (recording ends before the next pulse)'))
    yield 'unambiguous range', _metres(d.unambiguous_range_m), 'c / 2 PRF'


def _load_rows(imaging: Imaging, machine: Machine, d: Derived):
    grid = imaging.grid
    yield ('input', f'{d.input_rate / 1e6:.3g} MB/s',
           f'profiles {d.profile_rate / 1e6:.3g} MB/s; blocks {d.block_bytes / 1e6:.2g} and '
           f'{d.profile_block_bytes / 1e6:.2g} MB')
    yield 'image', f'{grid.n_x} x {grid.n_y}', f'{d.n_pixels / 1e6:.3g} Mpixel'
    yield ('exact imaging', f'{d.imaging_s:.3g} s',
           f'pixels x pulses x channels at {machine.rate_per_s / 1e9:.3g} G/s '
           f'({machine.rate_source}); an aperture takes {d.aperture_s:.3g} s')


def _metres(value: float) -> str:
    value = round(value, 9)  # the range of phase zero need not be exactly 0
    return f'{value / 1e3:.4g} km' if 1e4 <= value < math.inf else f'{value:.4g} m'


def _hertz(value: float) -> str:
    return f'{value / 1e3:.4g} kHz' if value >= 1e4 else f'{value:.4g} Hz'
