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

from ...signal.radar import RadarParameters
from ..echo_power import echo_power
from .ffbp_geometry import FfbpGeometry
from .ffbp_grids import local_slopes
from .ffbp_segments import Segment
from .neighbour_weights import mean_gain

# Places along range are nearly the same for a whole level, so that amplitudes of errors add up;
# those along direction differ from line to line, so that powers do.
_POWERS = (1, 2)
_PULSES, _CHANNELS, _TONES = 32, 4, 12  # that stand for all: errors ripple over the band


@dataclasses.dataclass(frozen=True, eq=False)
class LocalTones:
    """Local frequencies of some pulses at some pixels, in the images of every level.

    Attributes
    ----------
    along_range, along_alpha : (L, S, C, K, F) float64
        Of pulses, channels, positions and frequencies, rad/m and rad.
    known : (L, S) bool
        Whether a level has an image with the pulse in it.
    shares : (2, S, C, 1, F) float64
        In the power of an image, of what all pulses see alike and of noise; of sum 1.
    """

    along_range: np.ndarray
    along_alpha: np.ndarray
    known: np.ndarray
    shares: np.ndarray

    def along(self, axis: int) -> np.ndarray:
        """Frequencies along range (0) or direction (1)."""
        return (self.along_range, self.along_alpha)[axis]


def local_tones(geometry: FfbpGeometry, radar: RadarParameters) -> LocalTones:
    """Local frequencies of an aperture."""
    tx, rx, points = geometry.tx, geometry.rx, geometry.inside
    pulses, channels = (np.unique(np.linspace(0, n - 1, min(n, most)).round().astype(int))
                        for n, most in zip(tx.shape[:2], (_PULSES, _CHANNELS), strict=True))
    some = [a[np.ix_(pulses, channels)] for a in (tx, rx)]
    tone, by_tone = np.polynomial.legendre.leggauss(_TONES)
    k_c = radar.wavenumber_rad_per_m
    k = k_c + radar.half_band_rad_per_m * tone
    found, known = [], []
    for nodes in geometry.levels:
        starts, stops = (np.array([getattr(n.pulses, e) for n in nodes])
                         for e in ('start', 'stop'))
        number = np.maximum(np.searchsorted(starts, pulses, 'right') - 1, 0)
        known.append(np.zeros(len(pulses), bool) if not nodes else
                     (starts[number] <= pulses) & (pulses < stops[number]))
        origins = (np.array([nodes[i].centre for i in number]) if nodes
                   else np.tile(geometry.levels[0][0].centre, (len(pulses), 1)))
        by_range, by_alpha = local_slopes(origins, *some, points)
        found.append((k * by_range[..., None] - k_c, k * by_alpha[..., None]))
    return LocalTones(*(np.array(a) for a in zip(*found, strict=True)), np.array(known),
                      _shares(geometry, radar, pulses, channels)[..., None, None] * by_tone / 2)


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
        log_gain, spread = 0.0, 0.0
        for level, (known, segment) in enumerate(zip(tones.known, segments, strict=True)):
            frequency = tones.along(axis)[level] * (spacings[axis][level] / (2 * np.pi))
            loss, variance = mean_gain(kernel, oversampling[axis], segment.drift(axis), frequency)
            known = known[:, None, None, None]
            log_gain = log_gain + known * np.log1p(-loss)
            spread = spread + known * (np.sqrt(variance) / (1 - loss)) ** _POWERS[axis]
        each.append((log_gain, np.log1p(spread ** (2 / _POWERS[axis]))))
    if len(axes) > 1:
        each.append(tuple(map(sum, zip(*each, strict=True))))
    return [_mean_error(tones, *logs) for logs in each]


def _mean_error(tones, log_gain, log_spread) -> float:
    """Where the image is worst, of what pulses see alike or of noise."""
    lost = np.expm1(log_gain)
    error = lost ** 2 + (1 + lost) ** 2 * np.expm1(log_spread)
    return float(np.einsum('scpf,wscpf->wp', error, np.broadcast_to(
        tones.shares, (2, *error.shape))).max())


def expansion_error(segments: Sequence[Segment]) -> float:
    """Mean squared error of phases expanded along segments, which grow as the fourth power."""
    return (2 * math.pi * sum(s.cycles for s in segments) / 3) ** 2


def rounding_error(segments: Sequence[Segment], cycles_per_pixel: float) -> float:
    """Mean squared error of phases from places between pixels that are rounded to float32."""
    merges = sum(bool(s.length) for s in segments)
    return merges * (2 * math.pi * cycles_per_pixel * 2.0 ** -24) ** 2
