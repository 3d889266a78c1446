# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Lengths of Fourier transforms that are quick: of SciPy's, and of the processor's own backend."""

from __future__ import annotations

import functools
import math

import scipy.fft

# Time of a pass over the data by its radix, of lengths whose rows share cache lines, and of those
# with large factors (measured with SciPy's transforms of complex64, lengths 1000 to 16000)
_COST_PASS = {4: 0.83, 2: 0.46, 3: 0.85, 5: 1.16, 7: 1.54, 11: 2.3}
_CROWDED, _COST_CROWDED = 1024, 0.7
_COST_OTHER = 20.0


def smooth_lengths(least: int, longer: float) -> list[int]:
    """Lengths from `least` to `longer` times that without large factors, one at least."""
    lengths = [scipy.fft.next_fast_len(least)]
    while (following := scipy.fft.next_fast_len(lengths[-1] + 1)) <= longer * least:
        lengths.append(following)
    return lengths


@functools.lru_cache(maxsize=4096)
def quick_length(least: int) -> int:
    """Length of the quickest transform that is not shorter than `least`, and little longer."""
    return min(smooth_lengths(least, 1.12), key=lambda length: length * cost_per_sample(length))


@functools.lru_cache(maxsize=4096)
def cost_per_sample(length: int) -> float:
    """Relative time of a transform over its length."""
    cost = 0.0 if length % _CROWDED else _COST_CROWDED
    for radix, cost_pass in _COST_PASS.items():
        while length % radix == 0:
            cost += cost_pass
            length //= radix
    return cost if length == 1 else _COST_OTHER


RADICES = (2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 15, 16)
# columns side by side, and those that are transposed together, where vectors are longest: plans
# are the same on all processors
VECTOR, _BLOCK = 16, 8
_LONGER_ROW = 1.03  # than needed, at most
# Time over that of a pass through all samples (measured with lengths of 2000 to 30000): more for
# matrices whose lines or columns are no whole vectors; all else that is done with a row
_COST_TRANSPOSITION, _COST_UNALIGNED, _COST_ROW = 1.0, 0.5, 12.0


@functools.lru_cache(maxsize=4096)
def radices_of(n: int) -> tuple[int, ...] | None:
    """Of the fewest passes; None where a factor of the length is too large for this way."""
    if n == 1:
        return ()
    choices = [(*others, radix) for radix in RADICES if n % radix == 0
               if (others := radices_of(n // radix)) is not None]
    return min(choices, key=lambda radices: (len(radices), sum(radices)), default=None)


def _n_passes(n: int) -> float:
    """Number of `radices_of`; infinite where there are none."""
    radices = radices_of(n)
    return math.inf if radices is None else len(radices)


@functools.lru_cache(maxsize=4096)
def row_length(least: int, times: tuple[int, ...] = (1,)) -> int:
    """Length for the own transform of rows: `least`, or a few percent longer at most.

    The shorter the better, since everything else takes time by the length, too. Multiples that
    are wanted as well are as quick.
    """
    def cost(n: int) -> float:
        shapes = (row_shape(t * n) for t in times)
        return n * sum(t * (_COST_ROW + (math.inf if shape is None else _row_cost(*shape)))
                       for t, shape in zip(times, shapes, strict=True))

    lengths = [n for n in smooth_lengths(least, _LONGER_ROW) if cost(n) < math.inf]
    return min(lengths, key=cost, default=quick_length(least))


@functools.lru_cache(maxsize=4096)
def row_shape(n: int) -> tuple[int, int] | None:
    """Height and width of the matrix; None where SciPy is to transform."""
    factors = [f for f in range(VECTOR, math.isqrt(n) + 1) if n % f == 0]
    shapes = [shape for f in factors for shape in ((f, n // f), (n // f, f))
              if all(map(radices_of, shape))]
    return min(shapes, key=lambda shape: _row_cost(*shape), default=None)


def _row_cost(height: int, width: int) -> float:
    """Of a transform, in passes through all samples; little more where the matrix is long."""
    columns, lines = (-(-n // VECTOR) * VECTOR / n for n in (width, height))
    return (columns * _n_passes(height)
            + lines * (_n_passes(width) + _COST_TRANSPOSITION)
            + _COST_UNALIGNED * ((height % _BLOCK != 0) + (width % _BLOCK != 0))
            + abs(height - width) / (height + width))
