"""Multichannel backprojection with the exact two-way path of every channel.

Rosenberg & Gray, equations 13 to 17 and 19: each range profile is read at the distance of each
pixel, its carrier phase is restored, and all pulses and channels are summed. The paper applies
the phase of a channel's offset to the profile read at the reference antenna's delay; here every
channel is read at its own delay, which needs no approximation.
"""

from __future__ import annotations

import math

import numba
import numpy as np
import scipy.fft

from ..geometry import MapGrid
from ..signal.pulses import PulseBlock
from ..signal.radar import RadarParameters
from . import kernels
from .interpolation import N_PLANES, TAPS, polynomial_planes
from .lattice import Lattice, LineGeometry, line_geometry, plan_lattice

_CHUNK_BYTES = 6 << 20  # coefficients of one pass over the image: stays in cache
_POINTS_PER_CALL = 1 << 18


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
        self._check(block, image)
        if block.n_pulses == 0:
            return
        tx, rx = block.tx_m.reshape(-1, 3), block.rx_m.reshape(-1, 3)
        profiles = block.samples.reshape(-1, self.n_samples)
        geometry = line_geometry(self.grid, tx, rx)
        self._check_reach(geometry)
        n_line = self.grid.shape[1 - geometry.axis]
        lattice = plan_lattice(geometry, self.grid.spacing_m, n_line, self.radar,
                               self.n_samples, self.target_db)
        first_cell, n_cells = self._reachable_cells(geometry, lattice)
        bytes_per_row = N_PLANES * 4 * lattice.n_phases * n_cells
        rows = max(numba.get_num_threads(), _CHUNK_BYTES // bytes_per_row)
        for lo in range(0, len(profiles), rows):
            part = slice(lo, min(lo + rows, len(profiles)))
            planes = self._planes(profiles[part], lattice, first_cell, n_cells)
            project = self._project_lines if lattice.segment else self._project_points
            project(planes, tx[part], rx[part], geometry, lattice, first_cell, image)
        self.predicted_error_db = max(self.predicted_error_db, lattice.predicted_error_db)

    def _check(self, block, image):
        if not block.compressed:
            raise ValueError('the block holds raw pulses; apply range compression first')
        if not block.has_positions:
            raise ValueError('the block has no phase centres; backprojection needs the transmit '
                             'and receive position of every pulse and channel')
        if block.radar != self.radar or block.n_samples != self.n_samples:
            raise ValueError(f'the block has {block.n_samples} samples of {block.radar}; this '
                             f'plan is for {self.n_samples} samples of {self.radar}')
        if (image.shape != self.grid.shape or image.dtype != np.complex64
                or not image.flags.c_contiguous):
            raise ValueError(f'image is {image.dtype} {image.shape}; expected complex64 '
                             f'{self.grid.shape}, contiguous in C order')

    def _check_reach(self, geometry: LineGeometry):
        start = self.radar.range_start_m
        stop = start + self.n_samples * self.radar.sample_spacing_m
        if geometry.range_m[1] < start or geometry.range_m[0] > stop:
            raise ValueError(
                f'the grid lies {geometry.range_m[0]:.1f} to {geometry.range_m[1]:.1f} m from '
                f'the antenna, the profiles cover {start:.1f} to {stop:.1f} m; move the grid or '
                'the range window')

    def _reachable_cells(self, geometry, lattice) -> tuple[int, int]:
        """First lattice cell to keep and number of cells, zero padding included."""
        pad = max(lattice.segment, 8)
        cell_m = lattice.step_m * lattice.n_phases
        lo, hi = ((r - self.radar.range_start_m) / cell_m for r in geometry.range_m)
        first = max(math.floor(lo), 0) - 8
        last = min(math.ceil(hi), lattice.n_cells) + 8
        return first - pad, last - first + 2 * pad

    def _planes(self, profiles, lattice: Lattice, first_cell, n_cells) -> np.ndarray:
        """(R, U, 8, n_cells) float32 polynomial coefficients of profiles (R, N)."""
        workers = numba.get_num_threads()
        spectrum = scipy.fft.fft(profiles, lattice.n_padded, axis=-1, workers=workers)
        spectrum *= self._band_taper(lattice.n_padded)
        n_dense = lattice.n_cells * lattice.n_phases
        keep = min(lattice.n_padded, n_dense)
        padded = np.zeros((len(profiles), n_dense), np.complex64)
        upper, lower = (keep + 1) // 2, keep // 2
        padded[:, :upper] = spectrum[:, :upper]
        padded[:, n_dense - lower:] = spectrum[:, lattice.n_padded - lower:]
        padded *= np.float32(n_dense / lattice.n_padded)
        dense = scipy.fft.ifft(padded, axis=-1, workers=workers, overwrite_x=True)
        real, imag = self._window(dense.reshape(len(profiles), lattice.n_cells, -1),
                                  first_cell - TAPS, n_cells + 2 * TAPS)
        planes = np.empty((len(profiles), lattice.n_phases, N_PLANES, n_cells), np.float32)
        polynomial_planes(real, imag, lattice.interpolator.weights, lattice.interpolator.first,
                          planes)
        pad = max(lattice.segment, 8)
        planes[..., :pad], planes[..., n_cells - pad:] = 0.0, 0.0
        return planes

    @staticmethod
    def _window(dense, first, count):
        """Real and imaginary cells `first` onwards of (R, n, U), as (R, U, count); 0 outside."""
        lo, hi = max(first, 0), min(first + count, dense.shape[1])
        parts = np.zeros((2, len(dense), dense.shape[2], count), np.float32)
        inside = dense[:, lo:hi].transpose(0, 2, 1)
        parts[0, ..., lo - first:hi - first] = inside.real
        parts[1, ..., lo - first:hi - first] = inside.imag
        return parts

    def _band_taper(self, n) -> np.ndarray:
        """(n,) float32 gain by frequency: 1 in the band, smoothly to 0 at half the sample rate.

        Without it the ends of a profile, where sidelobes are cut off, would ring far inside.
        """
        oversampling = self.radar.sample_rate_hz / self.radar.bandwidth_hz
        beyond = 2 * np.abs(scipy.fft.fftfreq(n)) * oversampling - 1
        return np.cos(0.5 * np.pi * np.clip(beyond / (oversampling - 1), 0, 1)
                      ).astype(np.float32) ** 2

    def _project_lines(self, planes, tx, rx, geometry, lattice, first_cell, image):
        grid, segment, axis = self.grid, lattice.segment, geometry.axis
        steps = np.array([[grid.spacing_m, 0, 0], [0, -grid.spacing_m, 0]])
        start = np.array([grid.x_m[0], grid.y_m[0], grid.z_m])
        along, across = steps[axis], steps[1 - axis]
        n_pixels, n_lines = grid.shape[1 - axis], grid.shape[axis]
        strides = (1, grid.n_x)
        layout = np.array([n_lines, 0, strides[1 - axis], strides[axis]])
        if along[axis] * geometry.sign < 0:  # walk the lines from their other end
            start = start + (n_pixels - 1) * along
            along = -along
            layout[1:] = (n_pixels - 1) * layout[3], layout[2], -layout[3]
        wavelength = self.radar.wavelength_m
        range_zero = (self.radar.range_start_m
                      + (first_cell + segment) * lattice.n_phases * lattice.step_m)
        cycles = 2 * lattice.step_m / wavelength
        ramp = np.exp(2j * np.pi * np.fmod(cycles * lattice.n_phases
                                           * np.arange(n_pixels), 1.0))
        groups = -(-n_lines // kernels.LINES)
        work = np.empty((2, groups * kernels.LINES * segment), np.float32)
        kernels.project_lines(
            planes.reshape(-1), (planes.shape[0], planes.shape[1], planes.shape[3]), tx, rx,
            start, along, across, range_zero, lattice.step_m, cycles,
            math.fmod(2 * range_zero / wavelength, 1.0), ramp.astype(np.complex64),
            image.reshape(-1), layout, np.arange(segment, dtype=np.float32) - segment // 2,
            work[0], work[1], np.empty((groups, 5, kernels.LINES), np.float32),
            np.empty((groups, kernels.LINES), np.int64))

    def _project_points(self, planes, tx, rx, geometry, lattice, first_cell, image):
        del geometry  # points need no common direction
        polynomials = np.ascontiguousarray(planes[:, 0].transpose(0, 2, 1))
        range_zero = self.radar.range_start_m + first_cell * lattice.step_m
        wavelength = self.radar.wavelength_m
        y, x = self.grid.y_m, self.grid.x_m
        rows = max(1, _POINTS_PER_CALL // len(x))
        for lo in range(0, len(y), rows):
            part = slice(lo, min(lo + rows, len(y)))
            points = np.empty((part.stop - part.start, len(x), 3))
            points[..., 0], points[..., 1], points[..., 2] = x, y[part, None], self.grid.z_m
            kernels.project_points(polynomials, tx, rx, points.reshape(-1, 3), range_zero,
                                   lattice.step_m, 2 * lattice.step_m / wavelength,
                                   math.fmod(2 * range_zero / wavelength, 1.0),
                                   image[part].reshape(-1))


def compile_kernels() -> None:
    """Compile the kernels, or load them from the cache, before the first pulse arrives.

    Takes some seconds the first time on a machine and well under one after that.
    """
    radar = RadarParameters(10e9, 300e6, 600e6, 0.0)
    centres = np.zeros((1, 1, 3))
    block = PulseBlock(radar, True, [0], [0], np.zeros((1, 1, 512)), centres, centres)
    for x in (100.0, 1.0):  # by lines, and around the antenna by points
        Backprojector(MapGrid((x, 0.0, 0.0), 9, 9, 0.25), radar, block.n_samples)(block)
