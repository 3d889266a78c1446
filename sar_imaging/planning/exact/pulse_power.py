# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""How strong pulses are at the pixels of an image, which tells images that are darker."""

from __future__ import annotations

import dataclasses
import functools
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.fft

from ...device_arrays import beside, to_host
from ...geometry.grids import below, spread_evenly
from .points import ImagePoints

if TYPE_CHECKING:
    from ...geometry.grids import EvenGrid
    from ...geometry.illumination import Illumination
    from ...signal.radar import RadarParameters
    from ..profiles import PhaseHistory

_PAIRS = 512  # of an echo and a pixel: the power of speckle is known within 0.2 dB
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
    gain : (K,) float32, optional
        That turns phase histories into profiles, of which `samples` are then.
    """

    echoes: np.ndarray
    samples: np.ndarray
    share: np.ndarray
    gain: np.ndarray | None = None

    @classmethod
    def of_pixels(cls, grid: EvenGrid | ImagePoints, radar: RadarParameters, n_samples: int,
                  tx_m: np.ndarray, rx_m: np.ndarray, illumination: Illumination | None = None,
                  band: PhaseHistory | None = None) -> PulsePower:
        """At the pixels of a grid, of profiles or phase histories from centres (R, 3), metres."""
        echoes, index = _drawn(len(tx_m), *getattr(grid, 'size', grid.shape))
        start_m, spacing_m, gain = radar.range_start_m, radar.sample_spacing_m, None
        if band is not None:
            echoes = echoes - echoes % -(-len(tx_m) // _FEW)  # one transform serves many pixels
            n_samples, gain = _FINER * band.n_samples, band.gain(band.n_samples)
            start_m, spacing_m = band.range_start_m, band.period_m / n_samples
        points = (grid.positions(*index.astype(np.int64)) if isinstance(grid, ImagePoints)
                  else index.T @ grid.steps_m + grid.origin_m)
        length = sum(_norm(points - centres_m[echoes]) for centres_m in (tx_m, rx_m)) / 2
        number = np.rint((length - start_m) / spacing_m)
        some = (number >= 0) & (number < n_samples)  # not NaN, where a pixel is none
        if not some.all():
            echoes, points, number = echoes[some], points[some], number[some]
        power = np.full(len(echoes), len(tx_m) / _PAIRS)
        if illumination is not None:
            power *= np.nan_to_num(illumination.of_pairs(echoes, points)) ** 2
        return cls(echoes, number.astype(np.int64), power, gain)

    def of(self, echoes: np.ndarray) -> float:
        """Mean over the pixels, of profiles or phase histories (R, N) complex64 here or there."""
        if self.gain is None:
            where: Any = beside(self.echoes, echoes), beside(self.samples, echoes)
            values = to_host(echoes[where])
        else:
            some, row = self.without_repetition
            bands = to_host(echoes[beside(some, echoes)]) * self.gain
            values = scipy.fft.ifft(bands, _FINER * len(self.gain), norm='forward')[
                row, self.samples]
        return float(self.share @ (values.real ** 2 + values.imag ** 2))

    @functools.cached_property
    def without_repetition(self) -> tuple[np.ndarray, np.ndarray]:
        """Echoes without repetition, and the place of each among them."""
        return np.unique(self.echoes, return_inverse=True)


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
