"""Pixels whose ranges leave the profiles: pulses add nothing to them, and imagers say so."""

from __future__ import annotations

import numpy as np

from ...geometry.grids import MapGrid
from ...geometry.polar import PolarGrid
from ...signal.radar import RadarParameters
from .range_resampling import half_paths

_PIXELS_PER_SIDE, _ROWS = 24, 65  # at which ranges are looked at


def some_pixels(grid: MapGrid | PolarGrid) -> np.ndarray:
    """(S, 3) float64 positions all over a grid, metres, its corners among them."""
    if isinstance(grid, PolarGrid):
        return grid.lines(*(v.ravel() for v in np.meshgrid(*(
            np.linspace(v[0], v[-1], _PIXELS_PER_SIDE) for v in (grid.range_m, grid.alpha)))))[0]
    x, y = (np.linspace(v[0], v[-1], _PIXELS_PER_SIDE) for v in (grid.x_m, grid.y_m))
    x, y = (v.ravel() for v in np.meshgrid(x, y))
    return np.stack([x, y, np.full(x.shape, grid.z_m)], axis=-1)


def reach_warning(points_m, tx_m, rx_m, radar: RadarParameters, n_samples: int) -> str | None:
    """Say which share of the pixels lies beyond the profiles for some of the pulses.

    Parameters
    ----------
    points_m : (S, 3) float64
        Pixels, or some of them, metres.
    tx_m, rx_m : (R, 3) float64
        Phase centres, metres.
    radar : RadarParameters
        Of the profiles.
    n_samples : int
        Samples of a profile.

    Returns
    -------
    str or None
        None where all pixels lie within the profiles for all pulses.
    """
    start = radar.range_start_m
    stop = start + (n_samples - 1) * radar.sample_spacing_m
    rows = np.linspace(0, len(tx_m) - 1, min(len(tx_m), _ROWS)).round().astype(int)
    length = half_paths(tx_m[rows], rx_m[rows], points_m)[0]
    outside = (length < start) | (length > stop)
    if not outside.any():
        return None
    return (f'the ranges of {_percent(outside.any(axis=0).mean())} of the pixels, '
            f'{length.min():.1f} to {length.max():.1f} m, leave the profiles, {start:.1f} to '
            f'{stop:.1f} m, for some of the pulses, which add nothing there: '
            f'{_percent(outside.mean())} of the image is missing and its error larger than '
            'predicted; keep more of the profiles, or make the grid smaller')


def _percent(share: float) -> str:
    return f'{100 * share:.1f} %'
