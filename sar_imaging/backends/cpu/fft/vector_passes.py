"""Passes of Fourier transforms of `LANES` columns at a time, and the tables they work by.

A pass combines groups of `LANES` samples, as many as its radix says, by a butterfly. The first
pass reads groups from where they are, the last one leaves them where they are wanted, and between
passes they are in memory that stays in a core's cache. Which groups meet, and in which order they
are left, is all in tables, so that nothing is transposed or reordered by itself. A `Plan` holds:

- `table`, int64: number of passes, length, whether groups are fetched into the cache before the
  first pass needs them, and the radix of each pass; then, for each pass, `length` places (bytes)
  of the groups that butterfly after butterfly reads; then likewise those that it writes.
- `turns`, complex64: by what each group is multiplied before its butterfly, in the same order.
"""

from __future__ import annotations

import functools
from typing import NamedTuple

import numpy as np

from ....compilation import DETERMINISTIC, cfunc, njit, numba
from ....planning.afbp.row_length import radices_of
from . import butterflies as vectors
from .butterflies import SAMPLE_BYTES


class Plan(NamedTuple):
    """How a column of some length is transformed; see the module's text."""

    table: np.ndarray  # (3 + n_passes + 2 n_passes length,) int64
    turns: np.ndarray  # (n_turned, n_passes, length) complex64
    first: np.ndarray  # (length,) int64 element at each entry of the first pass

    @property
    def addresses(self) -> tuple[int, int]:
        """Of the table, and of the turns."""
        return self.table.ctypes.data, self.turns.ctypes.data

    def with_gain(self, gain: np.ndarray) -> Plan:
        """Elements of each of some sets, (S, length) float64, are multiplied by a gain, too.

        S is a multiple of the sets that are turned.
        """
        turns = np.tile(self.turns, (len(gain) // len(self.turns), 1, 1))
        turns[:, 0] *= gain[:, self.first]
        return self._replace(turns=turns)


@functools.lru_cache(maxsize=32)
def plan(length: int, inverse: bool, first_bytes: int, work_bytes: int, last_bytes: int,
         fetch: bool, n_turned: int = 1) -> Plan:
    """Tables of a transform, from the bytes between its elements.

    ``X[k] = sum_m x[m] exp(-j 2 pi m k / N)`` with N a product of radices: element and frequency
    are numbers of mixed digits, and pass i transforms digit i of the element to digit i of the
    frequency (Cooley and Tukey 1965). With D the product of the radices before, and k the
    frequency of the digits done so far, pass i first turns digit d by ``d k / (D radix)`` cycles.

    Parameters
    ----------
    length : int
        Elements, one that `radices_of` knows.
    inverse : bool
        Sign of the exponent.
    first_bytes, work_bytes, last_bytes : int
        From an element to the next where they are read, between passes, and where frequencies
        are left.
    fetch : bool
        Groups are fetched before they are needed: where so few lie side by side that the
        processor does not do so by itself.
    n_turned : int
        Sets of columns; those of set s are the second part of a longer transform, whose element m
        is turned by s m / (n_turned length) cycles.
    """
    radices = radices_of(length)
    # elements by their digits: each pass replaces one by that of a frequency
    element, digits = np.arange(length).reshape(radices), np.indices(radices)
    number = np.arange(n_turned).reshape(-1, *[1] * len(radices))
    frequency, done = np.zeros(radices, np.int64), 1
    cycles = number * element / (n_turned * length)
    sources, targets, turns = [], [], []
    for i, radix in enumerate(radices):
        cycles = cycles + digits[i] * frequency / (done * radix)
        source = element * (work_bytes if i else first_bytes)
        frequency = frequency + done * digits[i]
        done *= radix
        target = frequency * last_bytes if done == length else element * work_bytes
        turn = np.exp((2j if inverse else -2j) * np.pi * cycles).astype(np.complex64)
        sources.append(np.moveaxis(source, i, -1).ravel())
        # forwards, frequency -k is that of the inverse
        order = -np.arange(radix) % radix if inverse else np.arange(radix)
        targets.append(np.moveaxis(target, i, -1)[..., order].ravel())
        turns.append(np.moveaxis(turn, i + 1, -1).reshape(n_turned, length))
        cycles = np.zeros_like(cycles)
    table = np.concatenate([(len(radices), length, fetch), radices, *sources, *targets])
    return Plan(table, np.stack(turns, axis=1), sources[0] // first_bytes)


@functools.cache
def compiled() -> int:
    """Address that `run` wants."""
    numbers = [numba.int64] * 7
    return cfunc(numba.int64(*numbers), fastmath=DETERMINISTIC)(_passes).address


@njit
def run(code, source, work, target, n_groups, table, turns, turns_apart):
    """Transform `n_groups` times LANES columns that lie side by side; all arguments are int64.

    Numba would compile all butterflies again for each function that calls another, thus `code`,
    from `compiled`. Elements are read at `source`, kept at `work` between passes, and left at
    `target`. `table` and `turns` are `Plan.addresses`, turns those of the set; `turns_apart` is
    that of the first pass where turns differ between columns of one group, else 0.
    """
    vectors.call(code, (source, work, target, n_groups, table, turns, turns_apart))


def _passes(source, work, target, n_groups, table, turns, turns_apart):
    n_passes, length = vectors.integer_at(table), vectors.integer_at(table + 8)
    fetch = vectors.integer_at(table + 16)
    for p in range(n_passes):
        radix = vectors.integer_at(table + 8 * (3 + p))
        read, write = work if p else source, work if p < n_passes - 1 else target
        sources = table + 8 * (3 + n_passes + p * length)
        targets = sources + 8 * n_passes * length
        for entry in range(0, length, radix):
            if p == 0 and turns_apart:
                vectors.butterfly_of_turned(radix, read, sources + 8 * entry, write,
                                            targets + 8 * entry,
                                            turns_apart + vectors.GROUP_BYTES * entry)
                continue
            turn = turns + SAMPLE_BYTES * (p * length + entry)
            for group in range(n_groups):
                shift = vectors.GROUP_BYTES * group
                if p == 0 and fetch and entry + radix < length:
                    vectors.fetch(read + shift, sources + 8 * (entry + radix), radix)
                vectors.butterfly(radix, read + shift, sources + 8 * entry, write + shift,
                                  targets + 8 * entry, turn)
    return 0
