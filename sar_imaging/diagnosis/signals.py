# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Look for faults in raw pulses themselves: samples, times and channels, before any image.

- `sample_findings`: clipping, missing or unequal I and Q, their order, pulses cut short, bursts;
- `channel_findings`: dead, equal and unbalanced channels;
- `slope_findings`: chirps that another slope compresses better;
- `coupling_findings`: an echo that does not move with the platform;
- `timing_findings`: lost pulses, stamps of receipt, stamps of whole frames.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator

import numpy as np
from scipy import fft

from ..signal.background import subtract_background
from ..signal.pulses import PulseBlock
from ..signal.radar import Waveform
from ..signal.range_compression import RangeCompressor
from .hypotheses import with_slope, wrong_slope

__all__ = ['CERTAIN', 'LIKELY', 'ONE_OF_SEVERAL', 'Finding', 'channel_findings',
           'coupling_findings', 'sample_findings', 'slope_findings', 'timing_findings']

CERTAIN = 'certain'
LIKELY = 'likely'
ONE_OF_SEVERAL = 'one of several explanations that are as good'
# Clipping piles samples up at the largest value. Of a sinusoid 2.9 % lie within 0.1 % of its
# amplitude and 6.2 % in the next 0.9 %; of Gaussian samples, fewer and fewer.
_TOP, _NEXT = 0.999, 0.99
_PILED = 2.0
_FEWEST_CLIPPED = 20
_NONE = 1e-3  # of I in Q, or the other way round
_ALIKE = 0.98  # correlation of I and Q from which they are one signal
_NEAR_ZERO, _EVEN = 0.15, 0.3  # of the median: what magnitudes fall below; of offsets
_IMAGE = 0.03  # amplitude of the mirrored spectrum from which it shows in images, -30 dB
_SIGNIFICANT = 6.0  # standard deviations
_PARTS, _FEWEST_BANDS = 16, 2.0  # of pulses and of the band; of those that hold power
_SHORTEST = 8.0  # cycles of the bandwidth in a pulse that is no mere impulse
_MOST_PULSES = 256
_CUT = 1 / 32  # of a pulse that is zero at its end
_FEWEST_MOVING = 32  # pulses that tell what stays
_BURST = 10.0  # power of a pulse over the median, and of its floor
_LOW_SIDELOBES, _WEAKEST = 'hann', 25.0  # window, and per cent of the range bins, of a floor
_UNDONE = 3.0  # times by which the right order lowers the mirrored spectrum
_NOTICED, _GONE = 4.0, 2.5  # standard deviations of an image that is there, and of none
_MORE_FOCUSED = 1.6  # concentration of the profiles in another order of samples
_DEAD_DB = -25.0
_UNEQUAL_DB = 2.0
_EQUAL = 0.9999  # correlation of the samples of two channels
_FEW_PULSES = 64
_FACTORS = np.linspace(0.7, 1.45, 61)  # fine enough for time-bandwidth products of some hundreds
_FINER = (3, 9)
_SHARPER = 1.25  # times the concentration with the slope as it is given
_STILL = 10.0  # power of what stays over that of what changes, in the same range bin
_STRONG = 1.0  # power of what stays over the strongest that changes
_AS_STRONG = 0.8  # of the largest power
_MOVED = 4.0  # wavelengths that the platform has to move
_MANY_PULSES = 512
_FEWEST_TIMES = 16  # pulses that tell a pattern
_GAP = 1.6  # intervals between two pulses that follow each other by their numbers
_LATE = 0.03  # of an interval: scatter of the stamps from which receipt is likely
_LEAST_LATE_S = 20e-6
_HALF = 8  # pulses on each side of one whose neighbours tell its time
_SCATTER = 1.48  # standard deviation of normal numbers over their median magnitude
_SHARED = 0.5  # of the pulses, that have the stamp of the one before
_REGULAR = 0.95  # of the frames, that have as many pulses as most


@dataclasses.dataclass(frozen=True)
class Finding:
    """One fault of a recording.

    Parameters
    ----------
    fault : str
        Its name, the same for all recordings: ``'clipping'``.
    evidence : str
        What was measured, a sentence with figures.
    advice : str
        What to change, a sentence.
    compared : str
        What else would look like it, and was looked for.
    sure : str
        ``'certain'``, ``'likely'`` where another cause is possible, or that it is one of several
        explanations that are as good.
    sizes : tuple of float
        Sizes of the fault, where it was measured: offset of a clock in seconds, rate of a clock,
        factor of a slope, lever arm in metres.

    Examples
    --------
    >>> from sar_imaging.diagnosis.signals import Finding
    >>> finding = Finding('clipping', '3 % of the samples lie at the end of the scale',
    ...                   'lower the gain of the receiver', 'echoes that are strong')
    >>> print(finding)
    clipping: 3 % of the samples lie at the end of the scale. Compared with echoes that are
    strong: certain. Lower the gain of the receiver.
    """

    fault: str
    evidence: str
    advice: str
    compared: str = ''
    sure: str = CERTAIN
    sizes: tuple[float, ...] = ()

    def __str__(self) -> str:
        compared = f'Compared with {self.compared}: {self.sure}. ' if self.compared else ''
        advice = f'{self.advice[0].upper()}{self.advice[1:]}.'
        return f'{self.fault}: {self.evidence}. {compared}{advice}'


def sample_findings(block: PulseBlock) -> list[Finding]:
    """Find faults of raw samples: clipping, missing or exchanged I and Q, bursts.

    Parameters
    ----------
    block : PulseBlock
        Raw pulses; positions are not needed. Of range profiles it is only told whether they have
        a phase.

    Returns
    -------
    list of Finding

    Examples
    --------
    >>> import dataclasses
    >>> import numpy as np
    >>> from sar_imaging import concatenate
    >>> from sar_imaging.diagnosis.signals import sample_findings
    >>> from sar_imaging.simulation import SCENARIOS
    >>> block = concatenate(list(SCENARIOS['psf_raw']().blocks()))
    >>> sample_findings(block)
    []
    >>> real = dataclasses.replace(block, samples=block.samples.real.astype(np.complex64))
    >>> [finding.fault for finding in sample_findings(real)]
    ['real samples']
    """
    if not block.n_pulses:
        return []
    without_phase = _magnitudes(block)
    if block.compressed:
        return [without_phase] if without_phase else []
    found = [_clipping(block), without_phase or _components(block), _cut_short(block),
             _bursts(block)]
    if not block.radar.waveform.is_real and found[1] is None:
        found.append(_order(block) or _imbalance(block))
    return [finding for finding in found if finding is not None]


def _some(block: PulseBlock) -> PulseBlock:
    """Pulses spread over the block, as many as the statistics need."""
    step = -(-block.n_pulses // _MOST_PULSES)
    return block.select(slice(None, None, step)) if step > 1 else block


def _components_of(block: PulseBlock) -> Iterator[tuple[int, str, np.ndarray]]:
    real = block.radar.waveform.is_real
    for channel in range(block.n_channels):
        samples = block.samples[:, channel]
        yield channel, 'I' if not real else 'real', samples.real
        if not real:
            yield channel, 'Q', samples.imag


def clipped_share(values: np.ndarray) -> float:
    """Share of values that lie at the largest magnitude, 0 where they do not pile up there."""
    magnitude = np.abs(values)
    top = float(magnitude.max(initial=0.0))
    if top == 0:
        return 0.0
    piled = int(np.count_nonzero(magnitude >= _TOP * top))
    below = int(np.count_nonzero(magnitude >= _NEXT * top)) - piled
    return piled / values.size if piled >= max(_FEWEST_CLIPPED, _PILED * below) else 0.0


def _clipping(block: PulseBlock) -> Finding | None:
    shares = [(clipped_share(values), float(np.abs(values).max()), channel, name)
              for channel, name, values in _components_of(block)]
    share, level, channel, name = max(shares)
    if not share:
        return None
    n = len({channel for share, _, channel, _ in shares if share})
    return Finding('clipping', (
        f'{share:.2%} of the {name} samples of channel {channel} lie at the largest value, '
        f'{level:g}' + (f'; {n} of {block.n_channels} channels clip' if n > 1 else '')),
        'lower the gain of the receiver, or attenuate the coupling between its antennas: clipped '
        'echoes of strong reflectors raise the floor of the whole profile',
        'echoes that are strong, of which fewer samples reach the top than come near it')


def _magnitudes(block: PulseBlock) -> Finding | None:
    """Values that are never negative, and lie around no offset: their phase is lost.

    Samples around the offset of a converter reach as far below its value as above it.
    Magnitudes reach zero, and farther above their median than that.
    """
    samples = _some(block).samples
    if samples.imag.any() or samples.real.min() < 0:
        return None
    low, median, high = np.percentile(samples.real, [0.1, 50.0, 99.9])
    if median <= 0 or low > _NEAR_ZERO * median or abs(high + low - 2 * median) < _EVEN * median:
        return None
    return Finding('magnitudes only', (
        f'no sample is negative, one in a thousand is below {low / median:.2g} and one above '
        f'{high / median:.2g} times the median'),
        'let the driver publish samples, not their magnitudes (publish_magnitude: false of '
        'bgt60tr13c_ros2): without phase nothing can be focused',
        'samples around the offset of a converter, which reach as far below it as above', LIKELY)


def _components(block: PulseBlock) -> Finding | None:
    """I or Q missing, or both the same."""
    if block.radar.waveform.is_real:
        return None
    samples = _some(block).samples
    i, q = (float(np.sqrt(np.mean(np.square(part, dtype=float))))
            for part in (samples.real, samples.imag))
    if max(i, q) == 0:
        return Finding('no signal', 'all samples are zero',
                       'check the connection of the receiver and the variable that was loaded')
    if min(i, q) < _NONE * max(i, q):
        # magnitudes of one strong echo never come near zero, as samples around an offset do not
        positive = samples.real.min() >= 0 and samples.imag.min() >= 0
        return Finding('real samples', (
            f'{"Q" if q < i else "I"} is {min(i, q) / max(i, q):.1g} times the other component: '
            f'these are real samples{", none of them negative" if positive else ""}'),
            'give the waveform FMCW_REAL (dechirped) or PASSBAND (pulses), or load both '
            'components' + ('; where they are magnitudes, let the driver publish samples'
                            if positive else ''),
            'complex samples, whose components are of like power',
            ONE_OF_SEVERAL if positive else CERTAIN)
    correlation = float(np.mean(samples.real * samples.imag, dtype=float)) / (i * q)
    if abs(correlation) > _ALIKE:
        return Finding('I and Q alike', f'the correlation of I and Q is {correlation:.3f}',
                       'load the second component from its own variable or words',
                       'components of complex samples, which are not correlated')
    return None


def _cut_short(block: PulseBlock) -> Finding | None:
    """Some pulses end in zeros, as frames that lost packets do."""
    n_end = max(4, int(_CUT * block.n_samples))
    dead = ~block.samples[..., -n_end:].any(axis=-1)
    cut = (dead & block.samples.any(axis=-1)).any(axis=-1)
    empty = ~block.samples.any(axis=(1, 2))
    n = int(np.count_nonzero(cut | empty))
    if not n or cut.all() or empty.all():
        return None
    return Finding('incomplete pulses', (
        f'{n} of {block.n_pulses} pulses are empty or end in zeros'),
        'drop them or send them again: packets were lost between radar and computer; enlarge its '
        'network buffers', 'echoes that fade, whose samples are not all exactly zero')


def _bursts(block: PulseBlock) -> Finding | None:
    """Single pulses of more power, also where there is no echo.

    A reflector that flashes in one pulse, as the edge of a raster's target does, adds power to few
    range bins; another transmitter raises the floor between the echoes as well.
    """
    power = np.mean(np.square(np.abs(block.samples), dtype=float), axis=(1, 2))
    median = float(np.median(power))
    odd = power > _BURST * median if median > 0 else np.zeros(len(power), bool)
    # a reflector that the beam sweeps over is in many pulses in a row
    alone = np.flatnonzero(odd & ~(np.roll(odd, 2) | np.roll(odd, -2)))
    if not len(alone):
        return None
    rise = _floor(block.select(alone)) / max(float(np.median(_floor(_some(block)))), 1e-300)
    alone, rise = alone[rise > _BURST], rise[rise > _BURST]
    if not len(alone):
        return None
    return Finding('interference', (
        f'{len(alone)} of {block.n_pulses} pulses have '
        f'{10 * math.log10(power[alone].max() / median):.0f} dB more power than the others, and '
        f'{10 * math.log10(rise.min()):.0f} dB more between the echoes'),
        'leave these pulses out, and look for another radar or transmitter in the band',
        'reflectors that flash, which leave the floor between the echoes as it is', LIKELY)


def _floor(block: PulseBlock) -> np.ndarray:
    """(P,) power of range profiles where the echoes are weakest."""
    profiles = RangeCompressor.for_block(block, window=_LOW_SIDELOBES)(block).samples
    power = np.square(np.abs(profiles), dtype=float).mean(axis=1)
    return np.percentile(power[:, (power > 0).any(axis=0)], _WEAKEST, axis=1)


def _concentration(block: PulseBlock) -> float:
    """How much of the energy of the profiles lies in few range bins; 1 where in all alike."""
    profiles = RangeCompressor.for_block(block)(block).samples
    power = np.mean(np.square(np.abs(profiles), dtype=float), axis=(0, 1))
    return float(np.mean(np.square(power)) / np.mean(power)**2)


def with_words_exchanged(samples: np.ndarray) -> np.ndarray:
    """Samples whose words came as I0 I1 Q0 Q1 and were read as I0 Q0 I1 Q1, or the reverse.

    Both mistakes exchange the two words in the middle of four.
    """
    pairs = samples.reshape(*samples.shape[:-1], -1, 2)
    first, second = pairs[..., 0], pairs[..., 1]
    return np.stack([first.real + 1j * second.real, first.imag + 1j * second.imag],
                    axis=-1).reshape(samples.shape)


def _order(block: PulseBlock) -> Finding | None:
    if block.n_samples % 2:
        return None
    some = _some(block)
    exchanged = dataclasses.replace(some, samples=with_words_exchanged(some.samples))
    sharp = _concentration(exchanged)
    # the exchange also mends a part of a chirp whose I and Q are exchanged
    if sharp < _concentration(dataclasses.replace(some, samples=some.samples.conj())):
        return None
    better = sharp / _concentration(some)
    # exchanged words mirror a part of the spectrum, which the exchange undoes
    image = _undone_image(_moving(some), _moving(exchanged)) if better > 1 else 0.0
    if better < _MORE_FOCUSED and not image:
        return None
    return Finding('order of I and Q', (
        f'with the second and third of every four words exchanged the profiles are {better:.2f} '
        f'times as concentrated' + (
            f', and the mirrored spectrum of {20 * math.log10(image):.0f} dB goes'
            if image else '')),
        'read the words as I0 I1 Q0 Q1 where I0 Q0 I1 Q1 was read, or the other way round',
        'samples as they are, and I and Q exchanged', LIKELY)


def _undone_image(given: np.ndarray, exchanged: np.ndarray) -> float:
    """Amplitude of the mirrored spectrum that an exchange of words takes away; 0 for none.

    Samples (P, C, N) complex are those that were given, and the same with words exchanged.
    A tone at the frequency w, radians per sample, is mirrored with the amplitude
    ``cot(w / 2 + pi / 4)``: about ``cos(w) / 2`` near a quarter of the sampling rate, where the
    sign changes and the mean of all frequencies shows nothing. The image of unequal I and Q loses
    its phase by the exchange, not its power.
    """
    image, deviation = max(_amplitudes(given))
    rest, _ = max(_amplitudes(exchanged))
    if image < _NOTICED * deviation or rest > max(image / _UNDONE, _GONE * deviation):
        return 0.0
    pairs = [[_mirrored_pairs(samples[:, c])[:2] for c in range(given.shape[1])]
             for samples in (given, exchanged)]
    signal = sum(_power(signal) for signal, _ in pairs[0])
    before, after = (sum(_power(image) for _, image in some) for some in pairs)
    scatter = before / math.sqrt(sum(image.size for _, image in pairs[0]))
    return image if before - after > image**2 * signal / 2 - _NOTICED * scatter else 0.0


def _amplitudes(samples: np.ndarray) -> list[tuple[float, float]]:
    """Magnitudes of mirrored spectra in samples (P, C, N), even and odd, and their deviations."""
    found = (image_amplitude(samples[:, c], odd) for c in range(samples.shape[1])
             for odd in (False, True))
    return [(abs(amplitude), deviation) for amplitude, deviation in found]


def image_amplitude(samples: np.ndarray, odd: bool = False, *, by_parts: bool = False
                    ) -> tuple[complex, float]:
    """Amplitude of the mirrored spectrum in samples (P, N), and its standard deviation.

    Unequal gains ``1 + e`` and phases ``p`` of I and Q add ``(e + j p) / 2`` times the conjugated
    signal, whose spectrum is mirrored at zero frequency. It is estimated by least squares from
    bins of opposite frequency. Where `odd`, it is the rms amplitude of an image that is in
    proportion to the cosine of the frequency in radians per sample.

    An image of the receiver is the same in all pulses and at all frequencies; echoes at opposite
    frequencies happen to have phases alike in some. `by_parts` the deviation is therefore that of
    parts of the pulses, or of the band where more than one part of it holds power, whichever is
    larger; else that of independent bins.
    """
    signal, image, frequency = _mirrored_pairs(samples)
    whole = _power(signal)
    if odd:
        signal = signal * np.cos(frequency)
    power = np.square(np.abs(signal), dtype=float)
    total = float(power.sum())
    if total == 0:
        return 0j, math.inf
    products = image * signal.conj()
    amplitude = complex(np.sum(products, dtype=complex)) / total
    rest = products - amplitude * power
    deviation = (max(_deviation(rest, power, axis) for axis in (0, 1)) if by_parts else
                 math.sqrt(_power(rest)) / total)
    share = math.sqrt(total / whole)
    return amplitude * share, deviation * share


def _deviation(rest: np.ndarray, power: np.ndarray, axis: int) -> float:
    """Deviation of a mean, weighted by power (P, K), of which rest (P, K) is left, by parts."""
    starts = np.unique(np.linspace(0, rest.shape[axis], _PARTS, endpoint=False).astype(int))
    parts = np.add.reduceat(rest, starts, axis=axis).sum(axis=1 - axis)
    weight = np.add.reduceat(power, starts, axis=axis).sum(axis=1 - axis)
    total = weight.sum()
    n = total**2 / max(float(np.sum(np.square(weight))), 1e-300)  # that hold power
    if axis == 1 and n < _FEWEST_BANDS:
        return 0.0
    return math.sqrt(float(np.sum(np.square(np.abs(parts)))) * n / max(n - 1, 1e-3)) / total


def _mirrored_pairs(samples: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Conjugated bins of the signal, those of the opposite frequency, and this in rad/sample."""
    spectrum = fft.fft(samples - samples.mean(axis=-1, keepdims=True), axis=-1)
    n = samples.shape[-1]
    k = np.arange(2, n - 1)  # without zero frequency and its neighbours
    k = k[k != n // 2]
    one, mirrored = spectrum[..., k], spectrum[..., -k].conj()
    # of each pair the stronger one is the signal
    weak = np.sum(np.square(np.abs(one)), axis=0) <= np.sum(np.square(np.abs(mirrored)), axis=0)
    return mirrored[..., weak], one[..., weak], 2 * np.pi / n * k[weak]


def _power(values: np.ndarray) -> float:
    return float(np.sum(np.square(np.abs(values)), dtype=float))


def _moving(block: PulseBlock) -> np.ndarray:
    """Samples without what stays from pulse to pulse, such as coupling and offsets."""
    few = block.n_pulses < _FEWEST_MOVING
    return (block if few else subtract_background(block)).samples


def _image(block: PulseBlock) -> tuple[complex, int]:
    """Largest significant amplitude of a mirrored spectrum, 0 for none, and its channel."""
    samples = _moving(block)
    worst, at = 0j, 0
    for channel in range(block.n_channels):
        amplitude, deviation = image_amplitude(samples[:, channel], by_parts=True)
        if abs(amplitude) > max(abs(worst), _IMAGE, _SIGNIFICANT * deviation):
            worst, at = amplitude, channel
    return worst, at


def _imbalance(block: PulseBlock) -> Finding | None:
    radar = block.radar
    if radar.waveform == Waveform.LFM and radar.pulse_length_s * radar.bandwidth_hz < _SHORTEST:
        return None  # of an impulse the spectrum of a single echo is mirrored
    worst, at = _image(_some(block))
    if not worst:
        return None
    gain_db = 20 * math.log10(abs(1 + 2 * worst.real))
    return Finding('unequal I and Q', (
        f'channel {at} holds its mirrored spectrum at {20 * math.log10(abs(worst)):.0f} dB: I and '
        f'Q differ by {abs(gain_db):.1f} dB and {abs(math.degrees(2 * worst.imag)):.0f} degrees '
        'from a right angle'), 'equalise I and Q (gain and phase) before the pulses are sent on',
        'echoes at opposite frequencies, whose phases differ from pulse to pulse', LIKELY)


def channel_findings(block: PulseBlock) -> list[Finding]:
    """Find dead, equal and unbalanced channels.

    Parameters
    ----------
    block : PulseBlock
        Raw or compressed.

    Returns
    -------
    list of Finding

    Examples
    --------
    >>> import dataclasses
    >>> from sar_imaging import concatenate
    >>> from sar_imaging.diagnosis.signals import channel_findings
    >>> from sar_imaging.simulation import SCENARIOS
    >>> block = concatenate(list(SCENARIOS['psf_raw']().blocks()))
    >>> samples = block.samples.copy()
    >>> samples[:, 2] = 0.0
    >>> for finding in channel_findings(dataclasses.replace(block, samples=samples)):
    ...     print(finding.evidence)
    channel 2 is 299 dB or more below the others
    channels 0 and 1, 1 and 3, 3 and 4 hold the same samples
    """
    if block.n_channels < 2 or not block.n_pulses:
        return []
    step = max(1, block.n_pulses // 256)
    samples = block.samples[::step] - block.samples.mean(axis=0, keepdims=True)
    power = np.mean(np.square(np.abs(samples), dtype=float), axis=(0, 2))
    dead = power <= 10 ** (_DEAD_DB / 10) * power.max()
    level_db = 10 * np.log10(np.maximum(power, 1e-30) / max(np.median(power[~dead]), 1e-30))
    found = []
    if dead.any():
        found.append(Finding('dead channel', (
            f'channel {_listed(dead)} is {-level_db[dead].max():.0f} dB or more below the others'),
            'check its antenna and receiver, or leave it out',
            'channels that see less of the scene'))
    unequal = ~dead & (np.abs(level_db) > _UNEQUAL_DB)
    if unequal.any():
        worst = float(level_db[unequal][np.abs(level_db[unequal]).argmax()])
        found.append(Finding('unbalanced channels', (
            f'channel {_listed(unequal)} differs from the median of the channels by '
            f'{worst:+.1f} dB and less'),
            'measure the errors of the channels with `sar-imaging calibrate`, and give them to '
            'range_compression as calibration_file',
            'antennas that see different parts of the scene', LIKELY))
    equal = _equal_pairs(samples, ~dead)
    if equal:
        found.append(Finding('channel twice', (
            'channels ' + ', '.join(f'{a} and {b}' for a, b in equal) + ' hold the same samples'),
            'check the order of axes with which the samples were loaded',
            'channels side by side, whose noise differs'))
    return found


def _equal_pairs(samples: np.ndarray, alive: np.ndarray) -> list[tuple[int, int]]:
    numbers = np.flatnonzero(alive)
    rows = samples[:, numbers].swapaxes(0, 1).reshape(len(numbers), -1)
    products = np.abs(rows.conj() @ rows.T)
    norms = np.sqrt(np.maximum(np.diag(products), 1e-30))
    alike = products > _EQUAL * norms[:, None] * norms
    return [(int(numbers[a]), int(numbers[b])) for a, b in zip(*np.nonzero(alike), strict=True)
            if a < b]


def _listed(chosen: np.ndarray) -> str:
    return ', '.join(map(str, np.flatnonzero(chosen)))


def concentration(block: PulseBlock) -> float:
    """How much of the energy of each profile lies in few range bins; 1 where in all alike."""
    profiles = RangeCompressor.for_block(block)(block).samples
    power = np.square(np.abs(profiles), dtype=float)
    return float(np.mean(np.square(power)) / max(np.mean(power)**2, 1e-300))


def slope_findings(block: PulseBlock) -> list[Finding]:
    """Find whether another slope of the chirp compresses the pulses better.

    A wrong slope leaves a quadratic phase over the band and smears each echo by the error of the
    pulse length. This tells chirps that are compressed by a filter (`Waveform.LFM`). Those that
    were dechirped in the radar keep their sharpness, and their ranges are wrong instead.

    Parameters
    ----------
    block : PulseBlock
        Raw; positions are not needed.

    Returns
    -------
    list of Finding
        At most one.

    Examples
    --------
    >>> import dataclasses
    >>> from sar_imaging import concatenate
    >>> from sar_imaging.diagnosis.signals import slope_findings
    >>> from sar_imaging.simulation import SCENARIOS
    >>> block = concatenate(list(SCENARIOS['spotlight']().blocks()))
    >>> slope_findings(block)
    []
    >>> slope = block.radar.chirp_rate_hz_per_s
    >>> radar = dataclasses.replace(block.radar, chirp_rate_hz_per_s=-slope)
    >>> [finding.fault for finding in slope_findings(dataclasses.replace(block, radar=radar))]
    []
    """
    radar = block.radar
    if block.compressed or radar.waveform != Waveform.LFM or not radar.chirp_rate_hz_per_s:
        return []
    some = block.select(slice(None, None, -(-block.n_pulses // _FEW_PULSES)))
    some = dataclasses.replace(
        some, samples=some.samples[:, :1], tx_m=None, rx_m=None)

    def sharp(factor: float) -> float:
        try:
            return concentration(with_slope(some, factor))
        except ValueError:  # no such chirp
            return 0.0

    best, step = max(_FACTORS, key=sharp), float(_FACTORS[1] - _FACTORS[0])
    for finer in _FINER:
        best = max((best + step / finer * k for k in range(-2, 3)), key=sharp)
    gain = sharp(best) / max(sharp(1.0), 1e-300)
    if gain < _SHARPER:
        return []
    mistake = wrong_slope(float(best), radar)
    return [Finding(mistake.name, f'with {best:.3g} times the slope the energy of each profile is '
                    f'{gain:.1f} times as concentrated', mistake.advice,
                    'the slope that is given, and others from 0.7 to 1.45 times it',
                    sizes=mistake.sizes)]


def coupling_findings(block: PulseBlock) -> list[Finding]:
    """Find an echo that does not move with the platform and is stronger than the scene.

    Parameters
    ----------
    block : PulseBlock
        Raw or compressed, of a platform that moves; with positions, it is checked that it does.

    Returns
    -------
    list of Finding
        At most one.

    Examples
    --------
    >>> import dataclasses
    >>> from sar_imaging import concatenate
    >>> from sar_imaging.diagnosis.signals import coupling_findings
    >>> from sar_imaging.simulation import SCENARIOS
    >>> block = concatenate(list(SCENARIOS['spotlight']().blocks()))
    >>> coupling_findings(block)
    []
    >>> samples = block.samples.copy()
    >>> samples[..., 20] += 500.0  # from antenna to antenna
    >>> coupled = dataclasses.replace(block, samples=samples)
    >>> [finding.fault for finding in coupling_findings(coupled)]
    ['coupling']
    """
    if block.n_pulses < _FEWEST_MOVING:
        return []
    if block.has_positions:
        moved = np.ptp(block.phase_centre_m, axis=0).max()
        if moved < _MOVED * block.radar.wavelength_m:
            return []
    step = -(-block.n_pulses // _MANY_PULSES)
    some = block.select(slice(None, None, step))
    compressor = RangeCompressor.for_block(some)
    profiles = compressor(some).samples
    stays = np.square(np.abs(profiles.mean(axis=0)))
    changes = np.mean(np.square(np.abs(profiles), dtype=float), axis=0) - stays
    ratio = np.where(stays > _STILL * changes, stays, 0.0).max(axis=0)
    # profiles of ramps are periodic: the nearest of places that are as strong
    at = int(np.flatnonzero(ratio >= _AS_STRONG * ratio.max())[0])
    strongest = float(changes.max())
    if ratio[at] <= _STRONG * strongest:
        return []
    radar = compressor.output_radar
    return [Finding('coupling', (
        f'what stays at {radar.range_start_m + at * radar.sample_spacing_m:.2f} m while the '
        f'platform moves is {10 * math.log10(ratio[at] / max(strongest, 1e-30)):.0f} dB above '
        'the strongest echo that changes'),
        'shield the antennas from each other; meanwhile subtract what stays: parameter '
        'background_s of range_compression',
        'echoes of the scene, which change while the platform moves')]


def timing_findings(block: PulseBlock) -> list[Finding]:
    """Find lost pulses and times that are not those of transmission.

    Parameters
    ----------
    block : PulseBlock
        Pulses in the order sent, raw or compressed.

    Returns
    -------
    list of Finding

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging import concatenate
    >>> from sar_imaging.diagnosis.signals import timing_findings
    >>> from sar_imaging.simulation import SCENARIOS
    >>> block = concatenate(list(SCENARIOS['psf']().blocks()))
    >>> timing_findings(block)
    []
    >>> kept = np.delete(np.arange(200), [40, 41, 90])  # lost on the way
    >>> for finding in timing_findings(block.select(kept)):
    ...     print(finding.evidence)
    3 of 200 pulses are missing in 2 gaps of their numbers, up to 2 in a row
    """
    order = np.argsort(block.counter.astype(np.int64), kind='stable')
    counter = block.counter.astype(np.int64)[order]
    found = [_lost(counter)]
    if block.n_pulses >= _FEWEST_TIMES:
        time_s = (block.stamp_ns[order] - block.stamp_ns[order[0]]) * 1e-9
        found.append(_frames(counter, time_s))
    if found[1:] == [None]:
        found.append(_backward(time_s))
        what, counter, time_s = _rhythm(counter, time_s)
        pauses = _pauses(counter, time_s)
        found.append(_receipt(what, counter, time_s, pauses) or _gaps(what, pauses))
    return [finding for finding in found if finding is not None]


def _lost(counter: np.ndarray) -> Finding | None:
    steps = np.diff(counter)
    n_lost, n_gaps = int((steps - 1).clip(0).sum()), int(np.count_nonzero(steps > 1))
    if not n_lost:
        return None
    return Finding('lost pulses', (
        f'{n_lost} of {n_lost + len(counter)} pulses are missing in {n_gaps} gaps of their '
        f'numbers, up to {int(steps.max()) - 1} in a row'),
        'enlarge queues and network buffers between radar and recorder; images take gaps into '
        'account, but their sidelobes rise', 'numbers that are all there')


def _rhythm(counter: np.ndarray, time_s: np.ndarray) -> tuple[str, np.ndarray, np.ndarray]:
    """Frames, by their first pulses, of a radar that pauses after each; else its pulses.

    Returns their name, numbers and times, seconds.
    """
    steps = np.diff(time_s) / np.diff(counter).clip(1)
    starts = 1 + np.flatnonzero(steps > _GAP * np.percentile(steps, 25))  # half, of two pulses
    if len(starts) >= _FEWEST_TIMES:
        since = counter[starts] - counter[starts[0]]
        length = int(np.median(np.diff(since)))
        if length > 1 and np.mean(since % length == 0) >= _REGULAR:
            return 'frames', since // length, time_s[starts]
    return 'pulses', counter, time_s


def _pauses(counter: np.ndarray, time_s: np.ndarray) -> np.ndarray:
    """(P - 1,) how many pulses more each interval holds whose numbers follow each other."""
    steps = np.diff(time_s)
    around = median_around(steps, _HALF)
    odd = (np.diff(counter) == 1) & (steps > _GAP * around) & (around > 0)
    return np.where(odd, np.rint(steps / np.where(odd, around, 1.0) - 1), 0).astype(int)


def _gaps(what: str, pauses: np.ndarray) -> Finding | None:
    """Pauses between pulses, or frames, whose numbers follow each other."""
    n = np.count_nonzero(pauses)
    if not n or n > 0.1 * len(pauses):
        return None  # none, or the rhythm of the radar
    return Finding('lost pulses without gaps in their numbers', (
        f'{n} pauses hold about {pauses.sum()} {what} more, although the '
        'numbers of the pulses follow each other'),
        'let the radar number its pulses, not the program that receives them: positions by '
        'number are wrong after each pause', 'the rhythm of a radar that sends frames', LIKELY)


def _frames(counter: np.ndarray, time_s: np.ndarray) -> Finding | None:
    """Many pulses have the stamp of the one before: the time of their frame."""
    same = (np.diff(time_s) == 0) & (np.diff(counter) > 0)
    if same.mean() < _SHARED:
        return None
    per_frame = (len(time_s)) / (np.count_nonzero(~same) + 1)
    return Finding('stamps of frames', (
        f'{same.mean():.0%} of the pulses have the stamp of the one before, about '
        f'{per_frame:.0f} pulses for each stamp'),
        'give every pulse its own time: that of its frame plus its place in the frame times the '
        'pulse repetition interval', 'a clock of coarse steps, which are as long as a pulse')


def _receipt(what: str, counter: np.ndarray, time_s: np.ndarray, pauses: np.ndarray
             ) -> Finding | None:
    """Stamps scatter as those do that a computer gives when data arrive.

    Not so those of a radar whose lost pulses were not counted: with these they are even.
    """
    counter = counter + np.r_[0, np.cumsum(pauses)]
    interval = float(np.median(np.diff(time_s) / np.diff(counter).clip(1)))
    if interval <= 0 or len(time_s) < 4 * _HALF:
        return None
    late = scatter_s(counter, time_s)
    spread = _SCATTER * float(np.median(np.abs(late)))  # few pauses do not count
    if spread < max(_LATE * interval, _LEAST_LATE_S):
        return None
    return Finding('stamps of receipt', (
        f'stamps scatter by {1e3 * spread:.3g} ms around their trend, {spread / interval:.0%} '
        f'of the interval between {what}, up to {1e3 * np.abs(late).max():.3g} ms'),
        'stamp pulses by the clock of the radar, when they are sent; where it has none, set '
        "frames.stamp: receipt and frames.period_s in the description of a driver's messages, or "
        'fit a line through the stamps of receipt and subtract the delay',
        'the clock of a radar, whose pulses are evenly spaced', LIKELY)


def scatter_s(counter: np.ndarray, time_s: np.ndarray) -> np.ndarray:
    """Times less a line through their neighbours on both sides, seconds; without the ends."""
    n = len(counter)
    offsets = np.concatenate([np.arange(-_HALF, 0), np.arange(1, _HALF + 1)])
    at = np.arange(_HALF, n - _HALF)
    u = (counter[at[:, None] + offsets] - counter[at, None]).astype(float)
    t = time_s[at[:, None] + offsets]
    mean_u, mean_t = u.mean(axis=1, keepdims=True), t.mean(axis=1, keepdims=True)
    slope = (((u - mean_u) * (t - mean_t)).sum(axis=1)
             / np.square(u - mean_u).sum(axis=1))
    return time_s[at] - (mean_t[:, 0] - slope * mean_u[:, 0])


def _backward(time_s: np.ndarray) -> Finding | None:
    n = int(np.count_nonzero(np.diff(time_s) < 0))
    if not n:
        return None
    return Finding('times that run backwards', f'{n} pulses have an earlier stamp than the one '
                   'before by number', "order the pulses by the radar's numbers, and stamp them "
                   'by one clock that is never set back',
                   'pulses that were received in another order, whose numbers tell it')


def median_around(values: np.ndarray, half: int = 4) -> np.ndarray:
    """(N,) medians of values (N,) and of `half` neighbours on each side, ends repeated."""
    padded = np.pad(values, half, mode='edge')
    return np.median(np.lib.stride_tricks.sliding_window_view(padded, 2 * half + 1), axis=-1)
