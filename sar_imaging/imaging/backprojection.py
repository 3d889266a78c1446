"""Multichannel backprojection with the exact two-way path of every channel.

Rosenberg & Gray, equations 13 to 17 and 19: each range profile is read at the distance of each
pixel, its carrier phase is restored, and all pulses and channels are summed. The paper applies
the phase of a channel's offset to the profile read at the reference antenna's delay; here every
channel is read at its own delay, which needs no approximation.

Three ways lead to the same sum, and the geometry chooses the quickest that meets the error
target: a polar image around the aperture, interpolated to the map (its lines follow range
best); lines of the map itself; and pixel by pixel, for grids near or around the antenna.
"""

from __future__ import annotations

import math

import numpy as np

from ..geometry import MapGrid
from ..signal.pulses import PulseBlock, check_profiles
from ..signal.radar import RadarParameters
from .lattice import plan_lattice, point_lattice, sample_paths
from .polar import PolarPlan, plan_polar
from .polar_image import add_by_polar
from .projection import (
    Profiles,
    add_to_lines,
    add_to_points,
    line_middles,
    shared_phase,
)

_SAMPLES_PER_SIDE = 5  # grid positions at which the geometry is bounded


class Backprojector:
    """Backproject range profiles of one radar onto one grid.

    Parameters
    ----------
    grid : MapGrid
        Where the pixels are.
    radar : RadarParameters
        Of the compressed profiles; a profile must be sampled at 1.25 times its bandwidth or more.
    n_samples : int
        Samples of each profile.
    target_db : float
        Wanted error against time-domain correlation, dB. Chooses the interpolation.

    Attributes
    ----------
    predicted_error_db : float
        Predicted error against time-domain correlation of what was added so far, dB.
    method : str
        How the latest block was added: ``'polar'``, ``'lines'`` or ``'points'``.

    Raises
    ------
    ValueError
        The profiles are sampled too coarsely, or the target cannot be met in float32.

    Examples
    --------
    >>> plan = Backprojector(grid, profiles.radar, profiles.n_samples)    # doctest: +SKIP
    >>> image = plan(profiles)                                            # doctest: +SKIP
    """

    def __init__(self, grid: MapGrid, radar: RadarParameters, n_samples: int, *,
                 target_db: float = -80.0):
        if radar.sample_rate_hz < 1.25 * radar.bandwidth_hz:
            raise ValueError(
                f'profiles sampled at {radar.sample_rate_hz:g} Hz for a bandwidth of '
                f'{radar.bandwidth_hz:g} Hz; sample them at 1.25 times the bandwidth or more '
                '(parameter oversampling of the range compression)')
        if not -100.0 <= target_db <= -20.0:
            raise ValueError(f'target_db={target_db}; expected -100 to -20 dB, float32 '
                             'arithmetic reaches -100 dB')
        self.grid, self.radar, self.n_samples = grid, radar, int(n_samples)
        self.target_db = float(target_db)
        self.predicted_error_db = -math.inf
        self.method = ''

    def __call__(self, block: PulseBlock) -> np.ndarray:
        """Image of one block.

        Parameters
        ----------
        block : PulseBlock
            Range profiles with phase centres.

        Returns
        -------
        (n_y, n_x) complex64
            ``f(x) = sum_m sum_n s_mn(D_mn(x)) exp(+j k_c D_mn(x))``, row 0 at the largest y.

        Raises
        ------
        ValueError
            As `add`.
        """
        image = np.zeros(self.grid.shape, np.complex64)
        self.add(block, image)
        return image

    def add(self, block: PulseBlock, image: np.ndarray) -> None:
        """Add the pulses of a block to an image (equation 17 is a sum).

        Ranges outside a profile contribute nothing.

        Parameters
        ----------
        block : PulseBlock
            Range profiles with phase centres.
        image : (n_y, n_x) complex64
            Changed in place; contiguous in C order.

        Raises
        ------
        ValueError
            The block is not compressed, has no positions, does not match the plan, or none of
            its profiles reaches the grid.
        """
        check_profiles(block, self.radar, self.n_samples)
        self._check_image(image)
        if block.n_pulses == 0:
            return
        rows = (block.samples.reshape(-1, self.n_samples), block.tx_m.reshape(-1, 3),
                block.rx_m.reshape(-1, 3))
        lines = _MapLines(self.grid, *rows[1:])
        self._check_reach(lines.range_m)
        lattice = plan_lattice(lines.paths, 1.0, lines.n_pixels, self.radar, self.n_samples,
                               self.target_db)
        polar = plan_polar(self.grid, *rows[1:], self.radar, self.n_samples, self.target_db)
        if polar is not None and (lattice is None
                                  or polar.cost < lattice.cost * len(rows[0])):
            self.method, error = 'polar', self._add_by_polar(polar, rows, image)
        elif lattice is not None:
            self.method, error = 'lines', self._add_by_lines(lattice, lines, rows, image)
        else:
            self.method, error = 'points', self._add_by_points(lines.range_m, rows, image)
        self.predicted_error_db = max(self.predicted_error_db, error)

    def _check_image(self, image):
        if (image.shape != self.grid.shape or image.dtype != np.complex64
                or not image.flags.c_contiguous):
            raise ValueError(f'image is {image.dtype} {image.shape}; expected complex64 '
                             f'{self.grid.shape}, contiguous in C order')

    def _check_reach(self, range_m):
        start = self.radar.range_start_m
        stop = start + self.n_samples * self.radar.sample_spacing_m
        if range_m[1] < start or range_m[0] > stop:
            raise ValueError(
                f'the grid lies {range_m[0]:.1f} to {range_m[1]:.1f} m from the antenna, the '
                f'profiles cover {start:.1f} to {stop:.1f} m; move the grid or the range window')

    def _add_by_polar(self, plan: PolarPlan, rows, image) -> float:
        add_by_polar(plan, self.radar, rows, self.grid, image)
        return plan.predicted_error_db

    def _add_by_lines(self, lattice, lines, rows, image) -> float:
        profiles = Profiles(self.radar, lattice, lines.range_m)
        middles = line_middles(lines.locate, lines.n_lines, lines.n_pixels, lattice.segment)
        add_to_lines(profiles, *rows, middles, lines.layout, shared_phase(profiles,
                                                                          lines.n_pixels),
                     image.reshape(-1).view(np.float32))
        return lattice.predicted_error_db

    def _add_by_points(self, range_m, rows, image) -> float:
        lattice = point_lattice(self.radar, self.n_samples)
        grid = self.grid

        def points(part):
            y, x = np.divmod(np.arange(part.start, part.stop), grid.n_x)
            return np.stack([grid.x_m[x], grid.y_m[y], np.full(len(x), grid.z_m)], axis=-1)

        add_to_points(Profiles(self.radar, lattice, range_m), *rows, points, image.reshape(-1))
        return lattice.predicted_error_db


class _MapLines:
    """Lines of a map grid along the axis that follows range best, in the direction of growth."""

    def __init__(self, grid: MapGrid, tx_m, rx_m):
        n = _SAMPLES_PER_SIDE
        x, y = (np.linspace(a[0], a[-1], n) for a in (grid.x_m, grid.y_m))
        points = np.stack([*(v.ravel() for v in np.meshgrid(x, y)), np.full(n * n, grid.z_m)],
                          axis=-1)
        steps = np.array([[grid.spacing_m, 0, 0], [0, -grid.spacing_m, 0]])
        slopes = [self._sample(tx_m, rx_m, points, step).derivatives[0] for step in steps]
        least = [np.abs(s).min() if s.min() > 0 or s.max() < 0 else -1.0 for s in slopes]
        axis = int(np.argmax(least))
        forward = slopes[axis].mean() >= 0
        self._along = steps[axis] if forward else -steps[axis]
        self._across = steps[1 - axis]
        self.n_pixels, self.n_lines = grid.shape[1 - axis], grid.shape[axis]
        self._start = np.array([grid.x_m[0], grid.y_m[0], grid.z_m])
        pixel, line = ((2, 2 * grid.n_x), (2 * grid.n_x, 2))[axis]
        first = 0
        if not forward:
            self._start = self._start - (self.n_pixels - 1) * self._along
            first, pixel = (self.n_pixels - 1) * pixel, -pixel
        self.layout = np.array([self.n_lines, first, line, pixel, 1])
        self.paths = self._sample(tx_m, rx_m, points, self._along)
        # Range is monotonic along lines; between sampled lines it changes by at most its slope.
        beside = np.abs(slopes[1 - axis]).max() * (self.n_lines / (n - 1) / 2 + 1)
        if least[axis] < 0:
            beside += np.abs(slopes[axis]).max() * (self.n_pixels / (n - 1) / 2 + 1)
        self.range_m = (float(self.paths.length.min() - beside),
                        float(self.paths.length.max() + beside))

    @staticmethod
    def _sample(tx_m, rx_m, points, step):
        return sample_paths(tx_m, rx_m, (points, np.broadcast_to(step, points.shape)))

    def locate(self, pixel, line):
        """Positions and derivatives for `line_middles`."""
        position = (self._start + np.multiply.outer(pixel, self._along)
                    + np.multiply.outer(line, self._across))
        straight = np.zeros_like(position)
        return position, np.broadcast_to(self._along, position.shape), straight, straight


def compile_kernels() -> None:
    """Compile the kernels, or load them from the cache, before the first pulse arrives.

    Takes some seconds the first time on a machine and well under one after that.
    """
    radar = RadarParameters(10e9, 300e6, 600e6, 0.0)
    centres = np.zeros((1, 1, 3))
    block = PulseBlock(radar, True, [0], [0], np.zeros((1, 1, 512)), centres, centres)
    for x in (100.0, 1.0):  # by lines, and around the antenna by points
        grid = MapGrid((x, 0.0, 0.0), 16, 16, 0.25)
        plan = Backprojector(grid, radar, block.n_samples)
        image = plan(block)
        polar = plan_polar(grid, centres[0], centres[0], radar, block.n_samples, plan.target_db)
        if polar is not None:
            plan._add_by_polar(polar, (block.samples[0], centres[0], centres[0]), image)
