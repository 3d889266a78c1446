"""Error of the interpolations of fast factorised backprojection, one after the other.

What a pulse contributes to a local image is a tone at every pixel: its local frequencies are the
derivatives of its half path. Each interpolation multiplies the tone by a factor h that depends on
its frequency and on the place between samples, with a mean of 1 - l and a variance v over the
places. After all its interpolations the tone errs by

``E |H - 1|^2 = L^2 + (1 - L)^2 ((1 + s_range^2) (1 + s_direction^2) - 1)``

with ``L = 1 - prod (1 - l)``.

The losses l of all levels add up in amplitude. So do the spreads along range, where the places are
nearly the same for all of a level: s is the sum of ``sqrt(v) / (1 - l)``. Along direction places
differ from line to line and levels are independent: s^2 is the sum of ``v / (1 - l)^2``. Tones are
weighed by their share in the power of the image.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence

import numpy as np

from ..planning.echo_power import echo_power
from ..signal.radar import RadarParameters
from .ffbp_geometry import FfbpGeometry
from .ffbp_grids import local_slopes
from .ffbp_segments import Segment
from .neighbour_weights import mean_gain

_PULSES, _CHANNELS = 32, 4  # that stand for all
_TONE, _BY_TONE = np.polynomial.legendre.leggauss(12)  # over the band, where errors ripple


@dataclasses.dataclass(frozen=True, eq=False)
class LocalTones:
    """Local frequencies of some pulses at some pixels, in the images of every level.

    Attributes
    ----------
    slopes : (2, L, S, C, K) float64
        Derivatives of half paths from pulses and channels to positions, by range and direction.
    k, k_c : (F,) float64 and float
        Wavenumbers over the band and at the carrier, rad/m.
    known : (L, S) bool
        Whether a level has an image with the pulse in it.
    shares : (2, S, C, 1, F) float64
        In the power of an image, of what all pulses see alike and of noise; of sum 1.
    """

    slopes: np.ndarray
    k: np.ndarray
    k_c: float
    known: np.ndarray
    shares: np.ndarray

    def cycles(self, axis: int, level: int, spacing: float) -> np.ndarray:
        """(S, C, K, F) cycles per sample along range (0) or direction (1)."""
        turns = spacing / (2 * np.pi)
        found = turns * self.k * self.slopes[axis, level][..., None]
        return found if axis else found - turns * self.k_c


def local_tones(geometry: FfbpGeometry, radar: RadarParameters) -> LocalTones:
    """Local frequencies of an aperture."""
    tx, rx, points = geometry.tx, geometry.rx, geometry.inside
    pulses, channels = (np.unique(np.linspace(0, n - 1, min(n, most)).round().astype(int))
                        for n, most in zip(tx.shape[:2], (_PULSES, _CHANNELS), strict=True))
    some = [a[np.ix_(pulses, channels)] for a in (tx, rx)]
    k_c = radar.wavenumber_rad_per_m
    k = k_c + radar.half_band_rad_per_m * _TONE
    origins, known = [], []
    for nodes in geometry.levels:
        starts, stops = (np.array([getattr(n.pulses, e) for n in nodes])
                         for e in ('start', 'stop'))
        number = np.maximum(np.searchsorted(starts, pulses, 'right') - 1, 0)
        known.append((starts[number] <= pulses) & (pulses < stops[number]))
        origins += [nodes[i].centre for i in number]
    slopes = local_slopes(np.array(origins), *(np.tile(a, (len(known), 1, 1)) for a in some),
                          points)
    shares = _shares(geometry, radar, pulses, channels)
    return LocalTones(slopes.reshape(2, *np.shape(known), *slopes.shape[2:]), k, k_c,
                      np.array(known), shares[..., None, None] * _BY_TONE / 2)


def _shares(geometry, radar, pulses, channels) -> np.ndarray:
    """(2, S, C) shares of some pulses, each with its neighbours, in the power of images."""
    inside = geometry.inside
    power = echo_power(geometry.tx.reshape(-1, 3), geometry.rx.reshape(-1, 3), inside[4],
                       (inside[5] - inside[3], inside[7] - inside[1]), radar)
    first = np.r_[0, (pulses[1:] + pulses[:-1] + 1) // 2]
    found = [np.add.reduceat(p.reshape(geometry.tx.shape[:2]), first)[:, channels]
             for p in (power, np.ones_like(power))]
    return np.array([share / share.sum() for share in found])


def read_errors(tones: LocalTones, axes: Sequence[int], kernel: str,
                oversampling: Sequence[float], spacings: Sequence[Sequence[float]],
                segments: Sequence[Segment]) -> list[float]:
    """Mean squared errors of all interpolations, relative to the power of the image.

    Parameters
    ----------
    tones : LocalTones
        Of the aperture.
    axes : sequence of int
        Along which: 0 for range, 1 for direction.
    kernel : str
        Interpolation kernel.
    oversampling : (float, float)
        Along range and direction.
    spacings : two sequences of L floats
        Of local grids along range, metres, and direction, by level.
    segments : sequence of L Segment
        By which the images of each level are read.

    Returns
    -------
    list of float
        Along each axis, and last along all of them together.
    """
    each = []
    for axis in axes:
        kept, spread = 1.0, 0.0
        for level, (known, segment) in enumerate(zip(tones.known, segments, strict=True)):
            loss, variance = mean_gain(kernel, oversampling[axis], segment.drift(axis),
                                       tones.cycles(axis, level, spacings[axis][level]))
            if not known.all():
                loss, variance = (known[:, None, None, None] * v for v in (loss, variance))
            gain = 1 - loss
            kept = kept * gain
            spread = spread + (variance / gain ** 2 if axis else np.sqrt(variance) / gain)
        each.append((kept, spread if axis else spread ** 2))
    if len(axes) > 1:
        (kept_range, range_spread), (kept_alpha, alpha_spread) = each
        each.append((kept_range * kept_alpha,
                     range_spread + alpha_spread + range_spread * alpha_spread))
    return [_mean_error(tones, *both) for both in each]


def _mean_error(tones, kept, spread) -> float:
    """Where the image is worst, of what pulses see alike or of noise."""
    error = (1 - kept) ** 2 + kept ** 2 * spread
    return float(np.einsum('scpf,wscpf->wp', error, np.broadcast_to(
        tones.shares, (2, *error.shape))).max())


def expansion_error(segments: Sequence[Segment]) -> float:
    """Mean squared error of phases expanded along segments, which grow as the fourth power."""
    return (2 * math.pi * sum(s.cycles for s in segments) / 3) ** 2


def rounding_error(segments: Sequence[Segment], cycles_per_pixel: float) -> float:
    """Mean squared error of phases from places between pixels that are rounded to float32."""
    merges = sum(bool(s.length) for s in segments)
    return merges * (2 * math.pi * cycles_per_pixel * 2.0 ** -24) ** 2
