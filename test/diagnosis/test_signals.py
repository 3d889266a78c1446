# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Faults injected into random recordings are named; right recordings have none."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from benchmarks.support.doctor_cases import right_case
from benchmarks.support.doctor_faults import FAULTS, OF_IMAGES, NotApplicable
from sar_imaging.diagnosis.channel_phases import channel_phases
from sar_imaging.diagnosis.doctor import examine
from sar_imaging.diagnosis.signals import (
    clipped_share,
    image_amplitude,
    sample_findings,
    timing_findings,
)
from sar_imaging.signal.pulses import PulseBlock
from sar_imaging.signal.radar import RadarParameters, Waveform

OF_SIGNALS = [name for name in FAULTS if name not in OF_IMAGES]
SEEDS = range(4)  # one of each kind of radar


@pytest.mark.parametrize('seed', SEEDS)
def test_right_recordings_have_no_fault(seed):
    case = right_case(seed)
    assert examine(case.block).findings == ()


@pytest.mark.parametrize('name', OF_SIGNALS)
def test_fault_is_named_and_no_other_one(name):
    inject, wanted = FAULTS[name]
    n = 0
    for seed in (*SEEDS, 4, 6, 9):  # the last ones have several channels
        try:
            case = inject(right_case(seed), np.random.default_rng([seed, 7]))
        except NotApplicable:
            continue
        n += 1
        found = [finding.fault for finding in examine(case.block).findings]
        assert found and set(found) <= set(wanted), f'seed {seed}'
    assert n >= 2


@pytest.mark.parametrize(('name', 'seed'), [
    ('words in another order', 9064), ('words in another order', 9109),
    ('unequal I and Q', 9041), ('unequal I and Q', 9128)])
def test_order_and_inequality_near_a_quarter_of_the_sampling_rate(name, seed):
    """There exchanged words hardly mirror the spectrum, and the exchange hides unequal I and Q."""
    inject, wanted = FAULTS[name]
    case = inject(right_case(seed), np.random.default_rng([seed, 7]))
    assert {finding.fault for finding in sample_findings(case.block)} == set(wanted)


@pytest.mark.parametrize(('name', 'seed'), [
    ('clocks drift apart', 1), ('wrong slope', 5), ('scene outside the window', 3),
    ('I and Q exchanged', 1), ('phase of a channel', 4), ('clock offset', 7)])
def test_geometry_is_examined_in_the_image(name, seed):
    inject, wanted = FAULTS[name]
    case = inject(right_case(seed), np.random.default_rng([seed, 7]))
    examination = examine(case.block, case.grid)
    assert {finding.fault for finding in examination.findings} & set(wanted)


def test_every_finding_says_what_was_measured_and_what_to_do():
    case = FAULTS['clipping'][0](right_case(0), np.random.default_rng(0))
    [finding] = sample_findings(case.block)
    assert 'channel' in finding.evidence and '%' in finding.evidence
    assert str(finding).startswith('clipping: ') and 'gain' in finding.advice


@pytest.mark.parametrize('values', [
    np.cos(np.linspace(0, 1000, 100_000)), np.random.default_rng(1).standard_normal(100_000)],
    ids=['sinusoid', 'noise'])
def test_clipped_share_is_what_was_clipped(values):
    # a sinusoid and noise pile up less at their largest values than the limit demands
    assert clipped_share(values) == 0
    limit = 0.6 * np.abs(values).max()
    clipped = values.clip(-limit, limit)
    assert clipped_share(clipped) == pytest.approx(np.mean(np.abs(values) >= limit), rel=0.05)


def test_offset_of_a_converter_is_not_taken_for_magnitudes():
    # unsigned samples around mid-scale, as most converters give them, never negative either
    block = right_case(5).block
    samples = block.samples.real + 1.05 * np.abs(block.samples.real).max() + 0j
    found = [f.fault for f in sample_findings(dataclasses.replace(block, samples=samples))]
    assert 'magnitudes only' not in found
    samples = np.abs(block.samples) + 0j
    found = [f.fault for f in sample_findings(dataclasses.replace(block, samples=samples))]
    assert 'magnitudes only' in found


def test_phases_of_channels_are_measured():
    case = right_case(4)
    block = dataclasses.replace(
        case.block, samples=case.block.samples * np.exp([[0], [1.2j]]).astype(np.complex64))
    # noise of the images leaves some degrees
    assert np.ptp(channel_phases(case.block, case.grid)) < 0.1
    assert np.diff(channel_phases(block, case.grid)) == pytest.approx(1.2, abs=0.1)


@pytest.mark.parametrize(('gain', 'phase_rad'), [(1.2, 0.0), (1.0, 0.15), (0.85, -0.1)])
def test_image_amplitude_is_that_of_the_errors(gain, phase_rad):
    # noise of positive frequencies alone, as the beat of a scene ahead of the reference
    rng = np.random.default_rng(2)
    spectrum = np.zeros((64, 256), complex)
    spectrum[:, 5:100] = rng.standard_normal((64, 95)) + 1j * rng.standard_normal((64, 95))
    z = np.fft.ifft(spectrum)
    q = gain * (z.imag * np.cos(phase_rad) + z.real * np.sin(phase_rad))
    amplitude, deviation = image_amplitude(z.real + 1j * q)
    # closed form: x = a z + b conj(z)
    a = (1 + gain * np.exp(-1j * phase_rad)) / 2
    b = (1 - gain * np.exp(1j * phase_rad)) / 2
    assert abs(amplitude) == pytest.approx(abs(b) / abs(a), rel=1e-3)
    assert deviation < 0.01
    assert abs(image_amplitude(z)[0]) < 1e-12


def in_frames(block, length, late_s=0.0, paused=()):
    """Pulses 0.2 ms apart in frames every 20 ms, whose stamps are late at random."""
    frame, place = np.divmod(np.arange(block.n_pulses), length)
    late = np.random.default_rng(5).uniform(0.0, late_s, frame[-1] + 1)[frame]
    time_s = 0.02 * (frame + np.searchsorted(paused, frame)) + 2e-4 * place + late
    return dataclasses.replace(block, stamp_ns=np.rint(1e9 * time_s).astype(np.int64))


@pytest.mark.parametrize('length', [2, 4, 8])
def test_frames_of_several_pulses_have_a_rhythm_and_faults_of_their_own(length):
    """As drivers of TI and Infineon boards send them: their pauses were taken for late stamps."""
    block = right_case(0).block
    right = in_frames(block, length)
    assert timing_findings(right) == []
    whole = np.delete(np.arange(block.n_pulses), slice(5 * length, 7 * length))  # frames lost
    assert [f.fault for f in timing_findings(right.select(whole))] == ['lost pulses']
    [late] = timing_findings(in_frames(block, length, late_s=5e-3))
    assert late.fault == 'stamps of receipt' and 'of the interval between frames' in late.evidence
    [lost] = timing_findings(in_frames(block, length, paused=[9, 14]))
    assert lost.evidence.startswith('2 pauses hold about 2 frames more')


def test_stamps_of_receipt_are_measured():
    block = right_case(1).block
    interval = np.median(np.diff(block.stamp_ns))
    late = np.random.default_rng(3).exponential(0.3, block.n_pulses) * interval
    stamps = np.maximum.accumulate(block.stamp_ns + late.astype(np.int64))
    [finding] = timing_findings(dataclasses.replace(block, stamp_ns=stamps))
    assert finding.fault == 'stamps of receipt'


def test_pulses_lost_from_a_short_recording_are_no_late_stamps():
    """Of 24 pulses a half has a gap nearby, which bends the line through their neighbours."""
    kept = np.delete(np.arange(32), [*range(8, 12), *range(20, 24)])
    block = right_case(1).block.select(kept)
    uncounted = dataclasses.replace(block, counter=np.arange(len(kept)))
    assert [f.fault for f in timing_findings(block)] == ['lost pulses']
    [lost] = timing_findings(uncounted)
    assert lost.fault == 'lost pulses without gaps in their numbers'
    assert lost.evidence.startswith('2 pauses hold about 8 pulses more')
    [counted] = timing_findings(block.select(slice(0, 10)))  # whose numbers tell it
    assert counted.fault == 'lost pulses'


def _steps(delays_s, amplitudes, noise=0.01) -> PulseBlock:
    """Phase histories (P, 1, 64) of echoes at delays (P, S), 2 GHz at 22 GHz."""
    rng = np.random.default_rng(4)
    frequency = 22e9 + (np.arange(64) - 31.5) * 2e9 / 64
    samples = np.sum(amplitudes[..., None] * np.exp(
        -2j * np.pi * frequency * delays_s[..., None]), axis=1)
    samples = samples + noise * (rng.standard_normal(samples.shape)
                                 + 1j * rng.standard_normal(samples.shape))
    radar = RadarParameters(22e9, 2e9, 2e9, 0.0, waveform=Waveform.STEPPED_FREQUENCY)
    n = len(samples)
    return PulseBlock(radar, False, 10**9 + 10**7 * np.arange(n), np.arange(n), samples[:, None])


@pytest.mark.parametrize(('flashes', 'named'), [(True, []), (False, ['interference'])])
def test_edge_that_flashes_is_no_interference(flashes, named):
    """A single pulse of a raster sees an edge 20 dB above all else, or another transmitter."""
    delays = np.tile([6e-9, 9e-9, 7.3e-9], (100, 1))
    amplitudes = np.tile([1.0, 0.5, 0.0], (100, 1))
    amplitudes[50, 2] = 12.0 * flashes
    block = _steps(delays, amplitudes)
    if not flashes:
        rng = np.random.default_rng(5)
        block.samples[50] += 8.0 * (rng.standard_normal((1, 64))
                                    + 1j * rng.standard_normal((1, 64)))
    assert [f.fault for f in sample_findings(block)] == named


@pytest.mark.parametrize('unequal', [False, True])
def test_echo_at_the_opposite_frequency_is_no_unequal_i_and_q(unequal):
    """Of a layer and an echo behind the reference the spectrum is mirrored, at one frequency."""
    delays = np.tile([4e-9, -4e-9, 7e-9, 9.5e-9], (200, 1))
    delays[:, 2:] += 1e-10 * np.sin(np.arange(200) / 15)[:, None]
    delays[:, :2] += 4e-12 * np.sin(np.arange(200) / 40)[:, None] * [1, -1]
    block = _steps(delays, np.tile([1.0, 0.4 * (not unequal), 0.8, 0.7], (200, 1)))
    if unequal:
        block = dataclasses.replace(block, samples=block.samples.real
                                    + 0.75j * block.samples.imag)
    found = [f.fault for f in sample_findings(block)]
    assert found == (['unequal I and Q'] if unequal else [])
