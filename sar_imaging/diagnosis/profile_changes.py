"""Undo mistakes in raw samples on the range profiles that were computed from them.

Where only range profiles are at hand, raw samples need not be: with the spectrum P0 of a
pulse centred on time zero, profiles of conjugated LFM pulses are those of the right ones,
conjugated and filtered with ``P0 / conj(P0)``, and those compressed with the wrong sign of the
slope are the right ones filtered with it. Profiles of phase histories are transforms: conjugated
samples give ``conj(p(-u))`` at the delay u beyond the reference, reversed frequencies ``p(-u)``,
each but for the residual video phase, ``exp(-j pi K u^2)`` of the ramp.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from scipy import fft

from ..signal.pulses import PulseBlock
from ..signal.radar import Waveform
from ..signal.range_compression import GUARD_SAMPLES
from ..signal.waveforms import lfm_spectrum

REAL = (Waveform.FMCW_REAL, Waveform.PASSBAND)
RAMPS = (Waveform.FMCW, Waveform.FMCW_REAL)
PHASE_HISTORIES = (Waveform.STEPPED_FREQUENCY, *RAMPS)


def conjugations(block: PulseBlock) -> list[PulseBlock]:
    """Blocks as they are if samples came conjugated, or as Q, I instead of I, Q."""
    radar = block.radar
    plain = dataclasses.replace(block, samples=block.samples.conj())
    if not block.compressed:
        return [] if radar.waveform in REAL else [plain]
    out = [plain]
    if radar.waveform == Waveform.LFM and radar.chirp_rate_hz_per_s:
        out.append(_dispersed(plain, -1))
    elif radar.waveform in (Waveform.FMCW, Waveform.STEPPED_FREQUENCY):
        out.append(_mirrored(block, -2 * radar.chirp_rate_hz_per_s))
    return out


def reversed_slopes(block: PulseBlock) -> list[PulseBlock]:
    """Blocks as they are if the ramp falls where it is said to rise, or the other way round."""
    radar = block.radar
    if not radar.chirp_rate_hz_per_s or radar.waveform not in (Waveform.LFM, *RAMPS):
        return []
    out = [_with_slope_reversed(block, radar.carrier_hz)]
    if radar.waveform in RAMPS:
        # The middle of the ramp lies on the other side of its start, as far as that is known.
        swept_hz = abs(radar.chirp_rate_hz_per_s) * radar.pulse_length_s
        carrier_hz = radar.carrier_hz - np.sign(radar.chirp_rate_hz_per_s) * swept_hz
        if carrier_hz > swept_hz:
            out.append(_with_slope_reversed(block, carrier_hz))
    return out


def _with_slope_reversed(block: PulseBlock, carrier_hz: float) -> PulseBlock:
    radar = dataclasses.replace(block.radar, carrier_hz=carrier_hz,
                                chirp_rate_hz_per_s=-block.radar.chirp_rate_hz_per_s)
    changed = dataclasses.replace(block, radar=radar)
    if not block.compressed:
        return changed
    if radar.waveform == Waveform.LFM:
        return _dispersed(changed, +1)
    return _mirrored(dataclasses.replace(changed, samples=changed.samples.conj()), 0.0)


def _dispersed(block: PulseBlock, sign: int) -> PulseBlock:
    """Profiles of raw pulses that were compressed for the opposite slope.

    Parameters
    ----------
    block : PulseBlock
        With the radar to compress for.
    sign : int
        +1 where `block.radar` already has the opposite slope, -1 where it keeps it.
    """
    radar = block.radar
    frequency = fft.fftfreq(_padded(block.n_samples), 1 / radar.sample_rate_hz)
    band = np.abs(frequency) <= radar.bandwidth_hz / 2
    old = dataclasses.replace(radar, chirp_rate_hz_per_s=-sign * radar.chirp_rate_hz_per_s)
    new = dataclasses.replace(radar, chirp_rate_hz_per_s=sign * radar.chirp_rate_hz_per_s)
    gain = np.zeros(len(frequency), np.complex64)
    gain[band] = lfm_spectrum(frequency[band], old) / lfm_spectrum(frequency[band], new)
    spectra = fft.fft(block.samples, len(frequency)) * gain
    return dataclasses.replace(block, samples=fft.ifft(spectra)[..., :block.n_samples])


def _padded(n: int) -> int:
    return fft.next_fast_len(2 * n)


def _mirrored(block: PulseBlock, slope: float) -> PulseBlock:
    """Profiles of one period whose delays count the other way, times ``exp(j pi slope u^2)``.

    Profiles that were cut to a range window lack the other side; nothing focuses then.
    """
    n, rate_hz = block.n_samples, block.radar.sample_rate_hz
    # Profiles of a near scene begin at delay 0, others half a period before the reference.
    near = round(block.radar.first_sample_delay_s * rate_hz) >= -GUARD_SAMPLES - 1 and \
        block.radar.first_sample_delay_s <= 0
    period = max(n - 2 * GUARD_SAMPLES - int(near), 1)
    reference = GUARD_SAMPLES + (0 if near else period // 2)
    index = np.arange(n)
    source = GUARD_SAMPLES + (2 * reference - index - GUARD_SAMPLES) % period
    cycles = 0.5 * slope * ((index - reference) / rate_hz) ** 2
    turn = np.exp(2j * np.pi * np.remainder(cycles, 1.0)).astype(np.complex64)
    return dataclasses.replace(
        block, samples=block.samples[..., np.minimum(source, n - 1)].conj() * turn)
