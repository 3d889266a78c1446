"""Name the mistake that keeps an aperture from focusing, by trying to undo it."""

from __future__ import annotations

import dataclasses
import logging
from collections.abc import Callable, Iterable, Iterator

import numpy as np

from ..geometry.grids import MapGrid
from ..signal.pulses import PulseBlock, check_profiles
from ..signal.range_compression import RangeCompressor
from .coherence import OVERSAMPLING, Coherence, CoherenceProbe, gain_of
from .hypotheses import HYPOTHESES, Hypothesis, clock_offset, clock_offsets, with_offset
from .track import track_doubts

_logger = logging.getLogger(__name__)
# Of the coherence's contrast: 0.3 to 1.05 in noise and out of focus, 2.0 to 10 in focus; halfway
# where a mistake spares a part of the focus. See docs/troubleshooting.md.
FOCUSED = 3.0  # nothing is tried
_CLEARLY = 2.0  # from it on a hypothesis counts for more than odd positions
NOTHING = 1.3  # below it nothing stands out
_BETTER = 1.25  # times the contrast of the data as they are
_SHARPER = 2.0  # times its sharpness, where only samples change
_DARKER = 0.6  # times its agreement
_LEAST = 1.45  # contrast with which something focuses at all
_LEAST_COVERAGE = 0.25
_LARGEST_OFFSET_S = 2.0
_MOST_OFFSETS = 40  # on each side
_OFFSET_BUDGET = 1_500_000
FEWEST_PULSES = 16


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
        What tells the mistake, where it is not the focus.
    gain : float
        Agreement of the pulses with the mistake undone over that of the data; 1 where nothing was.

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

    @property
    def focused(self) -> bool:
        """True when scatterers stand out as they are."""
        return self.coherence >= NOTHING and not self.mistake

    def __str__(self) -> str:
        figure = f'focus {self.coherence:.2f} (noise 1, focused scatterers 2 and more)'
        if self.mistake and self.corrected > self.coherence:
            return f'{self.advice} (focus {self.coherence:.2f} becomes {self.corrected:.2f})'
        if self.advice:
            return f'{self.advice}; {figure}'
        return f'{figure}, no mistake found'


def diagnose(block: PulseBlock, grid: MapGrid, *, window: str = 'none') -> Diagnosis:
    """Look for the mistake that keeps an aperture from focusing.

    Tries, on the brightest part of the image alone: conjugated samples (or Q and I exchanged),
    the sign of the slope, positions in millimetres, centimetres or kilometres, exchanged x
    and y, a mirrored track, one-way delays, positions against the order of pulses, and an offset
    of the clock of up to 2 s. Takes a few seconds at most, on any size of image.

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
        Of the range compression of raw pulses.

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
    attempt = _Attempts(grid, window)
    first = attempt.coherence(block)
    _logger.debug('as is: %s', first)
    if block.n_pulses * block.n_channels < FEWEST_PULSES:
        return as_it_is(first, too_few(block))
    if first.contrast >= FOCUSED:
        return as_it_is(first)
    found = _best(attempt.hypotheses(block, HYPOTHESES), first)
    doubts = track_doubts(block)
    if found is not None and doubts and found[1].contrast < _CLEARLY:
        found = None  # what is odd about the track explains more
    if not doubts and found is None:
        found = _best(attempt.offsets(block), first)
    if found is not None:
        return explained(first, *found, first)
    return unexplained(first, doubts)


def as_it_is(first: Coherence, advice: str = '') -> Diagnosis:
    """No mistake is named."""
    return Diagnosis(first.contrast, first.coverage, corrected=first.contrast, advice=advice)


def too_few(block: PulseBlock) -> str:
    """What is said of a block that is too short to be judged."""
    return f'{block.n_pulses} pulses are too few to judge the focus'


def explained(first: Coherence, hypothesis: Hypothesis, undone: Coherence, before: Coherence
              ) -> Diagnosis:
    """A mistake is named; its undoing gave the second coherence, to the same pulses the third."""
    return Diagnosis(first.contrast, first.coverage, hypothesis.name, hypothesis.advice,
                     undone.contrast, gain=gain_of(undone, before))


def unexplained(first: Coherence, doubts: list[str]) -> Diagnosis:
    """No mistake focuses the image better; what is odd about the track is told."""
    if doubts:
        return Diagnosis(first.contrast, first.coverage, 'odd positions', '; '.join(doubts),
                         first.contrast)
    return as_it_is(first, '' if first.contrast >= NOTHING else nothing_helps(first))


def nothing_helps(first: Coherence) -> str:
    """What is said of an image without focus that no hypothesis explains."""
    if not first.coverage:
        return ('the profiles do not reach the grid, and no hypothesis about units, axes or '
                'delays explains it; check the positions of antenna and grid')
    return ('nothing stands out from noise, and no hypothesis about samples, positions or clock '
            'helps: an empty scene, or a mistake that is not among them')


class _Attempts:
    """Coherence of one aperture as it is and with mistakes undone."""

    def __init__(self, grid: MapGrid, window: str):
        self._grid, self._window = grid, window

    def coherence(self, block: PulseBlock) -> Coherence:
        """Coherence of a block, 0 where it does not reach the grid."""
        return CoherenceProbe(self._grid)(self._compressed(block))

    def _compressed(self, block: PulseBlock) -> PulseBlock:
        window = 'none' if block.compressed else self._window
        return RangeCompressor.for_block(block, window=window, oversampling=OVERSAMPLING)(block)

    def hypotheses(self, block: PulseBlock, hypotheses: Iterable[Hypothesis]
                   ) -> Iterator[tuple[Hypothesis, Coherence]]:
        """Coherence with each hypothesis that applies."""
        profiles = self._compressed(block)
        for hypothesis in hypotheses:
            # Positions can be changed on the profiles, compressed once.
            anew = hypothesis.of_samples or hypothesis.name.startswith('delay')
            source = block if anew else profiles
            for changed in hypothesis.undo(source):
                try:
                    ready = self._compressed(changed) if anew else changed
                except ValueError:
                    continue  # impossible as well
                result = CoherenceProbe(self._grid)(ready)
                _logger.debug('%s: %s', hypothesis.name, result)
                yield hypothesis, result

    def offsets(self, block: PulseBlock) -> Iterator[tuple[Hypothesis, Coherence]]:
        """Coherence with the best offset of the clock: searched, then refined."""
        profiles = self._compressed(block)
        places = self._grid.points()[::self._grid.n_y // 2 or 1, ::self._grid.n_x // 2 or 1]
        offsets = clock_offsets(profiles, places.reshape(-1, 3), _LARGEST_OFFSET_S,
                                _MOST_OFFSETS)
        if not len(offsets):
            return
        probe = CoherenceProbe(self._grid, _OFFSET_BUDGET)
        best, result = _searched(lambda offset: probe(with_offset(profiles, offset)), offsets)
        yield clock_offset(best), result


def _searched(coherence: Callable[[float], Coherence], values: np.ndarray
              ) -> tuple[float, Coherence]:
    """The value of the largest contrast: searched among evenly spaced ones, then refined."""
    contrasts = [coherence(value).contrast for value in values]
    best, step = float(values[np.argmax(contrasts)]), float(values[1] - values[0])
    for finer in (3, 9):
        tries = best + step / finer * np.arange(-2, 3)
        results = [coherence(value) for value in tries]
        at = int(np.argmax([result.contrast for result in results]))
        best = float(tries[at])
    _logger.debug('%s: %s', best, results[at])
    return best, results[at]


def _best(results: Iterable[tuple[Hypothesis, Coherence]], first: Coherence
          ) -> tuple[Hypothesis, Coherence] | None:
    """The hypothesis that focuses clearly better than the data as they are."""
    best, score = None, 0.0
    for hypothesis, result in results:
        if result.coverage < _LEAST_COVERAGE or result.contrast < _LEAST:
            continue
        gain = result.contrast / max(_BETTER * first.contrast, 1e-9)
        if result.agreement < _DARKER * first.agreement:
            gain = 0.0  # a part of the scene went dark, which is not focus
        if hypothesis.of_samples and result.contrast > 0.9 * first.contrast:
            gain = max(gain, result.sharpness / max(_SHARPER * first.sharpness, 1e-9))
        if gain > max(score, 1.0):
            best, score = (hypothesis, result), gain
    return best
