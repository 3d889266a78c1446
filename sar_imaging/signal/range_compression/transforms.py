"""Fourier transforms of range compression where the samples lie: on the processor or a device."""

from __future__ import annotations

import numpy as np
from scipy import fft

from ...compilation import numba
from ...device_arrays import on_device


def forward(samples, n: int):
    """(..., n) complex64 transform of samples (..., N), with zeros behind them."""
    if on_device(samples):
        return np.fft.fft(samples, n).astype(np.complex64, copy=False)
    return fft.fft(samples, n, workers=numba.get_num_threads())


def inverse(spectra, n: int):
    """(..., n) complex64 inverse transform, divided by n, of spectra, which may be overwritten."""
    if on_device(spectra):
        return np.fft.ifft(spectra, n).astype(np.complex64, copy=False)
    return fft.ifft(spectra, n, overwrite_x=True, workers=numba.get_num_threads())
