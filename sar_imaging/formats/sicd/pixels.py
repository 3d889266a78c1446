"""Pixels as SICD stores them: floating point, integers of 16 bits, amplitude and phase of 8."""

from __future__ import annotations

import numpy as np

FLOAT, INTEGER, AMPLITUDE_PHASE = PIXEL_TYPES = 'RE32F_IM32F', 'RE16I_IM16I', 'AMP8I_PHS8I'
DTYPES = {FLOAT: np.dtype(np.complex64),
          INTEGER: np.dtype([('real', np.int16), ('imag', np.int16)]),
          AMPLITUDE_PHASE: np.dtype([('amp', np.uint8), ('phase', np.uint8)])}
_LARGEST = 32767
_TABLE_DB = 72.0  # of amplitudes of 8 bits: 0.28 dB from one to the next


def encoded(samples: np.ndarray, pixel_type: str) -> tuple[np.ndarray, np.ndarray | None,
                                                           float | None]:
    """Pixels of a type from complex samples.

    Parameters
    ----------
    samples : (rows, columns) complex64
        At baseband.
    pixel_type : str
        One of `PIXEL_TYPES`.

    Returns
    -------
    pixels : (rows, columns)
        Of the type's dtype.
    amplitudes : (256,) float64 or None
        What codes of 8 bits stand for.
    scale : float or None
        What integers were multiplied by.

    Raises
    ------
    ValueError
        There is no such type, or a sample is not finite.
    """
    if pixel_type not in PIXEL_TYPES:
        raise ValueError(f'pixel_type={pixel_type!r}; expected one of {", ".join(PIXEL_TYPES)}')
    if pixel_type == FLOAT:
        return samples, None, None
    if not np.isfinite(samples).all():
        raise ValueError(f'{np.count_nonzero(~np.isfinite(samples))} samples are NaN or infinite, '
                         f'which {pixel_type} cannot hold; write {FLOAT}')
    out = np.empty(samples.shape, DTYPES[pixel_type])
    if pixel_type == INTEGER:
        scale = _integer_scale(samples)
        out['real'], out['imag'] = (np.rint(part * scale) for part in (samples.real.astype(float),
                                                                       samples.imag.astype(float)))
        return out, None, scale
    magnitude = np.abs(samples.astype(np.complex128))
    table = _amplitudes(float(magnitude.max(initial=0.0)))
    edges = 0.5 * (table[1:] + table[:-1])
    out['amp'] = np.searchsorted(edges, magnitude)
    turns = np.angle(samples.astype(np.complex128)) / (2 * np.pi)
    out['phase'] = np.rint(256 * turns).astype(np.int64) % 256
    return out, table, None


def decoded(pixels: np.ndarray, amplitudes: np.ndarray | None, scale: float) -> np.ndarray:
    """(rows, columns) complex64 samples of pixels of any type.

    Parameters
    ----------
    pixels : (rows, columns)
        In the machine's byte order.
    amplitudes : (256,) float64 or None
        What codes of 8 bits stand for; themselves unless told.
    scale : float
        What samples were multiplied by.
    """
    if pixels.dtype == DTYPES[FLOAT]:
        return pixels
    if pixels.dtype == DTYPES[INTEGER]:
        out = np.empty(pixels.shape, np.complex64)
        out.real, out.imag = pixels['real'] / scale, pixels['imag'] / scale
        return out
    table = np.arange(256.0) if amplitudes is None else amplitudes
    phasors = np.exp(2j * np.pi * np.arange(256) / 256)
    return (table[pixels['amp']] * phasors[pixels['phase']]).astype(np.complex64)


def _integer_scale(samples: np.ndarray) -> float:
    """Factor that uses the range of the integers; 1 for samples that are such integers."""
    values = np.ascontiguousarray(samples).view(np.float32)
    largest = float(np.abs(values).max(initial=0.0))
    if largest <= _LARGEST and (values == np.rint(values)).all():
        return 1.0
    return _LARGEST / largest


def _amplitudes(largest: float) -> np.ndarray:
    """Nothing, then even steps in decibels up to the largest.

    That is rounded, so that what was read from a file gets the same table again.
    """
    levels = 10 ** (np.linspace(-_TABLE_DB, 0.0, 255) / 20)
    return np.concatenate([[0.0], (float(f'{largest:.4e}') or 1.0) * levels])
