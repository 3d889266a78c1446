# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""The radar constant, which ties the samples of range profiles to square metres."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.ndimage import map_coordinates

from ..files import told
from ..yaml_text import read_yaml
from .response import ImageResponse

_QUIET_SHARE = 16  # of the profile: the piece without echoes that noise is measured in
_LEAST_GAIN = 1e-30  # images, of float32, overflow by less


@dataclasses.dataclass(frozen=True)
class RadarConstant:
    """Radar constant and noise: what turns image power into brightness.

    The peak in the range profile of a target of cross section sigma, at distances R_t and R_r from
    the phase centres, is ``gain sqrt(sigma) w / (R_t R_r)`` with the two-way amplitude w of the
    antenna pattern (the radar equation; M. I. Skolnik, Radar Handbook, 3rd ed., chapter 1).

    Parameters
    ----------
    gain : float
        Gain of the whole radar, metres times the unit of the samples.
    noise_power : float
        Mean squared magnitude of the noise in a sample of a profile; NaN if not known.

    Raises
    ------
    ValueError
        The gain is not positive and finite, or the noise is negative.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging import MapGrid, RadarParameters
    >>> from sar_imaging.radiometry import RadarConstant, image_response
    >>> radar = RadarParameters(10e9, 300e6, 400e6, first_sample_delay_s=6e-7)
    >>> track = np.zeros((64, 1, 3))
    >>> track[:, 0, 1:] = np.stack([np.linspace(-5, 5, 64), np.full(64, 50.0)], axis=-1)
    >>> response = image_response(MapGrid((80.0, 0.0, 0.0), 16, 16, 0.5), radar, track, track)
    >>> constant = RadarConstant.from_reflector(amplitude=0.8, pixel=(8, 8), response=response,
    ...                                         cross_section_m2=37.7)
    >>> print(f'gain {constant.gain:.1f} m')
    gain 18.2 m
    """

    gain: float
    noise_power: float = math.nan

    def __post_init__(self) -> None:
        if not _LEAST_GAIN < self.gain < 1 / _LEAST_GAIN:  # NaN, too
            raise ValueError(f'gain={self.gain}; expected a positive number: measure it with '
                             'RadarConstant.from_reflector')
        if self.noise_power < 0:
            raise ValueError(f'noise_power={self.noise_power}; expected 0 or more')

    @classmethod
    def load(cls, path: Path | str) -> RadarConstant:
        """Of a YAML file with `gain_m` and, if known, `noise_power`.

        Parameters
        ----------
        path : path
            As `sar-imaging radar-constant` writes it.

        Raises
        ------
        ValueError
            The file cannot be read, or lacks the gain; the text names it.
        """
        try:
            content = read_yaml(path)
            return cls(float(content['gain_m']), float(content.get('noise_power', math.nan)))
        except (TypeError, KeyError, AttributeError, ValueError) as error:
            raise ValueError(f'{path} is no file of a radar constant ({told(error)}); '
                             '`sar-imaging radar-constant` writes one, with gain_m and noise_power'
                             ) from error

    @classmethod
    def from_reflector(cls, amplitude: float, pixel: Sequence[float] | np.ndarray,
                       response: ImageResponse, cross_section_m2: float,
                       noise_power: float = math.nan) -> RadarConstant:
        """Measured at a reflector of known cross section.

        Parameters
        ----------
        amplitude : float
            Magnitude of the image at the reflector's peak, such as
            `sar_imaging.quality.impulse_response.measure_scatterer` finds between pixels.
        pixel : (2,) floats
            Row and column of the reflector, whole or not.
        response : ImageResponse
            Response of the image.
        cross_section_m2 : float
            Cross section of the reflector, square metres; see `trihedral_cross_section_m2`.
        noise_power : float
            As of the constructor.

        Raises
        ------
        ValueError
            The reflector is outside the image or not lit, or the cross section is not positive.
        """
        row, column = (float(p) for p in pixel)
        shape = response.amplitude.shape
        if not (0 <= row <= shape[0] - 1 and 0 <= column <= shape[1] - 1):
            raise ValueError(f'the reflector is at row {row:g}, column {column:g} of an image of '
                             f'{shape[0]} rows and {shape[1]} columns; give its place inside')
        if not cross_section_m2 > 0:
            raise ValueError(f'cross_section_m2={cross_section_m2}; expected more than 0')
        [of_one] = map_coordinates(response.amplitude, [[row], [column]], order=1)
        if not of_one > 0:
            raise ValueError('the antenna does not light the reflector; choose another')
        return cls(float(amplitude / (of_one * math.sqrt(cross_section_m2))), noise_power)


def trihedral_cross_section_m2(edge_m: float, wavelength_m: float) -> float:
    """Cross section of a triangular trihedral on its axis, ``4 pi a^4 / (3 lambda^2)``.

    Parameters
    ----------
    edge_m : float
        Length a of an edge where two of its plates meet, metres.
    wavelength_m : float
        Wavelength of the carrier, metres; the edge should be several of them.

    Returns
    -------
    float
        Square metres.

    Examples
    --------
    >>> from sar_imaging.radiometry import trihedral_cross_section_m2
    >>> round(trihedral_cross_section_m2(0.3, 0.03), 1)
    37.7
    """
    return 4 * math.pi * edge_m ** 4 / (3 * wavelength_m ** 2)


def noise_power(profiles: np.ndarray) -> float:
    """Mean squared magnitude of the noise, from the quietest piece of the range profiles.

    Right where a sixteenth of the profiles holds no echoes, as before the first return; too large
    by the weakest echoes elsewhere.

    Parameters
    ----------
    profiles : (..., N) complex
        Range profiles of many pulses.

    Returns
    -------
    float
        In the squared unit of the samples.

    Raises
    ------
    ValueError
        There are fewer than 16 samples.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging.radiometry import noise_power
    >>> rng = np.random.default_rng(1)
    >>> noise = rng.standard_normal((2, 200, 1, 256)) / 10
    >>> profiles = noise[0] + 1j * noise[1]
    >>> profiles[..., 100:120] += 5.0  # echoes
    >>> print(f'{noise_power(profiles):.3f}')
    0.019
    """
    profiles = np.asarray(profiles)
    n = profiles.shape[-1] // _QUIET_SHARE
    if n < 1:
        raise ValueError(f'{profiles.shape[-1]} samples; expected {_QUIET_SHARE} or more')
    power = np.abs(profiles.reshape(-1, profiles.shape[-1])) ** 2
    total = np.concatenate([[0.0], np.cumsum(power.mean(axis=0, dtype=np.float64))])
    return float((total[n:] - total[:-n]).min() / n)
