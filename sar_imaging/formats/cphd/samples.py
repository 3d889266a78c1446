"""Samples of vectors as numbers, and phase ramps along them."""

from __future__ import annotations

import numpy as np

_FINE = 64  # samples over which a ramp is computed before it is repeated
_LARGEST = {'CI2': 127, 'CI4': 32767}


def decode(raw: np.ndarray, amplitude: np.ndarray, sign: int) -> np.ndarray:
    """Samples of the phase convention ``exp(-j 2 pi f tau)`` from those of a file.

    Parameters
    ----------
    raw : (P, N) complex64 or (P, N, 2) integers
        As `Container.read_samples` gives them.
    amplitude : (P,) float64
        Factor of each vector.
    sign : int
        SGN of the file.

    Returns
    -------
    (P, N) complex64
    """
    if raw.ndim == 3:
        samples = raw.astype(np.float32).view(np.complex64)[..., 0]
    else:
        samples = raw.astype(np.complex64)
    if (amplitude != 1.0).any():
        samples = (samples * amplitude[:, None]).astype(np.complex64)
    return samples.conj() if sign > 0 else samples


def encode(samples: np.ndarray, amplitude: np.ndarray, sign: int, sample_type: str) -> np.ndarray:
    """Inverse of `decode`: (P, N) complex64, or (P, N, 2) integers, big endian."""
    if sign > 0:
        samples = samples.conj()
    if (amplitude != 1.0).any():
        samples = samples / amplitude[:, None]
    if sample_type == 'CF8':
        return samples.astype('>c8')
    parts = np.ascontiguousarray(samples, np.complex128).view(np.float64)
    largest = _LARGEST[sample_type]
    whole = np.clip(np.rint(parts), -largest - 1, largest)
    return whole.astype('>i1' if sample_type == 'CI2' else '>i2').reshape(*samples.shape, 2)


def full_scale(samples: np.ndarray, sample_type: str) -> np.ndarray:
    """(P,) float64 factors by which integers reach the largest sample of each vector."""
    if sample_type == 'CF8':
        return np.ones(len(samples))
    parts = np.ascontiguousarray(samples, np.complex64).view(np.float32)
    largest = np.abs(parts).max(axis=1).astype(np.float64)
    return np.where(largest > 0, largest, 1.0) / _LARGEST[sample_type]


def ramp(first_cycles: np.ndarray, step_cycles: np.ndarray, n: int) -> np.ndarray:
    """``exp(-j 2 pi (a + k b))`` for k = 0 ... n - 1.

    A product of coarse and fine turns: two complex exponentials for each 64 samples.

    Parameters
    ----------
    first_cycles, step_cycles : (P,) float64
        a and b, cycles.
    n : int
        Length of the ramps.

    Returns
    -------
    (P, n) complex128
    """
    fine = _turns(np.multiply.outer(step_cycles, np.arange(min(n, _FINE))))
    coarse = _turns(first_cycles[:, None]
                    + np.multiply.outer(step_cycles, np.arange(0, n, _FINE)))
    return (coarse[:, :, None] * fine[:, None]).reshape(len(fine), -1)[:, :n]


def _turns(cycles: np.ndarray) -> np.ndarray:
    return np.exp(-2j * np.pi * (cycles % 1.0))
