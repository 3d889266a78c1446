# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""How strong pulses are at the pixels of an image, and how much of that is at their band's ends.

Images may be darker than these pulses, or hold the side lobes alone of what is bright in other
ranges: then interpolation errs more than in an evenly bright scene, most at the ends of a band.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.fft

from ...device_arrays import beside, to_host
from ...geometry.grids import below, spread_evenly

if TYPE_CHECKING:
    from ...geometry.grids import Grid
    from ...geometry.illumination import Illumination
    from ...signal.radar import RadarParameters
    from ..profiles import PhaseHistory
    from .points import ImagePoints

_PAIRS = 512  # of an echo and a pixel: the power of speckle is known within 0.2 dB
# Ordinary images have a share of 0.05 at most; errors at the ends are 4 to 10 dB larger (measured)
_AT_ENDS, _ENDS_DB = 0.1, 10.0
_LEAST_APART = 0.05  # of what neighbours of the three kinds tell
_FEW, _FINER = 32, 2  # echoes, of phase histories, and samples to a cell of their profiles


@dataclasses.dataclass(frozen=True, eq=False)
class PulsePower:
    """Power of an image whose echoes add up as noise does, from some echoes at some pixels.

    Attributes
    ----------
    echoes, samples : (n,) int64
        Echoes, and the sample of each that is nearest to a pixel.
    share : (n,) float64
        Of each squared magnitude in the mean power of a pixel.
    band : float
        Bandwidth over sample rate.
    gain : (K,) float32, optional
        That turns phase histories into profiles, of which `samples` are then.
    """

    echoes: np.ndarray
    samples: np.ndarray
    share: np.ndarray
    band: float
    gain: np.ndarray | None = None

    @classmethod
    def of_pixels(cls, grid: Grid | ImagePoints, radar: RadarParameters, n_samples: int,
                  tx_m: np.ndarray, rx_m: np.ndarray, illumination: Illumination | None = None,
                  band: PhaseHistory | None = None) -> PulsePower:
        """At the pixels of a grid, of profiles or phase histories from centres (R, 3), metres."""
        echoes, index = _drawn(len(tx_m), *getattr(grid, 'size', grid.shape))
        start_m, spacing_m, gain = radar.range_start_m, radar.sample_spacing_m, None
        filled = radar.bandwidth_hz / radar.sample_rate_hz
        if band is not None:
            filled = 1 / _FINER
            echoes = echoes - echoes % -(-len(tx_m) // _FEW)  # one transform serves many pixels
            n_samples, gain = _FINER * band.n_samples, band.gain(band.n_samples)
            start_m, spacing_m = band.range_start_m, band.period_m / n_samples
        even: Any = grid if hasattr(grid, 'steps_m') else None
        points = (grid.positions(*index.astype(np.int64)) if even is None
                  else index.T @ even.steps_m + even.origin_m)
        length = sum(_norm(points - centres_m[echoes]) for centres_m in (tx_m, rx_m)) / 2
        number = np.rint((length - start_m) / spacing_m)
        ends = 1 if band is None else 0  # samples that lack one before or after
        some = (number >= ends) & (number < n_samples - ends)  # not NaN, where a pixel is none
        if not some.all():
            echoes, points, number = echoes[some], points[some], number[some]
        power = np.full(len(echoes), len(tx_m) / _PAIRS)
        if illumination is not None:
            power *= np.nan_to_num(illumination.of_pairs(echoes, points)) ** 2
        return cls(echoes, number.astype(np.int64), power, filled, gain)

    def of(self, echoes: np.ndarray) -> tuple[float, float]:
        """Mean over the pixels, of profiles or phase histories (R, N) complex64 here or there.

        The second value is what of the first lies at the ends of the band, and not all over it or
        beyond, as neighbouring samples tell; less where a few hold the power, which tell little.
        """
        three = self.samples + [[-1], [0], [1]]
        turn = 0.0  # radians from sample to sample in the middle of the band
        if self.gain is None:
            where: Any = beside(self.echoes, echoes), beside(three, echoes)
            values = to_host(echoes[where])
        else:
            some, number = self.without_repetition
            bands = to_host(echoes[beside(some, echoes)]) * self.gain
            n = _FINER * len(self.gain)
            values = scipy.fft.ifft(bands, n, norm='forward')[number, three % n]
            turn = math.pi * (len(self.gain) - 1) / n
        before, here, after = values
        power = self._sum(here, here)
        one = self._sum(before, here) + self._sum(here, after)
        two = self._sum(before, after)
        both = self._sum(before, before) + self._sum(after, after)
        if not (power.real and both.real):
            return power.real, 0.0
        share = _band_end_share(
            (one * np.exp(-1j * turn)).real / (power.real + 0.5 * both.real),
            (two * np.exp(-2j * turn)).real / (0.5 * both.real), self.band)
        few = 0.5 * np.linalg.norm(self.share * np.abs(here) ** 2) / power.real
        return power.real, power.real * max(share - float(few), 0.0)

    def _sum(self, one: np.ndarray, other: np.ndarray) -> complex:
        return complex(np.vdot(one, self.share * other))

    @functools.cached_property
    def without_repetition(self) -> tuple[np.ndarray, np.ndarray]:
        """Echoes without repetition, and the place of each among them."""
        return np.unique(self.echoes, return_inverse=True)


def _band_end_share(one: float, two: float, band: float) -> float:
    """Share of power at the ends of a band, 0 to 1.

    The rest fills the band evenly or, as noise, all of the sampling. `one` and `two` are the
    correlation of a sample with the next one and the one after, `band` the bandwidth over the
    sample rate.
    """
    even, ends = np.sinc([band, 2 * band]), np.cos(math.pi * band * np.array([1, 2]))
    apart = even[0] * ends[1] - even[1] * ends[0]
    share = ((even[0] * two - even[1] * one) / apart if abs(apart) > _LEAST_APART
             else (even[0] - one) / (even[0] - ends[0]))  # hardly any room for noise beyond
    return float(min(max(share, 0.0), 1.0))


def side_lobes_db(share: float) -> float:
    """By how much an image may err more that has this share at the ends of the band, dB."""
    return share * _ENDS_DB if share > _AT_ENDS else 0.0


def _norm(vectors: np.ndarray) -> np.ndarray:
    x, y, z = vectors.T
    return np.sqrt(x * x + y * y + z * z)


@functools.lru_cache(maxsize=8)
def _drawn(n_echoes: int, *shape: int) -> tuple[np.ndarray, np.ndarray]:
    """Numbers of echoes, (_PAIRS,), and of pixels along each axis, (A, _PAIRS), all over them.

    Those of pixels are whole, and float64.
    """
    unit = spread_evenly(0, _PAIRS)
    return below(unit[0] * n_echoes, n_echoes), np.array(
        [below(u * n, n) for u, n in zip(unit[1:], shape, strict=False)], np.float64)
