"""Pixels whose ranges leave the profiles: pulses add nothing to them, and imagers say so."""

from __future__ import annotations

import numpy as np

from ...geometry.grids import Grid
from ...geometry.half_paths import half_paths
from ...geometry.illumination import Illumination
from ...signal.radar import RadarParameters
from .range_gate import end_samples

_PIXELS_PER_SIDE, _ECHOES = {2: 24, 3: 8}, 65  # at which ranges are looked at, by axes


def some_pixels(grid: Grid) -> np.ndarray:
    """(S, 3) float64 positions all over a grid, metres, its corners among them."""
    n = _PIXELS_PER_SIDE[len(grid.shape)]
    index = np.meshgrid(*(np.unique(np.linspace(0, size - 1, n).round().astype(int))
                          for size in grid.shape), indexing='ij')
    return grid.positions(*(i.ravel() for i in index))


def covered_ranges(radar: RadarParameters, n_samples: int) -> tuple[float, float]:
    """Half paths of the first and the last sample of a profile, metres."""
    start = radar.range_start_m
    return start, start + (n_samples - 1) * radar.sample_spacing_m


class OutOfReach(ValueError):
    """No profile reaches a grid."""


def check_reach(range_m: tuple[float, float], radar: RadarParameters, n_samples: int) -> None:
    """Raise ValueError where no profile reaches a grid whose half paths are `range_m`."""
    start, stop = covered_ranges(radar, n_samples)
    if range_m[1] < start or range_m[0] > stop:
        raise OutOfReach(
            f'the grid lies {range_m[0]:.1f} to {range_m[1]:.1f} m from the antenna, the '
            f'profiles cover {start:.1f} to {stop:.1f} m; move the grid or the range window')


def reach_warnings(points_m, tx_m, rx_m, radar: RadarParameters, n_samples: int,
                   illumination: Illumination | None = None) -> tuple[str, ...]:
    """Say which share of the pixels lies beyond the profiles for some of the pulses.

    Nothing where all of them, (S, 3) all over the image, lie within the `n_samples` of the
    profiles for all phase centres, (..., 3), metres, that light them.
    """
    start, stop = covered_ranges(radar, n_samples)
    centres = [c.reshape(-1, 3) for c in (tx_m, rx_m)]
    echoes = np.linspace(0, len(centres[0]) - 1, min(len(centres[0]), _ECHOES)).round().astype(int)
    length = half_paths(*(c[echoes] for c in centres), points_m)[0]
    outside = (length < start) | (length > stop)
    if illumination is not None:
        outside &= illumination.select(echoes).amplitude(points_m) > 0
    if not outside.any():
        return ()
    return (f'the ranges of {_percent(outside.any(axis=0).mean())} of the pixels, '
            f'{length.min():.1f} to {length.max():.1f} m, leave the profiles, {start:.1f} to '
            f'{stop:.1f} m, for some of the pulses, which add nothing there: '
            f'{_percent(outside.mean())} of the image is missing; the predicted error is that '
            f'of pixels {end_samples(radar)} samples or more within the profiles; keep more of '
            'them, or make the grid smaller',)


def _percent(share: float) -> str:
    return f'{100 * share:.1f} %'
