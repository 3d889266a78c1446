# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Campaign of mistakes: eighteen of them, injected into right recordings; which are named?

Run from the repository root: ``make mistakes``, or ``python -m benchmarks.mistakes RECORDING``.
Writes benchmarks/results/mistakes.json and prints the table of docs/troubleshooting.md.
"""

from __future__ import annotations

import dataclasses
import json
import pathlib
import re
import sys
import time
from collections.abc import Callable

import numpy as np

from sar_imaging.diagnosis import diagnose
from sar_imaging.signal.dechirp import fmcw_parameters
from sar_imaging.signal.pulses import PulseBlock
from sar_imaging.signal.radar import Waveform

from .support.mistake_recordings import Recording, others, recordings

RESULTS = pathlib.Path(__file__).parent / 'results' / 'mistakes.json'


class NotApplicable(Exception):
    """The recording cannot show this mistake; the text says why."""


def _replace(r: Recording, **changes) -> PulseBlock:
    return dataclasses.replace(r.block, **changes)


def _moved(r: Recording, change) -> PulseBlock:
    return _replace(r, tx_m=change(r.block.tx_m), rx_m=change(r.block.rx_m))


def _radar(r: Recording, **changes) -> PulseBlock:
    return _replace(r, radar=dataclasses.replace(r.block.radar, **changes))


def offset_s(r: Recording) -> float:
    """Seconds by which `clock_offset` moves the positions."""
    shift = {'spotlight': 32}.get(r.name, r.block.n_pulses // 8)
    return 1e-9 * float(r.block.stamp_ns[shift] - r.block.stamp_ns[0])


def conjugated(r: Recording) -> PulseBlock:
    """Samples conjugated."""
    if r.block.radar.waveform.is_real and not r.block.compressed:
        raise NotApplicable('real samples')
    return _replace(r, samples=r.block.samples.conj())


def q_before_i(r: Recording) -> PulseBlock:
    """Q read as I and I as Q."""
    if r.block.radar.waveform.is_real and not r.block.compressed:
        raise NotApplicable('real samples')
    samples = r.block.samples
    return _replace(r, samples=samples.imag + 1j * samples.real)


def slope_sign(r: Recording) -> PulseBlock:
    """A ramp said to fall where it rises."""
    if r.fmcw:
        return _replace(r, radar=fmcw_parameters(**{
            **r.fmcw, 'slope_hz_per_s': -r.fmcw['slope_hz_per_s']}))
    if r.block.radar.waveform == Waveform.LFM and not r.block.compressed:
        return _radar(r, chirp_rate_hz_per_s=-r.block.radar.chirp_rate_hz_per_s)
    raise NotApplicable('no ramp')


def x_and_y(r: Recording) -> PulseBlock:
    """X and y exchanged."""
    if r.name in ('spotlight', 'gotcha', 'team6'):
        raise NotApplicable('the grid holds the mirrored scene, which is focused')
    return _moved(r, lambda p: p[..., [1, 0, 2]])


def millimetres(r: Recording) -> PulseBlock:
    """Positions in millimetres."""
    return _moved(r, lambda p: 1000 * p)


def adc_start(r: Recording) -> PulseBlock:
    """ADC start, or delay of the first sample, in microseconds."""
    if r.fmcw:
        start_us = 1e6 * r.fmcw.get('adc_start_s', 0.0) or 6.0
        return _replace(r, radar=fmcw_parameters(**{**r.fmcw, 'adc_start_s': start_us}))
    return _radar(r, first_sample_delay_s=1e6 * (r.block.radar.first_sample_delay_s or 6.67e-6))


def slope_unit(r: Recording) -> PulseBlock:
    """Slope in MHz/us."""
    if r.fmcw:
        return _replace(r, radar=fmcw_parameters(**{
            **r.fmcw, 'slope_hz_per_s': 1e-12 * r.fmcw['slope_hz_per_s']}))
    if r.block.radar.chirp_rate_hz_per_s:
        return _radar(r, chirp_rate_hz_per_s=1e-12 * r.block.radar.chirp_rate_hz_per_s)
    raise NotApplicable('no ramp')


def transposed(r: Recording) -> PulseBlock:
    """Samples with fast time first."""
    return _replace(r, samples=r.block.samples.transpose(2, 1, 0))


def left_out(r: Recording) -> PulseBlock:
    """Every eighth position left out, the others moved up."""
    kept = np.delete(np.arange(r.block.n_pulses), slice(0, None, 8))
    block = r.block.select(slice(0, len(kept)))
    return dataclasses.replace(block, tx_m=r.block.tx_m[kept], rx_m=r.block.rx_m[kept])


def fewer_positions(r: Recording) -> PulseBlock:
    """Every eighth position left out, as many pulses as ever."""
    return _moved(r, lambda p: np.delete(p, slice(0, None, 8), axis=0))


def float_seconds(r: Recording) -> PulseBlock:
    """Stamps in seconds, as floats."""
    return _replace(r, stamp_ns=1e-9 * r.block.stamp_ns)


def zero_counters(r: Recording) -> PulseBlock:
    """Counters all zero."""
    return _replace(r, counter=np.zeros(r.block.n_pulses, np.uint32))


def nan_samples(r: Recording) -> PulseBlock:
    """One NaN among the samples."""
    samples = r.block.samples.copy()
    samples[len(samples) // 3, 0, 7] = np.nan
    return _replace(r, samples=samples)


def clock_offset(r: Recording) -> PulseBlock:
    """Positions as the platform had them a part of the aperture later."""
    if r.name in ('arcsar', 'mimo'):
        raise NotApplicable('nominal times; a turn of the arc is focused')
    shift = int(np.searchsorted(r.block.stamp_ns, r.block.stamp_ns[0] + 1e9 * offset_s(r)))
    n = r.block.n_pulses
    return dataclasses.replace(r.block.select(slice(0, n - shift)), tx_m=r.block.tx_m[shift:],
                               rx_m=r.block.rx_m[shift:])


def carrier_in_ghz(r: Recording) -> PulseBlock:
    """Carrier in GHz."""
    return _radar(r, carrier_hz=1e-9 * r.block.radar.carrier_hz)


def bandwidth_in_mhz(r: Recording) -> PulseBlock:
    """Bandwidth in MHz, sampling in MHz."""
    return _radar(r, bandwidth_hz=1e-6 * r.block.radar.bandwidth_hz,
                  sample_rate_hz=1e-6 * r.block.radar.sample_rate_hz)


def positions_reversed(r: Recording) -> PulseBlock:
    """Positions in the opposite order of the pulses."""
    if r.name == 'arcsar':
        raise NotApplicable('the mirrored arc is focused')
    return _moved(r, lambda p: p[::-1])


def one_way_delay(r: Recording) -> PulseBlock:
    """Delay of the first sample counted one way."""
    radar = r.block.radar
    if abs(radar.range_start_m) < 1.5:
        raise NotApplicable('the first sample lies at the antenna')
    return _radar(r, first_sample_delay_s=0.5 * radar.first_sample_delay_s)


def degrees(r: Recording) -> PulseBlock:
    """Longitude and latitude in place of x and y."""
    def geographic(p):
        metres = 6_371_000 * np.pi / 180
        return np.stack([11.56 + p[..., 0] / metres / np.cos(np.radians(48.1)),
                         48.1 + p[..., 1] / metres, p[..., 2]], axis=-1)
    return _moved(r, geographic)


def at_rest(r: Recording) -> PulseBlock:
    """One position for all pulses: the poses were never interpolated."""
    if r.block.n_channels > 1 and np.ptp(r.block.rx_m[0], axis=0).any():
        # An array has a place for each channel; at rest is then the platform alone.
        return _moved(r, lambda p: np.broadcast_to(p[:1].mean(axis=1, keepdims=True), p.shape))
    return _moved(r, lambda p: np.broadcast_to(p[:1], p.shape))


# What has to stand in the text, any of them.
MISTAKES: dict[Callable[[Recording], PulseBlock], tuple[str, ...]] = {
    conjugated: ('conjugated',), slope_sign: ('sign of chirp_rate',),
    x_and_y: ('x and y of the phase centres are probably exchanged',),
    millimetres: ('millimetres',), adc_start: ('meant in us', 'meant in ns'),
    slope_unit: ('MHz/us',),
    transposed: ('transposed',), left_out: ('positions were left out',),
    fewer_positions: ('pulses have no position',),
    float_seconds: ('probably in seconds',), zero_counters: ('counter is 0 for all',),
    nan_samples: ('NaN',), clock_offset: ('clocks of pulses and positions',),
    q_before_i: ('Q and I exchanged',), carrier_in_ghz: ('meant in GHz',),
    bandwidth_in_mhz: ('meant in MHz',), positions_reversed: ('run against the pulses',),
    one_way_delay: ('counted one way',), degrees: ('degrees of longitude',),
    at_rest: ('no synthetic aperture',)}


def named(r: Recording, mistake: Callable[[Recording], PulseBlock]) -> tuple[str, float]:
    """What the package says about a recording with a mistake, and after how many seconds."""
    began = time.perf_counter()
    try:
        text = str(diagnose(mistake(r), r.grid, window=r.window))
    except ValueError as error:
        text = str(error)
    return text, time.perf_counter() - began


def right(r: Recording) -> dict:
    """What is said about right data: nothing."""
    diagnosis = diagnose(r.block, r.grid, window=r.window)
    return {'recording': r.name, 'focus': round(diagnosis.coherence, 2),
            'mistake': diagnosis.mistake, 'text': str(diagnosis)}


def main(names=None) -> int:
    """Run the campaign; returns 1 when less than 95 % are named or right data are accused."""
    cases, rights = [], []
    for r in recordings(names):
        rights.append(right(r))
        print(f'{r.name}: {rights[-1]["text"]}', flush=True)
        for mistake, words in MISTAKES.items():
            try:
                text, seconds = named(r, mistake)
            except NotApplicable as reason:
                cases.append({'recording': r.name, 'mistake': mistake.__name__,
                              'named': None, 'text': str(reason)})
                continue
            found = any(word in text for word in words)
            if found and mistake is clock_offset:  # the offset, too
                sign, value = re.search(r'at t ([+-]) ([\d.]+) s', text).groups()
                found = abs(float(sign + value) + offset_s(r)) < 0.1
            cases.append({'recording': r.name, 'mistake': mistake.__name__, 'named': found,
                          'seconds': round(seconds, 2), 'text': text})
            print(f'  {"    " if found else "MISS"} {mistake.__name__:20} {seconds:5.1f} s  '
                  f'{text[:180]}', flush=True)
    for other in others():
        rights.append(right(other))
        print(f'{rights[-1]["recording"]}: {rights[-1]["text"]}', flush=True)
    injected = [c for c in cases if c['named'] is not None]
    hits = sum(c['named'] for c in injected)
    accused = [r['recording'] for r in rights if r['mistake']]
    print(f'named: {hits} of {len(injected)}; right data accused: {accused or "none"}')
    if not names:
        RESULTS.write_text(json.dumps({'right': rights, 'cases': cases}, indent=1) + '\n')
    print(table(cases))
    return int(hits < 0.95 * len(injected) or bool(accused))


def table(cases: list[dict]) -> str:
    """Markdown table: a row for each mistake."""
    recorded = list(dict.fromkeys(c['recording'] for c in cases))
    marks = {True: 'yes', False: '**no**', None: '–'}
    rows = [f'| mistake | {" | ".join(recorded)} |', f'|{"---|" * (len(recorded) + 1)}']
    for mistake in MISTAKES:
        cells = {c['recording']: marks[c['named']] for c in cases
                 if c['mistake'] == mistake.__name__}
        title = mistake.__doc__.rstrip('.')
        rows.append(f'| {title} | {" | ".join(cells.get(n, "") for n in recorded)} |')
    return '\n'.join(rows)


if __name__ == '__main__':
    sys.exit(main(sys.argv[1:]))
