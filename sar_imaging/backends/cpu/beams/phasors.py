"""Phases of a sub-aperture's echoes in the directions of its beams, as `form_beams` computes them.

Beam m of echo i has the phase ``2 pi c L_mi`` at c cycles per metre. Beams lie in groups. Of a
group's beams, counted in pairs from the outermost inwards, one is as far on one side of the
group's middle as the other on the other side. With the mean M of a group's paths and half the
difference B of a pair's,

``exp(j 2 pi c L) = exp(j 2 pi c M) exp(+-j 2 pi c B)``,

exact where paths are straight over the group: a pair shares the second phasor, one of them its
conjugate. Echoes on opposite sides of the sub-aperture's middle have nearly opposite B and may
share it likewise. What that neglects is `shared_errors` of the plan.
"""

from __future__ import annotations

import functools
from typing import NamedTuple

import numpy as np

from .accumulation import ECHOES, LANES


class EchoPhasors(NamedTuple):
    """Paths and phases of echoes, Q phasors by `ECHOES`, for G groups of H pairs of beams.

    All arrays but the first are flat.

    Parameters
    ----------
    order : (Q,) or (2 * Q,) int64
        Echo of each phasor of a block, then of their conjugates if echoes share them, then those
        of the next block; -1 for none.
    middle, carrier, slope : (G * len(order),) float64
        In that order: M, what an echo's path is longer for the middle of a group than the
        reference's, metres; its phase at the carrier, cycles; what the path grows from beam to
        beam, metres.
    beside : (G * Q * H,) float64
        B, metres: groups, blocks, pairs from the outermost inwards, phasors of the block.
    middle_step, beside_step : (2 * G * len(order),) and (2 * G * Q * H,) float32
        Phasors of `middle` and `beside` over a vector of bins, real parts first.
    """

    order: np.ndarray
    middle: np.ndarray
    carrier: np.ndarray
    slope: np.ndarray
    beside: np.ndarray
    middle_step: np.ndarray
    beside_step: np.ndarray


def echo_phasors(path_m, group: int, paired: bool, cycles) -> EchoPhasors:
    """Phasors of echoes; arguments as of `form_beams`, and `cycles` of `SpectrumBins`."""
    upper, lower, before, after = _pairs_of_beams(len(path_m), group)
    n_groups, half = upper.shape
    echoes = _echoes_by_phasor(path_m, paired)
    path = path_m[:, echoes.reshape(-1)]
    slope = (path[after] - path[before]) / (after - before)[:, None]
    upper, lower = path[upper], path[lower]
    middle = (upper + lower).sum(axis=1) / (2 * half)
    beside = 0.5 * (upper - lower)
    if paired:
        own, other = np.split(beside, 2, axis=2)
        beside = 0.5 * (own - other)
        alone = echoes[1] < 0  # the middle of an odd number
        beside[:, :, alone] = own[:, :, alone]

    def by_block(values):
        """Both echoes of each phasor of a block, then those of the next block."""
        return values.reshape(-1, 1 + paired, echoes.shape[1] // ECHOES, ECHOES
                              ).swapaxes(1, 2).reshape(len(values), -1)

    middle = by_block(middle)
    beside = np.ascontiguousarray(beside.reshape(n_groups, half, -1, ECHOES).swapaxes(1, 2))
    return EchoPhasors(by_block(echoes.reshape(1, -1))[0], middle.reshape(-1),
                      np.fmod(cycles[0] * middle, 1.0).reshape(-1), by_block(slope).reshape(-1),
                      beside.reshape(-1), _step_phasors(cycles[1] * middle),
                      _step_phasors(cycles[1] * beside))


@functools.lru_cache(maxsize=16)
def _pairs_of_beams(n_beams: int, group: int):
    """Beams of each group's pairs, (G, H) each, and those before and after groups, (G,) each."""
    n_groups, half = -(-n_beams // group), -(-group // 2)
    first = np.arange(n_groups)[:, None] * group
    last = np.minimum(first + group, n_beams) - 1
    upper = np.minimum(first + np.arange(half), (first + last) // 2)
    return (upper, first + last - upper, np.maximum(first[:, 0] - 1, 0),
            np.minimum(last[:, 0] + 1, n_beams - 1))


def _echoes_by_phasor(path_m, paired: bool) -> np.ndarray:
    """(1, Q) echoes, or (2, Q) whose paths grow most unlike from the first beam to the last.

    -1 stands for none: in the last block of `ECHOES`, and opposite the middle of an odd number.
    """
    n_echoes = path_m.shape[1]
    n_phasors = -(-n_echoes // 2) if paired else n_echoes
    echoes = np.full((1 + paired, -(-n_phasors // ECHOES) * ECHOES), -1)
    order = np.argsort(path_m[-1] - path_m[0]) if paired else np.arange(n_echoes)
    echoes[0, :n_phasors] = order[:n_phasors]
    if paired:
        echoes[1, :n_echoes // 2] = order[::-1][:n_echoes // 2]
    return echoes


def _step_phasors(cycles) -> np.ndarray:
    """Phasors over a vector of bins, real parts first, flat."""
    cycles = LANES * cycles.reshape(-1)
    angle = (2 * np.pi * (cycles - np.rint(cycles))).astype(np.float32)
    return np.concatenate([np.cos(angle), np.sin(angle)])
