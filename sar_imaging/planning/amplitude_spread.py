"""Frequencies of echoes whose amplitude varies with direction, as that of narrow beams does."""

from __future__ import annotations

import math

import numpy as np

from ..geometry.illumination import AmplitudeSpread


def spread_frequencies(frequency, spread: float) -> np.ndarray:
    """Frequencies along direction of echoes whose amplitude varies with it.

    Parameters
    ----------
    frequency : (K, ...) float64
        Of echoes of even amplitude.
    spread : float
        Rms frequency of the amplitude, likewise.

    Returns
    -------
    (K or 6 K, ...) float64
        Alike in number for each node of a Gauss-Hermite rule of three nodes.
    """
    if spread == 0:
        return frequency
    beside = math.sqrt(3) * spread
    return np.concatenate([*[frequency] * 4, frequency - beside, frequency + beside])


def tail_error(spread: AmplitudeSpread, frequency, error_at, echoes=slice(None)) -> float:
    """Mean error of the faint frequencies of echoes' amplitudes, relative to their power.

    Of some echoes of even amplitude the frequencies are (K, R, S) float64, radians per unit of
    direction; ``error_at`` gives the error of some.
    """
    weight = 1.0 if spread.by_echo is None else spread.by_echo[echoes][:, None]
    return sum(0.5 * share * float(np.mean(
        weight * (error_at(frequency + f) + error_at(frequency - f))))
        for f, share in zip(spread.frequency, spread.share, strict=True) if share > 0)
