"""Whose Fourier transforms are used: those of this package, or SciPy's in their place."""

from __future__ import annotations

import os

import numpy as np
import scipy.fft

from ....compilation import numba

VARIABLE = 'SAR_IMAGING_TRANSFORMS'  # of the environment
OWN, SCIPY = 'own', 'scipy'


def own_transforms() -> bool:
    """Whether the transforms of this package are used, where they know the length.

    Raises
    ------
    ValueError
        The environment asks for some that there are not.
    """
    choice = os.environ.get(VARIABLE, OWN)
    if choice not in (OWN, SCIPY):
        raise ValueError(f'{VARIABLE}={choice!r}; expected {OWN}, or {SCIPY} for those of SciPy')
    return choice == OWN


def transform_by_scipy(data: np.ndarray, axis: int, *, inverse: bool) -> None:
    """Replace samples by their transform along an axis; neither direction divides by n."""
    transform, norm = (scipy.fft.ifft, 'forward') if inverse else (scipy.fft.fft, 'backward')
    result = transform(data, axis=axis, workers=numba.get_num_threads(), overwrite_x=True,
                       norm=norm)
    if not np.may_share_memory(result, data):  # SciPy may overwrite, but need not
        data[:] = result
