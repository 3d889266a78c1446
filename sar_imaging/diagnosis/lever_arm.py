"""Name a lever arm that is missing or wrong: the antenna is beside the point that poses are of.

A platform that turns moves the antenna around that point, by the rotation times the arm. A part of
it displaces the image, and is not seen; what is curved along the track blurs it. Arms are
therefore searched in the directions in which the turns of this platform blur the scene, and
the arm is named with which the pulses agree.
"""

from __future__ import annotations

import dataclasses
import itertools
import math

import numpy as np
from scipy.spatial.transform import Rotation

from ..geometry.grids import MapGrid
from ..signal.pulses import PulseBlock
from ..signal.range_compression import RangeCompressor
from .coherence import BUDGET, OVERSAMPLING, Coherence, CoherenceProbe, resolved
from .signals import Finding
from .thorough import one_channel

_FEWEST_PULSES = 32
_LONGEST_M = 1.0
_FELT_RAD = 1.2  # rms phase from one arm to the next
_BLURS_RAD = 3.0  # rms phase that the longest arm has to leave in a direction to be searched
_MOST_ARMS = 1500
_FEW_PULSES, _MOST_PULSES = 64, 256  # of a first look, and of the others
_COARSE_BUDGET, _FINE_BUDGET = 100_000, 500_000  # points times rows
_PEAKS = 8
_TILE = 4
_BETTER = 1.25  # times the agreement: right ones agree best as they are
_NOISE = 2.0  # agreement of noise
_LEAST = 1.45  # contrast with which something focuses at all


@dataclasses.dataclass(frozen=True)
class LeverArm:
    """An arm with which pulses agree.

    Parameters
    ----------
    arm_m : (3,) float64
        In the frame of the platform, metres, besides the one that the phase centres have; only
        in the directions that its turns tell.
    n_directions : int
        How many these are.
    as_it_is, corrected : Coherence
        Without and with it.
    """

    arm_m: np.ndarray
    n_directions: int
    as_it_is: Coherence
    corrected: Coherence

    @property
    def gain(self) -> float:
        """Agreement of the pulses over that without the arm."""
        return self.corrected.agreement / max(self.as_it_is.agreement, _NOISE)

    @property
    def found(self) -> bool:
        """Whether the pulses agree clearly better with it."""
        return (self.gain > _BETTER and self.corrected.contrast > _LEAST
                and self.corrected.agreement > 2 * _NOISE)

    def finding(self) -> Finding:
        """What is said of it."""
        told = ', '.join(f'{value:+.2f}' for value in self.arm_m)
        plural = 's' if self.n_directions > 1 else ''
        return Finding('lever arm', (
            f'with the antenna {np.linalg.norm(self.arm_m):.2f} m beside where it is said to be, '
            f'by ({told}) m in the frame of the platform, the focus figure '
            f'{self.as_it_is.contrast:.2f} becomes {self.corrected.contrast:.2f}; the turns of '
            f'the platform tell {self.n_directions} direction{plural} of the arm'),
            'measure where the phase centre of the antenna is from the point that the poses are '
            'of, and give it as antenna.tx and antenna.rx, or as lever arm of the alignment')


def find_lever_arm(block: PulseBlock, attitude: Rotation, grid: MapGrid, *,
                   window: str = 'none') -> LeverArm | None:
    """Search for the lever arm with which the pulses of an aperture agree.

    Parameters
    ----------
    block : PulseBlock
        Raw or compressed, with phase centres.
    attitude : Rotation
        Of the platform at each pulse, from its own frame into that of the phase centres.
    grid : MapGrid
        Where the scene is.
    window : str
        Of the range compression of raw pulses.

    Returns
    -------
    LeverArm or None
        None where the platform does not turn enough to tell any.
    """
    if block.n_pulses < _FEWEST_PULSES:
        return None
    directions, blur_rad = _directions(block, attitude, grid)
    if not len(directions):
        return None
    window = 'none' if block.compressed else window
    step = -(-block.n_pulses // _MOST_PULSES)
    attitude = attitude[::step]
    block = one_channel(block).select(slice(None, None, step))
    few = slice(None, None, -(-block.n_pulses // _FEW_PULSES))
    profiles = RangeCompressor.for_block(block, window=window, oversampling=OVERSAMPLING)(block)
    grid = resolved(grid, block)
    # the same pixels for all arms: these are not to displace the scene
    coarse, fine, whole = (
        (CoherenceProbe(grid, n, _TILE).fixed(some), some)
        for n, some in ((_COARSE_BUDGET, profiles.select(few)), (_FINE_BUDGET, profiles),
                        (BUDGET, profiles)))
    moves = _moves(block, attitude, grid)

    def judged(probe, arm) -> Coherence:
        focus, some = probe
        moved = (moves[few] if some is not profiles else moves) @ (np.asarray(arm) @ directions)
        return focus(dataclasses.replace(some, tx_m=some.tx_m + moved[:, None],
                                         rx_m=some.rx_m + moved[:, None]))

    steps_m = _FELT_RAD / blur_rad
    arms = list(itertools.product(*_values(steps_m)))
    figures = [judged(coarse, arm).agreement for arm in arms]
    best = max((arms[k] for k in np.argsort(figures)[::-1][:_PEAKS]),
               key=lambda arm: judged(fine, arm).agreement)
    for finer, axis in itertools.product((2, 4, 8), range(len(directions))):
        tries = [tuple(np.add(best, np.eye(len(best))[axis] * steps_m[axis] / finer * k))
                 for k in range(-1, 2)]
        best = max(tries, key=lambda arm: judged(fine, arm).agreement)
    return LeverArm(np.asarray(best) @ directions, len(directions),
                    judged(whole, np.zeros(len(directions))), judged(whole, best))


def _directions(block: PulseBlock, attitude: Rotation, grid: MapGrid
                ) -> tuple[np.ndarray, np.ndarray]:
    """(D, 3) directions of an arm that blurs the scene, and (D,) radians rms of each metre."""
    places = grid.points()[::grid.n_y // 2 or 1, ::grid.n_x // 2 or 1].reshape(-1, 3)
    sight = places[:, None] - block.phase_centre_m
    sight /= np.linalg.norm(sight, axis=-1, keepdims=True)
    # change of the half path to each place (K, P, 3) by a metre of each component of the arm
    turns = attitude.as_matrix()  # of which the mean displaces the scene
    change = np.einsum('kpi,pij->kpj', sight, turns - turns.mean(axis=0))
    line = np.polynomial.legendre.legvander(np.linspace(-1, 1, block.n_pulses), 1)
    change = change - line @ (np.linalg.pinv(line) @ change)
    _, values, directions = np.linalg.svd(change.reshape(-1, 3), full_matrices=False)
    blur_rad = (block.radar.wavenumber_rad_per_m * values
                / math.sqrt(len(places) * block.n_pulses))
    tells = blur_rad * _LONGEST_M > _BLURS_RAD
    return directions[tells], blur_rad[tells]


def _values(steps_m: np.ndarray) -> list[np.ndarray]:
    """Lengths of arm worth trying in each direction, metres; fewer where there are too many."""
    n = np.maximum(1, np.minimum(60, np.ceil(_LONGEST_M / steps_m))).astype(int)
    while np.prod(2 * n + 1) > _MOST_ARMS:
        n[np.flatnonzero(n)[-1]] -= 1  # what blurs least
    return [step * np.arange(-k, k + 1) for step, k in zip(steps_m, n, strict=True)]


def _moves(block: PulseBlock, attitude: Rotation, grid: MapGrid) -> np.ndarray:
    """(P, 3, 3) change of the phase centres by each component of an arm, metres per metre.

    Without what moves all pulses alike, and what grows evenly along the line of sight: both
    displace the image and focus nothing.
    """
    turns = attitude.as_matrix()
    moves = turns - turns.mean(axis=0)
    sight = np.asarray(grid.centre_m) - block.phase_centre_m.mean(axis=0)
    sight /= np.linalg.norm(sight)
    along = sight @ moves
    line = np.polynomial.legendre.legvander(np.linspace(-1, 1, block.n_pulses), 1)
    return moves - sight[:, None] * (line @ (np.linalg.pinv(line) @ along))[:, None, :]
