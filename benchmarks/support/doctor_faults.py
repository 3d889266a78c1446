# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Faults that the campaign of the doctor injects, and the findings that name them."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np

from sar_imaging.diagnosis.hypotheses import with_offset, with_slope
from sar_imaging.diagnosis.signals import with_words_exchanged
from sar_imaging.signal.pulses import PulseBlock
from sar_imaging.signal.range_compression import RangeCompressor
from sar_imaging.simulation.echoes import EchoSimulator

from .doctor_cases import Case


class NotApplicable(Exception):
    """The recording cannot have this fault."""


def _with(case: Case, **changes) -> Case:
    return dataclasses.replace(case, block=dataclasses.replace(case.block, **changes))


def _complex_only(case: Case) -> None:
    if case.block.radar.waveform.is_real:
        raise NotApplicable


def conjugated(case, rng):
    """Q before I, or the other sign of Q."""
    _complex_only(case)
    samples = case.block.samples
    return _with(case, samples=samples.conj() if rng.random() < 0.5
                 else samples.imag + 1j * samples.real)


def inverted(case, rng):
    """The ramp falls where it is said to rise."""
    if not case.block.radar.chirp_rate_hz_per_s or case.block.radar.waveform.is_real:
        raise NotApplicable  # real samples hold both signs
    return dataclasses.replace(case, block=with_slope(case.block, -1.0))


def clipped(case, rng):
    """The converter's full scale is 1.3 to 3 times the rms of the samples."""
    samples = case.block.samples
    rms = math.sqrt(np.mean(np.square(samples.real), dtype=float))
    limit = rng.uniform(1.3, 3.0) * rms
    if limit > 0.8 * np.abs(samples.real).max():
        limit = 0.8 * np.abs(samples.real).max()
    return _with(case, samples=samples.real.clip(-limit, limit)
                 + 1j * samples.imag.clip(-limit, limit))


def lost(case, rng):
    """Pulses lost in some gaps; their numbers tell it."""
    block = case.block
    keep = np.ones(block.n_pulses, bool)
    for _ in range(int(rng.integers(1, 6))):
        start = int(rng.integers(4, block.n_pulses - 12))
        keep[start:start + int(rng.integers(1, 8))] = False
    return dataclasses.replace(case, block=block.select(keep))


def lost_uncounted(case, rng):
    """Pulses lost, and numbered by the program that received the others."""
    case = lost(case, rng)
    return _with(case, counter=np.arange(case.block.n_pulses))


def wrong_slope(case, rng):
    """The slope of the ramp is 10 to 30 per cent off."""
    if not case.block.radar.chirp_rate_hz_per_s:
        raise NotApplicable
    sign = -1 if case.kind == 'drone' else rng.choice([-1, 1])  # else it is sampled too slowly
    factor = 1 + sign * rng.uniform(0.1, 0.3)
    return dataclasses.replace(case, block=with_slope(case.block, factor), sizes=(1 / factor,))


def clock_drift(case, rng):
    """The clocks of pulses and positions run 5 to 20 per cent apart."""
    rate = 1 + rng.choice([-1, 1]) * rng.uniform(0.05, 0.2)
    return dataclasses.replace(case, block=with_offset(case.block, 0.0, rate),
                               sizes=(1 / rate,))


def receipt(case, rng):
    """Stamps of a computer that serves the radar's data when it has time."""
    block = case.block
    interval = float(np.median(np.diff(block.stamp_ns)))
    late = rng.exponential(rng.uniform(0.1, 0.6), block.n_pulses) * interval
    stamps = np.maximum.accumulate(block.stamp_ns + late.astype(np.int64))
    return _with(case, stamp_ns=stamps)


def frame_stamps(case, rng):
    """All pulses of a frame have its time."""
    frame = int(rng.integers(4, 33))
    index = np.arange(case.block.n_pulses) // frame * frame
    return _with(case, stamp_ns=case.block.stamp_ns[index])


def _channels(case: Case) -> int:
    if case.block.n_channels < 2:
        raise NotApplicable
    return case.block.n_channels


def unbalanced(case, rng):
    """One channel 4 to 12 dB louder or fainter than the others."""
    n = _channels(case)
    gain = np.ones(n, np.float32)
    gain[int(rng.integers(n))] = 10 ** (rng.choice([-1, 1]) * rng.uniform(4, 12) / 20)
    return _with(case, samples=case.block.samples * gain[:, None])


def dead(case, rng):
    """One channel holds the noise of its converter alone."""
    n = _channels(case)
    samples = case.block.samples.copy()
    at = int(rng.integers(n))
    level = 1e-3 * np.abs(samples).std()
    samples[:, at] = level * (rng.standard_normal(samples[:, at].shape)
                              + 1j * rng.standard_normal(samples[:, at].shape))
    return _with(case, samples=samples)


def coupled(case, rng):
    """Antennas couple 6 to 30 dB above the strongest echo, nearest to the radar."""
    block, radar = case.block, case.block.radar
    away = radar.range_start_m + 0.1 * (case.grid.centre_m[1] - radar.range_start_m)
    still = np.zeros((1, 1, 3))
    coupling = EchoSimulator(radar, block.n_samples, compressed=False,
                             points_m=[[0.0, max(away, 0.3), 0.0]],
                             amplitudes=[1.0])(still, still)
    added = dataclasses.replace(block, samples=np.repeat(coupling, block.n_pulses, axis=0).repeat(
        block.n_channels, axis=1).astype(np.complex64))
    echo, one = (_peak(b) for b in (block, added))
    level = 10 ** (rng.uniform(6, 30) / 20) * echo / one
    return _with(case, samples=block.samples + (level * added.samples).astype(np.complex64))


def _peak(block: PulseBlock) -> float:
    """Largest magnitude of the range profiles."""
    return float(np.abs(RangeCompressor.for_block(block)(block).samples).max())


def axes(case, rng):
    """Positions of another frame: x and y exchanged."""
    return _with(case, tx_m=case.block.tx_m[..., [1, 0, 2]], rx_m=case.block.rx_m[..., [1, 0, 2]])


def clock_offset(case, rng):
    """The clocks of pulses and positions are a fifth to a third of the aperture apart."""
    block = case.block
    shift = int(rng.uniform(0.2, 0.33) * block.n_pulses) * int(rng.choice([-1, 1]))
    some = block.select(slice(max(0, shift), block.n_pulses + min(0, shift)))
    moved = block.select(slice(max(0, -shift), block.n_pulses - max(0, shift)))
    back = (moved.tx_m - some.tx_m).mean(axis=(0, 1))  # the scene stays where it is
    interval_s = 1e-9 * float(np.mean(np.diff(block.stamp_ns)))
    return dataclasses.replace(case, sizes=(-shift * interval_s,), block=dataclasses.replace(
        some, stamp_ns=moved.stamp_ns, counter=moved.counter, samples=moved.samples,
        tx_m=some.tx_m + back, rx_m=some.rx_m + back))


def outside(case, rng):
    """The scene lies beyond the window of range that was recorded."""
    far = case.block.n_samples * case.block.radar.sample_spacing_m
    centre = np.array(case.grid.centre_m)
    away = centre - case.block.tx_m.mean(axis=(0, 1))
    away[2] = 0.0
    distance = np.linalg.norm(away)
    centre += max(3 * far / distance, 5) * away
    return dataclasses.replace(case, grid=dataclasses.replace(case.grid, centre_m=tuple(centre)))


def words(case, rng):
    """Words of I and Q in another order."""
    _complex_only(case)
    if case.block.n_samples % 2:
        raise NotApplicable  # words would be exchanged across pulses
    return _with(case, samples=with_words_exchanged(case.block.samples))


def unequal(case, rng):
    """Gain and phase of Q differ from those of I."""
    _complex_only(case)
    gain = 1 + rng.choice([-1, 1]) * rng.uniform(0.1, 0.4)
    phase = rng.choice([-1, 1]) * rng.uniform(0.1, 0.4)
    samples = case.block.samples
    q = gain * (samples.imag * math.cos(phase) + samples.real * math.sin(phase))
    return _with(case, samples=samples.real + 1j * q)


def without_q(case, rng):
    """Only I was recorded."""
    _complex_only(case)
    return _with(case, samples=case.block.samples.real + 0j)


def magnitudes(case, rng):
    """The driver published magnitudes, as that of the BGT60 does unless told otherwise."""
    return _with(case, samples=np.abs(case.block.samples) + 0j)


def phases(case, rng):
    """Cables of one channel differ in length: its phase is 60 to 180 degrees off."""
    n = _channels(case)
    turn = np.ones(n, np.complex64)
    turn[int(rng.integers(n))] = np.exp(1j * rng.choice([-1, 1]) * rng.uniform(np.pi / 3, np.pi))
    _complex_only(case)
    return _with(case, samples=case.block.samples * turn[:, None])


def incomplete(case, rng):
    """Some pulses lost their last packets."""
    samples = case.block.samples.copy()
    n = int(rng.integers(1, 12))
    start = int(rng.uniform(0.3, 0.9) * samples.shape[2])
    samples[rng.integers(0, len(samples), n), :, start:] = 0
    return _with(case, samples=samples)


def interfered(case, rng):
    """Another radar in a few pulses."""
    samples = case.block.samples.copy()
    at = rng.integers(0, len(samples), int(rng.integers(1, 8)))
    level = 10 ** (rng.uniform(14, 30) / 20) * math.sqrt(np.mean(np.square(np.abs(samples))))
    noise = rng.standard_normal((len(at), *samples.shape[1:], 2)) / math.sqrt(2)
    real = case.block.radar.waveform.is_real
    samples[at] += (level * (noise[..., 0] + (0 if real else 1j) * noise[..., 1])
                    ).astype(np.complex64)
    return _with(case, samples=samples)


def lever_arm(case, rng):
    """The antenna is 0.3 to 0.8 m beside the point that the poses are of."""
    if case.attitude is None:
        raise NotApplicable
    block = case.block
    arm = rng.standard_normal(3)
    arm *= rng.uniform(0.3, 0.8) / np.linalg.norm(arm)
    moved = case.attitude.apply(arm)
    moved = (moved - moved.mean(axis=0))[:, None]
    return dataclasses.replace(case, sizes=tuple(arm), block=dataclasses.replace(
        block, tx_m=block.tx_m - moved, rx_m=block.rx_m - moved))


def whole_arm(case, rng):
    """The poses are of the pivot of a rotating arm, or of a place between it and the antenna."""
    if case.kind not in ('wide', 'arcsar'):
        raise NotApplicable
    block = case.block
    arm = rng.uniform(0.3, 1.0) * float(np.linalg.norm(block.tx_m[0, 0])) * np.array([1, 0, 0])
    moved = case.attitude.apply(arm)[:, None]
    return dataclasses.replace(case, sizes=tuple(arm), block=dataclasses.replace(
        block, tx_m=block.tx_m - moved, rx_m=block.rx_m - moved))


def mirrored(case, rng):
    """A sign of the positions is wrong: x or y points the other way."""
    sign = np.ones(3)
    sign[int(rng.integers(2))] = -1
    return _with(case, tx_m=sign * case.block.tx_m, rx_m=sign * case.block.rx_m)


def backwards(case, rng):
    """Positions in the opposite order of the pulses."""
    return _with(case, tx_m=case.block.tx_m[::-1], rx_m=case.block.rx_m[::-1])


def transmitters(case, rng):
    """Two transmitters were recorded in another order than said."""
    tx = case.block.tx_m[0]
    places = np.unique(np.round(tx, 6), axis=0)
    if not 1 < len(places) < case.block.n_channels:
        raise NotApplicable
    a, b = (np.flatnonzero(np.linalg.norm(tx - places[k], axis=1) < 1e-5)
            for k in rng.choice(len(places), 2, replace=False))
    samples = case.block.samples.copy()
    samples[:, a], samples[:, b] = case.block.samples[:, b], case.block.samples[:, a]
    return _with(case, samples=samples)


# Each fault and the findings that name it.
FAULTS: dict[str, tuple[Callable, tuple[str, ...]]] = {
    'I and Q exchanged': (conjugated, ('samples conjugated',)),
    'spectrum inverted': (inverted, ('sign of the slope', 'samples conjugated')),
    'clipping': (clipped, ('clipping',)),
    'lost pulses': (lost, ('lost pulses',)),
    'lost pulses, not counted': (lost_uncounted, ('lost pulses without gaps in their numbers',)),
    # a slope scales ranges as a clock scales the track: either focuses the other's mistake
    'wrong slope': (wrong_slope, ('wrong slope', 'clock drift')),
    'clocks drift apart': (clock_drift, ('clock drift', 'wrong slope')),
    'stamps of receipt': (receipt, ('stamps of receipt',)),
    'stamps of frames': (frame_stamps, ('stamps of frames',)),
    'unbalanced channel': (unbalanced, ('unbalanced channels',)),
    'dead channel': (dead, ('dead channel',)),
    'coupling': (coupled, ('coupling',)),
    'x and y exchanged': (axes, ('x and y exchanged', 'scene outside the window')),
    'clock offset': (clock_offset, ('clock offset',)),
    'scene outside the window': (outside, ('scene outside the window',)),
    'words in another order': (words, ('order of I and Q',)),
    'unequal I and Q': (unequal, ('unequal I and Q',)),
    'Q missing': (without_q, ('real samples',)),
    'magnitudes only': (magnitudes, ('magnitudes only', 'real samples')),
    'phase of a channel': (phases, ('phases of channels',)),
    'incomplete pulses': (incomplete, ('incomplete pulses',)),
    'interference': (interfered, ('interference',)),
    'lever arm': (lever_arm, ('lever arm',)),
    'lever arm forgotten': (whole_arm, ('lever arm', 'odd positions')),
    'track mirrored': (mirrored, ('track mirrored in x', 'track mirrored in y',
                                  'x and y exchanged', 'scene outside the window')),
    # along one axis, as upright, it is the same as that axis mirrored
    'positions reversed': (backwards, ('positions reversed', 'track mirrored in x',
                                       'track mirrored in y', 'track mirrored in z')),
    'order of transmitters': (transmitters, ('order of transmitters',)),
}
# Faults that show in the image alone, or in where the scene is.
OF_IMAGES = ('I and Q exchanged', 'spectrum inverted', 'wrong slope', 'clocks drift apart',
             'x and y exchanged', 'clock offset', 'scene outside the window',
             'phase of a channel', 'lever arm', 'lever arm forgotten', 'track mirrored',
             'positions reversed', 'order of transmitters')
