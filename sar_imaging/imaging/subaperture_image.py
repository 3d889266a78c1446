"""Coarse polar image of one sub-aperture: what travels from backprojection to AFBP fusion."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from ..geometry.polar import PolarGrid
from ..signal.radar import SPEED_OF_LIGHT
from ..signal.sequence import COUNTER_MASK


@dataclasses.dataclass(frozen=True)
class SubapertureImage:
    """Image of one sub-aperture in the polar coordinates of its aperture.

    All sub-apertures of an aperture use one polar grid, with the aperture's centre as origin
    (Zhang et al., unified polar coordinates), so that their spectra add without interpolation.

    Parameters
    ----------
    image : (n_alpha, n_range) complex64
        At range baseband: ``f(x) exp(-j 4 pi (r - r_0) / wavelength)`` with r_0 the first range.
    grid : PolarGrid
        Where the pixels are, in the imaging frame.
    carrier_hz, bandwidth_hz : float
        Centre frequency and two-sided bandwidth of the range profiles, hertz.
    aperture : int
        Number of the aperture, ``counter // pulses_per_aperture``.
    number, n_subapertures : int
        Place of this sub-aperture in the aperture, from 0, and how many make the aperture.
    first_counter : int
        Counter of the sub-aperture's first pulse, whether it came or not.
    n_pulses, n_missing : int
        Pulses in the image and pulses that it lacks; together the sub-aperture's length.
    stamp_ns : int
        Time of the middle of the sub-aperture, nanoseconds since the epoch of the pulses' clock.
    predicted_error_db : float
        Expected error of the backprojection against exact correlation, dB.

    Raises
    ------
    ValueError
        The image does not have the shape of the grid, or a value is impossible.
    """

    image: np.ndarray
    grid: PolarGrid
    carrier_hz: float
    bandwidth_hz: float
    aperture: int
    number: int
    n_subapertures: int
    first_counter: int
    n_pulses: int
    n_missing: int
    stamp_ns: int
    predicted_error_db: float

    def __post_init__(self):
        object.__setattr__(self, 'image', np.asarray(self.image, np.complex64))
        expected = (self.grid.n_alpha, self.grid.n_range)
        if self.image.shape != expected:
            raise ValueError(f'image.shape={self.image.shape} does not match the grid; expected '
                             f'(n_alpha, n_range)={expected}')
        _check_grid(self.grid)
        for name in ('carrier_hz', 'bandwidth_hz'):
            value = getattr(self, name)
            if not 0 < value < math.inf:
                raise ValueError(f'{name}={value} must be positive and finite')
        if not math.isfinite(self.predicted_error_db):
            raise ValueError(f'predicted_error_db={self.predicted_error_db} must be finite')
        for name in ('aperture', 'number', 'n_subapertures', 'first_counter', 'n_pulses',
                     'n_missing'):
            value = getattr(self, name)
            if not 0 <= value <= COUNTER_MASK:
                raise ValueError(f'{name}={value}; expected 0 to {COUNTER_MASK}')
        if self.number >= self.n_subapertures:
            raise ValueError(f'number={self.number} of n_subapertures={self.n_subapertures}; '
                             'numbers count from 0')
        if not 1 <= self.n_pulses <= COUNTER_MASK - self.n_missing:
            raise ValueError(f'n_pulses={self.n_pulses}, n_missing={self.n_missing}; expected at '
                             f'least one pulse, and at most {COUNTER_MASK} together')
        if not -2**63 <= self.stamp_ns < 2**63:
            raise ValueError(f'stamp_ns={self.stamp_ns} exceeds 64 bits; expected nanoseconds')

    @property
    def wavelength_m(self) -> float:
        """Wavelength at the carrier, metres."""
        return SPEED_OF_LIGHT / self.carrier_hz


def _check_grid(grid: PolarGrid) -> None:
    numbers = (*grid.origin_m, *grid.track, grid.z_m, grid.range_start_m, grid.range_spacing_m,
               grid.alpha_start, grid.alpha_spacing)
    if not all(map(math.isfinite, numbers)):
        raise ValueError(f'{grid} holds numbers that are NaN or infinite')
    if grid.range_spacing_m <= 0 or grid.alpha_spacing <= 0:
        raise ValueError(f'range_spacing_m={grid.range_spacing_m}, alpha_spacing='
                         f'{grid.alpha_spacing}; expected positive spacings: both axes ascend')
    if abs(math.hypot(*grid.track) - 1) > 1e-9:
        raise ValueError(f'track={grid.track} is no unit vector; divide it by its length')
    if grid.side not in (-1, 1):
        raise ValueError(f'side={grid.side}; expected +1 (left of the track) or -1 (right)')
