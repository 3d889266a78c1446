# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Channel calibration: amplitude, phase and delay of each channel relative to the others.

A channel with errors records ``g exp(j phi) s(t - delta)`` where a perfect one records the
baseband profile s(t): g from its amplifiers, phi at the carrier, delta from its lines. They are
removed in the spectrum, while the pulses are compressed
(`sar_imaging.signal.range_compression.RangeCompressor`), or from profiles by `apply`. How they are
estimated: `sar_imaging.exploitation.calibration`.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import yaml
from numpy.typing import ArrayLike
from scipy import fft

from ..files import replacing
from ..yaml_text import read_yaml
from .pulses import PulseBlock

_HEADER = """\
# Channel calibration: what each channel records relative to a perfect one, and is divided by.
# amplitude: factor; phase_deg: at the carrier; delay_s: of the envelope. In order of channels.
"""
_FIELDS = ('amplitude', 'phase_deg', 'delay_s')


class CalibrationError(ValueError):
    """A calibration file cannot be read; the text says why.

    Examples
    --------
    >>> from sar_imaging.signal.calibration import CalibrationError, ChannelCalibration
    >>> with open('empty.yaml', 'w') as file:
    ...     _ = file.write('channels: none')
    >>> try:
    ...     ChannelCalibration.load('empty.yaml')
    ... except CalibrationError as error:
    ...     print(error)
    calibration empty.yaml: expected the lists amplitude, phase_deg, delay_s and nothing else
    """


@dataclasses.dataclass(frozen=True)
class ChannelCalibration:
    """Errors of amplitude, phase and delay of the channels of one radar.

    Parameters
    ----------
    amplitude : (C,) float64
        Factor g of each channel, positive.
    phase_rad : (C,) float64
        Phase phi of each channel at the carrier, radians.
    delay_s : (C,) float64
        Two-way delay delta of each channel's envelope, seconds.

    Raises
    ------
    ValueError
        Lengths differ, a number is not finite, or an amplitude is not positive.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging.signal.calibration import ChannelCalibration
    >>> found = ChannelCalibration(amplitude=np.array([1.0, 0.8]), phase_rad=np.array([0.0, 0.5]),
    ...                            delay_s=np.zeros(2))
    >>> found.save('channels.yaml')
    >>> abs(ChannelCalibration.load('channels.yaml').weights).round(3).tolist()
    [1.0, 1.25]
    """

    amplitude: np.ndarray
    phase_rad: np.ndarray
    delay_s: np.ndarray

    def __post_init__(self) -> None:
        for field in dataclasses.fields(self):
            value = np.atleast_1d(np.asarray(getattr(self, field.name), float))
            object.__setattr__(self, field.name, value)
            if value.ndim != 1 or value.shape != self.amplitude.shape or not value.size:
                raise ValueError(f'{field.name}.shape={value.shape} does not match '
                                 f'amplitude.shape={self.amplitude.shape}; give one number per '
                                 'channel')
            if not np.isfinite(value).all():
                raise ValueError(f'{field.name}={value} is not finite')
        if not (self.amplitude > 0).all():
            raise ValueError(f'amplitude={self.amplitude}; expected positive factors; leave a '
                             'dead channel out of the data')

    @classmethod
    def none(cls, n_channels: int) -> ChannelCalibration:
        """Calibration that changes nothing."""
        return cls(np.ones(n_channels), np.zeros(n_channels), np.zeros(n_channels))

    @property
    def n_channels(self) -> int:
        """Number of channels C."""
        return self.amplitude.size

    @property
    def weights(self) -> np.ndarray:
        """(C,) complex64 factors that remove amplitude and phase: weights of a backprojector."""
        return (np.exp(-1j * self.phase_rad) / self.amplitude).astype(np.complex64)

    def check_channels(self, n_channels: int) -> None:
        """Raise ValueError when a block has another number of channels."""
        if n_channels != self.n_channels:
            raise ValueError(f'the block has {n_channels} channels, the calibration is for '
                             f'{self.n_channels}; use the calibration of this radar')

    def correction(self, baseband_hz: np.ndarray) -> np.ndarray:
        """(C, K) complex128 factors that remove the errors at K baseband frequencies, hertz."""
        cycles = self.delay_s[:, None] * np.asarray(baseband_hz, float)
        phasor = np.exp(1j * (2 * np.pi * cycles - self.phase_rad[:, None]))
        return phasor / self.amplitude[:, None]

    def apply(self, profiles: PulseBlock) -> PulseBlock:
        """Remove the errors from range profiles, taken as one period of a periodic signal.

        Raises
        ------
        ValueError
            The block is not compressed or has another number of channels.
        """
        if not profiles.compressed:
            raise ValueError('the block holds raw pulses; give the calibration to the '
                             'RangeCompressor')
        self.check_channels(profiles.n_channels)
        if not self.delay_s.any():
            return dataclasses.replace(profiles, samples=profiles.samples * self.weights[:, None])
        frequency = fft.fftfreq(profiles.n_samples, 1.0 / profiles.radar.sample_rate_hz)
        factor = self.correction(frequency).astype(np.complex64)
        samples = fft.ifft(fft.fft(profiles.samples) * factor, overwrite_x=True)
        return dataclasses.replace(profiles, samples=samples)

    def followed_by(self, other: ChannelCalibration) -> ChannelCalibration:
        """Errors of both: `other` was estimated after these had been removed."""
        other.check_channels(self.n_channels)
        return ChannelCalibration(self.amplitude * other.amplitude,
                                  _wrapped(self.phase_rad + other.phase_rad),
                                  self.delay_s + other.delay_s)

    def save(self, path: Path | str) -> None:
        """Write a YAML file; numbers keep all their digits."""
        values = {'amplitude': self.amplitude.tolist(),
                  'phase_deg': np.degrees(self.phase_rad).tolist(),
                  'delay_s': self.delay_s.tolist()}
        with replacing(path) as part:
            part.write_text(_HEADER + yaml.safe_dump(values, sort_keys=False,
                                                     default_flow_style=None))

    @classmethod
    def load(cls, path: Path | str) -> ChannelCalibration:
        """Read a file that `save` wrote, or a person in its form.

        Raises
        ------
        CalibrationError
            The file is missing, is not YAML of this form, or holds impossible numbers.
        """
        try:
            values = read_yaml(path)
        except ValueError as error:
            raise CalibrationError(f'calibration {error}; expected what the tool calibrate '
                                   'writes') from error
        if not isinstance(values, dict) or set(values) != set(_FIELDS):
            raise CalibrationError(f'calibration {path}: expected the lists {", ".join(_FIELDS)} '
                                   'and nothing else')
        try:
            # People put numbers in quotes, too.
            amplitude, phase_deg, delay_s = (_numbers(values[name]) for name in _FIELDS)
            return cls(amplitude, np.radians(phase_deg), delay_s)
        except (TypeError, ValueError) as error:
            raise CalibrationError(f'calibration {path}: {error}') from error


def _numbers(values: ArrayLike) -> np.ndarray:
    if not isinstance(values, list) or any(isinstance(v, bool) for v in values):
        raise ValueError('expected lists of numbers, one per channel')
    try:
        return np.array([float(v) for v in values])
    except ValueError:
        raise ValueError('expected lists of numbers, one per channel') from None


def _wrapped(phase_rad: np.ndarray) -> np.ndarray:
    """Phase between -pi and pi."""
    return np.angle(np.exp(1j * phase_rad))
