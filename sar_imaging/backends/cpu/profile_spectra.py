"""Spectra from which profiles are resampled: of profiles, or phase histories as they came."""

from __future__ import annotations

import numpy as np
import scipy.fft

from ...compilation import numba
from ...planning.profiles.phase_history import PhaseHistory
from ...planning.profiles.range_gate import RangeGate, rise


def spectra(source: RangeGate | PhaseHistory, samples: np.ndarray, n_padded: int,
            buffer) -> np.ndarray:
    """Spectra of what an image needs of some profiles.

    Parameters
    ----------
    source, samples, n_padded :
        As for `backends.reference.resample_profiles.profile_spectra`.
    buffer : callable
        ``buffer(name, shape, dtype)`` gives the memory.

    Returns
    -------
    (R, n_padded) complex64
    """
    if source.periodic:
        return samples
    padded = buffer('spectrum', (len(samples), n_padded), np.complex64)
    cut_profiles(source, samples, padded)
    return scipy.fft.fft(padded, axis=-1, workers=numba.get_num_threads(), overwrite_x=True)


def cut_profiles(window: RangeGate, samples: np.ndarray, out: np.ndarray) -> None:
    """Copy the window of profiles (R, N) to the start of `out` (R, M), zero beyond it."""
    n = window.n_samples
    out[:, :n] = samples[:, window.first:window.first + n]
    out[:, n:] = 0.0
    if window.n_rise:
        out[:, :window.n_rise] *= rise(window.n_rise)
    if window.n_fall:
        out[:, n - window.n_fall:n] *= rise(window.n_fall)[::-1]
