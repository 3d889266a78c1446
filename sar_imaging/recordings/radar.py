# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Radar parameters of a description, and phase histories referenced to one range."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np

from ..signal.dechirp import fmcw_parameters
from ..signal.radar import SPEED_OF_LIGHT, RadarParameters, Waveform
from .description import DescriptionError, Section, of_part

_COMMON = ('waveform', 'propagation_speed_m_per_s')
_START = ('first_sample_delay_s', 'range_start_m')
_RATE = ('sample_rate_hz', 'sample_spacing_m')
_OF_FMCW = (*_COMMON, 'start_frequency_hz', 'slope_hz_per_s', 'carrier_hz', 'bandwidth_hz',
            'sample_rate_hz', 'adc_start_s', 'reference_delay_s')
_BAND = ('carrier_hz', 'bandwidth_hz')
_KEYS = {
    'lfm': (*_COMMON, *_BAND, *_RATE, *_START, 'pulse_length_s', 'falling', 'compressed'),
    'passband': (*_COMMON, *_BAND, *_RATE, *_START),
    'fmcw': _OF_FMCW, 'fmcw_real': _OF_FMCW,
    'stepped_frequency': (*_COMMON, 'frequencies_hz', *_BAND, 'reference_range_m',
                          'compensated_to_m', 'compensated_range_m')}
KEYS = tuple(dict.fromkeys(key for keys in _KEYS.values() for key in keys))
_ROUNDING = 2e-7  # relative, of ranges that were stored as float32


def read_radar(section: Section, n_samples: int) -> tuple[RadarParameters, bool]:
    """Radar parameters, and whether the samples are range profiles.

    Parameters
    ----------
    section : Section
        The part ``radar``.
    n_samples : int
        Samples of a pulse.

    Raises
    ------
    DescriptionError
        A number is missing, contradicts another, or is of an impossible size.
    """
    kind = section.choice('waveform', tuple(_KEYS))
    for key in KEYS:
        if key in section and key not in _KEYS[kind]:
            raise section.error(key, f'no such key for the waveform {kind}',
                                f'it has {", ".join(_KEYS[kind])}')
    read = {'lfm': _lfm, 'passband': _passband, 'fmcw': _fmcw, 'fmcw_real': _fmcw,
            'stepped_frequency': _stepped}[kind]
    with of_part('radar'):
        radar, compressed = read(section, n_samples, section.number(
            'propagation_speed_m_per_s', SPEED_OF_LIGHT))
        if radar.bandwidth_hz > 2 * radar.carrier_hz:
            raise ValueError(f'a band of {radar.bandwidth_hz:g} Hz around {radar.carrier_hz:g} Hz '
                             'reaches below zero; expected at most twice the carrier')
        return radar, compressed


def _either(section: Section, keys: Sequence[str]) -> tuple[str, float]:
    """The key that is given, and its number."""
    given = [key for key in keys if key in section]
    if len(given) > 1:
        raise section.error(given[1], f'not both {" and ".join(given)}', 'leave one out')
    if not given:
        section.raw(keys[0], meaning=f'either it or {" or ".join(keys[1:])}')
    return given[0], section.number(given[0])


def _sampling(section: Section, speed: float) -> tuple[float, float]:
    """Sample rate and delay of the first sample."""
    key, value = _either(section, _RATE)
    if key == 'sample_spacing_m':
        if value <= 0:
            raise section.error(key, 'metres of range from sample to sample')
        value = speed / (2 * value)
    start, delay = _either(section, _START)
    return value, 2 * delay / speed if start == 'range_start_m' else delay


def _lfm(section: Section, _: object, speed: float) -> tuple[RadarParameters, bool]:
    rate_hz, delay_s = _sampling(section, speed)
    compressed, bandwidth = section.flag('compressed'), section.number('bandwidth_hz')
    length_s = (section.number('pulse_length_s', 0.0) if compressed
                else section.number('pulse_length_s'))
    slope = bandwidth / length_s if length_s else 0.0
    return RadarParameters(
        section.number('carrier_hz'), bandwidth, rate_hz, delay_s, length_s,
        -slope if section.flag('falling') else slope, Waveform.LFM, speed), compressed


def _passband(section: Section, _: object, speed: float) -> tuple[RadarParameters, bool]:
    rate_hz, delay_s = _sampling(section, speed)
    return RadarParameters(section.number('carrier_hz'), section.number('bandwidth_hz'), rate_hz,
                           delay_s, waveform=Waveform.PASSBAND,
                           propagation_speed_m_per_s=speed), False


def _fmcw(section: Section, n_samples: int, speed: float) -> tuple[RadarParameters, bool]:
    rate_hz, adc_start_s = section.number('sample_rate_hz'), section.number('adc_start_s', 0.0)
    if 'carrier_hz' in section or 'bandwidth_hz' in section:
        for key in ('start_frequency_hz', 'slope_hz_per_s', 'adc_start_s'):
            if key in section:
                raise section.error(key, f'not {key} besides carrier_hz and bandwidth_hz',
                                    'these are of the samples, the others of the whole ramp')
        slope = section.number('bandwidth_hz') * rate_hz / n_samples
        start_hz = section.number('carrier_hz') - slope * (n_samples - 1) / 2 / rate_hz
    else:
        start_hz = section.number('start_frequency_hz')
        slope = section.number('slope_hz_per_s')
    return fmcw_parameters(
        start_frequency_hz=start_hz, slope_hz_per_s=slope, sample_rate_hz=rate_hz,
        n_samples=n_samples, adc_start_s=adc_start_s,
        real_samples=section.raw('waveform') == 'fmcw_real',
        reference_delay_s=section.number('reference_delay_s', 0.0),
        propagation_speed_m_per_s=speed), False


def _stepped(section: Section, n_samples: int, speed: float) -> tuple[RadarParameters, bool]:
    if 'frequencies_hz' in section:
        frequency_hz = section.array('frequencies_hz').reshape(-1)
        if frequency_hz.size != n_samples:
            raise section.error('frequencies_hz', f'one frequency for each of {n_samples} samples',
                                f'it holds {frequency_hz.size}')
        carrier_hz, step_hz = uniform_frequencies(frequency_hz)
        bandwidth_hz = n_samples * step_hz
    else:
        carrier_hz, bandwidth_hz = (section.number(key) for key in _BAND)
    delay_s = 2 * section.number('reference_range_m', 0.0) / speed
    return RadarParameters(carrier_hz, bandwidth_hz, bandwidth_hz, delay_s,
                           waveform=Waveform.STEPPED_FREQUENCY,
                           propagation_speed_m_per_s=speed), False


def uniform_frequencies(frequency_hz: np.ndarray) -> tuple[float, float]:
    """Centre and step of equally spaced ascending frequencies that may be rounded.

    Parameters
    ----------
    frequency_hz : (N,) float64
        As stored, hertz.

    Raises
    ------
    DescriptionError
        They are not equally spaced.
    """
    if frequency_hz.size < 2:
        raise DescriptionError('radar.frequencies_hz: expected two frequencies or more')
    index = np.arange(frequency_hz.size) - (frequency_hz.size - 1) / 2
    step_hz = float(index @ frequency_hz / (index @ index))
    centre_hz = float(frequency_hz.mean())
    worst = np.abs(centre_hz + index * step_hz - frequency_hz).max()
    if not step_hz > 0 or worst > 1e-3 * step_hz:
        raise DescriptionError(
            f'radar.frequencies_hz: they deviate by {worst:.0f} Hz from equal steps of '
            f'{step_hz:.0f} Hz; expected a uniform grid, ascending')
    return centre_hz, step_hz


def reference_to_one_range(section: Section, variable: Callable[[str], np.ndarray],
                           radar: RadarParameters, samples: np.ndarray, position_m: np.ndarray
                           ) -> tuple[np.ndarray, RadarParameters]:
    """Phase histories that were compensated pulse by pulse, referenced to one range for all.

    Files of motion-compensated data refer each pulse to its distance from a point of the scene; a
    radar has one reference. The distance is computed from the positions: stored ones are rounded
    to float32, and a millimetre is 24 degrees of phase at 10 GHz.

    Parameters
    ----------
    section : Section
        The part ``radar``; without ``compensated_to_m`` nothing changes.
    variable : callable
        Gives the variable of a name, joined over the files.
    radar : RadarParameters
        Radar parameters of the samples.
    samples : (P, C, N) complex64
        Phase histories.
    position_m : (P, 3) float64
        Position of the antenna, metres.

    Returns
    -------
    samples : (P, C, N) complex64
    radar : RadarParameters
        With the reference.

    Raises
    ------
    DescriptionError
        The stored ranges contradict the positions.
    """
    point_m = section.vector('compensated_to_m', None)
    if point_m is None:
        return samples, radar
    range_m = np.linalg.norm(position_m - point_m, axis=1)
    stored_m = section.with_variables(variable).array('compensated_range_m', None)
    if stored_m is not None:
        if stored_m.size != range_m.size:
            raise section.error('compensated_range_m', f'one range for each of {range_m.size} '
                                f'pulses, not {stored_m.size}')
        difference = np.abs(stored_m.reshape(-1) - range_m).max()
        if difference > _ROUNDING * range_m.max():
            raise section.error('compensated_range_m', 'the distance of the antenna to '
                                f'{point_m.tolist()}', f'it differs by {difference:.4f} m: '
                                'correct compensated_to_m')
    reference_m = round(float(range_m.mean()), 3)
    n = samples.shape[-1]
    frequency_hz = (radar.carrier_hz
                    + (np.arange(n) - (n - 1) / 2) * (radar.bandwidth_hz / n))
    speed = radar.propagation_speed_m_per_s
    out = np.empty_like(samples)
    for i, away_m in enumerate(range_m - reference_m):
        cycles = 2.0 / speed * (away_m * frequency_hz)
        out[i] = samples[i] * np.exp(-2j * np.pi * np.remainder(cycles, 1.0))
    return out, dataclasses.replace(radar, first_sample_delay_s=2 * reference_m / speed)
