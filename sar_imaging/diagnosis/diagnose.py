# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Name the mistake that keeps an aperture from focusing, by imaging it without each in turn.

The aperture is imaged as it was told and as it would be without each mistake of a list, and the
figures of `sar_imaging.diagnosis.coherence` are compared: contrast, which tells whether anything
stands out, and the agreement of the pulses, which falls with every radian that is wrong while the
contrast of a few bright scatterers stays. A mistake is named when the image without it is clearly
better, and better in independent halves too: odd pulses, even pulses, and two halves of the map.
What other mistakes explain as well is told with it.

There is one engine with two lists of checks. Live, `diagnose` looks at images that are not clearly
in focus, for mistakes that destroy an image. Of recordings (`thorough`) it looks at every image,
and for values too that spoil a part of it: rate of the clock, and slope of the ramp.
"""

from __future__ import annotations

import dataclasses
import functools
import logging
from collections.abc import Callable, Iterable, Iterator

import numpy as np

from ..geometry.grids import MapGrid
from ..signal.pulses import PulseBlock, check_profiles
from .coherence import (
    BUDGET,
    FOCUSED,
    NOISE,
    Coherence,
    CoherenceProbe,
    gain_of,
    profiles_of,
    resolved,
)
from .hypotheses import (
    HYPOTHESES,
    ORDER,
    TRANSMITTERS,
    Hypothesis,
    clock_drift,
    clock_offset,
    clock_offsets,
    clock_rates,
    congruent,
    slopes,
    with_offset,
    with_slope,
    wrong_slope,
)
from .range_walk import walk_scale
from .track import at_rest, fills_a_plane, track_doubts

_logger = logging.getLogger(__name__)
# Of the coherence's contrast: 0.3 to 1.1 in noise and out of focus, 2.0 to 10 in focus; halfway
# where a mistake spares a part of the focus. See docs/troubleshooting.md.
_CLEARLY = 2.0  # in focus, whatever else is sharper
NOTHING = 1.3  # below it nothing stands out
LEAST = 1.45  # contrast with which something focuses at all
FEWEST_PULSES = 16
FINE_BUDGET, COARSE_BUDGET = 500_000, 250_000  # points times rows of a search
FEW_PULSES = 128  # of the first look of a search
_FEWEST_ALONE = 64  # pulses of a channel that is looked at alone
_MOST_OFFSETS = 100  # on each side
_LONGEST_LIVE_S = 2.0  # offset of a clock
_FELT_RAD = 1.5  # rms phase from one value to the next
_COMPARED, _PEAKS = 12, 3  # peaks of a search that are compared, and that are refined
_WORTH = 0.8  # of the least contrast, on few pixels
_ABOVE_NOISE = 2.0  # times its agreement
# Times the agreement of the data as they are: about half a decibel of contrast. With a value
# searched for, right simulated data agree 2 % better than as they are, measured ones 20 %.
BETTER = 1.3
_CERTAIN = 10.0  # times its agreement, from which on nothing else is tried
_PLAINLY = 2.0  # times its agreement, from which on halves are not asked
_LIKELIER = 1.1  # times the agreement of another mistake: less tells the two not apart
_DARKER, _AS_BRIGHT = 0.8, 0.95  # times the contrast, of images out of focus and in focus
_MIRRORED = 0.5  # of the contrast of a mirrored scene: an image of less is not in focus
_UPRIGHT = 0.25  # of an aperture's height, by which places may rise or fall
_ALIKE = 0.8  # of contrast and agreement: a mirrored scene is as sharp
_LEAST_COVERAGE = 0.25
_WALK = 0.07  # by which scatterers walk too far, or too little
_REFUTES, _TELLS = 0.9, 0.999  # confidence in another slope
_WALK_STEPS = 2
_FEWEST_WALKING = 3  # scatterers
_SLOPE = 'wrong slope'


@dataclasses.dataclass(frozen=True)
class Diagnosis:
    """Whether an aperture focuses, and which mistake probably keeps it from it.

    Parameters
    ----------
    coherence : float
        Focus figure of the data as they are, see `sar_imaging.diagnosis.coherence`.
    coverage : float
        Share of pixels and pulses that the profiles reach.
    mistake : str
        Name of the hypothesis that focuses, or of an oddity; empty when there is none.
    advice : str
        What to change, a sentence; empty when there is nothing to say.
    corrected : float
        Focus figure with the mistake undone; that of the data where nothing was.
    evidence : str
        What was measured.
    gain : float
        Agreement of the pulses with the mistake undone over that of the data; 1 where nothing was.
    sizes : tuple of float
        Sizes of the mistake, where it has any: offset in seconds, rate of a clock, factor of a
        slope.
    n_tried : int
        How many mistakes were tried.
    alternatives : tuple of str
        Names of other mistakes that explain the image as well as the one that is named.
    undecided : tuple of str
        Names of mistakes that this aperture cannot tell: the scene that is mirrored, moved,
        scaled or shown at another height is as much in focus.
    doubtful : tuple of str
        Those of them whose images are clearly sharper than the one of the data, which is not
        clearly in focus.
    undo : callable, optional
        From a block to the blocks that it should have been without the mistake.

    Examples
    --------
    >>> from sar_imaging.diagnosis import Diagnosis
    >>> diagnosis = Diagnosis(coherence=0.2, coverage=1.0, mistake='conjugated',
    ...                       advice='conjugate the samples', corrected=5.0)
    >>> diagnosis.mistake, diagnosis.focused
    ('conjugated', False)
    """

    coherence: float
    coverage: float
    mistake: str = ''
    advice: str = ''
    corrected: float = 0.0
    evidence: str = ''
    gain: float = 1.0
    sizes: tuple[float, ...] = ()
    n_tried: int = 0
    alternatives: tuple[str, ...] = ()
    undecided: tuple[str, ...] = ()
    doubtful: tuple[str, ...] = ()
    undo: Callable[[PulseBlock], list[PulseBlock]] | None = dataclasses.field(
        default=None, repr=False, compare=False)

    @property
    def focused(self) -> bool:
        """True when scatterers stand out as they are."""
        return self.coherence >= NOTHING and not self.mistake

    @property
    def tells(self) -> bool:
        """False where neither focus nor the want of it could be told."""
        return bool(self.mistake) or self.focused and not self.doubtful

    def __str__(self) -> str:
        figure = f'focus {self.coherence:.2f} (noise 1, focused scatterers 2 and more)'
        if self.mistake and self.corrected > self.coherence:
            return f'{self.advice} (focus {self.coherence:.2f} becomes {self.corrected:.2f})'
        if self.advice:
            return f'{self.advice}; {figure}'
        return f'{figure}, no mistake found'


def diagnose(block: PulseBlock, grid: MapGrid, *, window: str = 'none', thorough: bool = False
             ) -> Diagnosis:
    """Look for the mistake that keeps an aperture from focusing.

    Tries, on the brightest part of the image alone: conjugated samples (or Q and I exchanged),
    the sign of the slope, transmitters in another order, positions in millimetres, centimetres or
    kilometres, exchanged x and y, a mirrored track, one-way delays, positions against the order of
    pulses, and an offset of the clock. Takes a few seconds at most, on any size of image.

    A reflection of the whole geometry focuses as well as the truth: a mirrored straight track
    images the mirrored scene, and where the grid holds that, no focus tells it. The same goes
    for a clock offset on a track of constant velocity, which moves the image.

    Parameters
    ----------
    block : PulseBlock
        Pulses of one aperture, raw or compressed, with phase centres.
    grid : MapGrid
        Where they are imaged.
    window : str
        Window of the range compression of raw pulses.
    thorough : bool
        Also where the image is in focus, offsets of the clock of more than 2 s, clocks that drift
        apart, and a slope of the ramp that is up to a third off. Takes some seconds more.

    Returns
    -------
    Diagnosis

    Raises
    ------
    ValueError
        The block has no phase centres, or its samples cannot be compressed.

    Examples
    --------
    >>> import dataclasses
    >>> from sar_imaging import MapGrid, concatenate
    >>> from sar_imaging.diagnosis import diagnose
    >>> from sar_imaging.simulation import SCENARIOS
    >>> block = concatenate(list(SCENARIOS['psf']().blocks()))
    >>> wrong = dataclasses.replace(block, samples=block.samples.conj())
    >>> found = diagnose(wrong, MapGrid((10_000.0, 0.0, 0.0), 40, 40, 0.5))
    >>> found.focused, found.mistake
    (False, 'samples conjugated')
    >>> print(found.advice)
    the samples are probably conjugated, or Q and I exchanged; pass samples.conj(), ...
    """
    check_profiles(block, block.radar, block.n_samples, compressed=block.compressed)
    attempts = _Attempts(block, resolved(grid, block), window)
    first = attempts.first
    _logger.debug('as is: %s', first)
    if block.n_pulses * block.n_channels < FEWEST_PULSES:
        return _as_it_is(first, f'{block.n_pulses} pulses are too few to judge the focus')
    if not thorough and first.figure >= FOCUSED:
        return _as_it_is(first)
    doubts = track_doubts(block)
    tried = list(attempts.hypotheses())
    found = _best(tried)
    if found is not None and doubts and found.result.contrast < FOCUSED:
        found = None  # what is odd about the track explains more
    if not doubts and (found is None or found.mistake is ORDER or found.gain < _CERTAIN):
        searched = list(attempts.values(thorough))
        tried += searched
        found = _likelier(found, _best(searched))
    if found is not None:
        return _explained(first, found, tried)
    undecided = [t for t in tried if t.leaves_focus and _as_sharp(t)]
    walked = attempts.slope_by_walk() if thorough and not doubts else None
    return dataclasses.replace(
        walked or _unexplained(block, first, doubts), n_tried=len(tried),
        undecided=tuple(dict.fromkeys([*(t.mistake.name for t in undecided), *attempts.blind])),
        doubtful=tuple(dict.fromkeys(
            t.mistake.name for t in undecided if t.mistake.isometry and t.gain > BETTER
            and first.contrast < _CLEARLY)))


@dataclasses.dataclass(frozen=True)
class _Tried:
    """A mistake, the coherence without it, and that of the same pulses with it.

    `profiles` are those without it, and `told` those of the same pulses as they came.
    """

    mistake: Hypothesis
    result: Coherence
    before: Coherence
    profiles: PulseBlock
    told: PulseBlock
    grid: MapGrid

    @property
    def gain(self) -> float:
        return gain_of(self.result, self.before)

    def halves(self) -> list[float]:
        """Gains of odd and even pulses, and of the halves of the map that hold anything.

        Of what stands out, or of contrast where that is in focus: what is not may agree over wide
        parts, so that what stands out of it is much, too.
        """
        probe = CoherenceProbe(self.grid, BUDGET // 4)
        pairs = [[probe(b.select(slice(k, None, 2))) for b in (self.profiles, self.told)]
                 for k in (0, 1)]
        # scatterers may be in the other half without the mistake
        halves = [sorted(probe.halves(b), key=lambda half: -half.spread)
                  for b in (self.profiles, self.told)]
        pairs += [list(pair) for pair in zip(*halves, strict=True)
                  if pair[0].agreement > _ABOVE_NOISE * NOISE and pair[0].contrast > LEAST]
        return [max(gain_of(after, then), after.contrast / max(then.contrast, 1.0)
                    if after.contrast > LEAST else 0.0) for after, then in pairs]

    def on_pulses_of(self, other: _Tried) -> _Tried:
        """The same on those of its pulses and channels that another try has, too.

        Fewer pulses agree over wider parts of a scene, and an image of them has less contrast.
        """
        shared = np.isin(self.profiles.counter, other.profiles.counter)
        fewer = other.profiles.n_channels < self.profiles.n_channels
        if shared.all() and not fewer:
            return self
        profiles, told = (b.select(shared) for b in (self.profiles, self.told))
        if fewer:
            profiles, told = one_channel(profiles), one_channel(told)
        probe = CoherenceProbe(self.grid)
        return dataclasses.replace(self, result=probe(profiles), before=probe(told),
                                   profiles=profiles, told=told)

    @property
    def leaves_focus(self) -> bool:
        """Whether it is a mistake with which a scene may be as much in focus.

        At one elevation transmitters differ by phases alone, whatever their order.
        """
        slope = self.mistake.sizes[0] if self.mistake.name == _SLOPE else 1.0
        return (self.mistake.isometry or self.mistake is TRANSMITTERS
                or abs(slope - 1) > _WALK)

    @property
    def helps(self) -> bool:
        """Whether pulses agree clearly better than as they are."""
        result, before = self.result, self.before
        lit = before.contrast if before.agreement > NOISE else 0.0
        if self.mistake.of_samples:
            # where groups agree less than those of noise, 1 on average, contrast is over noise
            lit *= min(before.mean, 1.0)
        # layers below a track, and the part of an aperture that an offset leaves, agree widely
        stands_out = result.spread > _CERTAIN * max(before.spread, 1.0)
        focus = 1.0 if stands_out else LEAST
        # where contrast says the opposite, pulses have to agree plainly better
        better = BETTER if result.contrast >= lit else _PLAINLY
        return (result.coverage >= _LEAST_COVERAGE and self.gain > better
                and result.agreement > _ABOVE_NOISE * NOISE
                and result.contrast > max(focus, least_contrast(lit)))

    @property
    def shows_another_scene(self) -> bool:
        """Whether the image as it is may be as right, and this one of another part of the scene.

        Pulses agree as well on a mirrored scene, unless the grid holds little of one of them. An
        aperture that fills a plane shows one height of a scene, and another one with other ranges
        or upside down: which of them holds more is no matter of focus.
        """
        before = self.before
        if before.figure <= max(LEAST, _MIRRORED * self.result.contrast):
            return False
        turned = self.mistake.isometry or self.mistake is ORDER
        mirrored = turned and congruent(self.told, self.profiles)
        if not (turned and self._keeps_heights()) and fills_a_plane(self.told):
            return mirrored or before.contrast > _CLEARLY
        return mirrored and self.gain < _PLAINLY

    def _keeps_heights(self) -> bool:
        """Whether an aperture is not upside down."""
        z_m, before_m = (np.add(*b.centres_m)[..., 2] / 2 for b in (self.profiles, self.told))
        return bool(np.ptp(z_m - before_m) <= _UPRIGHT * np.ptp(before_m))


def least_contrast(contrast: float) -> float:
    """Contrast that another image needs so as not to be darker than one of this contrast."""
    return (_AS_BRIGHT if contrast > FOCUSED else _DARKER) * contrast


def _best(tried: Iterable[_Tried]) -> _Tried | None:
    """The mistake without which pulses agree clearly better than as they are."""
    helping = [t for t in tried if t.helps and not t.shows_another_scene]
    # short arrays agree over wide parts of a scene that is not in focus
    sharpest = max((t.result.contrast for t in helping), default=0.0)
    helping = [t for t in helping if t.result.contrast > _DARKER * sharpest]
    while helping:
        # an offset of the clock leaves out pulses: of two that help as much, the sharper counts
        gain = max(t.gain for t in helping) / _LIKELIER
        best = max((t for t in helping if t.gain >= gain), key=lambda t: t.result.contrast)
        halves = best.halves()
        # odd and even pulses are asked whatever the gain, halves of the map where it is small
        if min(halves[:2]) > 1.0 and (best.gain > _PLAINLY or min(halves) > 1.0):
            return best
        helping.remove(best)
    return None


def _likelier(found: _Tried | None, searched: _Tried | None) -> _Tried | None:
    """What agrees best; what was searched for among many values has to do clearly better.

    It must not darken the image either: a ramp of the wrong sign and another slope focuses a few
    scatterers, and the others less than the right ramp does. Where it is clearly sharper it
    counts, too: what is not in focus may agree over wide parts.
    """
    if found is None or searched is None:
        return found or searched
    one, other = found.on_pulses_of(searched), searched.on_pulses_of(found)
    _logger.debug('of the same pulses, %s: %s, %s: %s', one.mistake.name, one.result,
                  other.mistake.name, other.result)
    contrasts = one.result.contrast, other.result.contrast
    better = (contrasts[0] < _DARKER * contrasts[1] or other.gain > _LIKELIER * one.gain
              and contrasts[1] > least_contrast(contrasts[0]))
    return searched if better else found


def _sharper(one: _Tried, other: _Tried) -> _Tried:
    """The one of two in which more stands out, on the pulses that both have.

    Values that leave out opposite ends have few in common. Each end agrees over wide parts of the
    scene in its own way, so that what stands out counts over the mean: variance over mean.
    """
    shared = np.isin(one.profiles.counter, other.profiles.counter)
    if 2 * np.count_nonzero(shared) < min(one.profiles.n_pulses, other.profiles.n_pulses):
        return max(one, other,
                   key=lambda tried: tried.result.spread / max(tried.result.mean, 1e-9))
    spreads = one.on_pulses_of(other).result.spread, other.on_pulses_of(one).result.spread
    return one if spreads[0] >= spreads[1] else other


def _as_sharp(tried: _Tried) -> bool:
    """Whether the other scene is in focus, and as right as the one of the data.

    Transmitters that agree over the whole map leave less contrast than those that do not.
    """
    before = 0.0 if tried.mistake is TRANSMITTERS else tried.before.contrast
    return (tried.result.contrast > max(NOTHING, _ALIKE * before)
            and tried.result.agreement > _ALIKE * tried.before.agreement)


def _as_it_is(first: Coherence, advice: str = '') -> Diagnosis:
    """No mistake is named."""
    return Diagnosis(first.figure, first.coverage, corrected=first.figure, advice=advice)


def _explained(first: Coherence, found: _Tried, tried: list[_Tried]) -> Diagnosis:
    """A mistake is named, and what explains the image as well."""
    others = {t.mistake.name: t for t in tried
              if t.mistake.name != found.mistake.name and t.helps
              and t.gain * _LIKELIER > found.gain
              and t.result.contrast * _LIKELIER > found.result.contrast}
    halves = ', '.join(f'{gain:.3g}' for gain in found.halves())
    return Diagnosis(
        first.figure, first.coverage, found.mistake.name, found.mistake.advice,
        found.result.contrast, evidence=(
            f'without it the focus figure {found.before.contrast:.2f} becomes '
            f'{found.result.contrast:.2f}, and pulses agree {found.gain:.3g} times as well '
            f'({halves} times in what stands out of independent halves)'),
        gain=found.gain, sizes=found.mistake.sizes, n_tried=len({t.mistake.name for t in tried}),
        alternatives=tuple(others), undo=found.mistake.undo)


def _unexplained(block: PulseBlock, first: Coherence, doubts: tuple[str, ...]) -> Diagnosis:
    """No mistake focuses the image better; what is odd about the track is told."""
    if doubts and (first.figure < FOCUSED or at_rest(block)):
        return Diagnosis(first.figure, first.coverage, 'odd positions', '; '.join(doubts),
                         first.figure, 'the track is like that of no platform')
    return _as_it_is(first, '' if first.figure >= NOTHING else _nothing_helps(first))


def _nothing_helps(first: Coherence) -> str:
    """What is said of an image without focus that no hypothesis explains."""
    if not first.coverage:
        return ('the profiles do not reach the grid, and no hypothesis about units, axes or '
                'delays explains it; check the positions of antenna and grid')
    return ('nothing stands out from noise, and no hypothesis about samples, positions or clock '
            'helps: an empty scene, clutter alone, or a mistake that is not among them')


class _Attempts:
    """Coherence of one aperture as it is and with mistakes undone."""

    def __init__(self, block: PulseBlock, grid: MapGrid, window: str):
        self._block, self._grid, self._window = block, grid, window
        self._profiles = self._compressed(block)
        self._probe = CoherenceProbe(grid)
        self.first = self._probe(self._profiles)
        self._tells_slope = not block.compressed and block.radar.waveform.is_ramp
        self.blind: list[str] = []  # mistakes with which the aperture is as much in focus

    def _compressed(self, block: PulseBlock) -> PulseBlock:
        return profiles_of(block, self._window)

    def _tried(self, mistake: Hypothesis, profiles: PulseBlock, result: Coherence,
               before: PulseBlock | None = None) -> _Tried:
        """A try with profiles, compared with those before, of the same pulses."""
        _logger.debug('%s: %s', mistake.name, result)
        if before is None:
            return _Tried(mistake, result, self.first, profiles, self._profiles, self._grid)
        return _Tried(mistake, result, self._probe(before), profiles, before, self._grid)

    def hypotheses(self) -> Iterator[_Tried]:
        """The aperture with each mistake undone."""
        for hypothesis in HYPOTHESES:
            # Positions can be changed on the profiles, compressed once.
            anew = hypothesis.of_samples or hypothesis.name.startswith('delay')
            for changed in hypothesis.undo(self._block if anew else self._profiles):
                try:
                    ready = self._compressed(changed) if anew else changed
                except ValueError:
                    continue  # impossible as well
                yield self._tried(hypothesis, ready, self._probe(ready))

    def values(self, thorough: bool) -> Iterator[_Tried]:
        """The aperture with the best offset and rate of the clock, and slope of the ramp."""
        one = one_channel(self._block)
        alone = self if one is self._block else _Attempts(one, self._grid, self._window)
        for tried in alone._searched(thorough):
            if not (thorough and alone._refuted(tried.mistake)):
                yield tried
        self.blind = alone.blind

    def _searched(self, thorough: bool) -> Iterator[_Tried]:
        block, profiles = self._block, self._profiles
        places = self._grid.points()[::self._grid.n_y // 2 or 1, ::self._grid.n_x // 2 or 1]
        places = places.reshape(-1, 3)
        longest_s = 1e-9 * float(block.stamp_ns[-1] - block.stamp_ns[0])
        longest_s = longest_s if thorough else min(longest_s, _LONGEST_LIVE_S)
        offsets = clock_offsets(profiles, places, longest_s, _MOST_OFFSETS, felt_rad=_FELT_RAD)
        if len(offsets):
            yield self._search(profiles, offsets, clock_offset, lambda some, offset, track:
                               with_offset(some, offset, track=track))
        flat = fills_a_plane(block)  # other clocks and slopes may show other heights, in focus
        if flat or not len(offsets):
            self.blind.append('clock offset')
        if not thorough:
            return
        rates = clock_rates(profiles, places, felt_rad=_FELT_RAD)
        if len(rates):
            yield self._search(profiles, rates, clock_drift, lambda some, rate, track:
                               with_offset(some, 0.0, rate, track))
        if flat or not len(rates):
            self.blind.append('clock drift')
        if not self._tells_slope:
            return
        factors = slopes(profiles, places)
        if flat or not len(factors):
            self.blind.append(_SLOPE)
            return

        def mistake(factor: float) -> Hypothesis:
            return wrong_slope(factor, block.radar)

        tried = self._search(block, factors, mistake,
                             lambda some, factor, track: with_slope(some, factor))
        yield tried
        factor = tried.mistake.sizes[0]
        factor *= walk_scale(self._compressed(with_slope(block, factor)), self._grid).scale
        if factors[0] <= factor <= factors[-1]:
            changed = self._compressed(with_slope(block, factor))
            yield self._tried(mistake(factor), changed, self._probe(changed))

    def _refuted(self, tried: Hypothesis) -> bool:
        """Whether scatterers still walk as with another slope of the ramp."""
        return self._tells_slope and any(
            walk_scale(self._compressed(changed), self._grid).off(_WALK, _REFUTES, 2)
            for changed in tried.undo(self._block))

    def slope_by_walk(self) -> Diagnosis | None:
        """The slope of a ramp with which scatterers in focus walk as far as their phase says.

        With it they have to be as much in focus as before.
        """
        block = self._block
        if not self._tells_slope:
            return None
        as_it_is = walk_scale(self._profiles, self._grid)
        if as_it_is.n_scatterers >= _FEWEST_WALKING:
            # a walk that is off by less may be a slope, or a track that is some per cent off
            self.blind = [name for name in self.blind if name != _SLOPE]
            if as_it_is.off(0.0, _REFUTES, _FEWEST_WALKING):
                self.blind.append(_SLOPE)
        if not as_it_is.off(_WALK, _TELLS, _FEWEST_WALKING):
            return None
        factor = as_it_is.scale
        for _ in range(_WALK_STEPS):  # where ranges change, so do places and the walk
            changed = self._compressed(with_slope(block, factor))
            left = walk_scale(changed, self._grid)
            if left.n_scatterers:
                factor *= left.scale
        result = self._probe(changed)
        if abs(factor - 1) < _WALK or result.agreement < _DARKER * self.first.agreement:
            return None
        found = self._tried(wrong_slope(factor, block.radar), changed, result)
        return dataclasses.replace(_explained(self.first, found, []), evidence=(
            f'{as_it_is.n_scatterers} bright scatterers walk {as_it_is.scale:.2f} +- '
            f'{as_it_is.deviation:.2f} times as far through range as their phase says, and '
            f'{left.scale:.2f} times with this slope; the focus figure {self.first.contrast:.2f} '
            f'becomes {result.contrast:.2f}'))

    def _search(self, block: PulseBlock, values: np.ndarray,
                mistake: Callable[[float], Hypothesis], change: Callable[..., PulseBlock]
                ) -> _Tried:
        """The value with which most is gained: searched on few pixels, refined on more.

        Values that leave out pulses are compared with the same pulses as they are: a part of an
        aperture agrees over wider parts of the scene than all of it.
        """
        coarse, fine = (CoherenceProbe(self._grid, n)
                        for n in (COARSE_BUDGET, FINE_BUDGET))
        few, some = (block.select(slice(None, None, -(-block.n_pulses // n)))
                     for n in (FEW_PULSES, 2 * FEW_PULSES))

        def focus(value: float, probe: CoherenceProbe, pulses: PulseBlock) -> Coherence:
            try:
                return probe(self._ready(change(pulses, value, block)))
            except ValueError:  # no such ramp
                return Coherence(0.0, 0.0, 0.0)

        def spread(value: float, probe: CoherenceProbe, pulses: PulseBlock) -> float:
            result = focus(value, probe, pulses)
            # few pulses that are left agree over wide parts
            return result.spread if result.contrast > _WORTH * LEAST else 0.0

        def gain(value: float, probe: CoherenceProbe, pulses: PulseBlock) -> float:
            kept = np.isin(self._profiles.counter, change(pulses, value, block).counter)
            return gain_of(focus(value, probe, pulses), probe(self._profiles.select(kept)))

        figures = np.array([spread(value, coarse, few) for value in values])
        peaks = np.flatnonzero((figures >= np.r_[0, figures[:-1]])
                               & (figures >= np.r_[figures[1:], 0]))
        peaks = peaks[np.argsort(-figures[peaks])][:_COMPARED]
        best = sorted(peaks, key=lambda at: -gain(float(values[at]), coarse, few))[:_PEAKS]
        step = float(values[1] - values[0])

        def climbed(value: float) -> float:
            for finer in (3, 9):
                value = max((value + step / finer * k for k in range(-2, 3)),
                            key=lambda near: spread(near, fine, some))
            return value

        def tried(value: float) -> _Tried:
            changed = self._ready(change(block, value, block))
            kept = np.isin(self._profiles.counter, changed.counter)
            before = None if kept.all() else self._profiles.select(kept)
            return self._tried(mistake(value), changed, self._probe(changed), before)

        # the top of a narrow peak may lie between two values, each below a broad one
        return functools.reduce(_sharper, (tried(climbed(float(values[at]))) for at in best))

    def _ready(self, block: PulseBlock) -> PulseBlock:
        return block if block.compressed else self._compressed(block)


def one_channel(block: PulseBlock) -> PulseBlock:
    """The channel of median power, where its pulses are enough.

    Phases of channels are looked at apart, and need not be right here.
    """
    if block.n_channels == 1 or block.n_pulses < _FEWEST_ALONE:
        return block
    power = np.mean(np.square(np.abs(block.samples), dtype=float), axis=(0, 2))
    at = int(np.argsort(power)[len(power) // 2])
    return one_of(block, at)


def one_of(block: PulseBlock, channel: int) -> PulseBlock:
    """A channel alone."""
    at, (tx_m, rx_m) = slice(channel, channel + 1), block.centres_m
    return dataclasses.replace(block, samples=block.samples[:, at], tx_m=tx_m[:, at],
                               rx_m=rx_m[:, at])
