"""Add range profiles to image lines: geometry of the lines, then the kernel."""

from __future__ import annotations

import numba
import numpy as np

from ...geometry.polar import PolarGrid
from . import line_kernels
from .profiles import Profiles

_TASKS_PER_THREAD = 8


def line_middles(locate, n_lines: int, n_pixels: int, segment: int) -> np.ndarray:
    """Geometry of image lines as `line_kernels.project_lines` wants it.

    Parameters
    ----------
    locate : callable
        ``locate(pixel, line)`` gives position and its first to third derivative by the pixel
        number, each (..., 3) float64, metres, for broadcast numbers.
    n_lines, n_pixels : int
        Size of the image.
    segment : int
        Pixels of a segment.

    Returns
    -------
    (G, S, 12, LINES) float64
    """
    groups = -(-n_lines // line_kernels.LINES)
    line = np.minimum(np.arange(groups * line_kernels.LINES), n_lines - 1)
    middle = np.arange(-(-n_pixels // segment)) * segment + segment // 2
    parts = np.concatenate(locate(middle[:, None], line), axis=-1)  # (S, G * LINES, 12)
    parts = parts.reshape(len(middle), groups, line_kernels.LINES, 12)
    return np.ascontiguousarray(parts.transpose(1, 0, 3, 2))


def add_to_lines(profiles: Profiles, samples, tx_m, rx_m, layers, ramp, image) -> None:
    """Add rows to the lines of an image.

    Parameters
    ----------
    profiles : Profiles
        Plan of the profiles; its lattice has segments.
    samples : (R, N) complex64
        Profiles of the rows.
    tx_m, rx_m : (R, 3) float64
        Phase centres of the rows, metres.
    layers : sequence of ((G, S, 12, LINES) float64, (5,) int64)
        Lines from `line_middles`, and where they lie in the image: the layout of
        `line_kernels.project_lines`. All layers are of one size.
    ramp : (n_pixels,) complex64
        Factor of each pixel of a line.
    image :
        As `line_kernels.project_lines` describes it.
    """
    lattice = profiles.lattice
    segment = lattice.segment
    groups, segments = layers[0][0].shape[:2]
    tasks = min(groups * segments, _TASKS_PER_THREAD * numba.get_num_threads())
    work = np.empty((2, tasks * line_kernels.LINES * segment), np.float32)
    paths = np.empty((tasks, 8, line_kernels.LINES))
    coefficients = np.empty((tasks, 14, line_kernels.LINES), np.float32)
    base = np.empty((tasks, line_kernels.LINES), np.int64)
    index = np.arange(segment, dtype=np.float32) - segment // 2
    ramp = np.concatenate([ramp.real, ramp.imag])
    for rows in profiles.chunks(len(samples)):
        tx, rx = tx_m[rows], rx_m[rows]
        repeats = np.zeros((len(tx), 2), np.uint8)
        repeats[1:, 0] = (tx[1:] == tx[:-1]).all(axis=1)
        repeats[:, 1] = (tx == rx).all(axis=1)
        planes = profiles.planes(samples[rows])
        shape = (planes.shape[0], planes.shape[1], planes.shape[3])
        for lines, layout in layers:
            line_kernels.project_lines(
                planes.reshape(-1), shape, tx, rx, repeats, lines,
                profiles.range_at(segment), lattice.step_m, profiles.cycles_per_step,
                profiles.cycles_at(segment), ramp, image, layout, index, work[0], work[1], paths,
                coefficients, base)


class PolarLines:
    """Lines of a polar grid, prepared for adding any number of rows.

    Parameters
    ----------
    profiles : Profiles
        Plan of the profiles; its lattice cells are about as long as the range spacing.
    """

    def __init__(self, polar: PolarGrid, profiles: Profiles):
        lattice = profiles.lattice
        self._polar, self._profiles = polar, profiles
        self._lines = line_middles(self._locate, polar.n_alpha, polar.n_range, lattice.segment)
        # from the phase that the kernel leaves to range baseband
        cycles = 2 * (lattice.cell_m - polar.range_spacing_m) / profiles.radar.wavelength_m
        self._ramp = _phasor(cycles * np.arange(polar.n_range))

    def _locate(self, pixel, line):
        polar = self._polar
        derivatives = polar.lines(polar.range_start_m + polar.range_spacing_m * pixel,
                                  polar.alpha_start + polar.alpha_spacing * line)
        return [d * polar.range_spacing_m ** order for order, d in enumerate(derivatives[:4])]

    def add(self, samples, tx_m, rx_m, parts) -> None:
        """Add rows to an image at range baseband.

        Parameters
        ----------
        samples : (R, N) complex64
            Profiles of the rows.
        tx_m, rx_m : (R, 3) float64
            Phase centres of the rows, metres.
        parts : (2, n_alpha, n_range or more) float32
            Real and imaginary part of the image times ``exp(-j 4 pi (r - r_0) / lambda)``, r_0
            the first range; changed in place, contiguous. Lines may end in padding.
        """
        polar = self._polar
        layout = np.array([polar.n_alpha, 0, parts.shape[-1], 1, parts[0].size])
        add_to_lines(self._profiles, samples, tx_m, rx_m, [(self._lines, layout)], self._ramp,
                     parts.reshape(-1))

    def fill(self, samples, tx_m, rx_m, parts, weights=None) -> None:
        """Image of rows with weights, (R,) float32; otherwise as `add`."""
        parts[:] = 0.0
        if weights is not None:
            samples = samples * weights[:, None]
        self.add(samples, tx_m, rx_m, parts)


def shared_phase(profiles: Profiles, n_pixels: int) -> np.ndarray:
    """(n_pixels,) complex64 carrier phase that all lines of an image share."""
    cycles = profiles.cycles_per_step * profiles.lattice.n_phases * np.arange(n_pixels)
    return _phasor(cycles)


def _phasor(cycles) -> np.ndarray:
    return np.exp(2j * np.pi * np.fmod(cycles, 1.0)).astype(np.complex64)
