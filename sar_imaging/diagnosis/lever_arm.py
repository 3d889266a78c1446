# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Name a lever arm that is missing or wrong: the antenna is beside the point that poses are of.

A platform that turns moves the antenna around that point, by the rotation times the arm. A part of
it moves the track as a whole, and with it the image, in focus; what is left blurs it. Arms are
therefore searched in the directions in which the turns of this platform blur the scene, and
the arm is named with which the pulses agree. Turns of some degrees tell centimetres of arm, those
of a radar on a rotating arm its whole length.
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
import math
from collections.abc import Callable

import numpy as np
from scipy import ndimage
from scipy.spatial.transform import Rotation

from ..geometry.grids import MapGrid
from ..signal.pulses import PulseBlock
from .coherence import (
    BUDGET,
    NOISE,
    Coherence,
    CoherenceProbe,
    gain_of,
    profiles_of,
    resolved,
)
from .diagnose import BETTER, FINE_BUDGET, LEAST, least_contrast, one_channel
from .range_walk import half_bands
from .signals import LIKELY, ONE_OF_SEVERAL, Finding
from .track import jumps

_FEWEST_PULSES = 32
_LONGEST_M = 1.0
_FARTHEST_M = 1.25  # to which an arm may grow: one that gets there makes up for another fault
_SHORTEST_M = 0.005  # less is an error of the track
_FELT_RAD = 1.2  # rms phase from one arm to the next
_BLURS_RAD = 3.0  # rms phase that the longest arm has to leave in a direction to be searched
_ADDS_RAD = 0.5  # the same for a direction in which arms that were found are refined
_TOLD_RAD = 0.3  # rms phase that is still felt: it gives the error of a length
_SHORTER = 0.3  # per square metre: of arms that do as well, the shorter one
_MOST_ARMS = 1000
_FIRST_LOOK = 50_000_000  # points times rows times arms
_FEW_PULSES, _MOST_PULSES = 64, 256  # of a first look, and of the others
_PEAKS, _STARTS = 8, 3  # of a first look, and those that are refined
_MOST_CLIMBED = 100  # steps
_COURSE_DEGREE = 6  # of the polynomial that smooths a track for its course
_TURNS_RAD, _ONE_WAY = 0.5, 0.8  # by which a course has to turn, and share of all its turns
_STANDS = 0.2  # of the median speed: a platform that stands has no course


@dataclasses.dataclass(frozen=True)
class LeverArm:
    """An arm with which pulses agree.

    Parameters
    ----------
    arm_m : (3,) float64
        In the frame of the platform, metres, besides the one that the phase centres have; only
        in the directions that its turns tell.
    told_m : (3,) float64
        The part of it that is longer than its error: the rest is not felt.
    error_m : float
        Error of the length of that part, metres: what is not felt, and how odd and even pulses
        differ.
    n_directions : int
        How many these are.
    as_it_is, corrected : Coherence
        Without and with it.
    """

    arm_m: np.ndarray
    told_m: np.ndarray
    error_m: float
    n_directions: int
    as_it_is: Coherence
    corrected: Coherence

    @property
    def gain(self) -> float:
        """Agreement of the pulses over that without the arm."""
        return gain_of(self.corrected, self.as_it_is)

    @property
    def found(self) -> bool:
        """Whether the pulses agree clearly better with it, in an image that is no darker."""
        length = float(np.linalg.norm(self.arm_m))
        return (self.gain > BETTER
                and self.corrected.contrast > max(LEAST, least_contrast(self.as_it_is.contrast))
                and self.corrected.agreement > 2 * NOISE
                and _SHORTEST_M < length < 0.95 * _FARTHEST_M)

    def finding(self, *, alone: bool = True, frame: str = 'platform') -> Finding:
        """What is said of it, `alone` unless another mistake explains the pulses as well."""
        told = ', '.join(f'{value:+.2f}' for value in self.told_m)
        first = '' if alone else (
            'this arm or what else is named: either explains the blur on this track, so correct '
            'only one, and begin with the arm, which a ruler tells; ')
        directions = ('its direction is told whole' if self.n_directions == 3 else
                      'turns tell ' + ('one direction' if self.n_directions == 1 else
                                       'two directions') + ' of it and not the rest')
        return Finding('lever arm', (
            f'with the antenna {np.linalg.norm(self.told_m):.2f} +- {self.error_m:.2f} m beside '
            f'where it is said to be, by ({told}) m in the frame of the {frame}, the focus figure '
            f'{self.as_it_is.contrast:.2f} becomes {self.corrected.contrast:.2f} and pulses agree '
            f'{self.gain:.3g} times as well; {directions}'), first +
            'measure where the phase centre of the antenna is from the point that the poses are '
            'of, and give it as antenna.tx and antenna.rx of the node, or as '
            'alignment.lever_arm_m of `sar-imaging load`',
            'the arm as it is told, and all mistakes of positions and clocks',
            LIKELY if alone else ONE_OF_SEVERAL, tuple(map(float, self.told_m)))


def course(block: PulseBlock) -> Rotation | None:
    """Attitude of a platform that looks along its track, where this turns; x along it, z up."""
    if block.n_pulses < _FEWEST_PULSES:
        return None
    u = np.linspace(-1.0, 1.0, block.n_pulses)
    fits = [np.polynomial.Polynomial.fit(u, axis, _COURSE_DEGREE)
            for axis in block.phase_centre_m[:, :2].T]
    velocity = np.stack([fit.deriv()(u) for fit in fits], axis=1)
    speed = np.linalg.norm(velocity, axis=1)
    heading = np.unwrap(np.arctan2(velocity[:, 1], velocity[:, 0]))
    turned = abs(heading[-1] - heading[0])
    if speed.min() <= _STANDS * np.median(speed) or turned < max(
            _TURNS_RAD, _ONE_WAY * np.ptp(heading)):
        return None
    return Rotation.from_rotvec(heading[:, None] * [0.0, 0.0, 1.0])


def find_lever_arm(block: PulseBlock, attitude: Rotation, grid: MapGrid, *,
                   window: str = 'none') -> LeverArm | None:
    """Search for the lever arm with which the pulses of an aperture agree.

    Parameters
    ----------
    block : PulseBlock
        Raw or compressed, with phase centres.
    attitude : Rotation
        Attitude of the platform at each pulse, from its own frame into that of the phase centres.
    grid : MapGrid
        Where the scene is.
    window : str
        Window of the range compression of raw pulses.

    Returns
    -------
    LeverArm or None
        None where the platform does not turn enough to tell any, and for the rows of a raster: a
        phase that grows evenly over their pulses does not displace the image alone.
    """
    step_m = np.linalg.norm(np.diff(block.phase_centre_m, axis=0), axis=1)
    if block.n_pulses < _FEWEST_PULSES or len(jumps(step_m)) > 1:
        return None
    step = -(-block.n_pulses // _MOST_PULSES)
    block, attitude = one_channel(block).select(slice(None, None, step)), attitude[::step]
    moves = _moves(block, attitude)
    directions, blur_rad = _directions(block, moves, grid)
    if not len(directions):
        return None
    moves = moves @ directions.T
    profiles = profiles_of(block, window)
    # an arm may be all that makes an aperture
    grid = resolved(grid, _moved(block, 0.3 * _LONGEST_M * moves[:, :, 0]))

    def spread(arm: np.ndarray, pulses: slice = slice(None)) -> float:
        return fine(_moved(profiles.select(pulses), moves[pulses] @ arm)).spread

    fine = CoherenceProbe(grid, FINE_BUDGET)
    none = np.zeros(len(directions))
    few = slice(None, None, -(-block.n_pulses // _FEW_PULSES))
    starts = [none, *_beside_beats(profiles.select(few), moves[few], grid, blur_rad)]
    starts = sorted(starts, key=spread)[-_STARTS:]
    tops = []
    for start in starts:
        # the same pixels for all arms that are near: these are not to displace the scene
        fine = CoherenceProbe(grid, FINE_BUDGET).fixed(_moved(profiles, moves @ start))
        tops.append(_climbed(spread, start, blur_rad))
    fine = CoherenceProbe(grid, FINE_BUDGET)
    best = max(tops, key=spread)
    whole = CoherenceProbe(grid, BUDGET)
    fine = fine.fixed(_moved(profiles, moves @ best))
    odd, even = (_climbed(functools.partial(spread, pulses=slice(k, None, 2)), best, blur_rad)
                 for k in (0, 1))
    error_m = np.hypot(_TOLD_RAD / blur_rad, (odd - even) / 2)
    felt = np.abs(best) > error_m
    told = best * felt if felt.any() else best
    along = np.abs(told) / max(float(np.linalg.norm(told)), 1e-9)
    return LeverArm(best @ directions, told @ directions, float(along @ error_m),
                    int(np.sum(blur_rad * _LONGEST_M > _BLURS_RAD)),
                    whole(profiles), whole(_moved(profiles, moves @ best)))


def with_arm(block: PulseBlock, attitude: Rotation, arm_m: np.ndarray) -> PulseBlock:
    """A block whose antenna is `arm_m` (3,) farther from where poses are; its scene stays."""
    return _moved(block, _moves(block, attitude) @ arm_m)


def _moved(block: PulseBlock, by_m: np.ndarray) -> PulseBlock:
    """A block whose phase centres are moved (P, 3) metres."""
    return dataclasses.replace(block, tx_m=block.tx_m + by_m[:, None],
                               rx_m=block.rx_m + by_m[:, None])


def _moves(block: PulseBlock, attitude: Rotation) -> np.ndarray:
    """(P, 3, 3) change of the phase centres by each component of an arm, metres per metre.

    Without what shifts and turns the track as a whole, which moves the image and focuses nothing.
    """
    turns = attitude.as_matrix()
    rigid = _rigid(block).reshape(-1, 5)
    flat = turns.reshape(-1, 3)
    return (flat - rigid @ (np.linalg.pinv(rigid) @ flat)).reshape(turns.shape)


def _rigid(block: PulseBlock) -> np.ndarray:
    """(P, 3, 5) change of the phase centres by a shift, and by turns of the track as a whole.

    The turns are one about the vertical and one that tilts the line of the track. Those about
    the track itself are none: wiggles of a straight one would make them large.
    """
    arm = block.phase_centre_m - block.phase_centre_m.mean(axis=0)
    arm = arm / max(float(np.abs(arm).max()), 1e-9)
    along = np.linalg.svd(arm, full_matrices=False)[2][0]
    turned = np.cross([0.0, 0.0, 1.0], arm)
    tilted = np.outer(arm @ along, np.cross([-along[1], along[0], 0.0], along))
    shifted = np.broadcast_to(np.eye(3), (len(arm), 3, 3))
    return np.concatenate([shifted, turned[..., None], tilted[..., None]], axis=2)


def _directions(block: PulseBlock, moves: np.ndarray, grid: MapGrid
                ) -> tuple[np.ndarray, np.ndarray]:
    """(D, 3) directions of an arm that blurs the scene, and (D,) radians rms of each metre.

    What turns and shifts of the track explain of the change of the half paths is no blur.
    """
    places = grid.points()[::grid.n_y // 2 or 1, ::grid.n_x // 2 or 1].reshape(-1, 3)
    sight = places[:, None] - block.phase_centre_m
    sight /= np.linalg.norm(sight, axis=-1, keepdims=True)
    change, rigid = (np.einsum('kpi,pij->kpj', sight, a).reshape(-1, a.shape[2])
                     for a in (moves, _rigid(block)))
    change = change - rigid @ (np.linalg.pinv(rigid) @ change)
    _, values, directions = np.linalg.svd(change, full_matrices=False)
    blur_rad = block.radar.wavenumber_rad_per_m * values / math.sqrt(len(change))
    adds = blur_rad * _LONGEST_M > _ADDS_RAD
    if blur_rad[0] * _LONGEST_M < _BLURS_RAD:
        adds[:] = False
    return directions[adds], blur_rad[adds]


def _beside_beats(profiles: PulseBlock, moves: np.ndarray, grid: MapGrid, blur_rad: np.ndarray
                  ) -> list[np.ndarray]:
    """Arms (D,) near those with which the beats of the two halves of the band agree best.

    A half of the band apart, their phases turn by a full cycle for a cell or two of range: a few
    arms tell them all, and the brightest pixels of each are found, where millimetres of arm would
    have to be tried. As `_likely` otherwise.
    """
    upper, lower = half_bands(profiles.samples)
    radar = dataclasses.replace(profiles.radar, carrier_hz=profiles.radar.bandwidth_hz / 2)
    places = radar.range_start_m + radar.sample_spacing_m * np.arange(profiles.n_samples)
    turns = np.exp(-4j * np.pi / radar.wavelength_m * places)
    beats = dataclasses.replace(profiles, radar=radar,
                                samples=(upper * lower.conj() * turns).astype(np.complex64))
    finer = radar.wavelength_m / profiles.radar.wavelength_m
    out = []
    for arm in _likely(beats, moves, resolved(grid, beats), blur_rad / finer)[:_STARTS]:
        near = _moved(profiles, moves @ arm)
        out += [arm + more for more in _likely(near, moves, grid, blur_rad, finer)]
    return out


def _likely(profiles: PulseBlock, moves: np.ndarray, grid: MapGrid, blur_rad: np.ndarray,
            most: float = math.inf) -> np.ndarray:
    """(K, D) arms with which few pulses agree best, of all that are worth trying.

    Parameters
    ----------
    profiles : PulseBlock
        Profiles of few pulses of one channel.
    moves : (P, 3, D) float64
        Moves of their phase centres by a metre of arm in each direction.
    grid : MapGrid
        Grid of the image.
    blur_rad : (D,) float64
        Blur of a metre in each direction.
    most : float
        Lengths on each side.

    Returns
    -------
    (K, D) float64
        Metres in each direction, likeliest first.
    """
    lengths_m = _lengths(blur_rad, most)
    shape = tuple(map(len, lengths_m))
    probe = CoherenceProbe(grid, _FIRST_LOOK // math.prod(shape)).fixed(profiles)
    figures = np.reshape([probe(_moved(profiles, moves @ np.array(arm))).spread
                          for arm in itertools.product(*lengths_m)], shape)
    peaks = np.argwhere(figures == ndimage.maximum_filter(figures, 3))
    highest = sorted(peaks, key=lambda at: -figures[tuple(at)])[:_PEAKS]
    return np.array([[lengths[k] for lengths, k in zip(lengths_m, at, strict=True)]
                     for at in highest])


def _lengths(blur_rad: np.ndarray, most: float) -> list[np.ndarray]:
    """Lengths (N,) of arm worth trying in each direction, metres; 0 where it tells little."""
    n = np.minimum(blur_rad * _LONGEST_M / _FELT_RAD, most).astype(int)
    while np.prod(2 * n + 1) > _MOST_ARMS and n[1:].any():
        n[np.flatnonzero(n)[-1]] -= 1  # what blurs least
    return [_FELT_RAD / blur * np.arange(-k, k + 1) for blur, k in zip(blur_rad, n, strict=True)]


def _climbed(spread: Callable[[np.ndarray], float], start: np.ndarray, blur_rad: np.ndarray
             ) -> np.ndarray:
    """(D,) arm near a start (D,) with which most stands out, metres."""
    # scipy.optimize takes its time to import, which a node need not wait for
    from scipy.optimize import minimize

    def lack(phase_rad: np.ndarray) -> float:
        arm = phase_rad / blur_rad
        length = np.linalg.norm(arm)
        return -spread(arm) * math.exp(-_SHORTER * length**2) if length < _FARTHEST_M else 0.0

    first = start * blur_rad
    around = np.diag(np.minimum(_FELT_RAD / 2, 0.3 * _LONGEST_M * blur_rad))
    found = minimize(lack, first, method='Nelder-Mead', options={
        'initial_simplex': np.vstack([first, first + around]), 'maxfev': _MOST_CLIMBED,
        'xatol': 0.05, 'fatol': 0.05})
    return found.x / blur_rad
