# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Coarse polar image of one sub-aperture: what travels from backprojection to AFBP fusion."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np

from ..device_arrays import on_device
from ..geometry.grids import MapGrid
from ..geometry.illumination import Pointing
from ..geometry.polar import PolarGrid
from ..planning.afbp.polar_grids import UnifiedPolarGrids
from ..signal.pulses import PulseBlock
from ..signal.pulses.sequence import COUNTER_MASK

#: Names of the fields that count something, unsigned with 32 bits.
COUNTS = ('session', 'sequence', 'revision', 'aperture', 'number', 'n_subapertures', 'n_window',
          'first_counter', 'n_pulses', 'n_missing', 'pulses_per_aperture')


@dataclasses.dataclass(frozen=True)
class SubapertureEnds:
    """Where the pulses at the two ends of a sub-aperture's track were sent.

    They tell the band by which a window that slides is read, and how bright the sub-aperture is.

    Parameters
    ----------
    tx_m, rx_m : (2, 3) tuples of float
        Transmit and receive phase centre of the two pulses, the mean of their channels, metres.
    n_channels : int
        Channels of a pulse.
    boresight, up : (2, 3) tuples of float, or ()
        Directions of the antenna, unit vectors; none where nobody tells.
    weighted : bool
        Whether the image was weighed by the antenna's pattern.

    Raises
    ------
    ValueError
        Shapes differ, a number is not finite, or directions are no perpendicular unit vectors.
    """

    tx_m: tuple[Any, ...]
    rx_m: tuple[Any, ...]
    n_channels: int = 1
    boresight: tuple[Any, ...] = ()
    up: tuple[Any, ...] = ()
    weighted: bool = False

    def __post_init__(self) -> None:
        for name in ('tx_m', 'rx_m', 'boresight', 'up'):
            values = np.asarray(getattr(self, name), np.float64)
            if values.shape != (2, 3) and not (values.size == 0 and name in ('boresight', 'up')):
                raise ValueError(f'{name}.shape={values.shape}; expected (2, 3): of the '
                                 'pulses at both ends')
            if not np.isfinite(values).all():
                raise ValueError(f'{name} of the ends of a sub-aperture must be finite')
            object.__setattr__(self, name, tuple(map(tuple, values.tolist())))
        if not 1 <= self.n_channels <= COUNTER_MASK:
            raise ValueError(f'n_channels={self.n_channels}; expected at least 1')
        if len(self.boresight) != len(self.up) or (self.weighted and not self.up):
            raise ValueError('the ends of a weighed sub-aperture lack boresight or up; expected '
                             'both')
        if self.up:
            Pointing.of_unit_vectors(self.boresight, self.up)

    @classmethod
    def of(cls, block: PulseBlock, track: tuple[float, float], *, weighted: bool
           ) -> SubapertureEnds:
        """Those of some pulses, in their order, along `track`, the (2,) direction of x and y.

        Where a track turns back, neither the first pulse nor the last one is at its end.
        """
        along = block.phase_centre_m[:, :2] @ track
        ends, looks = sorted((int(along.argmin()), int(along.argmax()))), block.pointing
        tx_m, rx_m = block.centres_m
        return cls(tx_m[ends].mean(axis=1), rx_m[ends].mean(axis=1), block.n_channels,
                   () if looks is None else tuple(looks.boresight[ends]),
                   () if looks is None else tuple(looks.up[ends]), weighted)

    def pulses(self, n_pulses: int) -> tuple[np.ndarray, np.ndarray, Pointing | None]:
        """Phase centres (P, C, 3), metres, and pointing of pulses evenly from end to end."""
        fraction = np.linspace(0.0, 1.0, n_pulses)[:, None]

        def between(ends: Any) -> np.ndarray:
            return (1 - fraction) * np.array(ends[0]) + fraction * np.array(ends[1])

        tx_m, rx_m = (np.repeat(between(ends)[:, None], self.n_channels, axis=1)
                      for ends in (self.tx_m, self.rx_m))
        looks = Pointing(between(self.boresight), between(self.up)) if self.up else None
        return tx_m, rx_m, looks


@dataclasses.dataclass(frozen=True)
class SubapertureImage:
    """Image of one sub-aperture in the polar coordinates of its aperture.

    All sub-apertures of an aperture use one polar grid, with the aperture's centre as origin
    (Zhang et al., unified polar coordinates), so that their spectra add without interpolation.

    What belongs together is told by `session`, `sequence` and `revision`, whatever the counters
    of the pulses do: a restarted radar or a looping recording has old counters, but a new
    sequence.

    Parameters
    ----------
    image : (n_alpha, n_range) complex64
        On ``fusion.coarse``, at range baseband: ``f(x) exp(-j 4 pi (r - r_0) / wavelength)`` with
        r_0 the first range of that grid. On the device where a device formed it.
    fusion : UnifiedPolarGrids
        Grids that the sub-apertures of the aperture share.
    centre_m : float
        Middle of the image's band; see `SpectrumFusion.add`.
    map_grid : MapGrid
        Map that the fused image is wanted on; ``fusion.polar`` covers it.
    bandwidth_hz : float
        Two-sided bandwidth of the range profiles, hertz.
    session : int
        Number that a sender draws when it starts, to be told from its predecessor.
    sequence : int
        Running number of the aperture in the session; one more than that of the aperture right
        before it, at least two more where others lie between.
    revision : int
        How often the aperture was planned anew because its track had been foreseen too poorly;
        its sub-apertures are then sent again, on another grid, and replace the former ones.
    aperture : int
        Number of the aperture by its pulses, ``counter // pulses_per_aperture``.
    number, n_subapertures, n_window : int
        Place of this sub-aperture in the aperture, from 0; how many make the aperture, and how
        many an image: all of them, or fewer, the latest, of a sliding aperture.
    first_counter, n_pulses, n_missing : int
        Counter of the sub-aperture's first pulse, whether it came or not; pulses in the image and
        pulses that it lacks, together the sub-aperture's length.
    pulses_per_aperture : int
        Length of an aperture; its sub-apertures are equally long, but for a shorter last one.
    stamp_ns : int
        Time of the middle of the sub-aperture, nanoseconds since the epoch of the pulses' clock.
    predicted_error_db : float
        Expected error of the fused image on the map against exact correlation, dB. With
        illumination that of the sub-aperture's part, relative to its own power. NaN where its
        profiles cover no pixel.
    ends : SubapertureEnds or None
        Where its pulses were sent; None where the sender does not tell.

    Raises
    ------
    ValueError
        The image does not have the shape of the grid, or a value is impossible.
    """

    image: np.ndarray
    fusion: UnifiedPolarGrids
    centre_m: float
    map_grid: MapGrid
    bandwidth_hz: float
    session: int
    sequence: int
    revision: int
    aperture: int
    number: int
    n_subapertures: int
    n_window: int
    first_counter: int
    n_pulses: int
    n_missing: int
    pulses_per_aperture: int
    stamp_ns: int
    predicted_error_db: float
    ends: SubapertureEnds | None = None

    def __post_init__(self) -> None:
        if not on_device(self.image):
            object.__setattr__(self, 'image', np.asarray(self.image, np.complex64))
        expected = (self.grid.n_alpha, self.grid.n_range)
        if self.image.shape != expected:
            raise ValueError(f'image.shape={self.image.shape} does not match the grid; expected '
                             f'(n_alpha, n_range)={expected}')
        if not 0 < self.bandwidth_hz < math.inf:
            raise ValueError(f'bandwidth_hz={self.bandwidth_hz} must be positive and finite')
        for name, wrong in (('predicted_error_db', math.isinf(self.predicted_error_db)),
                            ('centre_m', not math.isfinite(self.centre_m))):
            if wrong:
                raise ValueError(f'{name}={getattr(self, name)} must be finite')
        for name in COUNTS:
            value = getattr(self, name)
            if not 0 <= value <= COUNTER_MASK:
                raise ValueError(f'{name}={value}; expected 0 to {COUNTER_MASK}')
        if self.number >= self.n_subapertures:
            raise ValueError(f'number={self.number} of n_subapertures={self.n_subapertures}; '
                             'numbers count from 0')
        if not 1 <= self.n_window <= self.n_subapertures:
            raise ValueError(f'n_window={self.n_window} of n_subapertures={self.n_subapertures}; '
                             'expected at least one and at most all')
        if not 1 <= self.n_pulses <= self.pulses_per_aperture - self.n_missing:
            raise ValueError(f'n_pulses={self.n_pulses}, n_missing={self.n_missing}; expected at '
                             f'least one pulse, and at most pulses_per_aperture='
                             f'{self.pulses_per_aperture} together')
        if not -2**63 <= self.stamp_ns < 2**63:
            raise ValueError(f'stamp_ns={self.stamp_ns} exceeds 64 bits; expected nanoseconds')

    @property
    def grid(self) -> PolarGrid:
        """Where the pixels are, in the imaging frame."""
        return self.fusion.coarse

    @property
    def length(self) -> int:
        """Pulses of the sub-aperture, whether they came or not."""
        return self.n_pulses + self.n_missing
