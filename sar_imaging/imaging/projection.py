"""Add range profiles to image lines or to points: resampling of profiles, then the kernels."""

from __future__ import annotations

import math

import numba
import numpy as np
import scipy.fft

from ..geometry.polar import PolarGrid
from ..signal.radar import RadarParameters
from ..signal.spectra import resampled_from_spectrum
from . import kernels
from .interpolation import N_PLANES, TAPS, polynomial_planes
from .lattice import Lattice

_CHUNK_BYTES = 4 << 20  # coefficients of one pass over the image: stays in cache
_POINTS_PER_CALL = 1 << 18
_GUARD = 8  # lattice cells beyond the ranges of the image


class Profiles:
    """Range profiles of one radar on a lattice, for the ranges that an image can reach.

    Parameters
    ----------
    radar : RadarParameters
        Of the profiles.
    lattice : Lattice
        How to resample them.
    range_m : (float, float)
        Smallest and largest half path of the image, metres.
    """

    def __init__(self, radar: RadarParameters, lattice: Lattice, range_m: tuple[float, float]):
        self.radar, self.lattice = radar, lattice
        self._pad = max(lattice.segment, _GUARD)
        lo, hi = ((r - radar.range_start_m) / lattice.cell_m for r in range_m)
        self._first = max(math.floor(lo), 0) - _GUARD - self._pad
        last = min(math.ceil(hi), lattice.n_cells) + _GUARD + self._pad
        self._count = last - self._first
        self._taper = _band_taper(lattice.n_padded, radar.sample_rate_hz / radar.bandwidth_hz)

    @property
    def cycles_per_step(self) -> float:
        """Carrier phase per lattice step, cycles."""
        return 2 * self.lattice.step_m / self.radar.wavelength_m

    def range_at(self, cell: int) -> float:
        """Half path at a cell of the planes, metres."""
        return self.radar.range_start_m + (self._first + cell) * self.lattice.cell_m

    def cycles_at(self, cell: int) -> float:
        """Carrier phase at a cell of the planes, fraction of a cycle."""
        return math.fmod(2 * self.range_at(cell) / self.radar.wavelength_m, 1.0)

    def chunks(self, n_rows: int):
        """Slices of rows whose planes stay in cache."""
        row = N_PLANES * 4 * self.lattice.n_phases * self._count
        step = max(numba.get_num_threads(), _CHUNK_BYTES // row)
        return (slice(lo, min(lo + step, n_rows)) for lo in range(0, n_rows, step))

    def planes(self, samples) -> np.ndarray:
        """Polynomial coefficients (R, U, 8, n) float32 of profiles (R, N) complex64."""
        lattice, workers = self.lattice, numba.get_num_threads()
        spectrum = scipy.fft.fft(samples, lattice.n_padded, axis=-1, workers=workers)
        spectrum *= self._taper
        dense = resampled_from_spectrum(spectrum, lattice.n_cells * lattice.n_phases,
                                        workers=workers)
        real, imag = self._window(dense.reshape(len(samples), lattice.n_cells, -1))
        planes = np.empty((len(samples), lattice.n_phases, N_PLANES, self._count), np.float32)
        polynomial_planes(real, imag, lattice.interpolator.weights, lattice.interpolator.first,
                          planes)
        planes[..., :self._pad], planes[..., self._count - self._pad:] = 0.0, 0.0
        return planes

    def _window(self, dense):
        """Real and imaginary part of the reachable cells of (R, n, U), phase-major; 0 outside."""
        first, count = self._first - TAPS, self._count + 2 * TAPS
        lo, hi = max(first, 0), min(first + count, dense.shape[1])
        parts = np.zeros((2, len(dense), dense.shape[2], count), np.float32)
        inside = dense[:, lo:hi].transpose(0, 2, 1)
        parts[0, ..., lo - first:hi - first] = inside.real
        parts[1, ..., lo - first:hi - first] = inside.imag
        return parts


def _band_taper(n: int, oversampling: float) -> np.ndarray:
    """(n,) float32 gain by frequency: 1 in the band, smoothly to 0 at half the sample rate.

    Without it the ends of a profile, where sidelobes are cut off, would ring far inside.
    """
    beyond = 2 * np.abs(scipy.fft.fftfreq(n)) * oversampling - 1
    return np.cos(0.5 * np.pi * np.clip(beyond / (oversampling - 1), 0, 1)
                  ).astype(np.float32) ** 2


def line_middles(locate, n_lines: int, n_pixels: int, segment: int) -> np.ndarray:
    """Geometry of image lines as `kernels.project_lines` wants it.

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
    groups = -(-n_lines // kernels.LINES)
    line = np.minimum(np.arange(groups * kernels.LINES), n_lines - 1)
    middle = np.arange(-(-n_pixels // segment)) * segment + segment // 2
    parts = np.concatenate(locate(middle[:, None], line), axis=-1)  # (S, G * LINES, 12)
    parts = parts.reshape(len(middle), groups, kernels.LINES, 12)
    return np.ascontiguousarray(parts.transpose(1, 0, 3, 2))


def add_to_lines(profiles: Profiles, samples, tx_m, rx_m, lines, layout, ramp, image) -> None:
    """Add rows to the lines of an image.

    Parameters
    ----------
    profiles : Profiles
        Plan of the profiles; its lattice has segments.
    samples : (R, N) complex64
        Profiles of the rows.
    tx_m, rx_m : (R, 3) float64
        Phase centres of the rows, metres.
    lines : (G, S, 12, LINES) float64
        From `line_middles`.
    layout, ramp, image :
        As `kernels.project_lines` describes them.
    """
    lattice, groups = profiles.lattice, len(lines)
    segment = lattice.segment
    work = np.empty((2, groups * kernels.LINES * segment), np.float32)
    paths = np.empty((groups, 8, kernels.LINES))
    coefficients = np.empty((groups, 10, kernels.LINES), np.float32)
    base = np.empty((groups, kernels.LINES), np.int64)
    index = np.arange(segment, dtype=np.float32) - segment // 2
    for rows in profiles.chunks(len(samples)):
        tx, rx = tx_m[rows], rx_m[rows]
        repeats = np.zeros((len(tx), 2), np.uint8)
        repeats[1:, 0] = (tx[1:] == tx[:-1]).all(axis=1)
        repeats[:, 1] = (tx == rx).all(axis=1)
        planes = profiles.planes(samples[rows])
        shape = (planes.shape[0], planes.shape[1], planes.shape[3])
        kernels.project_lines(
            planes.reshape(-1), shape, tx, rx, repeats, lines,
            profiles.range_at(segment), lattice.step_m, profiles.cycles_per_step,
            profiles.cycles_at(segment), ramp, image, layout, index, lattice.expand_phase,
            work[0], work[1], paths, coefficients, base)


class PolarLines:
    """Lines of a polar grid, prepared for adding any number of rows.

    Parameters
    ----------
    polar : PolarGrid
        Pixels.
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
        parts : (2, n_alpha, n_range) float32
            Real and imaginary part of the image times ``exp(-j 4 pi (r - r_0) / lambda)``, r_0
            the first range; changed in place, contiguous.
        """
        polar = self._polar
        layout = np.array([polar.n_alpha, 0, polar.n_range, 1, parts[0].size])
        add_to_lines(self._profiles, samples, tx_m, rx_m, self._lines, layout, self._ramp,
                     parts.reshape(-1))


def shared_phase(profiles: Profiles, n_pixels: int) -> np.ndarray:
    """(n_pixels,) complex64 carrier phase that all lines of an image share."""
    cycles = profiles.cycles_per_step * profiles.lattice.n_phases * np.arange(n_pixels)
    return _phasor(cycles)


def _phasor(cycles) -> np.ndarray:
    return np.exp(2j * np.pi * np.fmod(cycles, 1.0)).astype(np.complex64)


def add_to_points(profiles: Profiles, samples, tx_m, rx_m, points, image) -> None:
    """Add rows to arbitrary points.

    Parameters
    ----------
    profiles : Profiles
        Plan of the profiles, on `lattice.point_lattice`.
    samples : (R, N) complex64
        Profiles of the rows.
    tx_m, rx_m : (R, 3) float64
        Phase centres of the rows, metres.
    points : callable
        ``points(slice)`` gives positions (n, 3) float64 of these pixels, metres.
    image : (N,) complex64
        Image to add to.
    """
    for rows in profiles.chunks(len(samples)):
        planes = profiles.planes(samples[rows])
        polynomials = np.ascontiguousarray(planes[:, 0].transpose(0, 2, 1))
        for lo in range(0, image.size, _POINTS_PER_CALL):
            part = slice(lo, min(lo + _POINTS_PER_CALL, image.size))
            kernels.project_points(
                polynomials, tx_m[rows], rx_m[rows], points(part), profiles.range_at(0),
                profiles.lattice.step_m, profiles.cycles_per_step, profiles.cycles_at(0),
                image[part])
