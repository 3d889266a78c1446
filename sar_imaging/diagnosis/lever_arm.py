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
from collections.abc import Callable

import numpy as np
from scipy import ndimage, optimize
from scipy.spatial.transform import Rotation

from ..geometry.grids import MapGrid
from ..signal.pulses import PulseBlock
from ..signal.range_compression import RangeCompressor
from .coherence import (
    BUDGET,
    NOISE,
    OVERSAMPLING,
    Coherence,
    CoherenceProbe,
    gain_of,
    resolved,
    values_at,
)
from .jumps import jumps
from .signals import Finding
from .thorough import one_channel

_FEWEST_PULSES = 32
_LONGEST_M = 1.0
_FARTHEST_M = 1.25  # to which an arm may grow: one that gets there makes up for another fault
_FELT_RAD = 1.2  # rms phase from one arm to the next
_BLURS_RAD = 3.0  # rms phase that the longest arm has to leave in a direction to be searched
_ADDS_RAD = 0.5  # the same for a direction in which arms that were found are refined
_MOST_ARMS, _MOST_LENGTHS = 30_000, 60  # lengths on each side
_FEW_PULSES, _MOST_PULSES = 64, 256  # of a first look, and of the others
_COARSE_BUDGET, _FINE_BUDGET = 200_000, 500_000  # points times rows
_POINTS = 64  # at a time
_PEAKS, _STARTS = 8, 3  # of a first look, and those that are refined
_MOST_CLIMBED = 100  # steps
_TILE = 4
_BETTER = 1.25  # times the agreement: right ones agree best as they are
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
        return gain_of(self.corrected, self.as_it_is)

    @property
    def found(self) -> bool:
        """Whether the pulses agree clearly better with it."""
        return (self.gain > _BETTER and self.corrected.contrast > _LEAST
                and self.corrected.agreement > 2 * NOISE
                and np.linalg.norm(self.arm_m) < 0.95 * _FARTHEST_M)

    def finding(self, *, alone: bool = True) -> Finding:
        """What is said of it, `alone` unless another mistake explains the pulses as well."""
        told = ', '.join(f'{value:+.2f}' for value in self.arm_m)
        plural = 's' if self.n_directions > 1 else ''
        first = '' if alone else (
            'this arm or an offset of the clock: either explains the blur on this track, so '
            'correct only one, and begin with the arm, which a ruler tells; ')
        return Finding('lever arm', (
            f'with the antenna {np.linalg.norm(self.arm_m):.2f} m beside where it is said to be, '
            f'by ({told}) m in the frame of the platform, the focus figure '
            f'{self.as_it_is.contrast:.2f} becomes {self.corrected.contrast:.2f}; the turns of '
            f'the platform tell {self.n_directions} direction{plural} of the arm'), first +
            'measure where the phase centre of the antenna is from the point that the poses are '
            'of, and give it as antenna.tx and antenna.rx of the node, or as '
            'alignment.lever_arm_m of `sar-imaging load`')


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
        None where the platform does not turn enough to tell any, and for the rows of a raster: a
        phase that grows evenly over their pulses does not displace the image alone.
    """
    step_m = np.linalg.norm(np.diff(block.phase_centre_m, axis=0), axis=1)
    if block.n_pulses < _FEWEST_PULSES or len(jumps(step_m)) > 1:
        return None
    directions, blur_rad = _directions(block, attitude, grid)
    if not len(directions):
        return None
    window = 'none' if block.compressed else window
    step = -(-block.n_pulses // _MOST_PULSES)
    attitude = attitude[::step]
    block = one_channel(block).select(slice(None, None, step))
    profiles = RangeCompressor.for_block(block, window=window, oversampling=OVERSAMPLING)(block)
    grid = resolved(grid, block)
    moves = _moves(block, attitude, grid) @ directions.T
    # the same pixels for all arms: these are not to displace the scene
    fine, whole = (CoherenceProbe(grid, n, _TILE).fixed(profiles) for n in (_FINE_BUDGET, BUDGET))

    def judged(probe: CoherenceProbe, arm) -> Coherence:
        moved = (moves @ np.asarray(arm))[:, None]
        return probe(dataclasses.replace(profiles, tx_m=profiles.tx_m + moved,
                                         rx_m=profiles.rx_m + moved))

    def spread(arm) -> float:
        return judged(fine, arm).spread

    none = np.zeros(len(directions))
    few = slice(None, None, -(-block.n_pulses // _FEW_PULSES))
    starts = [none, *_likely(profiles.select(few), moves[few], grid, blur_rad)]
    starts = sorted(starts, key=spread)[-_STARTS:]
    arms = [_climbed(spread, start, blur_rad) for start in starts]
    best = max(arms, key=spread)
    return LeverArm(best @ directions, int(np.sum(blur_rad * _LONGEST_M > _BLURS_RAD)),
                    judged(whole, none), judged(whole, best))


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
    if blur_rad[0] * _LONGEST_M < _BLURS_RAD:
        return directions[:0], blur_rad[:0]
    adds = blur_rad * _LONGEST_M > _ADDS_RAD
    return directions[adds], blur_rad[adds]


def _likely(profiles: PulseBlock, moves: np.ndarray, grid: MapGrid, blur_rad: np.ndarray
            ) -> np.ndarray:
    """(K, D) arms with which few pulses agree best, of all that are worth trying.

    Arms are short beside cells of range, so that they turn the phases of echoes and leave their
    places. The sums for all arms of a grid are then products of matrices.

    Parameters
    ----------
    profiles : PulseBlock
        Of few pulses of one channel.
    moves : (P, 3, D) float64
        Of their phase centres by a metre of arm in each direction.
    grid : MapGrid
        Of the image.
    blur_rad : (D,) float64
        Of a metre in each direction.

    Returns
    -------
    (K, D) float64
        Metres in each direction, likeliest first.
    """
    points = CoherenceProbe(grid, _COARSE_BUDGET, _TILE).fixed(profiles).points
    lengths_m = _lengths(blur_rad)
    squares, means = np.zeros((2, *map(len, lengths_m)))
    total = 0.0
    for some in np.array_split(points, -(-len(points) // _POINTS)):
        values = values_at(profiles, some).astype(np.complex64)
        sight = some[:, None] - profiles.phase_centre_m
        sight /= np.linalg.norm(sight, axis=-1, keepdims=True)
        change_rad = profiles.radar.wavenumber_rad_per_m * np.einsum('kpi,pid->dkp', sight, moves)
        first, second, third = (
            np.exp(-1j * change[..., None] * lengths).astype(np.complex64)
            for change, lengths in itertools.zip_longest(
                change_rad, lengths_m, fillvalue=np.zeros_like(change_rad[0])))
        first *= values[..., None]
        power = np.sum(np.square(np.abs(values)), axis=1)
        total += float(power @ power)
        for k in range(len(lengths_m[2])):
            sums = (first * third[..., k:k + 1]).swapaxes(1, 2) @ second
            intensity = np.square(np.abs(sums))
            squares[..., k] += np.sum(np.square(intensity), axis=0)
            means[..., k] += np.tensordot(power, intensity, 1)
    figures = squares / total - np.square(means / total)  # as `Coherence.spread`
    peaks = np.argwhere(figures == ndimage.maximum_filter(figures, 3))
    peaks = sorted(peaks, key=lambda at: -figures[tuple(at)])[:_PEAKS]
    return np.array([[lengths[k] for lengths, k in zip(lengths_m, at, strict=True)]
                     for at in peaks])[:, :len(blur_rad)]


def _lengths(blur_rad: np.ndarray) -> list[np.ndarray]:
    """Three lengths (N,) of arm worth trying, metres, 0 alone in directions that tell little."""
    n = np.zeros(3, int)
    n[:len(blur_rad)] = np.minimum(_MOST_LENGTHS, blur_rad * _LONGEST_M / _FELT_RAD)
    while np.prod(2 * n + 1) > _MOST_ARMS:
        n[np.flatnonzero(n)[-1]] -= 1  # what blurs least
    steps_m = np.r_[_FELT_RAD / blur_rad, [1.0] * (3 - len(blur_rad))]
    return [step * np.arange(-k, k + 1) for step, k in zip(steps_m, n, strict=True)]


def _climbed(spread: Callable[[np.ndarray], float], start: np.ndarray, blur_rad: np.ndarray
             ) -> np.ndarray:
    """(D,) arm near a start (D,) with which most stands out, metres."""
    def lack(phase_rad: np.ndarray) -> float:
        arm = phase_rad / blur_rad
        return -spread(arm) if np.linalg.norm(arm) < _FARTHEST_M else 0.0

    first = start * blur_rad
    around = np.diag(np.minimum(_FELT_RAD / 2, 0.3 * _LONGEST_M * blur_rad))
    found = optimize.minimize(lack, first, method='Nelder-Mead', options={
        'initial_simplex': np.vstack([first, first + around]), 'maxfev': _MOST_CLIMBED,
        'xatol': 0.05, 'fatol': 0.05})
    return found.x / blur_rad


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
