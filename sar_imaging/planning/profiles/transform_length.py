"""Lengths of Fourier transforms that are quick."""

from __future__ import annotations

import functools

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
