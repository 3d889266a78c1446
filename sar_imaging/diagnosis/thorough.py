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
from .coherence import BUDGET, OVERSAMPLING, Coherence, CoherenceProbe, resolved
from .diagnose import FEWEST_PULSES, FOCUSED, NOTHING, Diagnosis, nothing_helps
from .hypotheses import (
    HYPOTHESES,
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
from .track import track_doubts

_logger = logging.getLogger(__name__)
_TILE = 4  # pixels: power of few pulses is wide across range, and narrow along it
_FINE_BUDGET, _COARSE_BUDGET = 500_000, 250_000  # points times rows of a search
_ROWS = 512  # of a search
_MOST_OFFSETS = 100  # on each side
_FELT_RAD = 1.5  # rms phase from one value to the next
_PEAKS = 3  # of a search, that are refined
_SLOPES = np.linspace(0.7, 1.45, 41)
_LEAST = 1.45  # contrast with which something focuses at all
_WORTH = 0.8  # of the least contrast, on few pixels
_NOISE = 2.0  # agreement of noise
_ABOVE_NOISE = 2.0  # times its agreement
_BETTER = 1.3  # times the agreement of the data as they are
_CERTAIN = 10.0  # times its agreement, from which on nothing else is tried
_LIKELIER = 1.25  # times the agreement of another mistake, for one that is searched for
_DARKER = 0.8  # times the contrast
_LEAST_COVERAGE = 0.25
_Found = tuple[Hypothesis, Coherence]


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
    attempt = _Attempts(block, resolved(grid, block), window)
    first = attempt.first
    _logger.debug('as is: %s', first)
    as_it_is = Diagnosis(first.contrast, first.coverage, corrected=first.contrast)
    if block.n_pulses * block.n_channels < FEWEST_PULSES:
        return dataclasses.replace(as_it_is, advice=(
            f'{block.n_pulses} pulses are too few to judge the focus'))
    doubts = track_doubts(block)
    found = None
    if first.contrast < FOCUSED:
        found = _best(attempt.hypotheses(), first)
    if found is not None and doubts and found[1].contrast < FOCUSED:
        found = None  # what is odd about the track explains more
    if not doubts and (found is None or found[1].agreement < _CERTAIN * first.agreement):
        found = _likelier(found, _best(attempt.searches(), first))
    if found is not None:
        hypothesis, coherence = found
        return Diagnosis(first.contrast, first.coverage, hypothesis.name, hypothesis.advice,
                         coherence.contrast)
    if doubts and first.contrast < FOCUSED:
        return dataclasses.replace(as_it_is, mistake='odd positions', advice='; '.join(doubts))
    return dataclasses.replace(
        as_it_is, advice='' if first.contrast >= NOTHING else nothing_helps(first))


def _best(results: Iterable[_Found], first: Coherence) -> _Found | None:
    """The mistake without which pulses agree clearly better than as they are."""
    least = max(_BETTER * first.agreement, _ABOVE_NOISE * _NOISE)
    lit = first.contrast if first.agreement > _NOISE else 0.0
    good = [(hypothesis, result) for hypothesis, result in results
            if result.coverage >= _LEAST_COVERAGE and result.agreement > least
            and result.contrast > max(_LEAST, _DARKER * lit)]
    return max(good, key=lambda found: found[1].agreement, default=None)


def _likelier(found: _Found | None, searched: _Found | None) -> _Found | None:
    """What agrees best; what was searched for among many values has to do clearly better."""
    if found is None or searched is None:
        return found or searched
    return searched if searched[1].agreement > _LIKELIER * found[1].agreement else found


class _Attempts:
    """Coherence of one aperture as it is and with mistakes undone."""

    def __init__(self, block: PulseBlock, grid: MapGrid, window: str):
        self._block, self._grid, self._window = block, grid, window
        self._profiles = self._compressed(block)
        self._probe = CoherenceProbe(grid, BUDGET, _TILE)
        self.first = self._probe(self._profiles)

    def _compressed(self, block: PulseBlock) -> PulseBlock:
        window = 'none' if block.compressed else self._window
        return RangeCompressor.for_block(block, window=window, oversampling=OVERSAMPLING)(block)

    def hypotheses(self) -> Iterator[_Found]:
        """Coherence with each mistake undone that few pixels tell to be worth it."""
        screen = CoherenceProbe(self._grid, _FINE_BUDGET, _TILE)
        for hypothesis in HYPOTHESES:
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
                yield hypothesis, result

    def searches(self) -> Iterator[_Found]:
        """Coherence with the best offset and rate of the clock, and slope of the ramp."""
        block, profiles = self._block, self._profiles
        places = self._grid.points()[::self._grid.n_y // 2 or 1, ::self._grid.n_x // 2 or 1]
        places = places.reshape(-1, 3)
        duration_s = 1e-9 * float(block.stamp_ns[-1] - block.stamp_ns[0])
        offsets = clock_offsets(profiles, places, duration_s, _MOST_OFFSETS,
                                felt_rad=_FELT_RAD)
        if len(offsets):
            offset, result = self._searched(profiles, offsets, with_offset)
            yield clock_offset(offset), result
        rates = clock_rates(profiles, places, felt_rad=_FELT_RAD)
        if len(rates):
            rate, result = self._searched(
                profiles, rates, lambda some, rate: with_offset(some, 0.0, rate))
            yield clock_drift(rate), result
        if not block.compressed and block.radar.waveform in RAMPS:
            factor, result = self._searched(block, _SLOPES, with_slope)
            yield wrong_slope(factor, block.radar), result

    def _searched(self, block: PulseBlock, values: np.ndarray,
                  change: Callable[[PulseBlock, float], PulseBlock]) -> tuple[float, Coherence]:
        """The value with which pulses agree best: searched on few pixels, refined on more."""
        few = _few_rows(block)
        coarse, fine = (CoherenceProbe(self._grid, n, _TILE)
                        for n in (_COARSE_BUDGET, _FINE_BUDGET))

        def focus(value: float, probe: CoherenceProbe) -> float:
            try:
                result = probe(self._changed(few, value, change))
            except ValueError:  # no such ramp
                return 0.0
            return result.agreement if result.contrast > _WORTH * _LEAST else 0.0

        figures = np.array([focus(value, coarse) for value in values])
        peaks = np.flatnonzero((figures >= np.r_[0, figures[:-1]])
                               & (figures >= np.r_[figures[1:], 0]))
        peaks = peaks[np.argsort(-figures[peaks])][:_PEAKS]
        step = float(values[1] - values[0])
        best = max((float(values[peak]) for peak in peaks), key=lambda value: focus(value, fine))
        for finer in (3, 9):
            best = max((best + step / finer * k for k in range(-2, 3)),
                       key=lambda value: focus(value, fine))
        result = self._probe(self._changed(block, best, change))
        _logger.debug('%s: %s', best, result)
        return best, result

    def _changed(self, block: PulseBlock, value: float,
                 change: Callable[[PulseBlock, float], PulseBlock]) -> PulseBlock:
        changed = change(block, value)
        return changed if block.compressed else self._compressed(changed)


def _few_rows(block: PulseBlock) -> PulseBlock:
    """As many channels as a search needs."""
    n = min(max(1, _ROWS // max(block.n_pulses, 1)), block.n_channels)
    channels = np.unique(np.linspace(0, block.n_channels - 1, n).astype(int))
    return dataclasses.replace(block, samples=block.samples[:, channels],
                               tx_m=block.tx_m[:, channels], rx_m=block.rx_m[:, channels])
