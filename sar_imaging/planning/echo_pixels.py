# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Pairs of an echo and a pixel that it lights, from which errors of images with beams are told.

What illumination does to an image is worst where patterns end: there few pairs make most of an
error, and echoes with the highest local frequencies. No mean over a few positions finds them.
Pairs are drawn evenly over all echoes and pixels, what is wrong with each is computed as the
kernels compute it, and twice the standard error of the mean is added.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from ..geometry.grids import below, spread_evenly
from ..geometry.half_paths import pair_lengths
from ..geometry.illumination import Illumination

if TYPE_CHECKING:
    from .profiles import PhaseHistory, RangeGate

MOST_PAIRS = 1 << 17
LEAST_DB = -160.0
_CELLS, _ECHOES_AT_ONCE = 4, 4096  # of an image along each axis; those that see them
_BESIDE = -1.0, -1 / 3, 1 / 3, 1.0  # of how far dark pairs count
_PAIRS, _ENOUGH = 4096, 1024  # drawn at once, and lit ones after which no more are drawn
_STANDARD_ERRORS = 2.0


@dataclasses.dataclass(frozen=True, eq=False)
class EchoPixels:
    """Echoes and pixels, evenly drawn of all pairs that are lit or beside a lit one.

    Attributes
    ----------
    illumination : Illumination
        Illumination of all echoes.
    echoes : (n,) int64
        Echoes; none where no pair was found.
    index : tuple of (n,) int64
        Pixels, along each axis.
    points_m : (n, 3) float64
        Their positions, metres.
    amplitude : (n,) float64
        Amplitude of the echoes there, 0 beside lit ones.
    place : (n,) float64
        Evenly from 0 to 1, for whatever else an error depends on.
    share : float
        Share of all pairs, those that are lit.
    """

    illumination: Illumination
    echoes: np.ndarray
    index: tuple[np.ndarray, ...]
    points_m: np.ndarray
    amplitude: np.ndarray
    place: np.ndarray
    share: float

    @classmethod
    def draw(cls, illumination: Illumination, positions: Callable[..., np.ndarray],
             shape: tuple[int, ...], beside: tuple[int, ...] = (), most: int = MOST_PAIRS, *,
             flat: bool = True) -> EchoPixels:
        """Draw pairs.

        Parameters
        ----------
        illumination : Illumination
            Illumination of the echoes.
        positions : callable
            Positions (..., 3), metres, from broadcast numbers along each axis: beside the image,
            too, and not whole.
        shape : tuple of int
            Numbers along each axis.
        beside : tuple of int, optional
            How far from lit pixels dark ones count along each axis.
        most : int
            Pairs after which no more are drawn.
        flat : bool
            The image lies on a plane, so that corners of its parts tell which are dark.
        """
        beside = beside or (0,) * len(shape)
        cells = _cells_to_draw(illumination, positions, shape, beside, flat)
        found, seen, n_illuminated, n = [], 0, 0, min(_PAIRS, most)
        while n_illuminated < _ENOUGH and seen < most and len(cells[0]):
            unit = spread_evenly(seen, n)
            number = below(unit[0] * len(cells[0]), len(cells[0]))
            echoes, index = cells[0][number], [
                below((cell[number] + u) * (size / _CELLS), size)
                for cell, u, size in zip(cells[1:], unit[1:], shape, strict=False)]
            points = positions(*index)
            amplitude = np.nan_to_num(illumination.of_pairs(echoes, points))
            some = amplitude > 0
            n_illuminated += int(np.count_nonzero(some))
            for axis, step in enumerate(beside):
                for there in (s * step for s in _BESIDE if step):
                    dark = np.flatnonzero(~some)
                    moved = [i[dark] + there * (a == axis) for a, i in enumerate(index)]
                    some[dark] = illumination.of_pairs(echoes[dark], positions(*moved)) > 0
            found.append([a[some] for a in (echoes, amplitude, points, unit[-1], *index)])
            seen += n
            n = min(3 * seen, most - seen)
        if not found:
            none, some = np.zeros(0, np.int64), np.zeros(0)
            return cls(illumination, none, (none,) * len(shape), np.zeros((0, 3)), some, some, 0.0)
        echoes, amplitude, points, place, *index = (np.concatenate(a) for a in zip(
            *found, strict=True))
        drawn = len(cells[0]) / (len(illumination.centre_m) * _CELLS ** len(shape))
        return cls(illumination, echoes, tuple(index), points, amplitude, place,
                   float(drawn * n_illuminated / seen))

    def __len__(self) -> int:
        """Number of pairs."""
        return len(self.echoes)

    def thinned(self, step: int) -> EchoPixels:
        """One of every so many."""
        some = slice(None, None, step)
        return dataclasses.replace(
            self, echoes=self.echoes[some], index=tuple(i[some] for i in self.index),
            points_m=self.points_m[some], amplitude=self.amplitude[some], place=self.place[some])

    @property
    def power(self) -> float:
        """Mean square of the amplitude over all pairs of an echo and a pixel."""
        n_illuminated = np.count_nonzero(self.amplitude)
        if not n_illuminated:
            return 0.0
        return self.share * float(np.sum(self.amplitude ** 2)) / n_illuminated

    def amplitude_at(self, points_m: np.ndarray) -> np.ndarray:
        """(n, ...) amplitudes of the echoes, each at points (n, ..., 3), metres."""
        return self.illumination.of_pairs(self.echoes, points_m)

    def error(self, wrong: np.ndarray, weight: float | np.ndarray = 1.0) -> float:
        """Mean of squared errors over that of the amplitude, and twice its standard error.

        `wrong`, (n,), are the errors' squares, `weight`, (n,), shares of the echoes in the power
        of the image. NaN counts as nothing.
        """
        return bounded_ratio(weight * wrong, weight * self.amplitude ** 2)

    def ends_db(self, window: RangeGate | PhaseHistory, oversampling: float, tx_m: np.ndarray,
                rx_m: np.ndarray) -> float:
        """Error because profiles end, dB; NaN where they leave nothing `predictable`.

        Arguments as of `RangeGate.end_error` and `Echoes`.
        """
        length = pair_lengths(tx_m[self.echoes], rx_m[self.echoes], self.points_m)
        power = self.amplitude ** 2 * window.predictable(length, self.amplitude > 0)
        if self.amplitude.any() and not power.any():
            return math.nan
        return 10 * math.log10(bounded_ratio(window.end_error(length, oversampling) * power, power)
                               + 10 ** (LEAST_DB / 10))

    def error_db(self, wrong: np.ndarray, weight: float | np.ndarray = 1.0) -> float:
        """`error` in dB, `LEAST_DB` at least."""
        return 10 * math.log10(self.error(wrong, weight) + 10 ** (LEAST_DB / 10))


def bounded_ratio(wrong: np.ndarray, power: np.ndarray) -> float:
    """Sum of squared errors over that of powers, (n,) of pairs, and twice its standard error."""
    wrong = np.nan_to_num(wrong)
    total, missed = power.sum(), wrong.sum()
    if missed == 0:
        return 0.0
    if total == 0:
        return math.inf
    ratio = missed / total
    return ratio + _STANDARD_ERRORS * math.sqrt(((wrong - ratio * power) ** 2).sum()) / total


def _cells_to_draw(illumination: Illumination, positions: Callable[..., np.ndarray],
                   shape: tuple[int, ...], beside: tuple[int, ...], flat: bool
                   ) -> tuple[np.ndarray, ...]:
    """Echoes, and numbers of cells along each axis, of which pairs may be lit or beside lit ones.

    (N,) int64 each. An image has `_CELLS` cells along each axis.
    """
    n_axes = len(shape)
    if not flat:
        every = np.indices((len(illumination.centre_m), *(_CELLS,) * n_axes))
        return tuple(a.ravel() for a in every)
    edges = [np.linspace(0, size, _CELLS + 1) for size in shape]
    corners = [np.stack([e[:-1] - step - 1, e[1:] + step], axis=1).ravel()
               for e, step in zip(edges, beside, strict=True)]
    points = positions(*np.meshgrid(*corners, indexing='ij')).reshape(-1, 3)
    found, n = [], len(illumination.centre_m)
    for start in range(0, n, _ECHOES_AT_ONCE):
        dark = illumination.select(slice(start, start + _ECHOES_AT_ONCE)).dark_cones(points)
        dark = dark.reshape(-1, *(_CELLS, 2) * n_axes)
        dark = np.bitwise_and.reduce(dark, axis=tuple(range(2, 2 * n_axes + 1, 2)))
        echo, *cells = np.nonzero(dark == 0)
        found.append([echo + start, *cells])
    return tuple(np.concatenate(a) for a in zip(*found, strict=True))
