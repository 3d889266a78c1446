# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""What trials of clock offsets tell: where the scene is sharpest, and how sure that is.

A trial is judged against the offsets nearby, whose images differ in focus alone; the scatter of
all other trials says how much chance makes of it. Six halves of the data, each by itself, must be
sharpest at the same offset: two of the scene, and of the pulses the early and the late ones, and
even and odd sub-apertures. Chance, a moving object, or a wrong offset that happens to focus a part
of the aperture make one half sharp, not all. The halves are judged tile by tile, too, so that one
bright object is one voice of many.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np

HALVES = ('one half of the scene', 'the other half of the scene', 'the early pulses',
          'the late pulses', 'the even sub-apertures', 'the odd sub-apertures')
SURROUNDINGS_RAD = 15.0  # of visible phase, to compare an offset with
PEAK_RAD = 3.0  # half width of a maximum, of visible phase
_PEAK_OF_HALF_RAD = 7.0  # a part of the aperture changes its phases more slowly
_END_RAD = 5.0  # at least so much must have been tried beyond an offset to claim it
_FEWEST_NEARBY = 4
# Standard deviations by which the halves together must prefer an offset to claim it, where its
# bright points are hardly in phase; less, the nearer their coherence comes to one that tells by
# itself. Of 82 searches with all that is within 8 rad of the right offset left out, those whose
# best one was 15 rad from it or more had 17 at most, and with a coherence of 0.7 less than 1, but
# for one with 13 and 0.8; none had 0.9. Of 400 flights four were found wrong with 0.7 to 0.9; they
# had less than 6.
_TO_CLAIM = 20.0
_USABLE_COHERENCE, _CLEAR_COHERENCE = 0.8, 0.9
_PLAINLY = 2.0
_NORMAL = 1.4826  # standard deviation over median absolute deviation


def _sharpness(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """``log(<I^2> / <I>^2) / 2`` of the means of intensity and of its square; NaN of darkness.

    0 where all pixels are alike, 0.35 of speckle, whatever the brightness.
    """
    with np.errstate(divide='ignore', invalid='ignore'):
        return 0.5 * np.log(second / np.square(first))


@dataclasses.dataclass(frozen=True)
class OffsetCurve:
    """Sharpness against the offset of the clocks.

    Attributes
    ----------
    offset_s : (N,) float64
        Offsets tried, ascending, seconds.
    visible_rad : (N,) float64
        Sum of the changes of the visible phases from the first offset on.
    gain : (N,) float64
        Sharpness of all pixels over that of the offsets 3 to 15 rad away, in standard deviations
        of its scatter over all offsets.
    halves : (6, N) float64
        The same of each of `HALVES`, the mean of that of all its pixels and of its tiles.
    best_s : float
        Where the gain is highest, seconds.
    step_s : float
        Offset that changes the phases by `offset_search.STEP_RAD` there, seconds.
    visible_range_rad : float
        Sum of the changes over all offsets; where it is small, an offset only displaces the image.
    """

    offset_s: np.ndarray
    visible_rad: np.ndarray
    gain: np.ndarray
    halves: np.ndarray
    best_s: float
    step_s: float
    visible_range_rad: float

    def _away(self, offset_s: float) -> np.ndarray:
        """(N,) visible phase from an offset on, radians."""
        return np.abs(self.visible_rad - np.interp(offset_s, self.offset_s, self.visible_rad))

    def outweighs(self, offset_s: float) -> bool:
        """Whether an offset is less sharp than the best one, beyond what scatters."""
        at = np.interp([self.best_s, offset_s], self.offset_s, self.gain)
        return bool(at[0] - at[1] >= _PLAINLY)

    def margins(self) -> list[tuple[str, float, float]]:
        """What each half of the data tells.

        Returns
        -------
        list of (str, float, float)
            Its name; the other offset where it is sharpest, seconds; and by how much the best
            offset is sharper than that, in standard deviations: below 0 where it is not.
        """
        away, out = self._away(self.best_s), []
        there = away <= max(PEAK_RAD, away.min())
        for name, gain in zip(HALVES, self.halves, strict=True):
            elsewhere = np.where(away > _PEAK_OF_HALF_RAD, gain, -np.inf)
            k = int(elsewhere.argmax())
            if np.isfinite(elsewhere[k]):
                out.append((name, float(self.offset_s[k]),
                            float(gain[there].max() - elsewhere[k])))
        return out

    def doubts(self, coherence: float = 0.0) -> list[str]:
        """Reasons not to use the best offset, in words.

        Parameters
        ----------
        coherence : float
            Coherence of the bright points of its image, which those of a wrong offset seldom have.
        """
        out = []
        if self.best_s in self.offset_s[[0, -1]]:
            out.append('it is the last one of those that could be tried, '
                       f'{self.offset_s[0]:+.3g} to {self.offset_s[-1]:+.3g} s: the true one may '
                       'lie beyond')
        return out + self._too_little(0.0 if coherence < _USABLE_COHERENCE else -np.inf)

    def open_points(self, coherence: float = 0.0) -> list[str]:
        """Reasons not to claim that the best offset is the true one, as `doubts`."""
        lack = (_CLEAR_COHERENCE - coherence) / (_CLEAR_COHERENCE - _USABLE_COHERENCE)
        out = self._too_little(_TO_CLAIM * min(lack, 1.0))
        if self._away(self.best_s)[[0, -1]].min() < _END_RAD:
            out.append('positions are not known far enough beyond it to tell it from others, only '
                       f'for offsets of {self.offset_s[0]:+.3g} to {self.offset_s[-1]:+.3g} s')
        return out

    def _too_little(self, limit: float) -> list[str]:
        margins = self.margins()
        total = sum(margin for *_, margin in margins)
        if total >= limit:
            return []
        return [f'the halves of the data prefer it to all others by {total:.1f} standard '
                f'deviations together, less than {limit:.3g}' + ''.join(
                    f'; {name}, taken alone, {"is" if "half" in name else "are"} sharpest at '
                    f'{offset_s:+.4g} s, by {-margin:.1f}'
                    for name, offset_s, margin in margins if margin < 0)]


class Trials:
    """Sharpness of the tiles at evenly spaced offsets, to compare others with.

    Parameters
    ----------
    offset_s, visible_rad : (N,) float64
        Offsets, and sum of the changes of the visible phases.
    means : (N, 2, 5, T) float64
        Means of intensity and squared intensity of T tiles, of all pulses and of early, late,
        even and odd ones; NaN where the profiles do not reach a tile.
    half : (T,) int
        Half of the scene that a tile belongs to, 0 or 1.
    """

    def __init__(self, offset_s: np.ndarray, visible_rad: np.ndarray, means: np.ndarray,
                 half: np.ndarray) -> None:
        self._offset_s, self._visible_rad = offset_s, visible_rad
        reached = np.isfinite(means[:, 0, 0]).any(axis=0)
        weight = np.zeros(len(half))  # bright tiles count more, by the root of their power
        weight[reached] = np.sqrt(np.nanmedian(means[:, 0, 0][:, reached], axis=0))
        everywhere = np.ones(len(half), bool)
        parts = [(0, everywhere), (0, half == 0), (0, half == 1),
                 *((k, everywhere) for k in (1, 2, 3, 4))]
        self._which = [(k, some, weight * some / max((weight * some).sum(), 1e-30))
                       for k, some in parts]
        # Each tile against its own middle, so that one that is out of reach takes nothing away.
        tiles = _sharpness(means[:, 0], means[:, 1])
        known = np.isfinite(tiles).any(axis=0)
        self._middle = np.nanmedian(np.where(known, tiles, 0.0), axis=0)
        self._of_all = self._levels(means)
        self._means = means

    def _levels(self, means: np.ndarray) -> np.ndarray:
        """(2, 7, M) sharpness of the tiles and of all pixels, of all data and of the halves."""
        tiles = _sharpness(means[:, 0], means[:, 1])
        out = np.zeros((2, len(self._which), len(means)))
        for row, (k, some, weight) in enumerate(self._which):
            out[0, row] = np.nan_to_num(tiles[:, k] - self._middle[k]) @ weight
            known = np.isfinite(means[:, 0, k]) & some
            n = np.maximum(known.sum(axis=1), 1)
            whole = _sharpness(*(np.where(known, means[:, j, k], 0.0).sum(axis=1) / n
                                 for j in (0, 1)))
            out[1, row] = np.nan_to_num(whole) * n / max(some.sum(), 1)
        return out

    def _gains(self, visible_rad: np.ndarray, means: np.ndarray) -> np.ndarray:
        """(7, M) gain of all data and of the halves at some offsets."""
        def over_nearby(places: np.ndarray, levels: np.ndarray) -> np.ndarray:
            out = levels.copy()
            for j, place in enumerate(places):
                away = np.abs(self._visible_rad - place)
                near = (away > PEAK_RAD) & (away < SURROUNDINGS_RAD)
                out[..., j] -= np.median(self._of_all[..., near] if near.sum() >= _FEWEST_NEARBY
                                         else self._of_all, axis=-1)
            return out

        scatter = over_nearby(self._visible_rad, self._of_all)
        scatter -= np.median(scatter, axis=-1, keepdims=True)
        scale = np.maximum(_NORMAL * np.median(np.abs(scatter), axis=-1), 1e-12)[..., None]
        gains = over_nearby(visible_rad, self._levels(means)) / scale
        # Of all data that of all pixels: of tiles alone one search in eight went astray.
        return np.concatenate([gains[1:, 0], gains[:, 1:].mean(axis=0)])

    def maxima(self) -> np.ndarray:
        """Numbers of the offsets where the gain is higher than beside them, highest first."""
        gain = self._gains(self._visible_rad, self._means)[0]
        beside = np.concatenate([[-np.inf], gain, [-np.inf]])
        peaks = np.flatnonzero((gain >= beside[:-2]) & (gain > beside[2:]))
        return peaks[np.argsort(-gain[peaks])]

    def curve(self, offset_s: np.ndarray, visible_rad: np.ndarray, means: np.ndarray, *,
              step: Callable[[float], float], visible_range_rad: float) -> OffsetCurve:
        """The curve of these offsets and of finer ones.

        Parameters
        ----------
        offset_s, visible_rad, means
            Of the finer ones.
        step : callable
            From an offset to `OffsetCurve.step_s`.
        visible_range_rad : float
            Visible range of the curve.
        """
        coarse = self._gains(self._visible_rad, self._means)
        gains = np.concatenate([coarse, self._gains(visible_rad, means)], axis=1)
        offset_s = np.concatenate([self._offset_s, offset_s])
        visible_rad = np.concatenate([self._visible_rad, visible_rad])
        best = int(gains[0].argmax())
        others = np.abs(self._visible_rad - visible_rad[best]) > PEAK_RAD
        for row, some in zip(gains, coarse[:, others] if others.any() else coarse, strict=True):
            middle = np.median(some)
            row[:] = (row - middle) / max(_NORMAL * np.median(np.abs(some - middle)), 1e-12)
        order = np.argsort(offset_s)
        best_s = float(offset_s[best])
        return OffsetCurve(offset_s[order], visible_rad[order], gains[0, order],
                           gains[1:, order], best_s, step(best_s), visible_range_rad)
