"""Fast factorised backprojection by a plan: memory of its images, threads, and the merges."""

from __future__ import annotations

import numpy as np
from tqdm import tqdm

from ..backends.cpu.line_kernels import LINES, project_lines
from ..backends.cpu.profiles import Profiles
from ..compilation import numba
from ..geometry.grids import MapGrid
from ..planning.profiles.range_gate import RangeGate
from ..signal.pulses import PulseBlock
from . import ffbp_kernels as loops
from .ffbp_plan import FfbpPlan
from .ffbp_tree import Node
from .neighbour_weights import TAPS, kernel_weights

_GROUPS_PER_THREAD = 16  # of lines: evens out the load


class FactorisedImager:
    """Forms images by one plan of fast factorised backprojection."""

    def __init__(self, plan: FfbpPlan):
        self.plan = plan
        kernel, lattice = plan.sampling.kernel, plan.lattice
        along = [kernel_weights(kernel, v) for v in plan.sampling.oversampling]
        self._pairs = [loops.paired(w) for w in along]
        self._weights = [w.T.ravel() for w in along]
        self._profiles = Profiles(RangeGate.whole(plan.radar, plan.n_samples), lattice,
                                  plan.range_m)
        longest = max(n.shape[1] for n in plan.levels[0].nodes)
        cycles = 2 * (lattice.cell_m - lattice.spacing) / plan.radar.wavelength_m
        self._ramp = np.exp(2j * np.pi * np.fmod(cycles * np.arange(longest), 1.0)
                            ).astype(np.complex64)

    def image(self, block: PulseBlock, *, progress: bool = False) -> np.ndarray:
        """Image of the range profiles of the planned aperture, complex64, with the carrier."""
        plan = self.plan
        image = np.zeros(plan.grid.shape, np.complex64)
        # one image per level is alive: a part is added to its parent as soon as it is made
        buffers = [np.zeros(2 * level.size + loops.PADDING, np.float32) for level in plan.levels]
        with tqdm(total=len(plan.levels[0].nodes), desc='ffbp', unit='sub-aperture',
                  disable=not progress) as bar:
            for node in plan.top:
                self._form(node, block, buffers, bar)
                self._add(node, buffers[node.level], image)
        return image

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
        plan, frame = self.plan, self.plan.frame
        segment = plan.lattice.segment
        n_alpha, n_range = node.shape
        size = n_alpha * n_range
        lines = np.empty((-(-n_alpha // LINES), -(-n_range // segment), 12, LINES))
        geometry = np.array([*frame.leave(node.centre), frame.z_m, *frame.track, *frame.across,
                             node.range_start, plan.range_spacing_m, node.alpha_start,
                             plan.levels[0].alpha_spacing])
        loops.local_lines(geometry, n_alpha, segment, lines)
        image[:2 * size] = 0.0
        echoes = [a[node.pulses].reshape(-1, a.shape[-1])
                for a in (block.samples, block.tx_m, block.rx_m)]
        layout = np.array([n_alpha, 0, n_range, 1, size])
        project_lines(self._profiles, *echoes, [(lines, layout)], self._ramp[:n_range], image)

    @property
    def _groups(self) -> int:
        return _GROUPS_PER_THREAD * numba.get_num_threads()

    def _merge(self, child, source, parent, target, first) -> None:
        """Add the image of a part to that of a longer sub-aperture."""
        plan, frame = self.plan, self.plan.frame
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
        width = level.segment + loops.LANES
        groups = min(rows, self._groups)
        loops.merge(source, child.shape, target, parent.shape, geometry, *self._pairs,
                    TAPS[plan.sampling.kernel] // 2, level.segment,
                    np.arange(width, dtype=np.float32), int(first),
                    *np.empty((5, groups * width), np.float32))

    def _add(self, node, source, image) -> None:
        """Interpolate one of the last local images to the requested grid."""
        self._interpolate(node, source, self.plan.grid, image.reshape(-1).view(np.float32),
                          (*image.shape, 2 * image.shape[1], 2, 1), 0.0)

    def _interpolate(self, node, source, grid, target, layout, cycles_per_column) -> None:
        plan, frame = self.plan, self.plan.frame
        if isinstance(grid, MapGrid):
            pixels = [grid.x_m[0], grid.y_m[0], grid.spacing_m, -grid.spacing_m]
        else:
            pixels = [*grid.origin_m[:2], grid.height_m, *grid.track, *grid.across,
                      grid.range_start_m, grid.range_spacing_m, grid.alpha_start,
                      grid.alpha_spacing]
        x, y, z = frame.leave(node.centre)
        geometry = np.array([
            x, y, z - frame.z_m, *frame.track, node.range_start, plan.range_spacing_m,
            node.alpha_start, plan.levels[node.level].alpha_spacing, 2 / plan.radar.wavelength_m,
            cycles_per_column])
        size = min(layout[0], self._groups) * loops.PIXELS
        loops.add_to_grid(source, node.shape, geometry, np.array(pixels, float), np.array(layout),
                          *self._weights, TAPS[plan.sampling.kernel], target,
                          *np.empty((2, size)), np.empty(size, np.int64),
                          *np.empty((4, size), np.float32))
