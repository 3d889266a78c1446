"""Faults of raw samples: clipping, I and Q, their order, pulses cut short, bursts."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterator

import numpy as np
from scipy import fft

from ...signal.background import subtract_background
from ...signal.pulses import PulseBlock
from ...signal.radar import Waveform
from ...signal.range_compression import RangeCompressor
from .finding import LIKELY, Finding

_REAL = (Waveform.FMCW_REAL, Waveform.PASSBAND)
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
    if block.radar.waveform not in _REAL and found[1] is None:
        found.append(_order(block) or _imbalance(block))
    return [finding for finding in found if finding is not None]


def _some(block: PulseBlock) -> PulseBlock:
    """Pulses spread over the block, as many as the statistics need."""
    step = -(-block.n_pulses // _MOST_PULSES)
    return block.select(slice(None, None, step)) if step > 1 else block


def _components_of(block: PulseBlock) -> Iterator[tuple[int, str, np.ndarray]]:
    real = block.radar.waveform in _REAL
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
    if block.radar.waveform in _REAL:
        return None
    samples = _some(block).samples
    i, q = (float(np.sqrt(np.mean(np.square(part, dtype=float))))
            for part in (samples.real, samples.imag))
    if max(i, q) == 0:
        return Finding('no signal', 'all samples are zero',
                       'check the connection of the receiver and the variable that was loaded')
    if min(i, q) < _NONE * max(i, q):
        return Finding('real samples', (
            f'{"Q" if q < i else "I"} is {min(i, q) / max(i, q):.1g} times the other component: '
            'these are real samples'),
            'give the waveform FMCW_REAL (dechirped) or PASSBAND (pulses), or load both '
            'components', 'complex samples, whose components are of like power')
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
