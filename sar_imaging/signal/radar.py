# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Parameters of the transmitted pulse and of the receiver's sampling."""

from __future__ import annotations

import dataclasses
import enum
import math

from . import magnitudes
from .magnitudes import SPEED_OF_LIGHT as SPEED_OF_LIGHT, check_magnitude


class Waveform(enum.IntEnum):
    """Kind of transmitted waveform; the number is its code on the wire.

    Examples
    --------
    >>> from sar_imaging import Waveform
    >>> from sar_imaging.simulation import SCENARIOS
    >>> SCENARIOS['psf_raw']().radar.waveform is Waveform.LFM
    True
    >>> [kind.name for kind in Waveform]
    ['LFM', 'STEPPED_FREQUENCY', 'FMCW', 'FMCW_REAL', 'PASSBAND']
    """

    LFM = 0  # linear frequency modulated pulses, sampled in fast time, demodulated to baseband
    STEPPED_FREQUENCY = 1  # phase history: one sample per frequency, ascending, carrier centred
    FMCW = 2  # dechirped ramp, complex converter: the beat of echo and transmitted ramp
    FMCW_REAL = 3  # the same with a real converter; imaginary parts are zero
    PASSBAND = 4  # real samples of the pulse at its carrier (UWB); imaginary parts are zero

    @property
    def is_real(self) -> bool:
        """Whether raw samples are real numbers."""
        return self in (Waveform.FMCW_REAL, Waveform.PASSBAND)

    @property
    def is_ramp(self) -> bool:
        """Whether raw samples are the beat of echo and transmitted ramp."""
        return self in (Waveform.FMCW, Waveform.FMCW_REAL)

    @property
    def is_phase_history(self) -> bool:
        """Whether raw samples run over frequency: compression is a Fourier transform."""
        return self.is_ramp or self == Waveform.STEPPED_FREQUENCY


@dataclasses.dataclass(frozen=True)
class RadarParameters:
    """Waveform and sampling of one radar.

    Delays are two-way, in seconds. For `Waveform.STEPPED_FREQUENCY` raw samples are frequencies
    ``carrier_hz + (n - (N - 1) / 2) * bandwidth_hz / N`` whose phase is referenced to a scatterer
    at the delay `first_sample_delay_s`; `sample_rate_hz` is then `bandwidth_hz`.

    For `Waveform.FMCW` raw samples are the echo times the conjugate of the reference ramp,
    ``exp(-j 2 pi (f_n u - K u^2 / 2))`` with ``f_n = carrier_hz + K (n - (N - 1) / 2) /
    sample_rate_hz``, the reference's frequency at sample n, and u the delay beyond
    `first_sample_delay_s`, the delay of the reference: 0 where the transmitted ramp itself is
    mixed. `bandwidth_hz` is what the N samples sweep, ``|K| N / sample_rate_hz``; see
    `sar_imaging.signal.dechirp.fmcw_parameters`. For `Waveform.FMCW_REAL` they are its real part.

    For `Waveform.PASSBAND` raw samples are ``Re(p(t - tau) exp(j 2 pi f_c (t - tau)))``.

    Parameters
    ----------
    carrier_hz : float
        Centre frequency that the receiver removes, hertz; of passband samples the middle of the
        band.
    bandwidth_hz : float
        Two-sided bandwidth of the waveform, hertz.
    sample_rate_hz : float
        Samples per second, hertz: complex ones, real ones of the waveforms that say so.
    first_sample_delay_s : float
        Two-way delay of sample 0 from the transmission of the pulse's leading edge (raw) or
        of its compressed peak (compressed, passband), seconds; of phase histories as told above.
    pulse_length_s : float
        Duration of the transmitted pulse, seconds.
    chirp_rate_hz_per_s : float
        Frequency slope K of a linear frequency modulated pulse or ramp, hertz per second, signed.
    waveform : Waveform
        Kind of waveform.
    propagation_speed_m_per_s : float
        Speed v of the waves, metres per second: c in air, ``c / sqrt(eps_r)`` in the ground, that
        of sound for a sonar. It is c in what the documentation writes as ``c / 2B`` and the like.

    Raises
    ------
    ValueError
        A value is not finite, not positive where it must be, or of a magnitude that no radar has
        (no sonar, where the waves are as slow as sound): a unit was mistaken, and the text says
        which one was probably meant.

    Examples
    --------
    >>> from sar_imaging import RadarParameters
    >>> radar = RadarParameters(carrier_hz=10e9, bandwidth_hz=300e6, sample_rate_hz=400e6,
    ...                         first_sample_delay_s=6.6e-6)
    >>> print(f'{radar.wavelength_m * 1000:.2f} mm, null spacing {radar.range_resolution_m:.3f} m')
    29.98 mm, null spacing 0.500 m
    >>> print(f'sample 0 at {radar.range_start_m:.1f} m')
    sample 0 at 989.3 m
    >>> RadarParameters(carrier_hz=10.0, bandwidth_hz=300e6, sample_rate_hz=400e6,
    ...                 first_sample_delay_s=6.6e-6)
    Traceback (most recent call last):
        ...
    ValueError: carrier_hz=10 Hz is not a radar's; expected 1e+06 to 2e+12 Hz; it was ...
    """

    carrier_hz: float
    bandwidth_hz: float
    sample_rate_hz: float
    first_sample_delay_s: float
    pulse_length_s: float = 0.0
    chirp_rate_hz_per_s: float = 0.0
    waveform: Waveform = Waveform.LFM
    propagation_speed_m_per_s: float = SPEED_OF_LIGHT

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):
            if field.name != 'waveform' and not math.isfinite(getattr(self, field.name)):
                raise ValueError(f'{field.name}={getattr(self, field.name)} is not finite')
        for name in ('carrier_hz', 'bandwidth_hz', 'sample_rate_hz',
                     'propagation_speed_m_per_s'):
            if getattr(self, name) <= 0:
                raise ValueError(f'{name}={getattr(self, name)} must be positive')
        if self.pulse_length_s < 0:
            raise ValueError(f'pulse_length_s={self.pulse_length_s} must not be negative')
        self._check_magnitudes()
        object.__setattr__(self, 'waveform', Waveform(self.waveform))

    def _check_magnitudes(self) -> None:
        check_magnitude('propagation_speed_m_per_s', self.propagation_speed_m_per_s,
                        magnitudes.SPEED)
        device = magnitudes.device(self.propagation_speed_m_per_s)
        check_magnitude('carrier_hz', self.carrier_hz, device.carrier)
        check_magnitude('bandwidth_hz', self.bandwidth_hz, device.bandwidth)
        check_magnitude('sample_rate_hz', self.sample_rate_hz, device.sample_rate)
        check_magnitude('first_sample_delay_s', self.first_sample_delay_s, device.delay)
        if self.chirp_rate_hz_per_s:
            check_magnitude('chirp_rate_hz_per_s', self.chirp_rate_hz_per_s, device.slope)

    @property
    def wavelength_m(self) -> float:
        """Wavelength at the carrier, metres."""
        return self.propagation_speed_m_per_s / self.carrier_hz

    @property
    def wavenumber_rad_per_m(self) -> float:
        """Two-way wavenumber ``4 pi f / c`` at the carrier, radians per metre of half path."""
        return 4.0 * math.pi * self.carrier_hz / self.propagation_speed_m_per_s

    @property
    def half_band_rad_per_m(self) -> float:
        """Half of the band as two-way wavenumber, ``2 pi B / c``, radians per metre."""
        return 2 * math.pi * self.bandwidth_hz / self.propagation_speed_m_per_s

    @property
    def wavenumbers_rad_per_m(self) -> tuple[float, float]:
        """Two-way wavenumbers at the lower and the upper edge of the band, radians per metre."""
        k, half = self.wavenumber_rad_per_m, self.half_band_rad_per_m
        return k - half, k + half

    @property
    def shortest_wavelength_m(self) -> float:
        """Wavelength at the upper edge of the band, metres."""
        return self.propagation_speed_m_per_s / (self.carrier_hz + self.bandwidth_hz / 2)

    @property
    def range_resolution_m(self) -> float:
        """Spacing of the nulls of an unweighted range response, ``c / 2B``, metres."""
        return self.propagation_speed_m_per_s / (2.0 * self.bandwidth_hz)

    @property
    def sample_spacing_m(self) -> float:
        """Half-path distance between fast-time samples, ``c / 2 f_s``, metres."""
        return self.propagation_speed_m_per_s / (2.0 * self.sample_rate_hz)

    @property
    def range_start_m(self) -> float:
        """Half-path distance of sample 0, metres."""
        return self.propagation_speed_m_per_s * self.first_sample_delay_s / 2.0
