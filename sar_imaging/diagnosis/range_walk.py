# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Compare how far scatterers walk through range with how far the phase says that they do.

Where an image is in focus, the phase of each bright scatterer follows the half path to its pixel.
The echo itself has to walk through range as far. The half bands of the profiles tell: with the
signal band B, one half lies B / 2 above the other, so that the phase between their images turns
by ``2 pi B / c`` for each metre by which the walk differs. Ranges that are `s` times too long, as
with a slope of the ramp that is said to be `s` times too small, turn it by ``(1 - s)`` times the
change of the half path. Errors of the track that leave the focus, and phases of channels, cancel.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from scipy import fft
from scipy.spatial import cKDTree
from scipy.special import stdtrit

from ..geometry.grids import MapGrid
from ..signal.pulses import PulseBlock
from .coherence import CoherenceProbe, GroupSums

_MOST_SCATTERERS = 48
_BRIGHTEST = 4000  # pixels among which they are looked for
_APART = 1.5  # resolution cells
_AGREE = 0.3  # share of the groups' power that adds up in phase: what the beam lights for a third
_ALIKE = 0.95  # coherence of the half bands with the best scale
_LEAST_RAD = 0.3  # rms phase for a scale of 2: less tells no scale
_SCALES = np.linspace(0.5, 1.8, 131)


@dataclasses.dataclass(frozen=True)
class WalkScale:
    """Walk through range over that of the phase, of the brightest scatterers.

    Parameters
    ----------
    scale : float
        1 where the radar's parameters are right; 0 for no scatterers.
    deviation : float
        Its standard error, from how the scatterers differ.
    n_scatterers : int
        How many tell it.
    """

    scale: float
    deviation: float
    n_scatterers: int

    def off(self, least: float, confidence: float, n_least: int) -> bool:
        """Whether enough scatterers tell that the scale is not 1, by Student's distribution."""
        if self.n_scatterers < max(n_least, 2):
            return False
        limit = stdtrit(self.n_scatterers - 1, (1 + confidence) / 2)
        return bool(abs(self.scale - 1) > max(least, limit * self.deviation))


def walk_scale(profiles: PulseBlock, grid: MapGrid) -> WalkScale:
    """Measure the scale of ranges by the walk of the brightest scatterers in focus.

    Parameters
    ----------
    profiles : PulseBlock
        Range profiles, sampled `OVERSAMPLING` times their bandwidth, with phase centres.
    grid : MapGrid
        As fine as the resolution.

    Returns
    -------
    WalkScale
    """
    sums = GroupSums(profiles)
    points = _scatterers(profiles, grid)
    if not len(points):
        return WalkScale(0.0, math.inf, 0)
    upper, lower = half_bands(profiles.samples)
    whole, half_path = sums(points, profiles.samples)
    cross = sums(points, upper)[0] * sums(points, lower)[0].conj()
    weight = np.maximum(np.abs(cross), 1e-300)
    whole_weight = weight.sum(axis=1)
    walk = half_path - ((half_path * weight).sum(axis=1) / whole_weight)[:, None]
    per_metre = 2 * np.pi * profiles.radar.bandwidth_hz / profiles.radar.propagation_speed_m_per_s
    turn_rad = per_metre * np.sqrt((weight * walk**2).sum(axis=1) / whole_weight)
    agree = (np.square(np.abs(whole.sum(axis=1)))
             / np.maximum(np.square(np.abs(whole)).sum(axis=1), 1e-300) / whole.shape[1])
    coherence = np.stack([
        np.abs(np.sum(cross * np.exp(-1j * per_metre * (1 - s) * walk), axis=1))
        for s in _SCALES], axis=1) / whole_weight[:, None]
    at = coherence.argmax(axis=1)
    tells = ((agree > _AGREE) & (coherence.max(axis=1) > _ALIKE) & (turn_rad > _LEAST_RAD)
             & (at > 0) & (at < len(_SCALES) - 1))
    return _mean(_SCALES[at[tells]], np.square(turn_rad[tells]))


def _mean(scales: np.ndarray, weight: np.ndarray) -> WalkScale:
    """Weighted mean of scales (K,), and its error from their scatter."""
    n = len(scales)
    if n < 2:
        return WalkScale(float(scales[0]) if n else 0.0, math.inf, n)
    weight = np.minimum(weight, 4 * np.median(weight))  # one alone does not decide
    weight = weight / weight.sum()
    mean = float(weight @ scales)
    spread = float(np.sum(np.square(weight * (scales - mean)))) * n / (n - 1)
    return WalkScale(mean, math.sqrt(spread), n)


def _scatterers(profiles: PulseBlock, grid: MapGrid) -> np.ndarray:
    """(K, 3) positions of the brightest local maxima of the image, metres."""
    probe = CoherenceProbe(grid).fixed(profiles)
    points, magnitude = probe.points, np.abs(probe.sums(profiles))
    bright = np.argsort(-magnitude)[:_BRIGHTEST]
    bright = bright[magnitude[bright] > 0]
    if not len(bright):
        return np.empty((0, 3))
    apart = _APART * max(profiles.radar.range_resolution_m, grid.spacing_m)
    pairs = cKDTree(points[bright]).query_pairs(apart, output_type='ndarray')
    peaks = np.delete(bright, np.unique(pairs[:, 1]))  # the second is the fainter of each
    return points[peaks[:_MOST_SCATTERERS]]


def half_bands(samples: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Profiles (P, C, N) complex64 of the upper and of the lower half of the band."""
    spectra = fft.fft(samples, axis=-1)
    above = fft.fftfreq(samples.shape[-1]) > 0
    return (fft.ifft(np.where(above, spectra, 0), axis=-1),
            fft.ifft(np.where(above, 0, spectra), axis=-1))
