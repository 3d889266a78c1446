# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Half path from phase centres to points: half the way there and back, and its derivatives."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import numpy as np

_ROWS_IN_CACHE = 512  # of paths at once
_STRIDE = 7919  # prime: neighbours are not all replaced by the same
_NEAREST_M = 1e-6  # keeps derivatives finite for a grid around the antenna


@dataclasses.dataclass(frozen=True)
class Paths:
    """Half path from rows of phase centres to sampled points of image lines.

    Attributes
    ----------
    length : (R, S) float64
        Half path, metres.
    derivatives : tuple of four (R, S) float64
        Its first to fourth derivative along the line.
    parts : tuple of int
        First row of each part of the rows that is added by itself.
    illuminated : (R, S) bool, optional
        Which rows illuminate which points, where not all do.
    weight : (W, R) float64, optional
        Shares of the rows in the power of an image, by the worst of W cases, where they differ;
        see `planning.echo_power`.
    """

    length: np.ndarray
    derivatives: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
    parts: tuple[int, ...] = (0,)
    illuminated: np.ndarray | None = None
    weight: np.ndarray | None = None

    def reversed(self) -> Paths:
        """The same points on lines that run the other way."""
        first, second, third, fourth = self.derivatives
        return dataclasses.replace(self, derivatives=(-first, second, -third, fourth))

    def with_illuminated(self, values: np.ndarray) -> np.ndarray:
        """Values (..., R, S) in which those of illuminated pairs stand for all others."""
        if self.illuminated is None:
            return values
        illuminated = np.flatnonzero(self.illuminated)
        source = np.arange(self.illuminated.size)
        dark = np.flatnonzero(~self.illuminated)
        source[dark] = illuminated[np.arange(len(dark)) * _STRIDE % len(illuminated)]
        return values.reshape(*values.shape[:-2], -1)[..., source].reshape(values.shape)

    def of_illuminated_rows(self, values: np.ndarray) -> np.ndarray:
        """Values (R, S) in which the mean of a row's illuminated ones stands for its others.

        Rows without any have that of the illuminated rows before and after.
        """
        if self.illuminated is None:
            return values
        count, number = self.illuminated.sum(axis=1), np.arange(len(self.illuminated))
        some = count > 0
        mean = (values * self.illuminated).sum(axis=1)[some] / count[some]
        return np.where(self.illuminated, values, np.interp(number, number[some], mean)[:, None])

    def of_illuminated(self, values: np.ndarray, rows: slice | np.ndarray = slice(None)
                       ) -> np.ndarray:
        """Values of illuminated pairs alone, (n,), from those of all pairs or of some rows."""
        return values if self.illuminated is None else values[self.illuminated[rows]]

    def mean(self, values: np.ndarray, rows: np.ndarray) -> float:
        """Mean of values (K, S) of some rows, (K,), over what they illuminate, by their shares."""
        weight = np.ones((1, len(rows))) if self.weight is None else self.weight[:, rows]
        count = np.full(len(rows), values.shape[1])
        if self.illuminated is not None and self.illuminated[rows].any():
            values = values * self.illuminated[rows]
            count = self.illuminated[rows].sum(axis=1)
        return float((weight @ values.sum(axis=1) / (weight @ count)).max())


def sample_paths(tx_m: np.ndarray, rx_m: np.ndarray, line: Sequence[np.ndarray]) -> Paths:
    """Half paths and their derivatives at points of image lines.

    `line` holds points (S, 3), metres, and their first to at most fourth derivative along the
    line; the others are zero.
    """
    found = _paths([np.asarray(c)[:, None] for c in _distinct(tx_m, rx_m)], line)
    length, first, second, third, fourth = found
    return Paths(length, (first, second, third, fourth))


def pair_paths(tx_m: np.ndarray, rx_m: np.ndarray, line: Sequence[np.ndarray]) -> np.ndarray:
    """(5, n) half paths and their four derivatives from phase centres (n, 3), each to one point.

    Centres in metres; `line` as of `sample_paths`, of n points.
    """
    return np.stack(_paths(_distinct(tx_m, rx_m), line))


def pair_lengths(tx_m: np.ndarray, rx_m: np.ndarray, points_m: np.ndarray) -> np.ndarray:
    """(n, ...) half paths from phase centres (n, 3), each to its points (n, ..., 3), metres."""
    between, centres = (slice(None), *[None] * (points_m.ndim - 2)), _distinct(tx_m, rx_m)
    return sum(np.sqrt(sum((points_m[..., axis] - c[:, axis][between]) ** 2 for axis in range(3)))
               for c in centres) / len(centres)


def _paths(centres: Sequence[np.ndarray], line: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Mean distance from centres, (..., 3) each, to points of lines, and its four derivatives.

    By Leibniz' rule for the square of the distance. Coordinates are taken one after the other:
    each array is as large as the result.
    """
    derivatives = [np.asarray(v).T for v in line[1:]]

    def square(i: int, j: int) -> Any:
        return (_dot(derivatives[i], derivatives[j]) if max(i, j) < len(derivatives) else 0.0)

    total: list[np.ndarray] = []
    for centre in centres:
        offset = [x - c for x, c in zip(line[0].T, np.moveaxis(centre, -1, 0), strict=True)]
        d = np.maximum(np.sqrt(_dot(offset, offset)), _NEAREST_M)
        along: list[Any] = [_dot(offset, v) for v in derivatives]
        p1, p2, p3, p4 = along + [0.0] * (4 - len(along))
        d1 = p1 / d
        d2 = (square(0, 0) + p2 - d1 * d1) / d
        d3 = (3 * square(0, 1) + p3 - 3 * d1 * d2) / d
        d4 = (3 * square(1, 1) + 4 * square(0, 2) + p4 - 4 * d1 * d3 - 3 * d2 * d2) / d
        found = [d, d1, d2, d3, d4]
        total = [a + b for a, b in zip(total, found, strict=True)] if total else found
    return total if len(centres) == 1 else [v / len(centres) for v in total]


def _dot(a: Sequence[np.ndarray] | np.ndarray, b: Sequence[np.ndarray] | np.ndarray) -> Any:
    """Products of vectors, coordinate by coordinate; many lines have one that does not change."""
    return sum((x * y for x, y in zip(a[1:], b[1:], strict=True) if y.any()), a[0] * b[0])


def _distinct(tx_m: np.ndarray, rx_m: np.ndarray) -> list[Any]:
    """Ends of paths: both, or one if they are in the same places."""
    return [tx_m] if np.array_equal(tx_m, rx_m) else [tx_m, rx_m]


def half_paths(tx_m: np.ndarray, rx_m: np.ndarray, position: np.ndarray, *directions: np.ndarray
               ) -> np.ndarray:
    """(1 + D, R, S) half paths to points (S, 3), metres, and their derivatives along D directions.

    `directions` are derivatives of the positions by some parameters, (S, 3) each.
    """
    centres = _distinct(tx_m, rx_m)
    found = np.zeros((1 + len(directions), len(position), len(tx_m)))
    for start in range(0, len(tx_m), _ROWS_IN_CACHE):
        some = slice(start, start + _ROWS_IN_CACHE)
        for centre in centres:
            offset = [position[:, axis, None] - centre[some, axis] for axis in range(3)]
            length = np.maximum(np.sqrt(_dot(offset, offset)), _NEAREST_M)
            found[0, :, some] += length
            for total, direction in zip(found[1:, :, some], directions, strict=True):
                total += _dot(offset, direction.T[:, :, None]) / length
    if len(centres) > 1:
        found /= len(centres)
    return found.swapaxes(1, 2)
