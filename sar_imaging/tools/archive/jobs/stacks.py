"""Stacks: apertures that saw the same pixels from nearly the same place, at different times."""

from __future__ import annotations

import dataclasses
from collections import defaultdict
from collections.abc import Sequence

import numpy as np

from .scans import ApertureScan
from .windows import Window

_SHARED = 0.5  # of the pixels of both windows together
_LARGEST_ANGLE_RAD = 0.05  # between the lines of sight; images decorrelate before


@dataclasses.dataclass(frozen=True)
class Pair:
    """Two apertures to compare.

    Attributes
    ----------
    first, second : ApertureScan
        The first of its stack, and another one.
    window : Window
        Pixels that both have.
    """

    first: ApertureScan
    second: ApertureScan
    window: Window

    @property
    def name(self) -> str:
        """Unique within the archive."""
        return f'{self.first.name}__{self.second.name}'


def find_pairs(scans: Sequence[ApertureScan], tile: int, spacing_m: float) -> list[Pair]:
    """First of each stack with each other one, in the order of their times.

    An aperture belongs to the stack of the earliest aperture of another recording, of the same
    carrier, that shares half of the pixels with it and saw their middle from the same direction,
    to within 0.05 rad. Otherwise it begins a stack.
    """
    begun: dict[tuple[int, int], list[ApertureScan]] = defaultdict(list)
    pairs = []
    for scan in sorted(scans, key=lambda s: (s.first_ns, s.name)):
        row, column = _middle(scan.window)
        for first in begun[row // tile, column // tile]:
            common = first.window.intersection(scan.window)
            if common is not None and _together(first, scan, common, spacing_m):
                pairs.append(Pair(first, scan, common))
                break
        else:
            for part in scan.window.tiles(tile):
                begun[part.row0 // tile, part.column0 // tile].append(scan)
    return pairs


def _middle(window: Window) -> tuple[int, int]:
    return (window.row0 + window.row1) // 2, (window.column0 + window.column1) // 2


def _together(first: ApertureScan, second: ApertureScan, common: Window, spacing_m: float) -> bool:
    if first.recording == second.recording or first.radar.carrier_hz != second.radar.carrier_hz:
        return False
    both = first.window.n_pixels + second.window.n_pixels - common.n_pixels
    if common.n_pixels < _SHARED * both:
        return False
    row, column = _middle(common)
    place = np.array([column * spacing_m, -row * spacing_m, 0.0])
    sights = [np.array(scan.centre_m) - place for scan in (first, second)]
    one, other = (sight / np.linalg.norm(sight) for sight in sights)
    return float(np.linalg.norm(one - other)) <= _LARGEST_ANGLE_RAD
