# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Radar parameters of an FMCW radar from its data sheet, and their limits.

The receiver mixes the echo with the ramp that is being transmitted, of frequency ``f_s + K t`` at
the time t after the ramp's start. An echo at the delay tau beats with the phase

``-2 pi ((f_s + K t) tau - K tau^2 / 2)``    (echo times conjugate of the transmitted ramp)

The last term, the residual video phase, is what a stepped-frequency radar does not have: it
changes with range and so along the aperture, and defocuses the image of a long or near track.
Range compression removes it (`sar_imaging.signal.range_compression`).
"""

from __future__ import annotations

from . import magnitudes
from .magnitudes import check_magnitude, probable_unit
from .radar import SPEED_OF_LIGHT, RadarParameters, Waveform

_LONGEST_START_S = 1e-3  # of ramps of radars; longer ones are microseconds
_MOST_SAMPLES = 2**24  # of a ramp: more follow only from broken numbers


def fmcw_parameters(*, start_frequency_hz: float, slope_hz_per_s: float, sample_rate_hz: float,
                    n_samples: int, adc_start_s: float = 0.0, real_samples: bool = False,
                    reference_delay_s: float = 0.0,
                    propagation_speed_m_per_s: float = SPEED_OF_LIGHT) -> RadarParameters:
    """Radar parameters of an FMCW radar or sonar.

    Parameters
    ----------
    start_frequency_hz : float
        Frequency at the start of the ramp, hertz.
    slope_hz_per_s : float
        Slope K of the ramp, hertz per second; negative for a falling one.
    sample_rate_hz : float
        Sample rate of the converter, hertz.
    n_samples : int
        Samples N of one ramp.
    adc_start_s : float
        Time of the first sample after the start of the ramp, seconds; at least the longest
        delay of the scene, before which echo and ramp do not overlap.
    real_samples : bool
        The converter has one path: samples are the real part of the beat signal.
    reference_delay_s : float
        Delay of the ramp that is mixed with the echo behind the transmitted one, seconds
        (stretch processing of a distant swath); times count from its start.
    propagation_speed_m_per_s : float
        Speed of the waves, metres per second.

    Returns
    -------
    RadarParameters
        Carrier at the middle sample, bandwidth as the samples sweep it.

    Raises
    ------
    ValueError
        The slope is zero, there are fewer than two samples, or a value is out of range; where it
        is in another unit, such as a slope in MHz/us, the text says so.

    Examples
    --------
    >>> from sar_imaging.signal.dechirp import fmcw_parameters
    >>> radar = fmcw_parameters(start_frequency_hz=77e9, slope_hz_per_s=40e12,
    ...                         sample_rate_hz=5e6, n_samples=256, adc_start_s=4e-6)
    >>> f'{radar.carrier_hz / 1e9:.3f} GHz, {radar.range_resolution_m * 100:.2f} cm'
    '78.180 GHz, 7.32 cm'
    """
    if slope_hz_per_s == 0 or n_samples < 2:
        raise ValueError(f'slope_hz_per_s={slope_hz_per_s}, n_samples={n_samples}; an FMCW radar '
                         'needs a ramp and at least two samples of it')
    _check_ramp(start_frequency_hz, slope_hz_per_s, sample_rate_hz, n_samples, adc_start_s,
                magnitudes.device(propagation_speed_m_per_s))
    middle_s = adc_start_s + (n_samples - 1) / 2 / sample_rate_hz
    return RadarParameters(
        carrier_hz=start_frequency_hz + slope_hz_per_s * middle_s,
        bandwidth_hz=abs(slope_hz_per_s) * n_samples / sample_rate_hz,
        sample_rate_hz=sample_rate_hz, first_sample_delay_s=reference_delay_s,
        pulse_length_s=n_samples / sample_rate_hz, chirp_rate_hz_per_s=slope_hz_per_s,
        waveform=Waveform.FMCW_REAL if real_samples else Waveform.FMCW,
        propagation_speed_m_per_s=propagation_speed_m_per_s)


def _check_ramp(start_hz: float, slope: float, rate_hz: float, n_samples: int,
                adc_start_s: float, device: magnitudes.Device) -> None:
    check_magnitude('start_frequency_hz', start_hz, device.carrier)
    check_magnitude('slope_hz_per_s', slope, device.slope)
    check_magnitude('sample_rate_hz', rate_hz, device.sample_rate)
    if n_samples > _MOST_SAMPLES:
        raise ValueError(f'n_samples={n_samples} of one ramp; expected at most {_MOST_SAMPLES}: '
                         'pass the samples of one ramp, not of all')
    before_hz, swept_hz = abs(slope) * abs(adc_start_s), abs(slope) * n_samples / rate_hz
    if before_hz > start_hz:
        raise ValueError(
            f'adc_start_s={adc_start_s:.6g} s: the ramp would move {before_hz:.4g} Hz before the '
            f'first sample, from start_frequency_hz={start_hz:.6g}'
            + (probable_unit('adc_start_s', adc_start_s, device.delay)
               if abs(adc_start_s) > _LONGEST_START_S else f' by slope_hz_per_s={slope:.6g}'))
    if swept_hz > start_hz:
        raise ValueError(
            f'the samples would sweep {swept_hz:.4g} Hz from start_frequency_hz={start_hz:.6g}; '
            f'check slope_hz_per_s={slope:.6g}, n_samples={n_samples} and '
            f'sample_rate_hz={rate_hz:.6g}, in Hz/s and Hz')


def check_fmcw(radar: RadarParameters, n_samples: int) -> None:
    """Refuse parameters that do not describe N samples of one ramp.

    Raises
    ------
    ValueError
        There is no slope, or bandwidth and slope disagree by more than 1 %.
    """
    swept = abs(radar.chirp_rate_hz_per_s) * n_samples / radar.sample_rate_hz
    if abs(swept - radar.bandwidth_hz) > 0.01 * radar.bandwidth_hz:
        raise ValueError(
            f'{n_samples} samples at sample_rate_hz={radar.sample_rate_hz:.6g} of a ramp of '
            f'chirp_rate_hz_per_s={radar.chirp_rate_hz_per_s:.6g} sweep {swept:.6g} Hz, '
            f'bandwidth_hz={radar.bandwidth_hz:.6g}; use fmcw_parameters, which derives it')
