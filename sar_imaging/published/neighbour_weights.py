"""Interpolation between neighbouring samples of a local image: weights, and what they err."""

from __future__ import annotations

import functools
import math

import numpy as np

#: Neighbours that each kernel reads along range and along direction.
TAPS = {'linear': 2, 'cubic': 4, 'knab8': 8}
DEGREE = 7  # of the polynomials in the tables of weights
MARGIN = 0.25  # how far beyond its interval a kernel is evaluated, pixels

_FREQUENCIES = np.linspace(0.0, 0.5, 129)  # of tables, cycles per sample
_PLACES, _DRIFTS = 12, 5  # nodes of the quadrature over an interval, and over a drift
_DRIFT_STEP = 0.01  # of tables, samples


def kernel_weights(kernel: str, oversampling: float) -> np.ndarray:
    """Weights of an interpolation kernel as polynomials.

    Sample ``first + k``, first = 1 - taps / 2, has the weight ``sum_q w[k, q] x^q`` at the
    position ``x + 1/2`` between samples 0 and 1.

    Parameters
    ----------
    kernel : str
        A key of `TAPS`: 'linear', 'cubic' (Lagrange), or 'knab8', a sinc in Knab's window (IEEE
        Trans. Inf. Theory 25, 1979), whose polynomials are a fit to within 1e-5.
    oversampling : float
        Sample rate over two-sided bandwidth; sets the width of Knab's window.

    Returns
    -------
    (taps, 8) float32
    """
    taps = TAPS[kernel]
    first = 1 - taps // 2
    x = np.cos(np.pi * (np.arange(64) + 0.5) / 64) * (0.5 + MARGIN)
    distance = x[:, None] + 0.5 - (np.arange(taps) + first)
    if kernel == 'knab8':
        values = _knab(distance, taps / 2, oversampling)
    else:  # Lagrange's polynomials
        nodes = np.arange(taps) + first - 0.5
        values = np.stack([np.prod([(x - m) / (n - m) for m in nodes if m != n], axis=0)
                           for n in nodes], axis=-1)
    powers = x[:, None] ** np.arange(DEGREE + 1)
    weights = np.linalg.lstsq(powers, values, rcond=None)[0].T
    return np.ascontiguousarray(weights, np.float32)


def _knab(x, half, oversampling):
    """Sinc in the window of Knab, which continues smoothly beyond its ends."""
    v = math.pi * half * (1 - 1 / oversampling)
    root = np.sqrt((1 - (x / half) ** 2).astype(complex))
    return np.sinc(x) * (np.cosh(v * root) / np.cosh(v)).real


def mean_gain(kernel: str, oversampling: float, drift: float, frequency
              ) -> tuple[np.ndarray, np.ndarray]:
    """What interpolation makes of a tone, over places that are evenly distributed.

    A tone of frequency f, read at x instead of where it is, gets the factor
    ``h(x) = sum_k w_k(x) exp(j 2 pi f (k - x))``.

    Parameters
    ----------
    kernel, oversampling :
        See `kernel_weights`.
    drift : float
        By how much places leave their interval at the ends of a segment, samples.
    frequency : (...) array_like
        Cycles per sample.

    Returns
    -------
    loss : (...) float64
        ``1 - E h``; it is real, because the weights are symmetric.
    variance : (...) float64
        ``E |h|^2 - (E h)^2``.
    """
    tables = _gain_tables(kernel, round(oversampling, 3), round(drift / _DRIFT_STEP) * _DRIFT_STEP)
    place = np.abs(frequency) * ((len(_FREQUENCIES) - 1) / _FREQUENCIES[-1])
    cell = place.astype(np.intp)
    part = place - cell
    return tuple(value.take(cell, mode='clip') + part * step.take(cell, mode='clip')
                 for value, step in tables)


@functools.lru_cache(maxsize=256)
def _gain_tables(kernel, oversampling, drift) -> list[tuple[np.ndarray, np.ndarray]]:
    """Loss and variance at frequencies, and their steps from there to the next."""
    place, by_place = np.polynomial.legendre.leggauss(_PLACES)
    along, by_along = np.polynomial.legendre.leggauss(_DRIFTS)
    x = np.add.outer(0.5 * place, drift * along).ravel()
    share = np.outer(by_place, by_along).ravel() / 4
    weights = kernel_weights(kernel, oversampling).astype(np.float64)
    values = weights @ x ** np.arange(DEGREE + 1)[:, None]
    away = np.arange(len(weights))[:, None] + 0.5 - len(weights) // 2 - x
    error = 1 - np.einsum('kx,fkx->fx', values, np.exp(
        2j * np.pi * _FREQUENCIES[:, None, None] * away))
    loss = error.real @ share
    variance = np.abs(error) ** 2 @ share - loss ** 2
    return [(v, np.diff(v, append=v[-1])) for v in (loss, variance)]
