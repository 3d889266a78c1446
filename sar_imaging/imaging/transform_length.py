"""Lengths of Fourier transforms that are quick."""

from __future__ import annotations

import functools
import math

import scipy.fft

# Time of a pass over the data by its radix, and of lengths whose rows share cache lines (measured
# with SciPy's transforms of complex64, lengths 1000 to 16000)
_COST_PASS = {4: 0.83, 2: 0.46, 3: 0.85, 5: 1.16, 7: 1.54, 11: 2.3}
_CROWDED, _COST_CROWDED = 1024, 0.7
_LONGER = 1.12  # more is never worth it


@functools.lru_cache(maxsize=4096)
def quick_length(least: int) -> int:
    """Length of the quickest transform that is not shorter than `least`, and little longer."""
    length = best = scipy.fft.next_fast_len(least)
    while length <= _LONGER * least:
        if length * _cost_per_sample(length) < best * _cost_per_sample(best):
            best = length
        length = scipy.fft.next_fast_len(length + 1)
    return best


def _cost_per_sample(length: int) -> float:
    cost = 0.0 if length % _CROWDED else _COST_CROWDED
    for radix, cost_pass in _COST_PASS.items():
        while length % radix == 0:
            cost += cost_pass
            length //= radix
    return cost if length == 1 else math.inf
