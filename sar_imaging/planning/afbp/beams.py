# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""How many beams a sub-aperture needs, how they are summed and read, and the error of both.

Seen from its own middle the paths of a sub-aperture's echoes depend on direction alone. From beam
to beam an echo is then an exponential, whose frequency is the derivative of its path by the number
of the beam times the wavenumber; what the interpolation takes from that frequency the echo gets
beforehand. Frequencies, and with them gains, differ a little over a group of beams and over a run
of bins, which share one: the errors of that are known from the geometry.
"""

from __future__ import annotations

import bisect
import dataclasses
import functools
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ...geometry.half_paths import pair_lengths, sample_paths
from ...geometry.polar import PolarGrid
from ...signal.radar import RadarParameters
from ..aliasing_error import cosine_fall
from ..costs import costs
from ..interpolators import Interpolator, design_interpolator
from ..plan import total_db
from ..profiles import RangeResampling

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

BEAM_TAPS, DEGREE = 6, 5  # neighbours between beams, and degree of the polynomials
STEP_BINS = 16  # over which phases of the beams of a group are taken to grow alike
_POINTS = 2048  # of the table: reading it linearly adds 1e-5
_NODES = 8  # between two beams
_BEYOND = 1.15  # times the band: what lies there should not meet a kink
_RUN_SHARE = 0.02  # of the carrier frequency, over which gains are taken to grow alike
_LEAST_RUNS = 16  # of bins; not by the number of threads, so that results do not depend on it


@dataclasses.dataclass(frozen=True, eq=False)
class BeamGain:
    """Gain of echoes by their frequency from beam to beam.

    Attributes
    ----------
    interpolator : Interpolator
        Between beams.
    step : float
        Step of the table, cycles per beam.
    log_gain : (N,) float64
        Natural logarithm of the gain by the magnitude of the frequency, from 0.
    power : (N,) float64
        What interpolation leaves of frequencies over one cycle per beam.
    """

    interpolator: Interpolator
    step: float
    log_gain: np.ndarray
    power: np.ndarray

    @functools.cached_property
    def derivatives(self) -> tuple[np.ndarray, np.ndarray]:
        """First and second derivative of the logarithm by frequency."""
        first = np.gradient(self.log_gain, self.step)
        return first, np.gradient(first, self.step)


@functools.lru_cache(maxsize=256)
def _tables(between: tuple[BeamGain, ...], groups: tuple[int, ...]) -> np.ndarray:
    """(2 + G, I N) tables of both derivatives, and of `_repeated` for G groups, of I gains."""
    return np.concatenate([np.stack([*one.derivatives, *(_repeated(one, group)
                                                         for group in groups)])
                           for one in between], axis=1)


def _repeated(between: BeamGain, group: int) -> np.ndarray:
    """Table of how much errors grow that rise over groups of so many beams and start again.

    They come in at other frequencies, from which interpolation takes less.
    """
    if group == 1:
        return np.zeros(_POINTS)
    harmonic = np.arange(1, group)
    share = 1 / np.sin(np.pi * harmonic / group) ** 2
    place = (between.step * np.arange(_POINTS)[:, None] + harmonic / group) * _POINTS
    power = between.power[place.round().astype(int) % _POINTS]
    return np.exp(between.log_gain) * np.sqrt(power @ share / share.sum())


def shared_errors(between: Sequence[BeamGain], radians: np.ndarray, chirp: np.ndarray,
                  uneven: ArrayLike, relative: Sequence[float], groups: Sequence[int]
                  ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rms errors of what neighbouring beams, bins and echoes share, for I kinds of beams.

    From beam to beam an echo is ``exp(j phi(m))`` of frequency ``f = phi' / (2 pi)``, and is to be
    multiplied by the gain g(f). Relative to the echo, and with ``l = log g``:

    - f changes from beam to beam: ``g(d/dm)`` of a chirp is more than g times it by
      ``(g'' / g) phi'' / (8 pi^2)``, and ``g'' / g = l'' + l'^2``;
    - over a run of bins, r wide relative to the carrier, l is a straight line through two Gaussian
      points: the parabola ``l'' (f r)^2 / 2`` leaves ``1 / sqrt(180)`` of itself (rms);
    - m beams from the middle of a group of G, the gain is off by ``l' phi'' m / (2 pi)`` and the
      phase, which is held over a vector of bins v wide, by ``phi' v m / sqrt(12)``; m is
      ``sqrt((G^2 - 1) / 12)`` (rms). Half the phase's bend, ``phi'' m^2 / 2``, leaves
      ``sqrt((G^2 - 1) (G^2 - 4) / 180)`` beside a pair's common part;
    - echoes that share phasors are off by `uneven` times m.

    Errors of a group start again with the next one: interpolation lets a part of them through.

    Parameters
    ----------
    between, groups : sequence of I BeamGain, sequence of G int
        Of the beams, and numbers of beams to a group.
    radians, chirp : (I, D, V, R) float64
        In D directions of R echoes of V sub-apertures: phase from beam to beam, and how it grows.
    uneven : (I,) array_like
        Phase from beam to beam by which echoes that share phasors are not opposite, rad.
    relative : (float, float)
        Width of a run of bins, whose gains grow alike, and of a vector of bins, over which phases
        of the beams of a group do, relative to the carrier.

    Returns
    -------
    always : (I, 2) float64
        With any group: of frequencies that change from beam to beam, of gains over a run.
    grouped : (I, G, 2) float64
        Of gains and phases that grow over a group, and of phases that bend over it.
    paired : (I, G) float64
        Of echoes that share phasors with opposite ones.
    """
    frequency = radians / (2 * math.pi)
    steps = np.array([one.step for one in between])[:, None, None, None]
    place = np.minimum(np.abs(frequency) * (1 / steps), _POINTS - 1)
    below = np.minimum(place.astype(np.intp), _POINTS - 2)
    share, table = place - below, _tables(tuple(between), tuple(groups))
    below += _POINTS * np.arange(len(between))[:, None, None, None]
    found = table.take(below, axis=1)
    found += share * (table.take(below + 1, axis=1) - found)
    first, second, grown = found[0], found[1], found[2:]
    # The kernel takes frequencies as held; gains run straight through two Gaussian points.
    always = [(second + first ** 2) * chirp / (8 * math.pi ** 2),
              second * (frequency * relative[0]) ** 2 / 2 / math.sqrt(180)]
    rising = np.hypot(first * chirp / (2 * math.pi), radians * relative[1] / math.sqrt(12))
    squared = np.square(groups)
    beside = np.sqrt((squared - 1) / 12)  # rms distance from the middle of a group
    squares = np.sqrt((squared - 1) * np.maximum(squared - 4, 0) / 180)
    n = len(grown)
    rms = rms_of_echoes(np.concatenate([always, rising * grown, chirp / 2 * grown, grown])).T
    return (rms[:, :2], np.stack([rms[:, 2:2 + n] * beside, rms[:, 2 + n:2 + 2 * n] * squares],
                                 axis=2),
            rms[:, 2 + 2 * n:] * np.reshape(uneven, (-1, 1)) * beside)


def rms_of_echoes(errors: np.ndarray) -> np.ndarray:
    """Rms over echoes of the largest of errors (..., D, V, R) anywhere; of V the worst."""
    return np.sqrt((np.abs(errors).max(axis=-3) ** 2).mean(axis=-1).max(axis=-1))


@functools.lru_cache(maxsize=64)
def beam_gain(oversampling: float, deapodised: bool) -> BeamGain:
    """Gain and interpolator for beams that lie so much closer than needed.

    Frequencies that change from beam to beam do best with gains of 1, which not being `deapodised`
    means.
    """
    interpolator = design_interpolator(oversampling, taps=BEAM_TAPS, degree=DEGREE,
                                       deapodised=deapodised)
    step = min(0.5, _BEYOND * 0.5 / interpolator.oversampling) / (_POINTS - 1)
    log_gain = np.zeros(_POINTS)
    if deapodised:
        log_gain = np.log(interpolator.gain(step * np.arange(_POINTS)))
    return BeamGain(interpolator, step, log_gain, _power(interpolator))


def _power(interpolator: Interpolator) -> np.ndarray:
    x, weight = np.polynomial.legendre.leggauss(_NODES)
    by_position = (0.5 + 0.5 * x)[:, None] ** np.arange(DEGREE + 1) @ interpolator.weights
    return 0.5 * weight @ np.abs(np.fft.fft(by_position, _POINTS)) ** 2


def bins_per_run(n_bins: int, relative_bandwidth: float) -> int:
    """Of all bins of a spectrum, those over which gains grow alike, in whole vectors.

    `relative_bandwidth` is that of all bins over the carrier frequency.
    """
    n_runs = max(_LEAST_RUNS, math.ceil(relative_bandwidth / _RUN_SHARE))
    return max(-(-n_bins // n_runs // STEP_BINS), 1) * STEP_BINS


_SAMPLES_PER_SIDE = 5  # grid positions at which the geometry is bounded
_DIRECTIONS = 33  # between which paths are compared
_MARGIN = 0.1  # of the directions of a grid, beyond them
_CLEAR = 0.9  # of the largest direction cosine on the plane
_DIRECTION_STEP = 1e-4  # of the direction cosine, for a derivative


@dataclasses.dataclass(frozen=True)
class BeamGeometry:
    """Polar coordinates around the middle of a sub-aperture, on the plane of a polar grid.

    Or of V sub-apertures at once, which all arrays then begin with.

    Attributes
    ----------
    polar : PolarGrid
        Whose plane, track direction and side they share.
    centre_m : (3,) float64
        Mean phase centre, metres.
    range_m : float
        Distance at which the paths of echoes are compared, metres: the harmonic mean of the
        extremes, from which their curvature differs least.
    direction : (float, float)
        Extremes of the direction cosine over the grid.
    """

    polar: PolarGrid
    centre_m: np.ndarray
    range_m: Any  # float, or (V,) float64, and so are the next two
    direction: tuple[Any, Any]

    @classmethod
    def of(cls, polar: PolarGrid, edges: np.ndarray, tx_m: np.ndarray, rx_m: np.ndarray
           ) -> BeamGeometry | None:
        """Coordinates for some echoes, see `around`."""
        return cls.around(polar, edges, 0.5 * (tx_m + rx_m).sum(axis=0) / len(tx_m))

    @classmethod
    def around(cls, polar: PolarGrid, edges: np.ndarray, centre: np.ndarray
               ) -> BeamGeometry | None:
        """Coordinates around mean phase centres; None where the plane is too steep below one.

        `edges` are the grid's, from `grid_edges`.
        """
        offset = edges - centre[..., None, :]
        length = np.sqrt(np.einsum('...sk,...sk->...s', offset, offset))
        direction = offset[..., :2] @ np.array(polar.track) / length
        low, high = direction.min(axis=-1), direction.max(axis=-1)
        range_m = 2 / (1 / length.min(axis=-1) + 1 / length.max(axis=-1))
        height = (centre[..., 2] - polar.z_m) / range_m
        steepest = np.maximum(np.abs(low), np.abs(high)) + _MARGIN * (high - low)
        steep = (steepest ** 2 + height ** 2 >= 0.98).any()
        return None if steep else cls(polar, centre, range_m, (low, high))

    @property
    def height_m(self) -> Any:
        """Height of the middle above the plane, metres."""
        return self.centre_m[..., 2] - self.polar.z_m

    @property
    def known(self) -> tuple[Any, Any]:
        """Extremes of the directions in which the plane lies well within sight."""
        (low, high), height = self.direction, self.height_m / self.range_m
        margin, clear = _MARGIN * (high - low), _CLEAR * np.sqrt(1 - height ** 2)
        return np.minimum(low - margin, -clear), np.maximum(high + margin, clear)

    def beam_path(self, tx_m: np.ndarray, rx_m: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """`extra_path`, continued straight beyond the known directions, where it ends.

        `direction` ascends.
        """
        low, high = (end[..., None] for end in self.known)
        if (low <= direction[..., :1]).all() and (direction[..., -1:] <= high).all():
            return self.extra_path(tx_m, rx_m, direction)
        before, after = (self.slope(tx_m, rx_m, end) for end in (low, high))
        return (self.extra_path(tx_m, rx_m, np.clip(direction, low, high))
                + before * np.minimum(direction - low, 0.0)[..., None]
                + after * np.maximum(direction - high, 0.0)[..., None])

    def extra_path(self, tx_m: np.ndarray, rx_m: np.ndarray, direction: ArrayLike) -> np.ndarray:
        """(S, R) by how much half paths are longer than the distance from the centre, metres.

        With w the offset of a phase centre from the middle and p that of the point in a
        direction, ``|p - w| - |p| = (|w|^2 - 2 w p) / (|p - w| + |p|)``, which cancels nothing.
        """
        return self._expansion(tx_m, rx_m, direction, 0)[0]

    def slope(self, tx_m: np.ndarray, rx_m: np.ndarray, direction: ArrayLike) -> np.ndarray:
        """(S, R) derivative of `extra_path` by direction, metres."""
        before, after = (self.extra_path(tx_m, rx_m, np.add(direction, step))
                         for step in (-_DIRECTION_STEP, _DIRECTION_STEP))
        return (after - before) / (2 * _DIRECTION_STEP)

    def expansion(self, tx_m: np.ndarray, rx_m: np.ndarray, direction: ArrayLike
                  ) -> list[np.ndarray]:
        """(S, R) `extra_path`, its first and its second derivative by direction, metres.

        In directions in which the plane lies within sight.
        """
        return self._expansion(tx_m, rx_m, direction, 2)

    def _expansion(self, tx_m: np.ndarray, rx_m: np.ndarray, direction: ArrayLike, order: int
                   ) -> list[np.ndarray]:
        """(S, R) `extra_path` and its first derivatives by direction."""
        height, range_m = (np.asarray(v)[..., None] for v in (self.height_m, self.range_m))
        along = range_m * np.asarray(direction, np.float64)
        across = np.sqrt(np.maximum(range_m ** 2 - along ** 2 - height ** 2, 0.0))
        # beyond the plane's horizon points lie further away than they are taken to
        beyond = along ** 2 + across ** 2 + height ** 2 - range_m ** 2
        both = tx_m if tx_m is rx_m else np.concatenate([tx_m, rx_m], axis=-2)
        offset = both - self.centre_m[..., None, :]
        square = np.einsum('...rk,...rk->...r', offset, offset) + 2 * height * offset[..., 2]
        to_track, beside = ((offset[..., :2] @ np.array(axis))[..., None, :]
                            for axis in (self.polar.track, self.polar.across))
        longer = (square[..., None, :] + beyond[..., None]
                  - 2 * (along[..., None] * to_track + across[..., None] * beside))
        far = range_m[..., None]
        distance = np.sqrt(far ** 2 + longer)
        found = [longer / (distance + far)]
        if order:  # of the square of the distance; within sight nothing is beyond
            turned = -range_m * along / across
            bent = -(range_m ** 2 + turned ** 2) / across
            found.append(-(far * to_track + turned[..., None] * beside) / distance)
            found.append((-bent[..., None] * beside - found[1] ** 2) / distance)
        n = tx_m.shape[-2]
        return found if both is tx_m else [0.5 * (v[..., :n] + v[..., n:]) for v in found]

    def uneven(self, tx_m: np.ndarray, rx_m: np.ndarray) -> float:
        """`unevenness` of echoes."""
        return unevenness(self.slope(tx_m, rx_m, self.direction))

    def spread(self, tx_m: np.ndarray, rx_m: np.ndarray, beyond: float = 0.0) -> float:
        """Largest derivative of `beam_path` by direction up to so far beyond the grid, metres."""
        low, high = self.direction
        directions = np.linspace(low - beyond, high + beyond, _DIRECTIONS, axis=-1)
        growth = np.diff(self.beam_path(tx_m, rx_m, directions), axis=-2)
        return float((np.abs(growth).max(axis=(-2, -1))
                      / (directions[..., 1] - directions[..., 0])).max())


def unevenness(slope: np.ndarray) -> float:
    """By how much echoes on opposite sides fail to be opposite, rms, metres of slope.

    `slope` is (2, R), that of `extra_path` in the extreme directions; of (V, 2, R) the worst.
    """
    slope = np.sort(slope, axis=-1)
    worst = np.abs(slope + slope[..., ::-1]).max(axis=-2)
    return math.sqrt((worst ** 2).mean(axis=-1).max()) / 2


def grid_edges(polar: PolarGrid) -> np.ndarray:
    """(S, 3) float64 positions along the near and the far edge of a grid, metres."""
    return polar.at(*polar.sampled(2, _SAMPLES_PER_SIDE))


CELL_TAPS = 8  # neighbours along range
_OVERSAMPLING = (1.16, 1.2, 1.24, 1.28, 1.34, 1.4, 1.5, 1.6, 1.8, 2.0,  # of beams
                 2.4, 2.8, 3.2, 4.0)
_MOST_DEAPODISED = 2.0  # beyond, interpolation takes little from any frequency
_LEAST_OVERSAMPLING = 1.1  # of cells: the interpolation could do with no less
_GROUPS = (18, 16, 14, 12, 10, 8, 6, 4, 2, 1)  # beams whose phases grow alike from bin to bin
_SEGMENTS = (128, 64, 32, 16)
_ECHOES = 17  # at which paths are compared
BEYOND = 1  # beams beyond those that interpolation needs, for rounding
OUTSIDE = BEAM_TAPS // 2 - 1 + BEYOND  # beams before the first direction of the grid
_SPREAD_STEP = 1.02  # factors between one spread that is planned for and the next
SLACK = 1.1  # sub-apertures that were not looked at may be as much worse
# Of all that a bend may leave: 1.3 times a lower bound is left at least (measured)
_BEND_SHARE = 0.65
_ROUNDED = 1 + 1e-9  # what rounding may add to a lower bound
_LEAST_UNEVEN = 1e-4  # wavelengths, which matters to no image
_ARITHMETIC_DB = -80.0  # float32 phasors that turn from bin to bin (measured)


@dataclasses.dataclass(frozen=True)
class BeamSampling:
    """Sampling of a sub-aperture's beams.

    Attributes
    ----------
    spread_m : float
        Largest derivative, by direction, of what an echo's path is longer than the reference's.
    spacing : float
        Spacing of the beams, in direction cosine.
    group : int
        Most beams whose phases are taken to grow alike over a vector of bins.
    uneven_m : float
        By how much echoes on opposite sides of the centre may fail to be opposite, rms, for them
        to share phasors; 0 where none do.
    segment : int
        Pixels that share one expansion of the geometry.
    between : BeamGain
        Interpolator between beams, and by what echoes are multiplied for it.
    along : Interpolator
        Along range.
    predicted_error_db : float
        Predicted error of the sub-aperture images against time-domain correlation, dB.
    n_weighed : int
        Images that make one of a sub-aperture, each weighed by parabolas of its own: one of each
        channel, or one of all. 0 where all pixels are lit alike.
    """

    spread_m: float
    spacing: float
    group: int
    uneven_m: float
    segment: int
    between: BeamGain
    along: Interpolator
    predicted_error_db: float
    n_weighed: int = 0

    @property
    def paired(self) -> bool:
        """Whether echoes on opposite sides share phasors: they do if nearly symmetric."""
        return self.uneven_m > 0

    def n_beams(self, span: float) -> int:
        """Beams over some extent in direction cosine, with those that interpolation needs."""
        return int(_n_beams(span, self.spacing))

    def directions(self, beams: BeamGeometry, tx_m: np.ndarray, rx_m: np.ndarray
                   ) -> tuple[float, float, int]:
        """First direction cosine, spacing and number of the beams of a sub-aperture.

        They lie closer where its echoes spread further than those that were planned for.
        """
        spacing, (low, high) = self.spacing, beams.direction
        spread = beams.spread(tx_m, rx_m, OUTSIDE * spacing)
        if spread > self.spread_m:
            spacing *= self.spread_m / spread
        return low - OUTSIDE * spacing, spacing, int(_n_beams(high - low, spacing))

    def range_gain(self, gain: np.ndarray, number: np.ndarray, n_cells: int) -> np.ndarray:
        """(N,) float64 by what bins of a profile's spectrum are multiplied on the way to cells.

        What interpolation along range takes from each frequency is made good. Where the `n_cells`
        of a period do not hold all bins, a taper follows: beyond the band lies what the cut ends
        of profiles leave, which would ring far inside if it ended at once. `gain` is that of the
        profiles, (N,) float32, `number`, (N,) int64, that of each bin from the carrier's on.
        """
        magnitudes = np.arange(np.abs(number).max() + 1)  # gains are the same on both sides
        gain = gain * self.along.gain(magnitudes / n_cells)[np.abs(number)]
        if n_cells < len(gain):
            edge = 0.5 / self.along.oversampling
            gain *= cosine_fall((np.abs(number) / n_cells - edge) / (0.5 - edge))
        return gain

    def group_of(self, n_beams: int) -> int:
        """Beams of each group, in no more groups than needed: even, or one."""
        return int(_groups(n_beams, self.group)[1])

    def operations(self, n_echoes: int, resampling: RangeResampling, n_pixels: int, span: float,
                   n_images: int = 1) -> dict[str, float]:
        """How often images do the operations of `CostModel` with beams.

        The echoes are those of all images together, pixels and `span`, in direction cosine, those
        of each; the range grid is that of the profiles.
        """
        n_images *= max(1, self.n_weighed)
        counts = _operations(self.n_beams(span), self.group, self.paired, self.segment, n_echoes,
                             resampling, n_pixels, n_images)
        return counts | {'weighed_image': n_images} if self.n_weighed else counts


def least_operations(n_echoes: float | np.ndarray, resampling: RangeResampling,
                     n_pixels: float | np.ndarray, n_needed: float | np.ndarray) -> dict[str, Any]:
    """What `BeamSampling.operations` is not below, whatever the sampling.

    `n_needed` is the number of beams that lie as far apart as the band of the echoes lets them.
    """
    n_beams = _n_beams(n_needed, 1 / _OVERSAMPLING[0])
    counts = _operations(n_beams, max(_GROUPS), True, max(_SEGMENTS), n_echoes, resampling,
                         n_pixels)
    return counts | {'beam_bin': 0.5 * n_beams * n_echoes * resampling.n_padded}  # of any groups


def least_bending_slope(polar: PolarGrid, radar: RadarParameters, target_db: float) -> float:
    """Derivative of paths by direction, metres, from which on they bend too much for beams.

    By a lower bound of the phase that is left of a bend, see `_seen_from_middles`, for echoes
    that lie evenly.
    """
    alpha = max(abs(polar.alpha_start), abs(polar.alpha[-1]))
    nearer = 1 / polar.range_start_m - 1 / polar.range_m[-1]
    # rms phases that are left of a bend of b rad at the ends: b^2 / 6, and this share of b
    by_band = radar.bandwidth_hz / radar.carrier_hz / math.sqrt(12) / 3
    left = _BEND_SHARE * math.sqrt(max(10 ** (target_db / 10) - 10 ** (_ARITHMETIC_DB / 10), 0.0))
    most = 3 * (math.sqrt(by_band ** 2 + left / 1.5) - by_band)
    curved = radar.wavenumber_rad_per_m * (1 - alpha ** 2) * nearer / 4
    return math.sqrt(most / curved) if curved > 0 else math.inf


# The next three take numbers, or arrays that are broadcast together.

def _n_beams(span: float | np.ndarray, spacing: float | np.ndarray) -> Any:
    return np.ceil(span / spacing) + BEAM_TAPS + 2 * BEYOND


def _groups(n_beams: float | np.ndarray, most: int | np.ndarray) -> tuple[Any, Any]:
    """Number and size of the groups of beams."""
    size = np.ceil(n_beams / np.ceil(n_beams / most))
    size = np.where(np.greater(most, 1), size + size % 2, 1)
    return np.ceil(n_beams / size), size


def _operations(n_beams: float | np.ndarray, most: int | np.ndarray, paired: bool | np.ndarray,
                segment: int | np.ndarray, n_echoes: float | np.ndarray,
                resampling: RangeResampling, n_pixels: float | np.ndarray, n_images: int = 1
                ) -> dict[str, Any]:
    (n_groups, size), n = _groups(n_beams, most), n_echoes * resampling.n_padded
    return {'beam_bin': n_groups * size * np.where(paired, 0.5, 1.0) * n,
            'beam_group': n_groups * n,
            'beam_cell': n_images * n_beams * resampling.n_cells,
            'beam_pixel': n_images * n_pixels,
            'beam_segment': n_images * n_pixels / segment}


def plan_beams(polar: PolarGrid, radar: RadarParameters, resampling: RangeResampling,
               subapertures: Sequence[tuple[np.ndarray, np.ndarray]], target_db: float,
               reach_m: float, padding_m: float = math.inf) -> BeamSampling | None:
    """Quickest sampling of beams that meets a target.

    An echo whose path grows by ``dL/ds`` with direction cosine s has ``k dL/ds`` radians per unit
    of s. Beams ``pi / (k_max max|dL/ds| oversampling)`` apart hold all echoes; the more they are
    oversampled, the less their interpolation errs (gridding: O'Sullivan 1985, Jackson et al.
    1991). For each oversampling, group of beams that share phases, and segment of pixels that
    share an expansion, the errors are those of

    - the geometry: paths by direction alone, less the bend that is made good to first order;
    - interpolation between beams and along range, and float32 phasors;
    - what beams, bins and echoes share (`shared_errors`);
    - the expansion of places and phases along a segment.

    They add as powers. Of the samplings whose error is small enough, the quickest is taken.

    None where no sampling meets the target.

    Parameters
    ----------
    polar, target_db :
        Of the sub-aperture images.
    radar, resampling :
        Of the profiles; cells of the range grid are those of the beams.
    subapertures : sequence of ((R, 3), (R, 3)) float64
        Phase centres of some sub-apertures of the length that is looked at, metres.
    reach_m : float
        Difference of the largest and the smallest half path, metres.
    padding_m : float
        Zeros between the ends of a padded profile, metres of half path: what the echoes' delays
        move beyond one end must not come in at the other. Periodic profiles have no ends.
    """
    over_range = radar.range_resolution_m / resampling.cell_m
    if over_range < _LEAST_OVERSAMPLING:
        return None
    along = design_interpolator(over_range, taps=CELL_TAPS, degree=DEGREE, deapodised=True)
    k, wavelength_m = radar.wavenumber_rad_per_m, radar.wavelength_m
    seen = _seen_from_middles(polar, subapertures, radar)
    if seen is None or seen.phase_error ** 2 > 10 ** (target_db / 10):
        return None
    # Beams beside the grid count, too; there are fewer the wider the spread.
    finest = math.pi / (radar.wavenumbers_rad_per_m[1] * _OVERSAMPLING[0])
    beyond = OUTSIDE * finest / max(float(np.abs(seen.slope).max()), 1e-3 * wavelength_m)
    spread = seen.beams.spread(*seen.centres, beyond)
    # The last segment reaches beyond the image.
    spare = resampling.n_cells - reach_m / resampling.cell_m - 2 * CELL_TAPS
    segments = np.array([segment for segment in _SEGMENTS if segment <= spare])
    if 2 * spread > padding_m or not len(segments):
        return None
    # In steps: plans for nearly the same sub-apertures give the same images to the last bit.
    steps = math.log(max(spread, 1e-3 * wavelength_m), _SPREAD_STEP)
    widest = _SPREAD_STEP ** math.ceil(steps)
    spacings = finest / widest * (_OVERSAMPLING[0] / np.array(_OVERSAMPLING))
    # The image has about as many lines as beams that lie as far apart as they may.
    span = polar.n_alpha * polar.alpha_spacing
    cost = costs().nanoseconds(_operations(
        _n_beams(span, spacings)[:, None, None, None], np.array(_GROUPS)[:, None, None],
        np.array([[True], [False]]), segments, len(subapertures[0][0]), resampling,
        polar.n_range * span / spacings[0]))
    slope, curvature = k * seen.slope, k * seen.curvature
    uneven = max(_LEAST_UNEVEN * wavelength_m, seen.uneven_m)
    n_bins, cell_m = resampling.n_padded, resampling.cell_m
    bin_rad_per_m = 2 * math.pi / (resampling.n_cells * cell_m)
    relative = [n * bin_rad_per_m / k
                for n in (bins_per_run(n_bins, n_bins * bin_rad_per_m / k), STEP_BINS)]
    half_m = segments * polar.range_spacing_m / 2
    drifts, bend = seen.drifts(half_m, cell_m / polar.range_spacing_m), seen.by_range[2]
    fixed = (_read_straight(drifts[0] / cell_m, over_range) ** 2
             + (k * bend * half_m ** 4 / 24 / 3) ** 2
             + seen.phase_error ** 2
             + 10 ** (total_db(along.error_db, _ARITHMETIC_DB) / 10))

    def errors(some: Sequence[int] | np.ndarray, views: slice = slice(None),
               groups: Sequence[int] = _GROUPS) -> np.ndarray:
        """Of some oversamplings and groups, arranged as the costs are; of some views a bound."""
        between, spacing = [_between(i) for i in some], spacings[some][:, None, None, None]
        always, grouped, shared = shared_errors(
            between, spacing * slope[:, views], spacing * (spacing * curvature[:, views]),
            spacings[some] * (k * uneven), relative, groups)
        read = _read_straight(drifts[1] / spacing[..., 0],
                              np.array(_OVERSAMPLING)[some, None, None])
        return (np.array([10 ** (one.interpolator.error_db / 10) + rms @ rms
                          for one, rms in zip(between, always, strict=True)])[:, None, None, None]
                + (grouped ** 2).sum(axis=2)[..., None, None]
                + np.array([[1.0], [0.0]]) * shared[..., None, None] ** 2
                + fixed + read[:, None] ** 2)

    @functools.cache
    def errors_db(i: int, group: int) -> np.ndarray:
        return 10 * np.log10(errors([i], groups=[_GROUPS[group]])[0, 0])

    # What misses at best is not oversampled enough; interpolation alone tells most of that, and
    # the view that reaches furthest most of the rest.
    useful = np.array([i for i in range(len(_OVERSAMPLING))
                       if _between(i).interpolator.error_db <= target_db])
    if not len(useful):
        return None
    furthest = int(np.abs(slope).max(axis=(0, 2)).argmax())
    hopeful = errors(useful, slice(furthest, furthest + 1)) <= _ROUNDED * 10 ** (target_db / 10)
    least = bisect.bisect_left(range(len(useful)), True, key=lambda n: any(
        errors_db(int(useful[n]), group).min() <= target_db
        for group in reversed(range(len(_GROUPS))) if hopeful[n, group].any()))
    hopeful[:least] = False
    places = np.flatnonzero(hopeful)
    for place in places[np.argsort(cost[useful].ravel()[places], kind='stable')]:
        n, group, alone, segment = np.unravel_index(place, hopeful.shape)
        i = int(useful[n])
        error_db = float(errors_db(i, group)[alone, segment])
        if error_db <= target_db:
            return BeamSampling(widest, float(spacings[i]), _GROUPS[group],
                                0.0 if alone else SLACK * uneven, int(segments[segment]),
                                _between(i), along, error_db)
    return None


def _read_straight(drift: np.ndarray, oversampling: float | np.ndarray) -> np.ndarray:
    """Rms error of reading at places that drift by so many samples, as if evenly."""
    return drift ** 3 / 6 * (math.pi / oversampling) ** 3 / 7


def _between(i: int) -> BeamGain:
    return beam_gain(_OVERSAMPLING[i], _OVERSAMPLING[i] <= _MOST_DEAPODISED)


@dataclasses.dataclass(frozen=True)
class _Views:
    """Geometry of V sub-apertures, each seen from its middle; of what is one number the worst."""

    beams: BeamGeometry
    centres: tuple[np.ndarray, np.ndarray]  # (V, R, 3) phase centres of some echoes, metres
    phase_error: float  # rms over the echoes of the largest one anywhere, rad
    uneven_m: float  # by which echoes on opposite sides of the centre are not opposite, rms
    slope: np.ndarray  # (D, V, R) first derivative of the echoes' paths by direction, metres
    curvature: np.ndarray  # (D, V, R) second derivative
    # along lines: extremes of the distance's first derivative, magnitudes of its second and fourth
    # and of the direction cosine's first and second
    by_range: tuple[tuple[float, float], float, float, float, float]

    def drifts(self, half_m: np.ndarray, cell: float) -> tuple[np.ndarray, np.ndarray]:
        """Errors of straight lines for distance, metres, and direction over S half segments.

        `half_m` are the halves, (S,) metres, `cell` the slope of the distance along ranges.
        """
        slope, d2, _, s1, s2 = self.by_range
        d1 = max(abs(d - cell) for d in slope)
        return d1 * half_m + d2 * half_m ** 2 / 2, s1 * half_m + s2 * half_m ** 2 / 2


def _seen_from_middles(polar: PolarGrid, subapertures: Sequence[tuple[np.ndarray, np.ndarray]],
                       radar: RadarParameters) -> _Views | None:
    """None where the plane is too steep below one of the sub-apertures."""
    centre = np.stack([0.5 * (tx + rx).mean(axis=0) for tx, rx in subapertures])
    beams = BeamGeometry.around(polar, grid_edges(polar), centre)
    if beams is None:
        return None
    some = [np.linspace(0, len(tx) - 1, _ECHOES).round().astype(int) for tx, _ in subapertures]
    tx, rx = (np.stack([one[end][np.concatenate([i, len(one[end]) - 1 - i])]  # opposite ones, too
                        for i, one in zip(some, subapertures, strict=True)]) for end in (0, 1))
    if np.array_equal(tx, rx):
        rx = tx
    lines = polar.lines(*polar.sampled(*2 * (_SAMPLES_PER_SIDE,)))
    middle, along = sample_paths(centre, centre, lines), np.array([*polar.track, 0.0])
    length, by_range = middle.length, middle.derivatives
    direction = (lines[0] - centre[:, None]) @ along / length
    first = (lines[1] @ along - direction * by_range[0]) / length
    second = (lines[2] @ along - 2 * first * by_range[0] - direction * by_range[1]) / length
    n = direction.shape[-1]
    path, slope, curvature = beams.expansion(tx, rx, np.concatenate(
        [direction, np.linspace(*beams.direction, 3, axis=-1)], axis=-1))
    path, slope, at_places = path[:, :n], slope[:, n:], slope[:, :n]
    # What paths by direction alone miss; interpolation between beams makes good, to first order,
    # that they bend.
    k = radar.wavenumber_rad_per_m
    nearer = (1 - direction ** 2) * (1 / length - 1 / beams.range_m[:, None]) / 2
    bend = at_places ** 2 * nearer[..., None]
    whole = pair_lengths(tx.reshape(-1, 3), rx.reshape(-1, 3), lines[0][None])
    missed = (whole.reshape(*tx.shape[:2], -1).swapaxes(1, 2) - length[..., None] - path - bend)
    error = (k * np.abs(missed) + (k * bend) ** 2 / 2
             + k * np.abs(bend) * (radar.bandwidth_hz / radar.carrier_hz / math.sqrt(12)))
    d2, d4, s1, s2 = (float(np.abs(d).max()) for d in (by_range[1], by_range[3], first, second))
    return _Views(beams, (tx, rx), float(rms_of_echoes(error.swapaxes(0, 1))),
                  unevenness(slope[:, [0, -1]]), slope.swapaxes(0, 1),
                  curvature[:, n:].swapaxes(0, 1),
                  ((float(by_range[0].min()), float(by_range[0].max())), d2, d4, s1, s2))
