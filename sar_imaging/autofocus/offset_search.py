"""Search for the offset of two clocks over seconds, by the contrast of many quick images.

An offset of a clock is one number, so every value that matters can be tried. How fine the trials
must be follows from the geometry: from one to the next the phases of the scene change by about a
radian, apart from what only displaces the image. A trial is an image of few pixels, exact enough
to tell focus. At the right offset alone all parts of the scene become sharp together.
"""

from __future__ import annotations

import dataclasses
import logging
import math
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from ..backends import AUTO, optional_entry
from ..geometry.grids import MapGrid
from ..geometry.track_frame import mean_centres
from ..quality.measures import contrast
from ..signal.pulses import PulseBlock
from .models import Geometry

if TYPE_CHECKING:
    from ..backends.protocol import Backend

_logger = logging.getLogger(__name__)
STEP_RAD = 1.2  # rms change of the visible phases from trial to trial
_SAMPLES = 121  # of the range of offsets, at which the step is determined
_DIFFERENCE_S = 1e-3
_POINTS = 3  # of the scene along each axis, for the visible phases
_PIXEL = 0.7  # pixels of a trial, in resolutions
_MOST_PIECES = 1200  # of lines; larger scenes are tried where the first image is brightest
_MOST_PULSES = 768  # with more, every second, third ... pulse is taken
_FEWEST_TRIALS, _MOST_TRIALS = 16, 1500
_BLOCKS = 6  # of the scene along each axis, dealt out to its two halves
_REFINED, _FINER = 6, 6  # maxima around which so many more trials are made on each side
# Of a maximum to use and to claim; see OffsetCurve. On 32 flights they were set by, prominence was
# 1.7 to 6.5 at the true offset, in the worse half of the scene 1.5 to 5.3; where the true offset
# lay outside of the trials it was 1.06 to 1.46 and 0.8 to 1.22.
LEAST_PROMINENCE = 1.55
_PROMINENCE_TO_CLAIM, _HALVES_TO_CLAIM, _PROMINENCE_ALONE = 1.6, 1.3, 1.8
_NEARBY_RAD = 3.0, 15.0
_FEWEST_NEARBY = 4
_LARGEST_RIVAL = 0.7
_SEPARATE = 0.1  # depth of the valley before a separate maximum, over the height of the highest


@dataclasses.dataclass(frozen=True)
class OffsetCurve:
    """Contrast against the offset of the clocks.

    Attributes
    ----------
    offset_s : (N,) float64
        Offsets tried, ascending, seconds.
    contrast : (N,) float64
        Of the trial images.
    halves : (N, 2) float64
        Contrast of two halves of the scene, dealt out by place.
    visible_rad : (N,) float64
        Sum of the changes of the visible phases from the first offset on.
    best_s : float
        Where contrast is highest, seconds.
    step_s : float
        Offset that changes the phases by `STEP_RAD` there, seconds.
    visible_range_rad : float
        Sum of the changes over all offsets; where it is small, an offset only displaces the image.
    rival : float
        Height of the next separate maximum over the median of the curve, relative to that of the
        highest: 0 without any, 1 where both are alike.
    prominence : float
        Contrast at the maximum over the median of what is 3 to 15 rad of visible phase away; NaN
        where so little was tried that there is nothing to compare with.
    prominence_of_halves : float
        The same of the half of the scene where it is less.
    at_edge : bool
        Whether the highest value is at an end of the offsets tried.
    """

    offset_s: np.ndarray
    contrast: np.ndarray
    halves: np.ndarray
    visible_rad: np.ndarray
    best_s: float
    step_s: float
    visible_range_rad: float
    rival: float
    prominence: float
    prominence_of_halves: float
    at_edge: bool

    def doubts(self) -> list[str]:
        """Reasons not to use the best offset, in words."""
        out = []
        if self.at_edge:
            out.append('contrast is highest at the end of the offsets that could be tried, '
                       f'{self.offset_s[0]:+.3g} to {self.offset_s[-1]:+.3g} s: the true one may '
                       'lie beyond')
        if not self.prominence >= LEAST_PROMINENCE:
            out.append(f'it hardly stands out from offsets nearby ({self.prominence:.2f} times '
                       f'their contrast, {LEAST_PROMINENCE:g} is asked for)')
        return out

    def open_points(self) -> list[str]:
        """Reasons not to claim that the best offset is the true one, in words."""
        out = []
        if self.rival > _LARGEST_RIVAL:
            out.append(f'another offset is nearly as sharp ({100 * self.rival:.0f} % of its '
                       'height)')
        if not (self.prominence >= _PROMINENCE_ALONE or self.prominence >= _PROMINENCE_TO_CLAIM
                and self.prominence_of_halves >= _HALVES_TO_CLAIM):
            out.append(f'it stands out from offsets nearby by {self.prominence:.2f} times their '
                       f'contrast, in one half of the scene by {self.prominence_of_halves:.2f}; '
                       f'{_PROMINENCE_TO_CLAIM:g} and {_HALVES_TO_CLAIM:g} are asked for, or '
                       f'{_PROMINENCE_ALONE:g} in all')
        return out


class OffsetSearch:
    """Trial images of one aperture for offsets of the clocks.

    Parameters
    ----------
    block : PulseBlock
        Range profiles.
    geometry : callable
        From an offset in seconds to the `Geometry` of the block; ValueError where it is not known.
    grid : MapGrid
        Of the image.
    reach_s : float
        Largest offset to try to both sides, seconds.
    backend : str or Backend
        What computes the trial images, as for `plan_image`.

    Raises
    ------
    ValueError
        The geometry is not known without an offset.
    """

    def __init__(self, block: PulseBlock, geometry: Callable[[float], Geometry], grid: MapGrid,
                 reach_s: float, backend: str | Backend = AUTO):
        self._geometry, self._reach_s = geometry, reach_s
        every = -(-block.n_pulses // _MOST_PULSES)
        self._pulses = slice(None, None, every)
        self._radar = block.radar
        self._trials = optional_entry(backend, 'TrialImages')(
            block.radar, block.samples[self._pulses])
        self._known = self._sample(np.linspace(-reach_s, reach_s, _SAMPLES))
        if not self._known:
            raise ValueError('no position is known for these pulses')
        x, y = (c + 0.35 * np.linspace(-1, 1, _POINTS) * n * grid.spacing_m for c, n in zip(
            grid.centre_m, (grid.n_x, grid.n_y), strict=False))
        self._points = np.stack(np.broadcast_arrays(x[:, None], y, grid.centre_m[2]),
                                axis=-1).reshape(-1, 3)
        self._plan_pixels(grid)

    def _sample(self, offsets) -> dict[float, Geometry]:
        known = {}
        for offset in offsets.tolist():
            try:
                known[offset] = self._geometry(offset)
            except ValueError:
                continue
        return known

    def _plan_pixels(self, grid: MapGrid) -> None:
        """Pieces of lines along range, and the half of the scene that each belongs to."""
        centre = np.array(grid.centre_m)
        looks = [centre - mean_centres(g.tx_m, g.rx_m) for g in self._known.values()]
        nominal = looks[int(np.argmin(np.abs(list(self._known))))].mean(axis=0)
        ground = np.hypot(*nominal[:2])
        along = np.array([*nominal[:2], 0.0]) / max(ground, 1e-9)
        across = np.array([-along[1], along[0], 0.0])
        spread = max(np.ptp(np.arctan2(look @ across, look @ along)) for look in looks)
        length = self._trials.length
        u_step = _PIXEL * self._radar.range_resolution_m * np.linalg.norm(nominal) / ground
        v_step = _PIXEL * self._radar.wavelength_m / 2 / max(spread, 1e-3)
        half = 0.5 * grid.spacing_m * np.array([grid.n_x, grid.n_y])
        u_half, v_half = (np.abs(axis[:2]) @ half for axis in (along, across))
        n_u, n_v = max(1, round(2 * u_half / u_step / length)), max(1, round(2 * v_half / v_step))
        u = (np.arange(n_u) - (n_u - 1) / 2) * length * u_step
        v = (np.arange(n_v) - (n_v - 1) / 2) * v_step
        middle = (u[:, None, None] * along + v[:, None] * across).reshape(-1, 3)
        inside = (np.abs(middle[:, :2]) <= half + 0.5 * length * u_step * np.abs(along[:2])
                  ).all(axis=1)
        part = (np.arange(n_u)[:, None] * _BLOCKS // n_u + np.arange(n_v) * _BLOCKS // n_v) % 2
        if n_u < _BLOCKS:
            part = (np.arange(n_u)[:, None] + np.arange(n_v) * _BLOCKS // n_v) % 2
        self._direction = u_step * along
        self._starts = centre + middle[inside] - 0.5 * length * self._direction
        self._part = part.ravel()[inside]
        if len(self._starts) > _MOST_PIECES:
            power = self._image(self._nearest()).sum(axis=1)
            bright = np.sort(np.argsort(-power)[:_MOST_PIECES])
            self._starts, self._part = self._starts[bright], self._part[bright]

    def _nearest(self) -> Geometry:
        return self._known[min(self._known, key=abs)]

    def _image(self, geometry: Geometry) -> np.ndarray:
        """(K, L) intensity of the pieces."""
        image = self._trials.image(geometry.tx_m[self._pulses], geometry.rx_m[self._pulses],
                                   self._starts, self._direction, geometry.range_bias_m)
        return np.square(image[0]) + np.square(image[1])

    def _measure(self, offset: float) -> tuple[float, float, float]:
        """Contrast of the trial at an offset, and of the two halves of the scene."""
        amplitude = np.sqrt(self._image(self._geometry(offset)))
        if not amplitude.any():
            return 0.0, 0.0, 0.0
        parts = [amplitude[self._part == k] for k in (0, 1)]
        return contrast(amplitude), *(contrast(a) if a.any() else 0.0 for a in parts)

    def _rates(self) -> tuple[np.ndarray, np.ndarray]:
        """Offsets whose geometry is known, and rms change of the visible phases, rad/s."""
        offsets, rates = [], []
        for offset, geometry in self._known.items():
            nearby = self._sample(np.array([offset + _DIFFERENCE_S, offset - _DIFFERENCE_S]))
            if nearby:
                [other, *_] = nearby
                offsets.append(offset)
                rates.append(visible_phase(geometry, nearby[other], self._points,
                                           self._radar.wavenumber_rad_per_m)
                             / abs(other - offset))
        return np.array(offsets), np.array(rates)

    def run(self) -> OffsetCurve:
        """Try all offsets, then those around the highest maxima more finely."""
        offsets, rates = self._rates()
        path = np.concatenate([[0.0], np.cumsum(0.5 * (rates[1:] + rates[:-1])
                                                * np.diff(offsets))])
        seen = float(path[-1])
        n = int(np.clip(math.ceil(seen / STEP_RAD), _FEWEST_TRIALS, _MOST_TRIALS))
        # where nothing is seen, too, so that the sum ascends
        path += np.linspace(0.0, 1e-3 + 0.02 * seen, len(path))
        trials = np.interp(np.linspace(0.0, path[-1], n + 1), path, offsets)
        found = np.array([self._measure(t) for t in trials])
        finer = np.unique(np.concatenate([np.interp(
            k + np.linspace(-1.0, 1.0, 2 * _FINER + 1), np.arange(n + 1), trials)
            for k in _maxima(found[:, 0])[:_REFINED]]))
        finer = np.setdiff1d(finer, trials)
        found = np.concatenate([found, [self._measure(t) for t in finer]])
        order = np.argsort(np.concatenate([trials, finer]))
        trials, found = np.concatenate([trials, finer])[order], found[order]
        best, visible = int(found[:, 0].argmax()), np.interp(trials, offsets, path)
        return OffsetCurve(
            trials, found[:, 0], found[:, 1:], visible, float(trials[best]),
            step_s=STEP_RAD / max(float(np.interp(trials[best], offsets, rates)), 1e-9),
            visible_range_rad=seen, rival=_rival(found[:, 0], best),
            prominence=_prominence(found[:, 0], visible, best),
            prominence_of_halves=min(_prominence(c, visible, best) for c in found[:, 1:].T),
            at_edge=bool(min(visible[best] - visible[0], visible[-1] - visible[best])
                         < STEP_RAD))


def _maxima(values: np.ndarray) -> np.ndarray:
    """Numbers of the local maxima, the highest first."""
    padded = np.concatenate([[-np.inf], values, [-np.inf]])
    peaks = np.flatnonzero((values >= padded[:-2]) & (values > padded[2:]))
    return peaks[np.argsort(-values[peaks])]


def _rival(values: np.ndarray, best: int) -> float:
    """Height of the next separate maximum over the median, relative to the highest one's."""
    floor = float(np.median(values))
    height = values[best] - floor
    for k in _maxima(values):
        low, high = sorted((k, best))
        deep = values[k] - values[low:high + 1].min()
        if k != best and deep > _SEPARATE * (values[best] - floor):
            return float((values[k] - floor) / height)
    return 0.0


def _prominence(values: np.ndarray, visible_rad: np.ndarray, best: int) -> float:
    away = np.abs(visible_rad - visible_rad[best])
    nearby = values[(away > _NEARBY_RAD[0]) & (away < _NEARBY_RAD[1])]
    if len(nearby) < _FEWEST_NEARBY:
        return math.nan
    return float(values[best] / max(np.median(nearby), 1e-30))


def visible_phase(first: Geometry, second: Geometry, points, wavenumber: float) -> float:
    """Rms difference of the phases of two geometries that an image shows, radians.

    What a displacement of each point in the plane or a constant phase explains is left out.

    Parameters
    ----------
    first, second : Geometry
        Of the same pulses, nearly alike.
    points : (K, 3) array_like
        Of the scene, metres.
    wavenumber : float
        ``4 pi / lambda``, rad/m.
    """
    every = slice(None, None, max(1, len(first.tx_m) // 128))
    total = 0.0
    for point in np.asarray(points):
        paths, looks = [], 0.0
        for geometry in (first, second):
            away = [point - c[every].mean(axis=1) for c in geometry[:2]]
            length = [np.linalg.norm(a, axis=1) for a in away]
            paths.append(0.5 * sum(length))
            looks = looks + 0.5 * sum(a / d[:, None] for a, d in zip(away, length, strict=True))
        basis, _ = np.linalg.qr(np.column_stack([np.ones(len(looks)), looks[:, :2]]))
        change = wavenumber * (paths[1] - paths[0])
        total += np.mean(np.square(change - basis @ (basis.T @ change)))
    return math.sqrt(total / len(points))
