"""Explain why profiles do not cover the grid, by units, axes and delays with which they would."""

from __future__ import annotations

import numpy as np

from ..geometry.grids import MapGrid
from ..signal.pulses import PulseBlock
from .hypotheses import GEOMETRY

_MOST_NAMED = 3


def distances(block: PulseBlock, grid: MapGrid) -> tuple[float, float]:
    """Least and largest half path between the pulses and the corners and middle of the grid."""
    x, y = grid.x_m[[0, -1]], grid.y_m[[0, -1]]
    points = np.array([*((a, b, grid.z_m) for a in x for b in y), grid.centre_m])
    half_path = sum(np.linalg.norm(points[:, None, None] - c, axis=-1)
                    for c in (block.tx_m, block.rx_m)) / 2
    return float(half_path.min()), float(half_path.max())


def reach_advice(block: PulseBlock, grid: MapGrid) -> str:
    """What would bring the grid into the profiles of a block.

    Parameters
    ----------
    block : PulseBlock
        Range profiles with phase centres.
    grid : MapGrid
        Where they are to be imaged.

    Returns
    -------
    str
        The mistakes that would explain it, likeliest first; empty where none does, or where the
        profiles reach the grid.
    """
    def within(candidate: PulseBlock) -> bool:
        near, far = distances(candidate, grid)
        start, stop = _profile(candidate)
        # Positions that shrink to a point explain nothing.
        moves = np.ptp(candidate.phase_centre_m, axis=0).max()
        return (start <= near and far <= stop
                and (block.n_pulses < 2 or moves > 0.1 * candidate.radar.wavelength_m))

    near, far = distances(block, grid)
    start, stop = _profile(block)
    if near < stop and far > start:
        return ''
    found = [h.advice for h in GEOMETRY if any(map(within, h.undo(block)))]
    return '; or '.join(found[:_MOST_NAMED])


def _profile(block: PulseBlock) -> tuple[float, float]:
    start = block.radar.range_start_m
    return start, start + block.n_samples * block.radar.sample_spacing_m
