"""Fast factorised backprojection (FFBP): the imager that AFBP is compared with.

Ulander, Hellsten & Stenström, IEEE Trans. AES 39, 2003; Zhang et al., section II.A and figure 2a.
Short sub-apertures are backprojected onto coarse polar grids around their own centres. Images of
neighbouring sub-apertures are then interpolated in two dimensions to a finer grid around their
common centre and summed, again and again, and at last to the requested grid.
"""

from __future__ import annotations

import logging
import math

import numba
import numpy as np
from tqdm import tqdm

from ..backends.cpu.baselines import ffbp_kernels as loops
from ..backends.cpu.line_kernels import LINES
from ..backends.cpu.lines import add_to_lines
from ..backends.cpu.profiles import Profiles
from ..geometry.grids import MapGrid
from ..geometry.polar import PolarGrid
from ..geometry.track_frame import mean_centres
from ..planning.baselines.ffbp import (
    Node,
    build_tree,
    check_side,
    choose_segments,
    find_frame,
    half_bands,
    outline_of,
    place_centres,
    place_grids,
    plan_profiles,
    widest_spacing,
)
from ..planning.profiles.profile_reach import check_reach, reach_warning, some_pixels
from ..planning.profiles.range_gate import RangeGate
from ..signal.pulses import PulseBlock, check_profiles
from ..signal.radar import RadarParameters

_logger = logging.getLogger(__name__)

#: Default samples per reciprocal bandwidth along range and along direction.
OVERSAMPLING = {'linear': 4.0, 'cubic': 2.5, 'knab8': 1.8}
_FIRST_STAGE_DB = -75.0
_GROUPS_PER_THREAD = 16  # of lines: evens out the load


class FfbpImager:
    """Fast factorised backprojection of one aperture.

    Positions are float64 throughout, the two-way path of every channel is exact in the first
    stage, and carrier phases are reduced to a fraction of a cycle before they become float32.
    Images are made depth first, so that one image per level is in memory.

    The error against time-domain correlation is that of the interpolations, one along range and
    one along direction per level, whose amplitudes add up: a merge factor of 4 halves the levels
    and gains 5 to 6 dB. It is not predicted, because it depends on how the scene fills the
    bands. Measured with sub-apertures of 16 pulses, 10 GHz, 600 MHz, eight scatterers and 192 x
    192 pixels, resolution about the same in range and azimuth, in dB with merge factor 2 (4):

    ==========================  =============  =============  =============
    aperture                    knab8          cubic          linear
    ==========================  =============  =============  =============
    256 pulses at 1 km          -54 (-61)      -26 (-31)      -18 (-23)
    1024 pulses at 10 km        -50 (-56)      -22 (-28)      -15 (-20)
    ==========================  =============  =============  =============

    Parameters
    ----------
    grid : MapGrid or PolarGrid
        Where the pixels are.
    radar : RadarParameters
        Of the compressed profiles; a profile must be sampled at 1.25 times its bandwidth or more.
    n_samples : int
        Samples of each profile.
    tx_m, rx_m : (P, C, 3) array_like
        Transmit and receive phase centres of the aperture, metres.
    pulses_per_subaperture : int
        Pulses that the first stage backprojects together.
    merge_factor : int
        Images that are merged at a time, 2 or more. Their number need not be a power of it.
    kernel : str
        Interpolation kernel: 'linear', 'cubic' (four neighbours each way) or 'knab8' (eight,
        a sinc in Knab's window).
    range_oversampling, angle_oversampling : float, optional
        Samples per reciprocal bandwidth of the local images, above 1.25 along range and above 1
        along direction; default `OVERSAMPLING` of the kernel.
    progress : bool
        Show a progress bar on standard error.

    Attributes
    ----------
    levels : list of Level
        Sub-apertures and their grids, shortest first.
    range_spacing_m : float
        Range spacing of all local grids, metres.
    warnings : tuple of str
        What makes the image worse than the profiles could.

    Raises
    ------
    ValueError
        An option is out of its range, positions are malformed, the profiles are sampled too
        coarsely, or the scene is too near or not on one side of the track.

    Examples
    --------
    >>> plan = FfbpImager(grid, profiles.radar, profiles.n_samples, profiles.tx_m,
    ...                   profiles.rx_m, merge_factor=4)                  # doctest: +SKIP
    >>> image = plan(profiles)                                            # doctest: +SKIP
    """

    def __init__(self, grid: MapGrid | PolarGrid, radar: RadarParameters, n_samples: int,
                 tx_m, rx_m, *, pulses_per_subaperture: int = 16, merge_factor: int = 2,
                 kernel: str = 'knab8', range_oversampling: float | None = None,
                 angle_oversampling: float | None = None, progress: bool = False):
        if not isinstance(grid, MapGrid | PolarGrid):
            raise ValueError(f'grid is a {type(grid).__name__}; FFBP images a MapGrid or a '
                             'PolarGrid: use exact backprojection')
        self.grid, self.radar, self.n_samples = grid, radar, int(n_samples)
        self.kernel, self._progress = kernel, progress
        self._tx, self._rx = (np.asarray(a, np.float64) for a in (tx_m, rx_m))
        _check_options(kernel, pulses_per_subaperture, merge_factor)
        _check_aperture(radar, self._tx, self._rx)
        default = OVERSAMPLING[kernel]
        self.range_oversampling = _oversampling('range', range_oversampling, default, 1.25)
        self.angle_oversampling = _oversampling('angle', angle_oversampling, default, 1.0)
        self.levels, self._top = build_tree(len(self._tx), pulses_per_subaperture, merge_factor)
        self._plan_grids()
        warning = reach_warning(some_pixels(grid), self._tx.reshape(-1, 3),
                                self._rx.reshape(-1, 3), radar, self.n_samples)
        self.warnings = () if warning is None else (warning,)
        for text in self.warnings:
            _logger.warning(text)
        along = [loops.kernel_weights(kernel, v)
                 for v in (self.range_oversampling, self.angle_oversampling)]
        self._pairs = [loops.paired(w) for w in along]
        self._weights = [w.T.ravel() for w in along]

    def _plan_grids(self):
        radar = self.radar
        edge, inside, edge_step = outline_of(self.grid)
        centres = mean_centres(self._tx, self._rx)
        frame = find_frame(edge, centres, self.grid.z_m)
        tx, rx, centres, edge, inside = (
            frame.enter(a) for a in (self._tx, self._rx, centres, edge, inside))
        place_centres(self.levels, centres)
        self._frame = frame
        check_side(self.levels[0].nodes, edge)
        half_range = 0.0
        for level in self.levels:
            if not level.nodes:
                continue
            along_range, along_alpha = half_bands(level.nodes, tx, rx, inside, radar)
            half_range = max(half_range, along_range)
            level.alpha_spacing = min(math.pi / self.angle_oversampling / max(along_alpha, 1.0),
                                      widest_spacing(level.nodes, inside))
        lattice = plan_profiles(self.levels[0].nodes, frame, tx, rx, inside,
                                0.999 * math.pi / half_range / self.range_oversampling, radar,
                                self.n_samples, _FIRST_STAGE_DB)
        if lattice is None:
            raise ValueError('range does not follow the lines of the local polar grids closely '
                             'enough: sub-apertures of '
                             f'{self.levels[0].nodes[0].pulses.stop} pulses are too long for a '
                             'scene this near; use fewer pulses_per_subaperture')
        self.range_spacing_m = lattice.spacing
        place_grids(self.levels, self._top, edge, edge_step, lattice.spacing,
                    loops.TAPS[self.kernel])
        choose_segments(self.levels, inside, lattice.spacing, radar.wavelength_m)
        self._profiles = Profiles(RangeGate.whole(radar, self.n_samples), lattice,
                                  self._reach(tx, rx, lattice.spacing))
        longest = max(n.shape[1] for n in self.levels[0].nodes)
        cycles = 2 * (lattice.cell_m - lattice.spacing) / radar.wavelength_m
        self._ramp = np.exp(2j * np.pi * np.fmod(cycles * np.arange(longest), 1.0)
                            ).astype(np.complex64)

    def _reach(self, tx, rx, spacing) -> tuple[float, float]:
        """Bounds of the half path over all first images, metres."""
        lo, hi = math.inf, -math.inf
        for node in self.levels[0].nodes:
            rows = np.stack([tx[node.pulses], rx[node.pulses]])
            away = float(np.linalg.norm(rows - node.centre, axis=-1).mean(axis=0).max())
            lo = min(lo, node.range_start - away)
            hi = max(hi, node.range_start + node.shape[1] * spacing + away)
        check_reach((lo, hi), self.radar, self.n_samples)
        return lo, hi

    def __call__(self, block: PulseBlock) -> np.ndarray:
        """Image of the aperture.

        Parameters
        ----------
        block : PulseBlock
            Range profiles of the planned aperture. Their own phase centres are used for the
            first stage; they may differ from the planned ones by a wavelength.

        Returns
        -------
        (n_y, n_x) or (n_alpha, n_range) complex64
            ``f(x) = sum_m sum_n s_mn(D_mn(x)) exp(+j k_c D_mn(x))`` at the pixels of the grid.

        Raises
        ------
        ValueError
            The block is not compressed, has no positions, or does not match the plan.
        """
        check_profiles(block, self.radar, self.n_samples)
        self._check_positions(block)
        rows, columns = (self.grid.shape if isinstance(self.grid, MapGrid)
                         else (self.grid.n_alpha, self.grid.n_range))
        image = np.zeros((rows, columns), np.complex64)
        # one image per level is alive: a part is added to its parent as soon as it is made
        buffers = [np.zeros(2 * level.size + loops.PADDING if level.nodes else 0, np.float32)
                   for level in self.levels]
        with tqdm(total=len(self.levels[0].nodes), desc='ffbp', unit='sub-aperture',
                  disable=not self._progress) as bar:
            for node in self._top:
                self._form(node, block, buffers, bar)
                self._add(node, buffers[node.level], image)
        return image

    def _check_positions(self, block):
        if block.tx_m.shape != self._tx.shape:
            raise ValueError(f'block.tx_m.shape={block.tx_m.shape}; this plan is for '
                             f'{self._tx.shape}, pulses and channels of the whole aperture')
        off = max(float(np.abs(block.tx_m - self._tx).max()),
                  float(np.abs(block.rx_m - self._rx).max()))
        if off > self.radar.wavelength_m:
            raise ValueError(f'phase centres of the block lie up to {off:.3f} m from the planned '
                             'ones; plan the imager with the positions of this aperture')

    def _form(self, node: Node, block, buffers, bar) -> None:
        """Make the image of a sub-aperture from its pulses or from its parts."""
        image = buffers[node.level]
        if not node.children:
            self._backproject(node, block, image)
            bar.update()
            return
        for number, child in enumerate(node.children):
            self._form(child, block, buffers, bar)
            self._merge(child, buffers[child.level], node, image, number == 0)

    def _backproject(self, node, block, image) -> None:
        segment = self._profiles.lattice.segment
        n_alpha, n_range = node.shape
        size = n_alpha * n_range
        lines = np.empty((-(-n_alpha // LINES), -(-n_range // segment), 12, LINES))
        frame = self._frame
        geometry = np.array([*frame.leave(node.centre), frame.z_m, *frame.track, *frame.across,
                             node.range_start, self.range_spacing_m, node.alpha_start,
                             self.levels[0].alpha_spacing])
        loops.local_lines(geometry, n_alpha, segment, lines)
        image[:2 * size] = 0.0
        rows = [a[node.pulses].reshape(-1, a.shape[-1])
                for a in (block.samples, block.tx_m, block.rx_m)]
        layout = np.array([n_alpha, 0, n_range, 1, size])
        add_to_lines(self._profiles, *rows, [(lines, layout)], self._ramp[:n_range], image)

    @property
    def _groups(self) -> int:
        return _GROUPS_PER_THREAD * numba.get_num_threads()

    def _merge(self, child, source, parent, target, first) -> None:
        """Add the image of a part to that of a longer sub-aperture."""
        level, frame = self.levels[parent.level], self._frame
        spacing, (rows, columns) = self.range_spacing_m, parent.shape
        if not level.segment:  # too near for the lines of the two grids to run side by side
            if first:
                target[:2 * rows * columns] = 0.0
            pixels = [*frame.leave(parent.centre)[:2], parent.centre[2] - frame.z_m, *frame.track,
                      *frame.across, parent.range_start, spacing, parent.alpha_start,
                      level.alpha_spacing]
            self._interpolate(child, source, pixels, target,
                              (rows, columns, columns, 1, rows * columns),
                              2 * spacing / self.radar.wavelength_m)
            return
        offset = child.centre - parent.centre
        geometry = np.array([
            offset[0], offset[1], parent.centre[2] - frame.z_m, child.centre[2] - frame.z_m,
            spacing, parent.range_start, child.range_start, parent.alpha_start,
            level.alpha_spacing, child.alpha_start, self.levels[child.level].alpha_spacing,
            2 * spacing / self.radar.wavelength_m])
        width = level.segment + loops.LANES
        groups = min(rows, self._groups)
        loops.merge(source, child.shape, target, parent.shape, geometry, *self._pairs,
                    loops.TAPS[self.kernel] // 2, level.segment,
                    np.arange(width, dtype=np.float32), int(first),
                    *np.empty((5, groups * width), np.float32))

    def _add(self, node, source, image) -> None:
        """Interpolate one of the last local images to the requested grid."""
        grid = self.grid
        if isinstance(grid, MapGrid):
            pixels = [grid.x_m[0], grid.y_m[0], grid.spacing_m, -grid.spacing_m]
        else:
            pixels = [*grid.origin_m[:2], grid.height_m, *grid.track, *grid.across,
                      grid.range_start_m, grid.range_spacing_m, grid.alpha_start,
                      grid.alpha_spacing]
        self._interpolate(node, source, pixels, image.reshape(-1).view(np.float32),
                          (*image.shape, 2 * image.shape[1], 2, 1), 0.0)

    def _interpolate(self, node, source, pixels, target, layout, cycles_per_column) -> None:
        x, y, z = self._frame.leave(node.centre)
        geometry = np.array([
            x, y, z - self._frame.z_m, *self._frame.track, node.range_start,
            self.range_spacing_m, node.alpha_start, self.levels[node.level].alpha_spacing,
            2 / self.radar.wavelength_m, cycles_per_column])
        size = min(layout[0], self._groups) * loops.PIXELS
        loops.add_to_grid(source, node.shape, geometry, np.array(pixels, float), np.array(layout),
                          *self._weights, loops.TAPS[self.kernel], target, *np.empty((2, size)),
                          np.empty(size, np.int64), *np.empty((4, size), np.float32))


def _check_options(kernel, pulses_per_subaperture, merge_factor) -> None:
    if kernel not in loops.TAPS:
        raise ValueError(f'kernel={kernel!r}; expected one of {", ".join(loops.TAPS)}')
    for name, value, least in (('pulses_per_subaperture', pulses_per_subaperture, 1),
                               ('merge_factor', merge_factor, 2)):
        if value != int(value) or value < least:
            raise ValueError(f'{name}={value}; expected an integer of {least} or more')


def _check_aperture(radar, tx, rx) -> None:
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


def _oversampling(name, value, default, least) -> float:
    value = default if value is None else float(value)
    if not (value > least and math.isfinite(value)):
        raise ValueError(f'{name}_oversampling={value}; expected more than {least}')
    return value
