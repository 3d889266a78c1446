# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Operation 3: backprojection onto arbitrary points, and onto few for a search."""

from __future__ import annotations

import numpy as np

from ...geometry.illumination import Illumination
from ...planning.profiles import PhaseHistory, RangeGate
from ...signal.radar import RadarParameters
from .resample_profiles import profile_spectra, resample_profiles


def half_paths(tx_m: np.ndarray, rx_m: np.ndarray, points_m: np.ndarray) -> np.ndarray:
    """Half the way from transmitter to point to receiver, ``(|tx - x| + |rx - x|) / 2``.

    Parameters
    ----------
    tx_m, rx_m : (3,) float64
        Phase centres, metres.
    points_m : (..., 3) float64
        Positions, metres.

    Returns
    -------
    (...) float64
        Metres.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging.backends.reference.project_points import half_paths
    >>> points = np.array([[100.0, 0.0, 0.0], [0.0, 50.0, 0.0]])
    >>> half_paths(np.zeros(3), np.zeros(3), points).tolist()
    [100.0, 50.0]
    """
    return 0.5 * (np.linalg.norm(points_m - tx_m, axis=-1)
                  + np.linalg.norm(points_m - rx_m, axis=-1))


def project_points(source: RangeGate | PhaseHistory, samples: np.ndarray, n_padded: int,
                   tx_m: np.ndarray, rx_m: np.ndarray, points_m: np.ndarray,
                   illumination: Illumination | None = None) -> np.ndarray:
    """Sum of range profiles at points, each with the phase of its path.

    ``f(x) = sum_r w_r(x) s_r(D_r(x)) exp(+j 4 pi D_r(x) / lambda)``: Rosenberg & Gray, equations
    13 to 17, with the exact path of every channel.

    Parameters
    ----------
    source, samples, n_padded :
        As for `profile_spectra`.
    tx_m, rx_m : (R, 3) float64
        Phase centres of the echoes, metres.
    points_m : (..., 3) float64
        Positions, metres; with a NaN for none.
    illumination : Illumination, optional
        Illumination of the echoes: w; 1 without.

    Returns
    -------
    (...) complex128
        0 where there is no position.
    """
    spectra = profile_spectra(source, samples, n_padded)
    known = ~np.isnan(points_m).any(axis=-1)
    image = np.zeros(known.shape, np.complex128)
    for echo, (spectrum, tx, rx) in enumerate(zip(spectra, tx_m, rx_m, strict=True)):
        path = half_paths(tx, rx, points_m[known])
        weight = 1.0 if illumination is None else illumination.select([echo]).amplitude(
            points_m[known])[0]
        cycles = 2 * (path - source.phase_range_m) / source.radar.wavelength_m
        image[known] += (weight * resample_profiles(source, spectrum[None], path[None])[0]
                         * np.exp(2j * np.pi * np.fmod(cycles, 1.0)))
    return image


class TrialImages:
    """Quick images for the search of autofocus: profiles are linear between their samples.

    As `backends.protocol.TrialImages` describes it.

    Parameters
    ----------
    radar : RadarParameters
        Radar parameters of the profiles.
    samples : (R, N) complex64
        Profiles.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging.backends.reference import TrialImages
    >>> from sar_imaging.simulation import SCENARIOS
    >>> block = next(SCENARIOS['psf']().blocks(10))
    >>> rows = [a.reshape(50, -1) for a in (block.samples, block.tx_m, block.rx_m)]
    >>> trial = TrialImages(block.radar, rows[0])
    >>> step_m = np.array([0.25, 0.0, 0.0])
    >>> first = np.array([[10_000.0, 0.0, 0.0]]) - (trial.length // 2) * step_m
    >>> real, imaginary = trial.image(*rows[1:], first, step_m)
    >>> peak = int(np.hypot(real, imaginary)[0].argmax())
    >>> print(f'brightest at x = {first[0, 0] + peak * step_m[0]:.0f} m')
    brightest at x = 10000 m
    """

    length = 16

    def __init__(self, radar: RadarParameters, samples: np.ndarray) -> None:
        self._radar, self._profiles = radar, samples.reshape(-1, samples.shape[-1])

    def image(self, tx_m: np.ndarray, rx_m: np.ndarray, starts_m: np.ndarray, step_m: np.ndarray,
              range_bias_m: float = 0.0) -> np.ndarray:
        """``f(x) = sum_r s_r(D_r(x)) exp(+j 4 pi D_r(x) / lambda)``, s_r linear and 0 outside."""
        radar, n = self._radar, self._profiles.shape[-1]
        points = starts_m[:, None] + np.arange(self.length)[:, None] * step_m
        start_m = radar.range_start_m - range_bias_m
        sampled_m = start_m + np.arange(-1, n + 1) * radar.sample_spacing_m
        image = np.zeros(points.shape[:-1], np.complex128)
        for profile, tx, rx in zip(self._profiles, tx_m.reshape(-1, 3), rx_m.reshape(-1, 3),
                                   strict=True):
            path = half_paths(tx, rx, points)
            cycles = np.fmod(2 * path / radar.wavelength_m, 1.0)
            image += np.interp(path, sampled_m, np.pad(profile, 1)) * np.exp(2j * np.pi * cycles)
        return np.stack([image.real, image.imag]).astype(np.float32)
