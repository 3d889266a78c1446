"""Which pieces can be computed: those whose needs are settled, in the order they were given."""

from __future__ import annotations

import heapq
from collections import defaultdict
from collections.abc import Sequence
from typing import Any


class Order:
    """Pieces that wait for others.

    Parameters
    ----------
    pieces : sequence
        With `key` and `needs`.

    Attributes
    ----------
    ready : list of int
        A heap (heapq) of indices of pieces whose needs are settled, less those taken from it.

    Raises
    ------
    ValueError
        Keys occur twice, or a piece needs one that does not exist, or itself.
    """

    def __init__(self, pieces: Sequence[Any]):
        indices = {piece.key: index for index, piece in enumerate(pieces)}
        if len(indices) < len(pieces):
            twice = next(p.key for i, p in enumerate(pieces) if indices[p.key] != i)
            raise ValueError(f'two pieces are called {twice!r}; keys must be unique')
        self._missing = [len(set(piece.needs)) for piece in pieces]
        self._dependents: dict[int, list[int]] = defaultdict(list)
        for index, piece in enumerate(pieces):
            for key in dict.fromkeys(piece.needs):
                if key not in indices:
                    raise ValueError(f'{piece.key!r} needs {key!r}, which is not among the pieces')
                self._dependents[indices[key]].append(index)
        self.ready = [index for index, missing in enumerate(self._missing) if not missing]
        self._check_circles(pieces)

    def settled(self, index: int) -> None:
        """A piece is finished or lost: what waited for it alone is ready."""
        for other in self._dependents.pop(index, ()):
            self._missing[other] -= 1
            if not self._missing[other]:
                heapq.heappush(self.ready, other)

    def _check_circles(self, pieces: Sequence[Any]) -> None:
        missing, ready = list(self._missing), list(self.ready)
        for index in ready:  # grows meanwhile
            for other in self._dependents.get(index, ()):
                missing[other] -= 1
                if not missing[other]:
                    ready.append(other)
        if len(ready) < len(pieces):
            name = next(piece.key for piece, left in zip(pieces, missing, strict=True)
                        if left)
            raise ValueError(f'{name!r} needs itself, directly or through others')
