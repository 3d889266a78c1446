# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Random cases with antenna patterns and pointings, to test predicted errors of beams on."""

from __future__ import annotations

import dataclasses

import numpy as np

from benchmarks.support.random_cases import random_case
from sar_imaging.geometry.grids import MapGrid
from sar_imaging.geometry.illumination import AntennaPattern, PatternCut, Pointing
from sar_imaging.signal import PulseBlock

_CUTS = PatternCut.sinc, PatternCut.gaussian, PatternCut.cosine, PatternCut.uniform
_WIDEST = 0.9  # radians


@dataclasses.dataclass(frozen=True)
class LitCase:
    """Pulses of an antenna over one scene, and the map that is wanted of them.

    Attributes
    ----------
    grid : MapGrid
        The map.
    block : PulseBlock
        Range profiles with phase centres and pointing.
    pattern : AntennaPattern
        Over azimuth.
    extent_rad : float
        Angle under which the antenna sees the map.
    target_db : float
        Random target of exact backprojection, dB.
    traits : dict
        As of `RandomCase`.
    """

    grid: MapGrid
    block: PulseBlock
    pattern: AntennaPattern
    extent_rad: float
    target_db: float
    traits: dict

    def cut(self, extents: float, turn: int = 0) -> PatternCut:
        """Cut that is so many times as wide as the map; one kind after the other by the seed."""
        return _CUTS[(self.traits['seed'] + turn) % 4](min(self.extent_rad * extents, _WIDEST))


def lit_case(seed: int) -> LitCase:
    """A random radar, track and scene, seen by a steered, a fixed or a turning antenna.

    Patterns are 0.3 to 3 times as wide as the map. Parameters follow from the seed.
    """
    case, rng = random_case(seed), np.random.default_rng(seed)
    block = case.profiles
    centre, target = block.phase_centre_m, np.array(case.grid.centre_m)
    look = target - centre.mean(axis=0)
    extent = case.grid.spacing_m * max(case.grid.shape) / np.linalg.norm(look)
    extents = rng.uniform(0.3, 3.0)
    turn = extent * rng.uniform(-0.5, 0.5) * np.linspace(-1, 1, len(centre))
    pointing = (Pointing.steered(centre, target), Pointing(np.tile(look, (len(centre), 1))),
                Pointing(look + np.cross([0, 0, 1.0], look) * turn[:, None]))[seed % 3]
    pulses = PulseBlock(block.radar, True, block.stamp_ns, block.counter, block.samples,
                        block.tx_m, block.rx_m, pointing=pointing)
    found = LitCase(case.grid, pulses, None, extent, float(rng.uniform(-75, -45)), case.traits)
    return dataclasses.replace(found, pattern=AntennaPattern(found.cut(extents)))
