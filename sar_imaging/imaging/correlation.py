"""Time-domain correlation (TDC): the exact image, and the reference of every other imager.

Rosenberg & Gray, equations 7 and 8, evaluated in float64 straight from the spectra; nothing is
interpolated and the two-way path of every channel is exact.
"""

from __future__ import annotations

import numpy as np
from tqdm import tqdm

from ..compilation import njit, numba
from ..signal.radar import SPEED_OF_LIGHT

_LANES = 16  # points advanced together: enough independent sums to hide the latency of one
_POINTS_PER_CALL = 4096


def correlate(frequencies_hz, spectra, tx_m, rx_m, points, *, progress: bool = False):
    """Correlate the spectra with the exact reference of every point.

    ``f(x) = sum_m sum_n sum_f S_mn(f) exp(+j 2 pi f tau_mn(x))`` with the two-way delay
    ``tau_mn(x) = (|tx_mn - x| + |rx_mn - x|) / c``.

    Parameters
    ----------
    frequencies_hz : (K,) array_like
        Absolute frequencies, equally spaced, hertz.
    spectra : (P, C, K) complex array_like
        Spectra referred to zero delay, as `sar_imaging.signal.spectra.band_spectrum` gives them.
    tx_m, rx_m : (P, C, 3) array_like
        Transmit and receive phase centres, metres.
    points : (..., 3) array_like
        Positions to image, in the frame of the phase centres, metres.
    progress : bool
        Show a progress bar on standard error.

    Returns
    -------
    (...) complex128
        Image at the points.

    Raises
    ------
    ValueError
        Shapes disagree, the frequencies are not equally spaced, or something is not finite.
    """
    frequencies = np.asarray(frequencies_hz, np.float64)
    spectra = np.ascontiguousarray(spectra, np.complex128)
    tx, rx = (np.ascontiguousarray(a, np.float64) for a in (tx_m, rx_m))
    points = np.asarray(points, np.float64)
    _check(frequencies, spectra, tx, rx, points)
    step = (frequencies[-1] - frequencies[0]) / max(len(frequencies) - 1, 1)
    flat = np.ascontiguousarray(points.reshape(-1, 3))
    out = np.empty(len(flat), np.complex128)
    re, im = np.ascontiguousarray(spectra.real), np.ascontiguousarray(spectra.imag)
    with tqdm(total=len(flat), desc='correlation', unit='pixel', disable=not progress) as bar:
        for start in range(0, len(flat), _POINTS_PER_CALL):
            part = slice(start, min(start + _POINTS_PER_CALL, len(flat)))
            _correlate(frequencies[0] / SPEED_OF_LIGHT, step / SPEED_OF_LIGHT, re, im, tx, rx,
                       flat[part], out[part])
            bar.update(part.stop - part.start)
    return out.reshape(points.shape[:-1])


def _check(frequencies, spectra, tx, rx, points):
    if spectra.ndim != 3 or spectra.shape[-1] != len(frequencies):
        raise ValueError(f'spectra.shape={spectra.shape} does not match '
                         f'{len(frequencies)} frequencies; expected (pulses, channels, K)')
    expected = (*spectra.shape[:2], 3)
    for name, array in (('tx_m', tx), ('rx_m', rx)):
        if array.shape != expected:
            raise ValueError(f'{name}.shape={array.shape}; expected {expected}, one position '
                             'per pulse and channel')
    if points.shape[-1:] != (3,):
        raise ValueError(f'points.shape={points.shape}; expected (..., 3)')
    for name, array in (('frequencies_hz', frequencies), ('spectra', spectra), ('tx_m', tx),
                        ('rx_m', rx), ('points', points)):
        if not np.isfinite(array).all():
            raise ValueError(f'{name} contains NaN or infinity')
    steps = np.diff(frequencies)
    if steps.size and np.ptp(steps) > 1e-6 * np.abs(steps).max() + 1e-15 * frequencies.max():
        raise ValueError('frequencies_hz are not equally spaced: steps from '
                         f'{steps.min()} to {steps.max()} Hz')


@njit(parallel=True)
def _correlate(first, step, re, im, tx, rx, points, out):
    """Horner's rule in ``exp(j 2 pi step tau)``, `_LANES` points side by side.

    `first` and `step` are in cycles per metre of two-way path.
    """
    n_pulses, n_channels, n_bins = re.shape
    n_groups = (len(points) + _LANES - 1) // _LANES
    for group in numba.prange(n_groups):
        lo = group * _LANES
        n = min(_LANES, len(points) - lo)
        total_re, total_im = np.zeros(_LANES), np.zeros(_LANES)
        acc_re, acc_im = np.empty(_LANES), np.empty(_LANES)
        z_re, z_im = np.empty(_LANES), np.empty(_LANES)
        path = np.zeros(_LANES)
        for m in range(n_pulses):
            for c in range(n_channels):
                for i in range(n):
                    path[i] = (_distance(points[lo + i], tx[m, c])
                               + _distance(points[lo + i], rx[m, c]))
                    cycles = step * path[i]
                    angle = 2 * np.pi * (cycles - np.floor(cycles))
                    z_re[i], z_im[i] = np.cos(angle), np.sin(angle)
                acc_re[:], acc_im[:] = 0.0, 0.0
                for k in range(n_bins - 1, -1, -1):
                    a, b = re[m, c, k], im[m, c, k]
                    for i in range(_LANES):
                        r = acc_re[i] * z_re[i] - acc_im[i] * z_im[i] + a
                        acc_im[i] = acc_re[i] * z_im[i] + acc_im[i] * z_re[i] + b
                        acc_re[i] = r
                for i in range(n):
                    cycles = first * path[i]
                    angle = 2 * np.pi * (cycles - np.floor(cycles))
                    w_re, w_im = np.cos(angle), np.sin(angle)
                    total_re[i] += acc_re[i] * w_re - acc_im[i] * w_im
                    total_im[i] += acc_re[i] * w_im + acc_im[i] * w_re
        for i in range(n):
            out[lo + i] = total_re[i] + 1j * total_im[i]


@njit(inline='always')
def _distance(a, b):
    return np.sqrt((a[0] - b[0]) ** 2 + (a[1] - b[1]) ** 2 + (a[2] - b[2]) ** 2)
