"""Name the mistake that keeps an aperture from focusing, thoroughly: of recordings, not live.

`diagnose` asks in a second whether an image focuses at all. Here values are searched too, offset
and rate of the clock and slope of the ramp, where a small error leaves most of the focus. Pixels
are therefore as fine as the resolution, and the agreement of pulses decides
(`Coherence.agreement`): it falls with every radian that is wrong, while the contrast of a few
bright scatterers stays.
"""

from __future__ import annotations

import dataclasses
import logging
from collections.abc import Callable, Iterable, Iterator

import numpy as np

from ..geometry.grids import MapGrid
from ..signal.pulses import PulseBlock, check_profiles
from ..signal.range_compression import RangeCompressor
from .coherence import (
    BUDGET,
    NOISE,
    OVERSAMPLING,
    Coherence,
    CoherenceProbe,
    gain_of,
    resolved,
)
from .diagnose import (
    FEWEST_PULSES,
    FOCUSED,
    Diagnosis,
    as_it_is,
    explained,
    too_few,
    unexplained,
)
from .hypotheses import (
    HYPOTHESES,
    ORDER,
    SAMPLES,
    Hypothesis,
    clock_drift,
    clock_offset,
    clock_offsets,
    clock_rates,
    with_offset,
    with_slope,
    wrong_slope,
)
from .profile_changes import RAMPS
from .range_walk import walk_scale
from .track import track_doubts

_logger = logging.getLogger(__name__)
_TILE = 4  # pixels: power of few pulses is wide across range, and narrow along it
_FINE_BUDGET, _COARSE_BUDGET = 500_000, 250_000  # points times rows of a search
_FEWEST_ALONE = 64  # pulses of a channel that is looked at alone
_MOST_OFFSETS = 100  # on each side
_FELT_RAD = 1.5  # rms phase from one value to the next
_PEAKS = 3  # of a search, that are refined
_SLOPES = np.linspace(0.7, 1.45, 41)
_LEAST = 1.45  # contrast with which something focuses at all
_WORTH = 0.8  # of the least contrast, on few pixels
_ABOVE_NOISE = 2.0  # times its agreement
_BETTER = 1.3  # times the agreement of the data as they are
_BETTER_VALUE = 1.15  # with a value searched for: right ones agree best as they are, within 2 %
_CERTAIN = 10.0  # times its agreement, from which on nothing else is tried
_LIKELIER = 1.1  # times the agreement of another mistake, for one that is searched for
_DARKER = 0.8  # times the contrast
_AS_DARK = 0.7  # of the contrast, which those that agree more have to reach
_LEAST_COVERAGE = 0.25
_WALK = 0.07  # by which scatterers walk too far, or too little
_WALK_TELLS, _WALK_REFUTES = 4.0, 3.0  # standard deviations
_WALK_STEPS = 2
# A mistake, the coherence without it, and that of the same pulses with it
_Tried = tuple[Hypothesis, Coherence, Coherence]


def diagnose_thoroughly(block: PulseBlock, grid: MapGrid, *, window: str = 'none') -> Diagnosis:
    """Look for the mistake that keeps an aperture from focusing, or makes it focus less.

    Tries what `diagnose` tries, offsets of the clock up to half of the aperture, clocks that
    drift apart, and a slope of the ramp that is up to a third off. Takes some seconds.

    Parameters
    ----------
    block : PulseBlock
        Pulses of one aperture, raw or compressed, with phase centres.
    grid : MapGrid
        Where they are imaged.
    window : str
        Of the range compression of raw pulses.

    Returns
    -------
    Diagnosis

    Raises
    ------
    ValueError
        The block has no phase centres, or its samples cannot be compressed.
    """
    check_profiles(block, block.radar, block.n_samples, compressed=block.compressed)
    grid = resolved(grid, block)
    attempt = _Attempts(block, grid, window)
    first = attempt.first
    _logger.debug('as is: %s', first)
    if block.n_pulses * block.n_channels < FEWEST_PULSES:
        return as_it_is(first, too_few(block))
    doubts = track_doubts(block)
    # ramps of the other sign may leave the phases of a short track in focus
    found = _best(attempt.hypotheses(HYPOTHESES if first.contrast < FOCUSED else SAMPLES))
    if found is not None and doubts and found[1].contrast < FOCUSED:
        found = None  # what is odd about the track explains more
    if not doubts and (found is None or found[0] is ORDER or _gain(found) < _CERTAIN):
        one = one_channel(block)
        alone = attempt if one is block else _Attempts(one, grid, window)
        searched = [tried for tried in alone.searches() if not alone.refuted(tried[0])]
        found = _likelier(found, _best(searched, _BETTER_VALUE))
    if found is not None:
        return explained(first, *found)
    walked = None if doubts else attempt.slope_by_walk()
    if walked is not None:
        return walked
    return unexplained(first, doubts if first.contrast < FOCUSED else [])


def _best(results: Iterable[_Tried], least: float = _BETTER) -> _Tried | None:
    """The mistake without which pulses agree clearly better than as they are."""
    helping = [tried for tried in results if _helps(tried, least)]
    most = max((result.contrast for _, result, _ in helping), default=0.0)
    # short arrays agree over wide parts of a scene that is not in focus
    helping = [tried for tried in helping if tried[1].contrast > _AS_DARK * most]
    if not helping:
        return None
    # an offset of the clock leaves out pulses: of two that help as much, the sharper image counts
    gain = max(map(_gain, helping)) / _LIKELIER
    return max((tried for tried in helping if _gain(tried) >= gain),
               key=lambda tried: tried[1].contrast)


def _gain(tried: _Tried) -> float:
    _, result, as_it_is = tried
    return gain_of(result, as_it_is)


def _helps(tried: _Tried, least: float) -> bool:
    hypothesis, result, as_it_is = tried
    lit = as_it_is.contrast if as_it_is.agreement > NOISE else 0.0
    if hypothesis.of_samples:
        # where groups agree less than those of noise, 1 on average, contrast is that over noise
        lit *= min(as_it_is.mean, 1.0)
    if hypothesis.isometry and lit > _AS_DARK * result.contrast:
        return False  # the mirrored scene is in focus, and as right as this one
    # the part of an aperture that an offset leaves agrees widely, with less contrast
    stands_out = result.spread > _CERTAIN * max(as_it_is.spread, 1.0)
    focus = _LEAST * (_WORTH if stands_out else 1.0)
    return (result.coverage >= _LEAST_COVERAGE and _gain(tried) > least
            and result.agreement > _ABOVE_NOISE * NOISE
            and result.contrast > max(focus, _DARKER * lit))


def _likelier(found: _Tried | None, searched: _Tried | None) -> _Tried | None:
    """What agrees best; what was searched for among many values has to do clearly better.

    It must not darken the image either: a ramp of the wrong sign and another slope focuses a few
    scatterers, and the others less than the right ramp does.
    """
    if found is None or searched is None:
        return found or searched
    better = (_gain(searched) > _LIKELIER * _gain(found)
              and searched[1].contrast > _DARKER * found[1].contrast)
    return searched if better else found


class _Attempts:
    """Coherence of one aperture as it is and with mistakes undone."""

    def __init__(self, block: PulseBlock, grid: MapGrid, window: str):
        self._block, self._grid, self._window = block, grid, window
        self._profiles = self._compressed(block)
        self._probe = CoherenceProbe(grid, BUDGET, _TILE)
        self.first = self._probe(self._profiles)
        self._tells_slope = not block.compressed and block.radar.waveform in RAMPS

    def _compressed(self, block: PulseBlock) -> PulseBlock:
        window = 'none' if block.compressed else self._window
        return RangeCompressor.for_block(block, window=window, oversampling=OVERSAMPLING)(block)

    def hypotheses(self, tried: Iterable[Hypothesis]) -> Iterator[_Tried]:
        """Coherence with each mistake undone that few pixels tell to be worth it."""
        screen = CoherenceProbe(self._grid, _FINE_BUDGET, _TILE)
        for hypothesis in tried:
            # Positions can be changed on the profiles, compressed once.
            anew = hypothesis.of_samples or hypothesis.name.startswith('delay')
            for changed in hypothesis.undo(self._block if anew else self._profiles):
                try:
                    ready = self._compressed(changed) if anew else changed
                except ValueError:
                    continue  # impossible as well
                result = screen(ready)
                if result.contrast > _WORTH * _LEAST:
                    result = self._probe(ready)
                _logger.debug('%s: %s', hypothesis.name, result)
                yield hypothesis, result, self.first

    def searches(self) -> Iterator[_Tried]:
        """Coherence with the best offset and rate of the clock, and slope of the ramp."""
        block, profiles = self._block, self._profiles
        places = self._grid.points()[::self._grid.n_y // 2 or 1, ::self._grid.n_x // 2 or 1]
        places = places.reshape(-1, 3)
        duration_s = 1e-9 * float(block.stamp_ns[-1] - block.stamp_ns[0])
        offsets = clock_offsets(profiles, places, duration_s, _MOST_OFFSETS,
                                felt_rad=_FELT_RAD)
        if len(offsets):
            offset, result = self._searched(profiles, offsets, with_offset)
            yield clock_offset(offset), *result
        rates = clock_rates(profiles, places, felt_rad=_FELT_RAD)
        if len(rates):
            rate, result = self._searched(
                profiles, rates, lambda some, rate: with_offset(some, 0.0, rate))
            yield clock_drift(rate), *result
        if self._tells_slope:
            factor, result = self._searched(block, _SLOPES, with_slope)
            yield wrong_slope(factor, block.radar), *result
            factor *= walk_scale(self._changed(block, factor, with_slope), self._grid).scale
            if _SLOPES[0] <= factor <= _SLOPES[-1]:
                changed = self._changed(block, factor, with_slope)
                yield wrong_slope(factor, block.radar), self._probe(changed), self.first

    def refuted(self, tried: Hypothesis) -> bool:
        """Whether scatterers still walk as with another slope of the ramp."""
        return self._tells_slope and any(
            walk_scale(self._compressed(changed), self._grid).off(_WALK, _WALK_REFUTES, 2)
            for changed in tried.undo(self._block))

    def slope_by_walk(self) -> Diagnosis | None:
        """The slope of a ramp with which scatterers in focus walk as far as their phase says."""
        block = self._block
        if not self._tells_slope:
            return None
        as_it_is = walk_scale(self._profiles, self._grid)
        if not as_it_is.off(_WALK, _WALK_TELLS, 3):
            return None
        factor = as_it_is.scale
        for _ in range(_WALK_STEPS):  # where ranges change, so do places and the walk
            changed = self._compressed(with_slope(block, factor))
            left = walk_scale(changed, self._grid)
            if left.n_scatterers:
                factor *= left.scale
        mistake = wrong_slope(factor, block.radar)
        return dataclasses.replace(
            explained(self.first, mistake, self._probe(changed), self.first), evidence=(
                f'{as_it_is.n_scatterers} bright scatterers walk {as_it_is.scale:.2f} +- '
                f'{as_it_is.deviation:.2f} times as far through range as their phase says'))

    def _searched(self, block: PulseBlock, values: np.ndarray,
                  change: Callable[[PulseBlock, float], PulseBlock]
                  ) -> tuple[float, tuple[Coherence, Coherence]]:
        """The value with which most stands out: searched on few pixels, refined on more."""
        coarse, fine = (CoherenceProbe(self._grid, n, _TILE)
                        for n in (_COARSE_BUDGET, _FINE_BUDGET))

        def focus(value: float, probe: CoherenceProbe) -> float:
            try:
                result = probe(self._changed(block, value, change))
            except ValueError:  # no such ramp
                return 0.0
            # few pulses that are left agree over wide parts
            return result.spread if result.contrast > _WORTH * _LEAST else 0.0

        figures = np.array([focus(value, coarse) for value in values])
        peaks = np.flatnonzero((figures >= np.r_[0, figures[:-1]])
                               & (figures >= np.r_[figures[1:], 0]))
        peaks = peaks[np.argsort(-figures[peaks])][:_PEAKS]
        step = float(values[1] - values[0])

        def climbed(value: float) -> float:
            for finer in (3, 9):
                value = max((value + step / finer * k for k in range(-2, 3)),
                            key=lambda near: focus(near, fine))
            return value

        # the top of a narrow peak may lie between two values, each below a broad one
        best = max((climbed(float(values[peak])) for peak in peaks),
                   key=lambda value: focus(value, fine))
        changed = self._changed(block, best, change)
        result = self._probe(changed), self._of_the_same(changed)
        _logger.debug('%s: %s', best, result)
        return best, result

    def _of_the_same(self, changed: PulseBlock) -> Coherence:
        """Coherence as it is, of the pulses that a change left."""
        kept = np.isin(self._profiles.counter, changed.counter)
        return self.first if kept.all() else self._probe(self._profiles.select(kept))

    def _changed(self, block: PulseBlock, value: float,
                 change: Callable[[PulseBlock, float], PulseBlock]) -> PulseBlock:
        changed = change(block, value)
        return changed if block.compressed else self._compressed(changed)


def one_channel(block: PulseBlock) -> PulseBlock:
    """The channel of median power, where its pulses are enough.

    Phases of channels are looked at apart, and need not be right here.
    """
    if block.n_channels == 1 or block.n_pulses < _FEWEST_ALONE:
        return block
    power = np.mean(np.square(np.abs(block.samples), dtype=float), axis=(0, 2))
    at = int(np.argsort(power)[len(power) // 2])
    return dataclasses.replace(block, samples=block.samples[:, at:at + 1],
                               tx_m=block.tx_m[:, at:at + 1], rx_m=block.rx_m[:, at:at + 1])
