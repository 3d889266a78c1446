# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Fast factorised backprojection (FFBP): Ulander, Hellsten, Stenström, IEEE Trans. AES 39, 2003.

After Zhang et al. (see `imaging.afbp`), section II.A and figure 2a: images of short sub-apertures
on local polar grids are merged, some at a time, into images of longer ones, by two-dimensional
interpolation; those of the last few are added up on the requested grid. The two-way path of every
channel is exact in the first stage.

From top to bottom: the method, its plan, the choice of what meets a target, the predicted error,
the geometry of the local grids, and the compiled  These work on images at range baseband:
value times ``exp(-j 4 pi (r - r_0) / lambda)`` with the first range r_0 of the image's own grid,
real and imaginary parts apart in one flat array. Positions are float64; the carrier phase is
reduced to a fraction of a cycle in float64 before it becomes float32.
"""

from __future__ import annotations

import bisect
import dataclasses
import functools
import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic
from numpy.typing import ArrayLike
from tqdm import tqdm

from ..backends.cpu.lines import LINES, project_lines
from ..backends.cpu.phasors import cos_cycles, fraction, sin_cycles
from ..backends.cpu.profiles import Profiles
from ..compilation import kernel_part, njit, numba
from ..geometry.grids import MapGrid
from ..geometry.half_paths import Paths, half_paths, sample_paths
from ..geometry.polar import PolarGrid
from ..geometry.track import mean_centres, side_of, track_beside
from ..imaging.image import Report
from ..memory import IMAGE_BYTES
from ..planning.costs import costs
from ..planning.echo_power import echo_power
from ..planning.plan import total_db, with_chance
from ..planning.profiles import (
    ECHOES_PER_PASS,
    RangeGate,
    RangeResampling,
    check_reach,
    covered_ranges,
    plan_resampling,
    reach_warnings,
    some_pixels,
)
from ..signal.pulses import PulseBlock
from ..signal.radar import RadarParameters
from .judged import JudgedMethod, JudgedPlan, may_err_db

ENDS = 'ends of profiles'  # the cause that no sampling helps
# A few dozen scatterers are by chance darker than their pulses; bright parts that are small are
# read at some places between samples only.
_CHANCE_DB = 2.0
_LEAST = 1e-20  # mean squared error
_ECHOES = 33  # whose profiles' ends are looked at
_MERGE_FACTORS = (4, 8)  # those of 2 and 3 take as long as that of 4, and err more
_OVERSAMPLINGS = 1.3 * 1.04 ** np.arange(40)  # to choose from, 1.3 to 6
_LEAST_DB, _MOST_DB = -90.0, -10.0  # targets
_FIRST_STAGE_DB, _FIRST_SHARE_DB = -75.0, 9.0  # less costs little, and may not take more
_HALF_DB, _SLACK_DB = 5.0, 0.3  # of the target for each axis, chance deducted; and to try again
_ROUNDS = 4
_PULSES, _CHANNELS = 32, 4  # that stand for all
_TONE, _BY_TONE = np.polynomial.legendre.leggauss(12)  # over the band, where errors ripple
_SLIGHTLY_FINER = 0.999  # spacing of range than the band asks for
_EDGE_SAMPLES = 33  # per edge of the requested grid
_PULSES_PER_NODE = 5  # whose paths bound the local frequencies
_NARROW = 0.01  # spacing of directions that any geometry allows
_SAFETY = 1.02  # of bandwidths, for what lies between the sampled pulses and positions
LANES = 16  # pixels beyond a segment, whole vectors
_SEGMENTS = (112, 48, 16)  # with LANES more, whole vectors
_SAMPLED_NODES = 64  # per level, where the geometry is looked at closely
_CUBIC_CYCLES = 2e-5  # error of the expansion of the carrier phase along a segment: -78 dB
#: Neighbours that each kernel reads along range and along direction.
TAPS = {'linear': 2, 'cubic': 4, 'knab8': 8}
DEGREE = 7  # of the polynomials in the tables of weights
MARGIN = 0.25  # how far beyond its interval a kernel is evaluated, pixels
_FREQUENCIES = np.linspace(0.0, 0.5, 129)  # of tables, cycles per sample
_PLACES, _DRIFTS = 12, 5  # nodes of the quadrature over an interval, and over a drift
_DRIFT_STEP = 0.01  # of tables, samples
_GROUPS_PER_THREAD = 16  # of lines: evens out the load
PADDING = 256  # values after an image that a segment may read
PIXELS = 64  # of the requested grid, whose geometry is computed together
_FAST = ('contract', 'reassoc', 'nsz')
_FLOAT = ir.FloatType()


class Ffbp(JudgedMethod):
    """Fast factorised backprojection: maps and polar grids that lie on one side of the track.

    For its options see `plan_ffbp`.
    """

    NAME = 'ffbp'
    OWN = {'pulses_per_subaperture': 16, 'merge_factor': None, 'kernel': None,
           'range_oversampling': None, 'angle_oversampling': None}

    def plan(self, tx_m: np.ndarray, rx_m: np.ndarray) -> Report:
        """See `Method`."""
        plan = plan_ffbp(self.grid, self.radar, self.n_samples, tx_m, rx_m,
                         target_db=self.options.target_db, **self.own)
        kernel, resampling = plan.sampling.kernel, plan.resampling
        along = [kernel_weights(kernel, v) for v in plan.sampling.oversampling]
        self._pairs = [paired(w) for w in along]
        self._weights = [w.T.ravel() for w in along]
        self._profiles = Profiles(RangeGate.whole(plan.radar, plan.n_samples), resampling,
                                  plan.range_m)
        longest = max(n.shape[1] for n in plan.levels[0].nodes)
        cycles = 2 * (resampling.cell_m - resampling.spacing) / plan.radar.wavelength_m
        self._ramp = np.exp(2j * np.pi * np.fmod(cycles * np.arange(longest), 1.0)
                            ).astype(np.complex64)
        return self.planned(plan)

    def form(self, block: PulseBlock) -> np.ndarray:
        """See `Method`."""
        plan = self.report.plan
        image = np.zeros(plan.grid.shape, np.complex64)
        # one image per level is alive: a part is added to its parent as soon as it is made
        buffers = [np.zeros(2 * level.size + PADDING, np.float32) for level in plan.levels]
        with tqdm(total=len(plan.levels[0].nodes), desc='ffbp', unit='sub-aperture',
                  disable=not self.options.progress) as bar:
            for node in plan.top:
                self._form(node, block, buffers, bar)
                self._add(node, buffers[node.level], image)
        return image

    def _form(self, node: Node, block: PulseBlock, buffers: list[np.ndarray], bar: tqdm) -> None:
        """Make the image of a sub-aperture from its pulses or from its parts."""
        image = buffers[node.level]
        if not node.children:
            self._backproject(node, block, image)
            bar.update()
            return
        for number, child in enumerate(node.children):
            self._form(child, block, buffers, bar)
            self._merge(child, buffers[child.level], node, image, number == 0)

    def _backproject(self, node: Node, block: PulseBlock, image: np.ndarray) -> None:
        plan, frame = self.report.plan, self.report.plan.frame
        segment = plan.resampling.segment
        n_alpha, n_range = node.shape
        size = n_alpha * n_range
        lines = np.empty((-(-n_alpha // LINES), -(-n_range // segment), 15, LINES))
        geometry = np.array([*frame.leave(node.centre), frame.z_m, *frame.track, *frame.across,
                             node.range_start, plan.range_spacing_m, node.alpha_start,
                             plan.levels[0].alpha_spacing])
        local_lines(geometry, n_alpha, segment, lines)
        image[:2 * size] = 0.0
        echoes = [a[node.pulses].reshape(-1, a.shape[-1])
                for a in (block.samples, block.tx_m, block.rx_m)]
        layout = np.array([n_alpha, 0, n_range, 1, size])
        project_lines(self._profiles, *echoes, [(lines, layout)], self._ramp[:n_range], image)

    @property
    def _groups(self) -> int:
        return _GROUPS_PER_THREAD * numba.get_num_threads()

    def _merge(self, child: Node, source: np.ndarray, parent: Node, target: np.ndarray, first: bool
               ) -> None:
        """Add the image of a part to that of a longer sub-aperture."""
        plan, frame = self.report.plan, self.report.plan.frame
        level, spacing, (rows, columns) = (plan.levels[parent.level], plan.range_spacing_m,
                                           parent.shape)
        cycles = 2 * spacing / plan.radar.wavelength_m
        if not level.segment:  # too near for the lines of the two grids to run side by side
            if first:
                target[:2 * rows * columns] = 0.0
            self._interpolate(child, source, plan.polar_grid(parent), target,
                              (rows, columns, columns, 1, rows * columns), cycles)
            return
        offset = child.centre - parent.centre
        geometry = np.array([
            offset[0], offset[1], parent.centre[2] - frame.z_m, child.centre[2] - frame.z_m,
            spacing, parent.range_start, child.range_start, parent.alpha_start,
            level.alpha_spacing, child.alpha_start, plan.levels[child.level].alpha_spacing,
            cycles])
        width = level.segment + LANES
        groups = min(rows, self._groups)
        merge(source, child.shape, target, parent.shape, geometry, *self._pairs,
                    TAPS[plan.sampling.kernel] // 2, level.segment,
                    np.arange(width, dtype=np.float32), int(first),
                    *np.empty((5, groups * width), np.float32))

    def _add(self, node: Node, source: np.ndarray, image: np.ndarray) -> None:
        """Interpolate one of the last local images to the requested grid."""
        self._interpolate(node, source, self.report.plan.grid, image.reshape(-1).view(np.float32),
                          (*image.shape, 2 * image.shape[1], 2, 1), 0.0)

    def _interpolate(self, node: Node, source: np.ndarray, grid: MapGrid | PolarGrid,
                     target: np.ndarray, layout: tuple[int, ...], cycles_per_column: float
                     ) -> None:
        plan, frame = self.report.plan, self.report.plan.frame
        if isinstance(grid, MapGrid):
            pixels = [grid.x_m[0], grid.y_m[0], grid.spacing_m, -grid.spacing_m, *7 * [0.0]]
        else:
            pixels = [*grid.origin_m[:2], grid.height_m, *grid.track, *grid.across,
                      grid.range_start_m, grid.range_spacing_m, grid.alpha_start,
                      grid.alpha_spacing]
        x, y, z = frame.leave(node.centre)
        geometry = np.array([
            x, y, z - frame.z_m, *frame.track, node.range_start, plan.range_spacing_m,
            node.alpha_start, plan.levels[node.level].alpha_spacing, 2 / plan.radar.wavelength_m,
            cycles_per_column])
        size = min(layout[0], self._groups) * PIXELS
        add_to_grid(source, node.shape, geometry, np.array(pixels, float), np.array(layout),
                          *self._weights, TAPS[plan.sampling.kernel], target,
                          *np.empty((2, size)), np.empty(size, np.int64),
                          *np.empty((4, size), np.float32))


@dataclasses.dataclass(frozen=True)
class FfbpSampling:
    """How local images are sampled and read, and how well profiles are read to make them.

    Attributes
    ----------
    kernel : str
        A key of `TAPS`.
    oversampling : (float, float)
        Samples per reciprocal bandwidth along range and direction.
    first_stage_db : float
        Largest error of the first local images, dB.
    """

    kernel: str
    oversampling: tuple[float, float]
    first_stage_db: float = -75.0


@dataclasses.dataclass(frozen=True, eq=False)
class FfbpPlan(JudgedPlan):
    """How the image of an aperture is formed by FFBP.

    Attributes
    ----------
    grid : MapGrid or PolarGrid
        Where the pixels are.
    radar : RadarParameters
        Describes the compressed profiles.
    n_samples : int
        Samples of each profile.
    tx_m, rx_m : (P, C, 3) float64
        Phase centres that it is for, metres.
    sampling : FfbpSampling
        Kernel and spacing of the local images.
    frame : Frame
        Track direction and plane that all local grids share.
    levels : tuple of Level
        Sub-apertures and their grids, shortest first.
    top : tuple of Node
        Sub-apertures from which the image is made at last.
    resampling : RangeResampling
        How profiles are resampled; its spacing is the range spacing of all local grids.
    range_m : (float, float)
        Bounds of the half path over all first images, metres.
    errors_db : mapping of str to float
        Predicted error against time-domain correlation by cause, dB, of a scene that is evenly
        bright.
    warnings : tuple of str
        What makes the image worse than predicted.
    """

    grid: MapGrid | PolarGrid
    radar: RadarParameters
    n_samples: int
    tx_m: np.ndarray
    rx_m: np.ndarray
    sampling: FfbpSampling
    frame: Frame
    levels: tuple[Level, ...]
    top: tuple[Node, ...]
    resampling: RangeResampling
    range_m: tuple[float, float]
    errors_db: Mapping[str, float]
    warnings: tuple[str, ...]

    @property
    def range_spacing_m(self) -> float:
        """Range spacing of all local grids, metres."""
        return self.resampling.spacing

    def polar_grid(self, node: Node) -> PolarGrid:
        """Pixels of a sub-aperture's own image, in the imaging frame."""
        frame = self.frame
        return PolarGrid(frame.leave(node.centre), tuple(frame.track),
                         side_of(frame.track, frame.across), frame.z_m, node.range_start,
                         self.range_spacing_m, node.shape[1], node.alpha_start,
                         self.levels[node.level].alpha_spacing, node.shape[0])

    @property
    def operations(self) -> dict[str, float]:
        """How often the operations of `CostModel` are done."""
        taps, counts = TAPS[self.sampling.kernel], {'image': 1.0}
        n_echoes = self.tx_m.shape[0] * self.tx_m.shape[1]
        first = sum(_pixels(n) * (n.pulses.stop - n.pulses.start) for n in self.levels[0].nodes)
        counts |= self.resampling.operations(n_echoes, first / len(self.tx_m))
        merged, gathered = 0.0, len(self.top) * math.prod(self.grid.shape)
        for level in self.levels:
            read = sum(_pixels(n) * len(n.children) for n in level.nodes)
            if level.segment:
                merged += read * (1 + LANES / level.segment)
            else:
                gathered += read
        return counts | {'merged_pixel': merged, 'merged_tap': merged * taps,
                         'gathered_pixel': gathered, 'gathered_tap': gathered * taps}

    @property
    def seconds(self) -> float:
        """Predicted time on one thread."""
        return costs().seconds(self.operations)

    @property
    def n_bytes(self) -> int:
        """Memory that forming the image takes: itself, one per level, and some profiles, bytes."""
        resampling = self.resampling
        profiles = (min(ECHOES_PER_PASS, self.tx_m.shape[0] * self.tx_m.shape[1]) * 4
                    * resampling.interpolator.n_planes * resampling.n_phases * resampling.n_cells)
        return profiles + IMAGE_BYTES * (math.prod(self.grid.shape)
                                         + sum(level.size for level in self.levels))

    def __str__(self) -> str:
        counts = ', '.join(str(len(level.nodes)) for level in self.levels)
        along_range, along_alpha = self.sampling.oversampling
        return (f'local images of {counts} sub-apertures, kernel {self.sampling.kernel}, '
                f'oversampled {along_range:.2f} times along range and {along_alpha:.2f} along '
                'direction')


def _pixels(node: Node) -> int:
    return node.shape[0] * node.shape[1]


def plan_ffbp(grid: MapGrid | PolarGrid, radar: RadarParameters, n_samples: int, tx_m: ArrayLike,
              rx_m: ArrayLike, *, target_db: float = -60.0, pulses_per_subaperture: int = 16,
              merge_factor: int | None = None, kernel: str | None = None,
              range_oversampling: float | None = None, angle_oversampling: float | None = None
              ) -> FfbpPlan:
    """Plan the image of an aperture.

    Parameters
    ----------
    grid : MapGrid or PolarGrid
        Where the pixels are.
    radar : RadarParameters
        Describes the compressed profiles; a profile must be sampled at 1.25 times its bandwidth
        or more.
    n_samples : int
        Samples of each profile.
    tx_m, rx_m : (P, C, 3) array_like
        Transmit and receive phase centres of the aperture, metres.
    target_db : float
        Wanted error against time-domain correlation, dB. What is left out of `merge_factor` and
        the options behind it is what meets the target in the least time; where all of them are
        given, the error is what they make it.
    pulses_per_subaperture : int
        Pulses that the first stage backprojects together.
    merge_factor : int, optional
        Images that are merged at a time, 2 or more. Their number need not be a power of it.
    kernel : str, optional
        Interpolation kernel: 'linear', 'cubic' (four neighbours each way) or 'knab8' (eight,
        a sinc in Knab's window).
    range_oversampling, angle_oversampling : float, optional
        Samples per reciprocal bandwidth of the local images, above 1.25 along range and above 1
        along direction.

    Returns
    -------
    FfbpPlan

    Raises
    ------
    ValueError
        An option is out of its range, positions are malformed, the profiles are sampled too
        coarsely, the scene is too near or not on one side of the track, or the target is out of
        reach. Profiles that are too short for the scene raise the predicted error alone.
    """
    _check_aperture(grid, radar, tx_m, rx_m)
    _check_options(kernel, pulses_per_subaperture, merge_factor)
    given = [None if v is None else _checked(name, v, least) for name, v, least in (
        ('range', range_oversampling, 1.25), ('angle', angle_oversampling, 1.0))]

    def plan(geometry: FfbpGeometry, tones: LocalTones, sampling: FfbpSampling) -> FfbpPlan:
        return plan_from_geometry(grid, radar, n_samples, tx_m, rx_m, geometry, tones, sampling)

    def geometry_of(factor: int) -> tuple[FfbpGeometry, LocalTones]:
        geometry = ffbp_geometry(grid, radar, tx_m, rx_m, int(pulses_per_subaperture), factor)
        return geometry, local_tones(geometry, radar)

    if None not in (merge_factor, kernel, *given):
        return plan(*geometry_of(int(merge_factor)), FfbpSampling(kernel, tuple(given)))
    if not _LEAST_DB <= target_db <= _MOST_DB:
        raise ValueError(f'target_db={target_db}; expected {_LEAST_DB:g} to {_MOST_DB:g} dB')
    trees = [geometry_of(int(f)) for f in ((merge_factor,) if merge_factor else _MERGE_FACTORS)]
    kernels = (kernel,) if kernel else tuple(TAPS)
    return _quickest(plan, trees, kernels, given, grid, target_db)


def _quickest(plan: Callable[[FfbpGeometry, LocalTones, FfbpSampling], FfbpPlan],
              trees: list[tuple[FfbpGeometry, LocalTones]], kernels: tuple[str, ...],
              given: list[float | None], grid: MapGrid | PolarGrid, target_db: float) -> FfbpPlan:
    """Plan of the least cost that meets a target; plans are made until one does."""
    slack, reached = 0.0, math.inf
    for _ in range(_ROUNDS):
        found = [c for tree in trees for kernel in kernels
                 for c in _candidates(*tree, kernel, given, grid, target_db - slack)]
        within = [c for c in found if c.meets]
        best = min(within or found, key=lambda c: c.cost if within else c.error)
        planned = plan(*best.tree, best.sampling)
        error = total_db(*(e for cause, e in planned.errors_db.items() if cause != ENDS))
        excess, reached = error - target_db, min(reached, error)
        if excess <= 0:
            return planned
        if not within:
            break
        slack += excess + _SLACK_DB
    raise ValueError(f'FFBP reaches {reached:.1f} dB here, target_db={target_db:g} is out of its '
                     'reach: use more pulses_per_subaperture, AFBP or exact backprojection')


@dataclasses.dataclass(frozen=True, eq=False)
class _Candidate:
    tree: tuple[FfbpGeometry, LocalTones]
    sampling: FfbpSampling
    meets: bool
    cost: float  # about, nanoseconds
    error: float


def _candidates(geometry: FfbpGeometry, tones: LocalTones, kernel: str,
                given: list[float | None], grid: MapGrid | PolarGrid, target_db: float
                ) -> Iterator[_Candidate]:
    """The coarsest sampling along either axis with which a kernel errs by half of the target."""
    allowed, errors, chosen = 10 ** ((target_db - _HALF_DB) / 10), [], []
    for axis in (0, 1):
        def error(oversampling: float, axis: int = axis) -> float:
            spacings = ([geometry.range_spacing(oversampling)] * len(geometry.levels),
                        geometry.alpha_spacings(oversampling))
            return read_errors(tones, (axis,), kernel, (oversampling,) * 2, spacings,
                               [Segment()] * len(geometry.levels))[0]

        values = _OVERSAMPLINGS if given[axis] is None else (given[axis],)
        number = bisect.bisect_left(values, -allowed, key=lambda v, e=error: -e(v))
        chosen.append(float(values[min(number, len(values) - 1)]))
        errors.append(error(chosen[-1]))
    sampling = FfbpSampling(kernel, tuple(chosen),
                            min(_FIRST_STAGE_DB, target_db - _FIRST_SHARE_DB))
    yield _Candidate((geometry, tones), sampling, max(errors) <= allowed,
                     _cost(geometry, sampling, grid), sum(errors))


def _cost(geometry: FfbpGeometry, sampling: FfbpSampling, grid: MapGrid | PolarGrid) -> float:
    """About how long an image takes, nanoseconds."""
    taps, cost = TAPS[sampling.kernel], costs()
    offset = geometry.edge - geometry.levels[0][0].centre
    r = np.linalg.norm(offset, axis=-1)
    n_range = np.ptp(r) / geometry.range_spacing(sampling.oversampling[0]) + taps
    lines = [np.ptp(offset[:, 0] / r) / spacing + taps if spacing else 0.0
             for spacing in geometry.alpha_spacings(sampling.oversampling[1])]
    merges = sum(len(node.children) * n_lines
                 for nodes, n_lines in zip(geometry.levels, lines, strict=True) for node in nodes)
    return (n_range * (geometry.tx[..., 0].size * lines[0] * cost.line_pixel
                       + merges * (cost.merged_pixel + taps * cost.merged_tap))
            + len(geometry.top) * math.prod(grid.shape)
            * (cost.gathered_pixel + taps * cost.gathered_tap))


def _check_options(kernel: str | None, pulses_per_subaperture: int, merge_factor: int | None
                   ) -> None:
    if kernel is not None and kernel not in TAPS:
        raise ValueError(f'kernel={kernel!r}; expected one of {", ".join(TAPS)}')
    for name, value, least in (('pulses_per_subaperture', pulses_per_subaperture, 1),
                               ('merge_factor', merge_factor or 2, 2)):
        if value != int(value) or value < least:
            raise ValueError(f'{name}={value}; expected an integer of {least} or more')


def _check_aperture(grid: MapGrid | PolarGrid, radar: RadarParameters, tx: np.ndarray,
                    rx: np.ndarray) -> None:
    if not isinstance(grid, MapGrid | PolarGrid):
        raise ValueError(f'grid is a {type(grid).__name__}; FFBP images a MapGrid or a '
                         'PolarGrid: use exact backprojection')
    if radar.sample_rate_hz < 1.25 * radar.bandwidth_hz:
        raise ValueError(
            f'profiles sampled at {radar.sample_rate_hz:g} Hz for a bandwidth of '
            f'{radar.bandwidth_hz:g} Hz; sample them at 1.25 times the bandwidth or more '
            '(parameter oversampling of the range compression)')
    if tx.ndim != 3 or tx.shape[-1] != 3 or tx.shape != rx.shape or 0 in tx.shape:
        raise ValueError(f'tx_m.shape={tx.shape}, rx_m.shape={rx.shape}; expected the same '
                         '(pulses, channels, 3), at least one pulse')
    if not (np.isfinite(tx).all() and np.isfinite(rx).all()):
        raise ValueError('phase centres contain NaN or infinity; every pulse needs a finite '
                         'transmit and receive position')


def _checked(name: str, value: float, least: float) -> float:
    if not (value > least and math.isfinite(value)):
        raise ValueError(f'{name}_oversampling={value}; expected more than {least}')
    return float(value)


def plan_from_geometry(grid: MapGrid | PolarGrid, radar: RadarParameters, n_samples: int,
                       tx_m: np.ndarray, rx_m: np.ndarray, geometry: FfbpGeometry,
                       tones: LocalTones, sampling: FfbpSampling) -> FfbpPlan:
    """Plan with a given tree and sampling.

    Parameters
    ----------
    grid, radar, n_samples, tx_m, rx_m :
        As `FfbpPlan` has them.
    geometry : FfbpGeometry
        Tree and frame of the aperture.
    tones : LocalTones
        Local frequencies in this geometry.
    sampling : FfbpSampling
        Kernel and spacing of the local images.

    Raises
    ------
    ValueError
        The scene is too near, or no profile reaches it.
    """
    levels, frame, scene = geometry.levels, geometry.frame, geometry.scene
    resampling = plan_profiles(levels[0], frame, geometry.tx, geometry.rx, scene,
                               geometry.range_spacing(sampling.oversampling[0]), radar, n_samples,
                               sampling.first_stage_db)
    if resampling is None:
        raise ValueError('range does not follow the lines of the local polar grids closely '
                         f'enough: sub-apertures of {levels[0][0].pulses.stop} pulses are too '
                         'long for a scene this near; use fewer pulses_per_subaperture')
    alpha_spacings = geometry.alpha_spacings(sampling.oversampling[1])
    segments = [choose_segment(nodes, alpha_spacings, scene, resampling.spacing,
                               radar.wavelength_m) for nodes in levels]
    placed, top = place_grids(levels, geometry.top, alpha_spacings, [s.length for s in segments],
                              geometry.edge, geometry.edge_step, resampling.spacing,
                              TAPS[sampling.kernel])
    range_m = _reach(placed[0].nodes, geometry, resampling.spacing)
    check_reach(range_m, radar, n_samples)
    start, stop = covered_ranges(radar, n_samples)
    within = start <= range_m[0] and range_m[1] <= stop
    warnings = () if within else reach_warnings(some_pixels(grid), tx_m, rx_m, radar, n_samples)
    errors = _errors_db(geometry, radar, RangeGate.whole(radar, n_samples), tones, sampling,
                        resampling, alpha_spacings, segments,
                        may_err_db(grid, tx_m, rx_m, radar, _CHANCE_DB))
    return FfbpPlan(grid, radar, n_samples, tx_m.copy(), rx_m.copy(), sampling, frame, placed,
                    top, resampling, range_m, errors, warnings)


def _reach(nodes: Sequence[Node], geometry: FfbpGeometry, spacing: float) -> tuple[float, float]:
    """Bounds of the half path over all first images, metres."""
    first = [n.pulses.start for n in nodes]
    centres = np.repeat([n.centre for n in nodes], np.diff([*first, nodes[-1].pulses.stop]),
                        axis=0)[:, None]
    path = 0.5 * sum(np.linalg.norm(a - centres, axis=-1) for a in (geometry.tx, geometry.rx))
    away = np.maximum.reduceat(path.max(axis=1), first)
    start = np.array([n.range_start for n in nodes])
    stop = start + np.array([n.shape[1] for n in nodes]) * spacing
    return float((start - away).min()), float((stop + away).max())


def _errors_db(geometry: FfbpGeometry, radar: RadarParameters, window: RangeGate,
               tones: LocalTones, sampling: FfbpSampling, resampling: RangeResampling,
               alpha_spacings: list[float], segments: list[Segment], chance_db: float
               ) -> dict[str, float]:
    reading = reading_segments(geometry, segments)
    spacings = [resampling.spacing] * len(segments), alpha_spacings
    *each, both = read_errors(tones, (0, 1), sampling.kernel, sampling.oversampling, spacings,
                              reading)
    shares = both / max(sum(each), _LEAST)  # losses along the two add up in amplitude
    cycles = 2 * resampling.spacing / radar.wavelength_m
    echoes = np.linspace(0, geometry.tx[..., 0].size - 1, _ECHOES).round().astype(int)
    length = half_paths(*(a.reshape(-1, 3)[echoes] for a in (geometry.tx, geometry.rx)),
                        geometry.scene)[0]
    errors = {'sub-aperture images': resampling.predicted_error_db}
    errors |= {cause: 10 * math.log10(max(error, _LEAST)) for cause, error in (
        ('interpolated ranges', each[0] * shares), ('interpolated directions', each[1] * shares),
        ('expanded geometry', expansion_error(segments)),
        ('rounded places', rounding_error(segments, cycles)))}
    return with_chance(errors, chance_db) | {ENDS: window.mean_end_error_db(
        length, oversampling=resampling.oversampling(radar))}


def reading_segments(geometry: FfbpGeometry, segments: Sequence[Segment]) -> list[Segment]:
    """Segments by which the images of each level are read, from those that it is merged along."""
    found = [Segment()] * len(segments)
    for nodes, segment in zip(geometry.levels, segments, strict=True):
        for level in {child.level for node in nodes for child in node.children}:
            found[level] = segment
    return found


@dataclasses.dataclass(frozen=True, eq=False)
class LocalTones:
    """Local frequencies of some pulses at some pixels, in the images of every level.

    Attributes
    ----------
    slopes : (2, L, S, C, K) float64
        Derivatives of half paths from pulses and channels to positions, by range and direction.
    k, k_c : (F,) float64 and float
        Wavenumbers over the band and at the carrier, rad/m.
    known : (L, S) bool
        Whether a level has an image with the pulse in it.
    powers : (2, S, C, 1, F) float64
        Part of each in the power of an image of what all pulses see alike, and of noise; of sum 1.
    """

    slopes: np.ndarray
    k: np.ndarray
    k_c: float
    known: np.ndarray
    powers: np.ndarray

    def cycles(self, axis: int, level: int, spacing: float) -> np.ndarray:
        """(S, C, K, F) cycles per sample along range (0) or direction (1)."""
        cycles_of = spacing / (2 * np.pi)  # a radian per metre or direction cosine
        found = cycles_of * self.k * self.slopes[axis, level][..., None]
        return found if axis else found - cycles_of * self.k_c


def local_tones(geometry: FfbpGeometry, radar: RadarParameters) -> LocalTones:
    """Local frequencies of an aperture."""
    tx, rx, points = geometry.tx, geometry.rx, geometry.scene
    pulses, channels = (np.unique(np.linspace(0, n - 1, min(n, most)).round().astype(int))
                        for n, most in zip(tx.shape[:2], (_PULSES, _CHANNELS), strict=True))
    some = [a[np.ix_(pulses, channels)] for a in (tx, rx)]
    k_c = radar.wavenumber_rad_per_m
    k = k_c + radar.half_band_rad_per_m * _TONE
    origins, known = [], []
    for nodes in geometry.levels:
        starts, stops = (np.array([getattr(n.pulses, e) for n in nodes])
                         for e in ('start', 'stop'))
        number = np.maximum(np.searchsorted(starts, pulses, 'right') - 1, 0)
        known.append((starts[number] <= pulses) & (pulses < stops[number]))
        origins += [nodes[i].centre for i in number]
    slopes = local_slopes(np.array(origins), *(np.tile(a, (len(known), 1, 1)) for a in some),
                          points)
    powers = _powers(geometry, radar, pulses, channels)
    return LocalTones(slopes.reshape(2, *np.shape(known), *slopes.shape[2:]), k, k_c,
                      np.array(known), powers[..., None, None] * _BY_TONE / 2)


def _powers(geometry: FfbpGeometry, radar: RadarParameters, pulses: np.ndarray,
            channels: np.ndarray) -> np.ndarray:
    """(2, S, C) parts of some pulses, each with its neighbours, in the power of images."""
    scene = geometry.scene
    power = echo_power(geometry.tx.reshape(-1, 3), geometry.rx.reshape(-1, 3), scene[4],
                       (scene[5] - scene[3], scene[7] - scene[1]), radar)
    first = np.r_[0, (pulses[1:] + pulses[:-1] + 1) // 2]
    found = [np.add.reduceat(p.reshape(geometry.tx.shape[:2]), first)[:, channels]
             for p in (power, np.ones_like(power))]
    return np.array([power / power.sum() for power in found])


def read_errors(tones: LocalTones, axes: Sequence[int], kernel: str,
                oversampling: Sequence[float], spacings: Sequence[Sequence[float]],
                segments: Sequence[Segment]) -> list[float]:
    """Mean squared errors of all interpolations, relative to the power of the image.

    What a pulse contributes to a local image is a tone at every pixel: its local frequencies are
    the derivatives of its half path. Each interpolation multiplies the tone by a factor h that
    depends on its frequency and on the place between samples, with a mean of 1 - l and a variance
    v over the places. After all its interpolations the tone errs by

    ``E |H - 1|^2 = L^2 + (1 - L)^2 ((1 + s_range^2) (1 + s_direction^2) - 1)``

    with ``L = 1 - prod (1 - l)``.

    The losses l of all levels add up in amplitude, so that larger merge factors, which make fewer
    levels, err less. So do the spreads along range, where the places are nearly the same for all
    of a level: s is the sum of ``sqrt(v) / (1 - l)``. Along direction places differ from line to
    line and levels are independent: s^2 is the sum of ``v / (1 - l)^2``. Tones are weighed by
    their share in the power of the image.

    Parameters
    ----------
    tones : LocalTones
        Local frequencies of the aperture.
    axes : sequence of int
        Along which: 0 for range, 1 for direction.
    kernel : str
        Interpolation kernel.
    oversampling : (float, float)
        Along range and direction.
    spacings : two sequences of L floats
        Spacings of local grids along range, metres, and direction, by level.
    segments : sequence of L Segment
        By which the images of each level are read.

    Returns
    -------
    list of float
        Along each axis, and last along all of them together.
    """
    each = []
    for axis in axes:
        kept, spread = 1.0, 0.0
        for level, (known, segment) in enumerate(zip(tones.known, segments, strict=True)):
            loss, variance = mean_gain(kernel, oversampling[axis], segment.drift(axis),
                                       tones.cycles(axis, level, spacings[axis][level]))
            if not known.all():
                loss, variance = (known[:, None, None, None] * v for v in (loss, variance))
            gain = 1 - loss
            kept = kept * gain
            spread = spread + (variance / gain ** 2 if axis else np.sqrt(variance) / gain)
        each.append((kept, spread if axis else spread ** 2))
    if len(axes) > 1:
        (kept_range, range_spread), (kept_alpha, alpha_spread) = each
        each.append((kept_range * kept_alpha,
                     range_spread + alpha_spread + range_spread * alpha_spread))
    return [_mean_error(tones, *both) for both in each]


def _mean_error(tones: LocalTones, kept: np.ndarray, spread: np.ndarray) -> float:
    """Where the image is worst, of what pulses see alike or of noise."""
    error = (1 - kept) ** 2 + kept ** 2 * spread
    return float(np.einsum('scpf,wscpf->wp', error, np.broadcast_to(
        tones.powers, (2, *error.shape))).max())


def expansion_error(segments: Sequence[Segment]) -> float:
    """Mean squared error of phases expanded along segments, which grow as the fourth power."""
    return (2 * math.pi * sum(s.cycles for s in segments) / 3) ** 2


def rounding_error(segments: Sequence[Segment], cycles_per_pixel: float) -> float:
    """Mean squared error of phases from places between pixels that are rounded to float32."""
    merges = sum(bool(s.length) for s in segments)
    return merges * (2 * math.pi * cycles_per_pixel * 2.0 ** -24) ** 2


@dataclasses.dataclass(frozen=True, eq=False)
class FfbpGeometry:
    """An aperture in the frame of its local grids.

    Attributes
    ----------
    frame : Frame
        Track direction and plane.
    tx, rx : (P, C, 3) float64
        Phase centres in the frame, metres.
    edge : (E, 3) float64
        Outline of the scene in the frame, metres.
    edge_step : float
        Distance of its samples, metres.
    scene : (9, 3) float64
        Positions all over the scene in the frame, three by three, metres.
    levels : list of lists of Node
        Sub-apertures, without their grids, shortest first.
    top : list of Node
        Those from which the image is made at last.
    half_range : float
        Half the bandwidth of local images along range, rad/m.
    half_alpha : list of float
        Half the bandwidth along direction cosine by level, rad.
    widest : list of float
        Largest spacings of direction by level.
    """

    frame: Frame
    tx: np.ndarray
    rx: np.ndarray
    edge: np.ndarray
    edge_step: float
    scene: np.ndarray
    levels: list[list[Node]]
    top: list[Node]
    half_range: float
    half_alpha: list[float]
    widest: list[float]

    def range_spacing(self, oversampling: float) -> float:
        """Range spacing, metres, for samples per reciprocal bandwidth."""
        return _SLIGHTLY_FINER * math.pi / self.half_range / oversampling

    def alpha_spacings(self, oversampling: float) -> list[float]:
        """Spacing of direction cosines by level, for samples per reciprocal bandwidth."""
        return [min(math.pi / oversampling / max(half, 1.0), widest)
                for half, widest in zip(self.half_alpha, self.widest, strict=True)]


def ffbp_geometry(grid: MapGrid | PolarGrid, radar: RadarParameters, tx_m: np.ndarray,
                  rx_m: np.ndarray, pulses_per_subaperture: int, merge_factor: int
                  ) -> FfbpGeometry:
    """Geometry of an aperture.

    Raises
    ------
    ValueError
        The scene does not lie on one side of the track.
    """
    edge, scene, edge_step = outline_of(grid)
    centres = mean_centres(tx_m, rx_m)
    frame = find_frame(edge, centres, grid.z_m)
    tx, rx, centres, edge, scene = (frame.enter(a) for a in (tx_m, rx_m, centres, edge, scene))
    levels, top = build_tree(centres, pulses_per_subaperture, merge_factor)
    check_side(levels[0], edge)
    half_range, half_alpha = half_bands(levels, tx, rx, scene, radar)
    return FfbpGeometry(frame, tx, rx, edge, edge_step, scene, levels, top, max(half_range),
                        half_alpha, widest_spacings(levels, scene))


@dataclasses.dataclass(frozen=True, eq=False)
class Node:
    """A sub-aperture: its pulses, its parts and its image's grid.

    Attributes
    ----------
    pulses : slice
        Its pulses.
    level : int
        0 for the shortest ones.
    children : tuple of Node
        Parts from which its image is made; none at level 0.
    centre : (3,) float64
        Origin of its grid: along track, across track and up, metres.
    range_start, alpha_start : float
        First range, metres, and direction cosine.
    shape : (int, int)
        Directions and ranges.
    """

    pulses: slice
    level: int
    children: tuple[Node, ...]
    centre: np.ndarray
    range_start: float = 0.0
    alpha_start: float = 0.0
    shape: tuple[int, int] = (0, 0)


@dataclasses.dataclass(frozen=True, eq=False)
class Level:
    """What the sub-apertures of one length share.

    Each has a grid around its own centre (Zhang et al., figure 2a), sampled as finely along
    direction as its length asks for. It covers the requested grid and what the interpolation
    kernels of the levels above it reach beyond it.

    Attributes
    ----------
    nodes : tuple of Node
        The sub-apertures, in order.
    alpha_spacing : float
        Spacing of direction cosines.
    segment : int
        Pixels along which geometry is expanded when their images are made from their parts;
        0 where it must be computed for every pixel.
    """

    nodes: tuple[Node, ...]
    alpha_spacing: float
    segment: int

    @property
    def size(self) -> int:
        """Pixels of the largest image."""
        return max(n.shape[0] * n.shape[1] for n in self.nodes)


@dataclasses.dataclass(frozen=True, eq=False)
class Frame:
    """Common track direction and plane of all local grids.

    Attributes
    ----------
    track, across : (2,) float64
        Horizontal unit vectors along the track and from it into the scene.
    z_m : float
        Height of the plane, metres.
    """

    track: np.ndarray
    across: np.ndarray
    z_m: float

    def enter(self, points: np.ndarray) -> np.ndarray:
        """Positions (..., 3) as along track, across track and up."""
        points = np.asarray(points, float)
        return np.stack([points[..., :2] @ self.track, points[..., :2] @ self.across,
                         points[..., 2]], axis=-1)

    def leave(self, point: np.ndarray) -> tuple[float, float, float]:
        """A position along track, across track and up in the imaging frame."""
        x, y = point[0] * self.track + point[1] * self.across
        return float(x), float(y), float(point[2])


def find_frame(outline: np.ndarray, centres: np.ndarray, z_m: float) -> Frame:
    """Frame of an aperture and the scene that it looks at.

    Parameters
    ----------
    outline : (E, 3) float64
        Edge of the scene, metres.
    centres : (P, 3) float64
        Phase centres, metres.
    z_m : float
        Height of the plane, metres.
    """
    track, side = track_beside(centres, outline.mean(axis=0))
    return Frame(track, side * np.array([-track[1], track[0]]), z_m)


def build_tree(centres: np.ndarray, pulses_per_subaperture: int, merge_factor: int
               ) -> tuple[list[list[Node]], list[Node]]:
    """Sub-apertures of every level, and those from which the image is made at last.

    Groups are as even as can be; a group of one stays as it is, so that any number of
    sub-apertures will do. Origins lie in the middle of the phase centres.

    Parameters
    ----------
    centres : (P, 3) float64
        Phase centres in the frame, metres.
    pulses_per_subaperture, merge_factor : int
        Pulses of the shortest sub-apertures, and how many of them are merged at a time.

    Returns
    -------
    levels : list of lists of Node
        Shortest first.
    top : list of Node
        At most `merge_factor` sub-apertures that make up the whole aperture.
    """
    def made(starts: list[int], parts: list[tuple[Node, ...]]) -> list[Node]:
        """Sub-apertures, each up to where the next one starts."""
        middles = 0.5 * (np.minimum.reduceat(centres, starts)
                         + np.maximum.reduceat(centres, starts))
        return [some[0] if len(some) == 1 else Node(slice(start, stop), len(levels), some, middle)
                for start, stop, some, middle
                in zip(starts, [*starts[1:], len(centres)], parts, middles, strict=True)]

    levels, starts = [], list(range(0, len(centres), pulses_per_subaperture))
    top = made(starts, [()] * len(starts))
    levels.append(top)
    while len(top) > merge_factor:
        groups = -(-len(top) // merge_factor)
        edges = [len(top) * i // groups for i in range(groups + 1)]
        parts = [tuple(top[a:b]) for a, b in zip(edges[:-1], edges[1:], strict=True)]
        top = made([part[0].pulses.start for part in parts], parts)
        levels.append([n for n in top if n.level == len(levels)])
    return levels, top


def outline_of(grid: MapGrid | PolarGrid) -> tuple[np.ndarray, np.ndarray, float]:
    """Edge of a grid, positions all over it, and the distance between samples of the edge.

    Returns
    -------
    edge : (E, 3) float64
    scene : (9, 3) float64
    step : float
        Metres.
    """
    def place(a: np.ndarray, b: np.ndarray) -> np.ndarray:
        if isinstance(grid, MapGrid):
            x, y = (v[0] + s * (v[-1] - v[0]) for v, s in ((grid.x_m, a), (grid.y_m, b)))
            return np.stack([x, y, np.full(x.shape, grid.z_m)], axis=-1)
        return grid.lines(grid.range_start_m + a * (grid.n_range - 1) * grid.range_spacing_m,
                          grid.alpha_start + b * (grid.n_alpha - 1) * grid.alpha_spacing)[0]

    s = np.linspace(0.0, 1.0, _EDGE_SAMPLES)
    zero = np.zeros_like(s)
    edges = [place(s, zero), place(s, zero + 1), place(zero, s), place(zero + 1, s)]
    step = max(np.linalg.norm(np.diff(e, axis=0), axis=-1).max() for e in edges)
    a, b = (v.ravel() for v in np.meshgrid(*[np.linspace(0.0, 1.0, 3)] * 2))
    return np.concatenate(edges), place(a, b), float(step)


def check_side(nodes: list[Node], edge: np.ndarray) -> None:
    """Raise ValueError where a scene does not lie on one side of the track.

    Parameters
    ----------
    nodes : list of Node
        Sub-apertures with centres.
    edge : (E, 3) float64
        Outline of the scene in the frame, metres.
    """
    furthest, nearest = max(n.centre[1] for n in nodes), edge[:, 1].min()
    if nearest <= furthest:
        raise ValueError(f'the scene begins {nearest - furthest:.1f} m beside the track; fast '
                         'factorised backprojection needs it on one side; use exact '
                         'backprojection')


def widest_spacings(levels: list[list[Node]], points: np.ndarray) -> list[float]:
    """Spacings of directions by level that keep the margins of short sub-apertures near the scene.

    Parameters
    ----------
    levels : list of lists of Node
        Sub-apertures with centres.
    points : (K, 3) float64
        Positions all over the scene, in the frame, metres.
    """
    along, _, _, r = _offsets(_centres(levels), points)
    spread = np.maximum.reduceat(np.ptp(along / r, axis=1), _firsts(levels))
    return np.maximum(spread / 2, _NARROW).tolist()


def half_bands(levels: list[list[Node]], tx: np.ndarray, rx: np.ndarray, points: np.ndarray,
               radar: RadarParameters) -> tuple[list[float], list[float]]:
    """Half the bandwidth of local images along range (rad/m) and direction (rad) by level.

    They are the derivatives of the half path times the wavenumber, largest over the
    sub-apertures' pulses (their first and last among them) and over the scene.

    Parameters
    ----------
    levels, points :
        As for `widest_spacings`.
    tx, rx : (P, C, 3) float64
        Phase centres in the frame, metres.
    radar : RadarParameters
        Describes the profiles.
    """
    share = np.linspace(0.0, 1.0, _PULSES_PER_NODE)
    start, stop = (np.array([[getattr(n.pulses, e)] for nodes in levels for n in nodes])
                   for e in ('start', 'stop'))
    pulses = np.rint(start + share * (stop - 1 - start)).astype(int)
    slopes = local_slopes(_centres(levels),
                          *(a[pulses].reshape(len(pulses), -1, 3) for a in (tx, rx)), points)
    by_range, beside, by_alpha = (
        np.maximum.reduceat(np.abs(s).max(axis=(1, 2)), _firsts(levels))
        for s in (slopes[0], slopes[0] - 1, slopes[1]))
    band = radar.half_band_rad_per_m
    k = radar.wavenumber_rad_per_m + band
    return (_SAFETY * (band * by_range + k * beside)).tolist(), (_SAFETY * (k * by_alpha)).tolist()


def _centres(levels: list[list[Node]]) -> np.ndarray:
    """(N, 3) centres of all sub-apertures, level by level, metres."""
    return np.array([n.centre for nodes in levels for n in nodes])


def _firsts(levels: list[list[Node]]) -> np.ndarray:
    """(L,) number of the first sub-aperture of each level among them all."""
    return np.cumsum([0, *map(len, levels[:-1])])


def local_slopes(origins: np.ndarray, tx: np.ndarray, rx: np.ndarray, points: np.ndarray
                 ) -> np.ndarray:
    """Derivatives of half paths by range and direction from some origins.

    Parameters
    ----------
    origins : (N, 3) float64
        Origins of polar grids in the frame, metres.
    tx, rx : (N, R, 3) float64
        Phase centres that each of them is looked at with, metres.
    points : (K, 3) float64
        Positions on the ground, metres.

    Returns
    -------
    (2, N, R, K) float64
        By range, and by direction cosine, metres.
    """
    along, ground, _, r = _offsets(origins, points)
    alpha = along / r
    by_range = alpha, r * (1 - alpha ** 2) / ground
    by_alpha = r, -r ** 2 * alpha / ground
    slopes = 0.0
    for centres in (tx, rx):
        *ray, _, length = _offsets(centres, points)  # (N, R, K)
        u, v = (part / length for part in ray)
        slopes = slopes + 0.5 * np.array([u * a[:, None] + v * b[:, None]
                                          for a, b in (by_range, by_alpha)])
    return slopes


def _offsets(origins: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, ...]:
    """Along track, across and up from origins (..., 3) to points (K, 3), and distance, metres."""
    along, across, up = (points[:, axis] - origins[..., axis, None] for axis in range(3))
    return along, across, up, np.sqrt(along * along + across * across + up * up)


def plan_profiles(nodes: list[Node], frame: Frame, tx: np.ndarray, rx: np.ndarray,
                  points: np.ndarray, spacing: float, radar: RadarParameters, n_samples: int,
                  target_db: float) -> RangeResampling | None:
    """Range grid of the profiles for the first stage; its spacing is that of all local grids."""
    lengths, derivatives, span = [], [], 0.0
    for node in nodes[::max(1, len(nodes) // 8)]:
        offset = points - node.centre
        r = np.linalg.norm(offset, axis=-1)
        local = PolarGrid((0.0, 0.0, node.centre[2]), (1.0, 0.0), 1, frame.z_m,
                          abs(node.centre[2] - frame.z_m) + 1.0, 1.0, 1, 0.0, 1.0, 1)
        echoes = [a[node.pulses].reshape(-1, 3) - [*node.centre[:2], 0.0] for a in (tx, rx)]
        paths = sample_paths(*echoes, local.lines(r, offset[:, 0] / r))
        lengths.append(paths.length)
        derivatives.append(paths.derivatives)
        span = max(span, float(np.ptp(r)))
    joined = Paths(np.concatenate(lengths),
                   tuple(np.concatenate(d) for d in zip(*derivatives, strict=True)))
    return plan_resampling(joined, spacing, math.ceil(span / spacing) + LANES, radar, n_samples,
                        target_db, fit_spacing=True)


def place_grids(levels: list[list[Node]], top: list[Node], alpha_spacings: list[float],
                segments: list[int], edge: np.ndarray, edge_step: float, spacing: float, taps: int
                ) -> tuple[tuple[Level, ...], tuple[Node, ...]]:
    """Choose first range, direction and size of every local grid.

    Parameters
    ----------
    levels, top :
        The tree.
    alpha_spacings, segments : list of float and int
        Spacing of direction cosines and length of segments of each level.
    edge : (E, 3) float64
        Outline of the requested grid in the frame, metres.
    edge_step : float
        Distance of its samples, metres.
    spacing : float
        Range spacing, metres.
    taps : int
        Neighbours that the kernel reads.

    Returns
    -------
    levels : tuple of Level
    top : tuple of Node
    """
    beyond = taps // 2 + 1 + MARGIN
    more_range, more_alpha = 0.0, 0.0  # of the grids that read this level, beyond the scene
    offset = 0.0  # of their origins from those of their parts
    nearest = float(_offsets(_centres(levels[:1]), edge)[-1].min())
    grids: dict[Node, tuple[float, float, tuple[int, int]]] = {}
    for nodes, alpha_spacing in zip(reversed(levels), reversed(alpha_spacings), strict=True):
        more_range, more_alpha = (
            more_range + more_alpha * offset + beyond * spacing,
            more_alpha * (1 + offset / nearest) + more_range * offset / nearest ** 2
            + beyond * alpha_spacing)
        grids |= zip(nodes, _grids(nodes, edge, edge_step, (spacing, alpha_spacing),
                                   (more_range, more_alpha)), strict=True)
        away = [c.centre - n.centre for n in nodes for c in n.children]
        offset = float(np.linalg.norm(away, axis=-1).max()) if away else 0.0
    placed: dict[Node, Node] = {}
    for nodes in levels:  # parts before what is made of them
        for n in nodes:
            placed[n] = Node(n.pulses, n.level, tuple(placed[c] for c in n.children), n.centre,
                             *grids[n])
    return (tuple(Level(tuple(placed[n] for n in nodes), *shared) for nodes, *shared in
                  zip(levels, alpha_spacings, segments, strict=True)),
            tuple(placed[n] for n in top))


def _grids(nodes: list[Node], edge: np.ndarray, edge_step: float, spacings: tuple[float, float],
           more: tuple[float, float]) -> list[tuple[float, float, tuple[int, int]]]:
    """First range, direction and shape of the grids of a level.

    `spacings` and `more` are those of range and direction.
    """
    (spacing, alpha_spacing), (more_range, more_alpha) = spacings, more
    along, across, up, r = _offsets(_centres([nodes]), edge)
    alpha = along / r
    r_lo, alpha_lo, alpha_hi = r.min(axis=1), alpha.min(axis=1), alpha.max(axis=1)
    # between two samples of the edge
    more_range = more_range + edge_step ** 2 / r_lo
    more_alpha = more_alpha + 2 * edge_step ** 2 / r_lo ** 2
    range_start, alpha_start = r_lo - more_range, alpha_lo - more_alpha
    steepest = np.maximum(np.abs(alpha_start), alpha_hi + more_alpha)
    height = np.abs(up[:, 0])
    ground = range_start * np.sqrt(np.maximum(0.0, 1 - steepest ** 2))
    below = (across.min(axis=1) <= more_range) | (ground <= height + spacing)
    if below.any():
        i = int(below.argmax())
        raise ValueError(
            f'the scene begins {r_lo[i]:.1f} m from the sub-aperture of pulses '
            f'{nodes[i].pulses.start} to {nodes[i].pulses.stop - 1}, {height[i]:.1f} m above it, '
            f'at direction cosines {alpha_lo[i]:.3f} to {alpha_hi[i]:.3f}: its grid would reach '
            'the ground below the antenna or the track; move the grid away or use exact '
            'backprojection')
    shape = [(np.ceil((extent + 2 * more) / step) + 1).astype(int).tolist() for extent, more, step
             in ((alpha_hi - alpha_lo, more_alpha, alpha_spacing),
                 (np.ptp(r, axis=1), more_range, spacing))]
    return list(zip(range_start.tolist(), alpha_start.tolist(), zip(*shape, strict=True),
                    strict=True))


@dataclasses.dataclass(frozen=True)
class Segment:
    """How a level's images are merged from their parts.

    Attributes
    ----------
    length : int
        Pixels; 0 where geometry is computed for every pixel.
    drift_range, drift_alpha : float
        Root mean squares of how far the part's samples run from its pixels at the ends of a
        segment, samples.
    cycles : float
        Root mean square error of the carrier phase at the ends of a segment, cycles.
    """

    length: int = 0
    drift_range: float = 0.0
    drift_alpha: float = 0.0
    cycles: float = 0.0

    def drift(self, axis: int) -> float:
        """Along range (0) or direction (1), samples."""
        return (self.drift_range, self.drift_alpha)[axis]


def choose_segment(nodes: list[Node], alpha_spacings: list[float], points: np.ndarray,
                   spacing: float, wavelength_m: float) -> Segment:
    """Longest segment along which the expansions of a merge are exact enough.

    Parameters
    ----------
    nodes : list of Node
        Sub-apertures of one level.
    alpha_spacings : list of float
        Spacing of direction cosines of all levels.
    points : (K, 3) float64
        Positions all over the scene, in the frame, metres.
    spacing : float
        Range spacing, metres.
    wavelength_m : float
        At the carrier, metres.
    """
    if not any(n.children for n in nodes):
        return Segment()
    some = nodes[::max(1, len(nodes) // _SAMPLED_NODES)]
    pairs = [(n, c) for n in some for c in n.children]
    spacings = np.array([alpha_spacings[c.level] for _, c in pairs])[:, None]
    parent = np.array([n.centre for n, _ in pairs])[:, None]
    child = np.array([c.centre for _, c in pairs])[:, None]
    for length in _SEGMENTS:
        # the quartic term at the end of a segment, by the fourth difference over it
        fourth, *drifts = _drifts(points, parent, child, spacings, spacing, length)
        cycles = np.abs(fourth) * 16 / 24 * 2 / wavelength_m
        if cycles.max() <= _CUBIC_CYCLES and max(np.abs(d).max() for d in drifts) <= MARGIN:
            return Segment(length, *map(_rms, drifts), _rms(cycles))
    return Segment()


def _rms(values: np.ndarray) -> float:
    return math.sqrt(np.mean(np.square(values)))


def _drifts(points: np.ndarray, parent: np.ndarray, child: np.ndarray, alpha_spacing: np.ndarray,
            spacing: float, segment: int) -> tuple[np.ndarray, ...]:
    """Fourth difference of the child's range along a segment of the parent, metres, and drifts.

    The fourth difference over a segment is ``4! (half / 2)^4 / 24`` of the fourth derivative.
    Drifts are those of range and direction from the middle to the ends, samples.
    """
    half = segment / 2 * spacing
    offset = points - parent
    r = np.linalg.norm(offset, axis=-1)
    alpha, height = offset[..., 0] / r, offset[..., 2]

    def coordinates(f: float) -> tuple[np.ndarray, np.ndarray]:
        ground = np.sqrt(np.maximum((r + f) ** 2 * (1 - alpha ** 2) - height ** 2, 0.0))
        a, c = (r + f) * alpha, ground
        shift = parent - child
        rc = np.sqrt((a + shift[..., 0]) ** 2 + (c + shift[..., 1]) ** 2
                     + (height + shift[..., 2]) ** 2)
        return rc, (a + shift[..., 0]) / rc

    nodes = half * np.array([-1.0, -0.5, 0.0, 0.5, 1.0])
    ranges, alphas = zip(*(coordinates(f) for f in nodes), strict=True)
    fourth = ranges[0] - 4 * ranges[1] + 6 * ranges[2] - 4 * ranges[3] + ranges[4]
    along_range = np.array([ranges[0] + half, ranges[4] - half]) - ranges[2]
    along_alpha = np.array([alphas[0], alphas[4]]) - alphas[2]
    return (fourth, along_range / spacing,
            along_alpha / alpha_spacing * (1 + LANES / segment))


def kernel_weights(kernel: str, oversampling: float) -> np.ndarray:
    """Weights of an interpolation kernel as polynomials.

    Sample ``first + k``, first = 1 - taps / 2, has the weight ``sum_q w[k, q] x^q`` at the
    position ``x + 1/2`` between samples 0 and 1.

    Parameters
    ----------
    kernel : str
        A key of `TAPS`: 'linear', 'cubic' (Lagrange), or 'knab8', a sinc in Knab's window (IEEE
        Trans. Inf. Theory 25, 1979), whose polynomials are a fit to within 1e-5.
    oversampling : float
        Sample rate over two-sided bandwidth; sets the width of Knab's window.

    Returns
    -------
    (taps, 8) float32
    """
    taps = TAPS[kernel]
    first = 1 - taps // 2
    x = np.cos(np.pi * (np.arange(64) + 0.5) / 64) * (0.5 + MARGIN)
    distance = x[:, None] + 0.5 - (np.arange(taps) + first)
    if kernel == 'knab8':
        values = _knab(distance, taps / 2, oversampling)
    else:  # Lagrange's polynomials
        nodes = np.arange(taps) + first - 0.5
        values = np.stack([np.prod([(x - m) / (n - m) for m in nodes if m != n], axis=0)
                           for n in nodes], axis=-1)
    powers = x[:, None] ** np.arange(DEGREE + 1)
    weights = np.linalg.lstsq(powers, values, rcond=None)[0].T
    return np.ascontiguousarray(weights, np.float32)


def _knab(x: np.ndarray, half: float, oversampling: float) -> np.ndarray:
    """Sinc in the window of Knab, which continues smoothly beyond its ends."""
    v = math.pi * half * (1 - 1 / oversampling)
    root = np.sqrt((1 - (x / half) ** 2).astype(complex))
    return np.sinc(x) * (np.cosh(v * root) / np.cosh(v)).real


def mean_gain(kernel: str, oversampling: float, drift: float, frequency: ArrayLike
              ) -> tuple[np.ndarray, np.ndarray]:
    """What interpolation makes of a tone, over places that are evenly distributed.

    A tone of frequency f, read at x instead of where it is, gets the factor
    ``h(x) = sum_k w_k(x) exp(j 2 pi f (k - x))``.

    Parameters
    ----------
    kernel, oversampling :
        See `kernel_weights`.
    drift : float
        By how much places leave their interval at the ends of a segment, samples.
    frequency : (...) array_like
        Cycles per sample.

    Returns
    -------
    loss : (...) float64
        ``1 - E h``; it is real, because the weights are symmetric.
    variance : (...) float64
        ``E |h|^2 - (E h)^2``.
    """
    tables = _gain_tables(kernel, round(oversampling, 3), round(drift / _DRIFT_STEP) * _DRIFT_STEP)
    place = np.abs(frequency) * ((len(_FREQUENCIES) - 1) / _FREQUENCIES[-1])
    cell = place.astype(np.intp)
    part = place - cell
    return tuple(value.take(cell, mode='clip') + part * step.take(cell, mode='clip')
                 for value, step in tables)


@functools.lru_cache(maxsize=256)
def _gain_tables(kernel: str, oversampling: float, drift: float
                 ) -> list[tuple[np.ndarray, np.ndarray]]:
    """Loss and variance at frequencies, and their steps from there to the next."""
    place, by_place = np.polynomial.legendre.leggauss(_PLACES)
    along, by_along = np.polynomial.legendre.leggauss(_DRIFTS)
    x = np.add.outer(0.5 * place, drift * along).ravel()
    share = np.outer(by_place, by_along).ravel() / 4
    weights = kernel_weights(kernel, oversampling).astype(np.float64)
    values = weights @ x ** np.arange(DEGREE + 1)[:, None]
    away = np.arange(len(weights))[:, None] + 0.5 - len(weights) // 2 - x
    error = 1 - np.einsum('kx,fkx->fx', values, np.exp(
        2j * np.pi * _FREQUENCIES[:, None, None] * away))
    loss = error.real @ share
    variance = np.abs(error) ** 2 @ share - loss ** 2
    return [(v, np.diff(v, append=v[-1])) for v in (loss, variance)]


def paired(weights: np.ndarray) -> np.ndarray:
    """Weights (taps, 8) as `merge` reads them: even, then odd powers of one tap of each pair.

    The kernels are symmetric, so that tap k at x weighs what tap ``taps - 1 - k`` does at -x.
    """
    half = weights[:len(weights) // 2]
    return np.ascontiguousarray(np.concatenate([half[:, ::2], half[:, 1::2]], axis=1).reshape(-1))


@njit
def local_lines(geometry, n_alpha, segment, lines):
    """Lines of a local polar grid as `backends.cpu.lines.project_lines` wants them.

    Parameters
    ----------
    geometry : (12,) float64
        Origin x, y, z of the grid and height of its plane, metres; track x, y and its normal x,
        y; first range and spacing, metres; first direction cosine and spacing.
    n_alpha, segment : int
        Directions, and pixels of a segment.
    lines : (G, S, 15, LINES) float64
        Position in the middle of each segment and its first to fourth derivative by the pixel
        number, metres.
    """
    ux, uy, vx, vy = geometry[4], geometry[5], geometry[6], geometry[7]
    step = geometry[9]
    height = geometry[2] - geometry[3]
    for group in range(lines.shape[0]):
        for number in range(lines.shape[1]):
            r = geometry[8] + (number * segment + segment // 2) * step
            for j in range(LINES):
                alpha = geometry[10] + min(group * LINES + j, n_alpha - 1) * geometry[11]
                squeeze = 1 - alpha * alpha
                ground = np.sqrt(max(r * r * squeeze - height * height, 1e-12))
                g1 = r * squeeze / ground
                g2 = (squeeze - g1 * g1) / ground
                g3 = -3 * g1 * g2 / ground
                g4 = -(4 * g1 * g3 + 3 * g2 * g2) / ground
                lines[group, number, 0, j] = geometry[0] + r * alpha * ux + ground * vx
                lines[group, number, 1, j] = geometry[1] + r * alpha * uy + ground * vy
                lines[group, number, 2, j] = geometry[3]
                lines[group, number, 3, j] = (alpha * ux + g1 * vx) * step
                lines[group, number, 4, j] = (alpha * uy + g1 * vy) * step
                lines[group, number, 5, j] = 0.0
                lines[group, number, 6, j] = g2 * vx * step * step
                lines[group, number, 7, j] = g2 * vy * step * step
                lines[group, number, 8, j] = 0.0
                lines[group, number, 9, j] = g3 * vx * step * step * step
                lines[group, number, 10, j] = g3 * vy * step * step * step
                lines[group, number, 11, j] = 0.0
                lines[group, number, 12, j] = g4 * vx * step ** 4
                lines[group, number, 13, j] = g4 * vy * step ** 4
                lines[group, number, 14, j] = 0.0


@njit(parallel=True)
def merge(child, child_shape, parent, parent_shape, geometry, weights_range, weights_alpha, pairs,
          segment, index, start, place, line_re, line_im, out_re, out_im):
    """Interpolate a local image to the polar grid of a longer sub-aperture.

    Both grids have the same range spacing and plane, so that a segment of a line of the parent
    follows a line of the child: the neighbours are loaded contiguously, first along direction
    for all ranges that the segment reads, then along range.

    Parameters
    ----------
    child, parent : (2 * n_alpha * n_range + PADDING,) float32
        Images; the child must cover the parent and the kernel.
    child_shape, parent_shape : (int, int)
        Their n_alpha, n_range.
    geometry : (12,) float64
        Origin of the child from the parent's along and across track; heights of the parent's and
        the child's origin above the plane, metres; range spacing, the parent's and the child's
        first range, metres; the parent's first direction cosine and spacing; the child's.
        Cycles of carrier phase per range pixel come last.
    weights_range, weights_alpha : (pairs * 8,) float32
        From `paired`.
    pairs : int
        Pairs of taps.
    segment : int
        Pixels along which the geometry is expanded, a multiple of `LANES`.
    index : (segment + LANES,) float32
        Numbers 0, 1, 2, ...
    start : int
        1 to overwrite the parent, 0 to add to it.
    place, line_re, line_im, out_re, out_im : (groups * (segment + LANES),) float32
        Work space for each of the groups into which lines are divided among threads. Separate
        arrays, because the compiler knows that these do not overlap.
    """
    for group in numba.prange(len(place) // (segment + LANES)):
        _merge_lines(np.int64(group), child, child_shape, parent, parent_shape, geometry,
                     (weights_range, weights_alpha), pairs, segment, index, start,
                     (place, line_re, line_im, out_re, out_im))


@kernel_part(distinct=True)
def _merge_lines(group, child, child_shape, parent, parent_shape, geometry, weights, pairs,
                 segment, index, start, work):
    """Lines of one group; `weights` are along range and direction, the rest is as of `merge`."""
    weights_range, weights_alpha = weights
    place, line_re, line_im, out_re, out_im = work
    n_lines, n = parent_shape
    child_lines, child_n = child_shape
    du, dv, height_p, height_c = geometry[0], geometry[1], geometry[2], geometry[3]
    step, range_p, range_c = geometry[4], geometry[5], geometry[6]
    cycles_per_pixel = geometry[11]
    cycles_per_place = np.float32(cycles_per_pixel)
    child_size, parent_size = child_lines * child_n, n_lines * n
    width = segment + LANES
    n_groups = len(place) // width
    half, first = segment // 2, 1 - pairs
    one, centre = np.uint64(1), np.float32(0.5)
    at = np.uint64(group * width)
    for line in range(group * n_lines // n_groups, (group + 1) * n_lines // n_groups):
        alpha = geometry[7] + line * geometry[8]
        squeeze = 1.0 - alpha * alpha
        for begin in range(0, n, segment):
            # The child's coordinates in the middle of the segment, and their derivatives
            # by the parent's range
            r = range_p + (begin + half) * step
            ground = np.sqrt(r * r * squeeze - height_p * height_p)
            g1 = r * squeeze / ground
            g2 = (squeeze - g1 * g1) / ground
            g3 = -3.0 * g1 * g2 / ground
            a, c = r * alpha - du, ground - dv
            rc = np.sqrt(a * a + c * c + height_c * height_c)
            inverse = 1.0 / rc
            r1 = (a * alpha + c * g1) * inverse
            r2 = (alpha * alpha + g1 * g1 + c * g2 - r1 * r1) * inverse
            r3 = (3.0 * g1 * g2 + c * g3 - 3.0 * r1 * r2) * inverse
            ac = a * inverse
            a1 = (alpha - ac * r1) * inverse
            a2 = -(2.0 * a1 * r1 + ac * r2) * inverse
            # in pixels
            v = (rc - range_c) / step
            node = np.floor(v)
            u = (ac - geometry[9]) / geometry[10]
            row = np.floor(u)
            t0, t1 = np.float32(v - node), np.float32(r1 - 1.0)
            t2, t3 = np.float32(0.5 * r2 * step), np.float32(r3 * step * step / 6.0)
            scale = step / geometry[10] / r1
            u0, u1 = np.float32(u - row - 0.5), np.float32(a1 * scale)
            u2 = np.float32(0.5 * a2 * scale * step / r1)
            phase = np.float32(fraction(cycles_per_pixel * (node - begin - half)))
            count = np.uint64((min(segment, n - begin) + LANES - 1) // LANES * LANES)
            reach = count + np.uint64(LANES)
            low = np.int64(row) + first
            low = min(max(low, 0), child_lines - 2 * pairs)
            from_ = low * child_n + np.int64(node) - half + first
            from_ = min(max(from_, 0), (child_lines - 2 * pairs + 1) * child_n)
            source, row_step = np.uint64(from_), np.uint64(child_n)
            behind = np.float32(first - half) - t0
            for i in range(reach):
                f = index[i] + behind
                place[at + i] = u0 + f * (u1 + f * u2)
            source_im = source + np.uint64(child_size)
            if pairs == 4:
                _weigh(child, source, child, source_im, row_step, weights_alpha, np.uint64(4),
                       place, at, reach, line_re, line_im)
            elif pairs == 2:
                _weigh(child, source, child, source_im, row_step, weights_alpha, np.uint64(2),
                       place, at, reach, line_re, line_im)
            else:
                _weigh(child, source, child, source_im, row_step, weights_alpha, np.uint64(1),
                       place, at, reach, line_re, line_im)
            for i in range(count):
                f = index[i] - np.float32(half)
                place[at + i] = t0 + f * (t1 + f * (t2 + f * t3)) - centre
            if pairs == 4:
                _weigh(line_re, at, line_im, at, one, weights_range, np.uint64(4),
                       place, at, count, out_re, out_im)
            elif pairs == 2:
                _weigh(line_re, at, line_im, at, one, weights_range, np.uint64(2),
                       place, at, count, out_re, out_im)
            else:
                _weigh(line_re, at, line_im, at, one, weights_range, np.uint64(1),
                       place, at, count, out_re, out_im)
            pixel = np.uint64(line * n + begin)
            pixel_im = pixel + np.uint64(parent_size)
            for i in range(count):
                cycles = fraction(cycles_per_place * (place[at + i] + centre) + phase)
                square = cycles * cycles
                sine, cosine = sin_cycles(cycles, square), cos_cycles(square)
                re, im = out_re[at + i], out_im[at + i]
                out_re[at + i] = re * cosine - im * sine
                out_im[at + i] = re * sine + im * cosine
            inside = np.uint64(min(segment, n - begin))
            if start == 1:
                for i in range(inside):
                    parent[pixel + i] = out_re[at + i]
                    parent[pixel_im + i] = out_im[at + i]
            else:
                for i in range(inside):
                    parent[pixel + i] += out_re[at + i]
                    parent[pixel_im + i] += out_im[at + i]


@njit(inline='always')
def _weigh(real, at_re, imag, at_im, step, weights, pairs, places, at, count, out_re, out_im):
    """Weighted sums of neighbours `step` apart; a constant number of pairs unrolls the loop."""
    for i in range(count):
        x = places[at + i]
        xx = x * x
        re, im = np.float32(0.0), np.float32(0.0)
        for k in range(pairs):
            w = np.uint64(8) * k
            even = weights[w] + xx * (weights[w + np.uint64(1)] + xx * (
                weights[w + np.uint64(2)] + xx * weights[w + np.uint64(3)]))
            odd = x * (weights[w + np.uint64(4)] + xx * (weights[w + np.uint64(5)] + xx * (
                weights[w + np.uint64(6)] + xx * weights[w + np.uint64(7)])))
            near = k * step + i
            far = (pairs + pairs - np.uint64(1) - k) * step + i
            sum_re = real[at_re + near] + real[at_re + far]
            sum_im = imag[at_im + near] + imag[at_im + far]
            re += even * sum_re + odd * (real[at_re + near] - real[at_re + far])
            im += even * sum_im + odd * (imag[at_im + near] - imag[at_im + far])
        out_re[at + i] = re
        out_im[at + i] = im


@njit(parallel=True)
def add_to_grid(local, shape, geometry, grid, layout, weights_range, weights_alpha, taps,
                image, x, y, place, along_range, along_alpha, cosine, sine):
    """Interpolate a local image to the pixels of any map or polar grid and add it.

    The value of each pixel is a weighted sum of taps x taps neighbours, for which the carrier
    ``exp(+j 4 pi (r - r_0) / lambda)`` is put back.

    Parameters
    ----------
    local : (2 * n_alpha * n_range + PADDING,) float32
        Image at range baseband.
    shape : (int, int)
        Its n_alpha, n_range.
    geometry : (11,) float64
        Local grid: origin x, y, metres, and its height above the plane; track x, y; first
        range and spacing, metres; first direction cosine and spacing; cycles per metre of range.
        Last come the cycles per column that the image leaves out: 0, or for an image at range
        baseband the cycles per pixel.
    grid : (11,) float64
        Pixels of the image. Map: x and y of the first pixel, step of x by column and of y by row,
        metres, and zeros. Polar: origin x, y and its height above the plane, track x, y, its
        normal x, y, first range and spacing, first direction cosine and spacing.
    layout : (5,) int64
        Rows and columns of the image; steps of the index in `image` from row to row, from column
        to column, and from a real part to its imaginary part.
    weights_range, weights_alpha : (8 * taps,) float32
        `kernel_weights`, transposed.
    taps : int
        2, 4 or 8.
    image : (N,) float32
        Real and imaginary parts to add to.
    x, y : (groups * PIXELS,) float64
        Work space for each of the groups into which rows are divided among threads.
    place : (groups * PIXELS,) int64
        Work space.
    along_range, along_alpha, cosine, sine : (groups * PIXELS,) float32
        Work space.
    """
    n_alpha, n_range = shape
    rows, columns = layout[0], layout[1]
    column_step, imag_step = np.uint64(layout[3]), np.uint64(layout[4])
    first = 1 - taps // 2
    imag = n_alpha * n_range
    ox, oy, height = geometry[0], geometry[1], geometry[2]
    ux, uy = geometry[3], geometry[4]
    per_range, per_alpha = 1.0 / geometry[6], 1.0 / geometry[8]
    n_groups = len(x) // PIXELS
    for group in numba.prange(n_groups):
        at = np.uint64(group * PIXELS)
        for row in range(group * rows // n_groups, (group + 1) * rows // n_groups):
            for begin in range(0, columns, PIXELS):
                count = np.uint64(min(PIXELS, columns - begin))
                if grid[10] == 0.0:  # of a map; the compiler may read all of it either way
                    for i in range(count):
                        x[at + i] = grid[0] + (begin + np.float64(i)) * grid[2] - ox
                        y[at + i] = grid[1] + row * grid[3] - oy
                else:
                    alpha = grid[9] + row * grid[10]
                    for i in range(count):
                        r = grid[7] + (begin + np.float64(i)) * grid[8]
                        ground = np.sqrt(r * r * (1.0 - alpha * alpha) - grid[2] * grid[2])
                        x[at + i] = grid[0] + r * alpha * grid[3] + ground * grid[5] - ox
                        y[at + i] = grid[1] + r * alpha * grid[4] + ground * grid[6] - oy
                for i in range(count):
                    r = np.sqrt(x[at + i] * x[at + i] + y[at + i] * y[at + i] + height * height)
                    v = (r - geometry[5]) * per_range
                    u = ((x[at + i] * ux + y[at + i] * uy) / r - geometry[7]) * per_alpha
                    node = min(max(np.floor(v), -1.0 * first), n_range - taps - 1.0 * first)
                    line = min(max(np.floor(u), -1.0 * first), n_alpha - taps - 1.0 * first)
                    along_range[at + i] = v - node - 0.5
                    along_alpha[at + i] = u - line - 0.5
                    place[at + i] = np.int64((line + first) * n_range + node + first)
                    cycles = np.float32(fraction(geometry[9] * (r - geometry[5])
                                                  - geometry[10] * (begin + np.float64(i))))
                    sine[at + i] = sin_cycles(cycles, cycles * cycles)
                    cosine[at + i] = cos_cycles(cycles * cycles)
                pixel = np.uint64(row * layout[2] + begin * layout[3])
                for i in range(count):
                    if taps == 8:
                        re, im = interpolate8(local, place[at + i], n_range, imag, weights_range,
                                              weights_alpha, along_range[at + i],
                                              along_alpha[at + i])
                    elif taps == 4:
                        re, im = interpolate4(local, place[at + i], n_range, imag, weights_range,
                                              weights_alpha, along_range[at + i],
                                              along_alpha[at + i])
                    else:
                        re, im = interpolate2(local, place[at + i], n_range, imag, weights_range,
                                              weights_alpha, along_range[at + i],
                                              along_alpha[at + i])
                    c, s = cosine[at + i], sine[at + i]
                    to = pixel + i * column_step
                    image[to] += re * c - im * s
                    image[to + imag_step] += re * s + im * c


def _make(taps: int) -> Any:
    kind = ir.VectorType(_FLOAT, taps)

    @intrinsic
    def interpolate(typing_context, image, place, line_step, imag, table_range, table_alpha,
                    x_range, x_alpha):
        def generate(context, builder, signature, arguments):
            def data(number):
                array = context.make_array(signature.args[number])
                return array(context, builder, arguments[number]).data

            def load(base, position):
                pointer = builder.bitcast(builder.gep(base, [position]), kind.as_pointer())
                values = builder.load(pointer)
                values.align = 4
                return values

            def add_product(a, b, c):
                return builder.fadd(builder.fmul(a, b, flags=_FAST), c, flags=_FAST)

            def splat(value):
                vector = builder.insert_element(ir.Constant(kind, ir.Undefined), value,
                                                _number(0))
                return builder.shuffle_vector(vector, vector, _lanes([0] * taps))

            def weights(table, x):
                x = splat(x)
                total = load(table, ir.Constant(ir.IntType(64), DEGREE * taps))
                for power in reversed(range(DEGREE)):
                    total = add_product(
                        total, x, load(table, ir.Constant(ir.IntType(64), power * taps)))
                return total

            def total(vector, width):
                while width > 1:
                    width //= 2
                    parts = [builder.shuffle_vector(vector, vector, _lanes(list(lanes)))
                             for lanes in (range(width), range(width, 2 * width))]
                    vector = builder.fadd(*parts, flags=_FAST)
                return builder.extract_element(vector, _number(0))

            along_range = weights(data(4), arguments[6])
            along_alpha = weights(data(5), arguments[7])
            each = [builder.shuffle_vector(along_alpha, along_alpha, _lanes([k] * taps))
                    for k in range(taps)]
            base, sums = data(0), []
            for part in (arguments[1], builder.add(arguments[1], arguments[3])):
                lines, where = ir.Constant(kind, [0.0] * taps), part
                for weight in each:
                    lines = add_product(weight, load(base, where), lines)
                    where = builder.add(where, arguments[2])
                sums.append(total(builder.fmul(lines, along_range, flags=_FAST), taps))
            return cgutils.pack_array(builder, sums)

        whole = types.int64
        return (types.UniTuple(types.float32, 2)(
            image, whole, whole, whole, table_range, table_alpha, types.float32, types.float32),
            generate)

    interpolate.__doc__ = f"""Real and imaginary part between {taps} x {taps} neighbours.

    Parameters
    ----------
    image : (N,) float32
        Real, then imaginary parts.
    place : int64
        First neighbour; not checked against the size of the image.
    line_step, imag : int64
        From line to line, and from a real part to its imaginary part.
    table_range, table_alpha : ({(DEGREE + 1) * taps},) float32
        Coefficients of the weights of all neighbours, by ascending power.
    x_range, x_alpha : float32
        Where to evaluate them.
    """
    return interpolate


def _number(value: int) -> ir.Constant:
    return ir.Constant(ir.IntType(32), value)


def _lanes(lanes: list[int]) -> ir.Constant:
    return ir.Constant(ir.VectorType(ir.IntType(32), len(lanes)), lanes)


interpolate2, interpolate4, interpolate8 = (_make(taps) for taps in (2, 4, 8))
