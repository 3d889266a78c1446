"""Range profiles on the lattice that backprojection reads: resampling and polynomials."""

from __future__ import annotations

import math

import numpy as np
import scipy.fft

from ..compilation import njit, numba
from ..signal.radar import RadarParameters
from .interpolation import TAPS, polynomial_planes
from .lattice import ROWS_PER_PASS, Lattice
from .range_window import RangeWindow

_CHUNK_BYTES = 64 << 20  # coefficients of one pass over the image
_GUARD = 8  # lattice cells beyond the ranges of the image


class Profiles:
    """Range profiles of one radar on a lattice, for the ranges that an image can reach.

    Parameters
    ----------
    radar : RadarParameters
        Of the profiles.
    lattice : Lattice
        How to resample them.
    window : RangeWindow
        What to take of them; `lattice` was planned for as many samples.
    range_m : (float, float)
        Smallest and largest half path of the image, metres.
    """

    def __init__(self, radar: RadarParameters, lattice: Lattice, window: RangeWindow,
                 range_m: tuple[float, float]):
        self.radar, self.lattice, self._window = radar, lattice, window
        self._buffers: dict[str, np.ndarray] = {}
        self._pad = max(lattice.segment, _GUARD)
        lo, hi = ((r - window.range_start_m) / lattice.cell_m for r in range_m)
        self._first = max(math.floor(lo), 0) - _GUARD - self._pad
        last = min(math.ceil(hi), lattice.n_cells) + _GUARD + self._pad
        self._count = last - self._first
        # The inverse transform divides by its own length.
        self._gain = np.float32(lattice.n_cells * lattice.n_phases / lattice.n_padded
                                ) * _band_taper(lattice.n_padded,
                                                radar.sample_rate_hz / radar.bandwidth_hz)

    @property
    def cycles_per_step(self) -> float:
        """Carrier phase per lattice step, cycles."""
        return 2 * self.lattice.step_m / self.radar.wavelength_m

    def range_at(self, cell: int) -> float:
        """Half path at a cell of the planes, metres."""
        return self._window.range_start_m + (self._first + cell) * self.lattice.cell_m

    def cycles_at(self, cell: int) -> float:
        """Carrier phase at a cell of the planes, fraction of a cycle."""
        return math.fmod(2 * self.range_at(cell) / self.radar.wavelength_m, 1.0)

    def chunks(self, n_rows: int):
        """Slices of rows that are added in one pass."""
        row = 4 * self.lattice.interpolator.n_planes * self.lattice.n_phases * self._count
        step = min(ROWS_PER_PASS, max(numba.get_num_threads(), _CHUNK_BYTES // row))
        return (slice(lo, min(lo + step, n_rows)) for lo in range(0, n_rows, step))

    def planes(self, samples) -> np.ndarray:
        """Polynomial coefficients of some profiles.

        Parameters
        ----------
        samples : (R, N) complex64
            Profiles.

        Returns
        -------
        (R, U, 2 * (degree + 1), n) float32
            As `polynomial_planes` makes them. Valid until the next call, which writes to the same
            memory: fresh memory for every
            few profiles costs as much as filling it.
        """
        lattice, workers = self.lattice, numba.get_num_threads()
        n_rows, n_dense = len(samples), lattice.n_cells * lattice.n_phases
        spectrum = self._buffer('spectrum', (n_rows, lattice.n_padded), np.complex64)
        self._window.cut(samples, spectrum)
        spectrum = scipy.fft.fft(spectrum, axis=-1, workers=workers, overwrite_x=True)
        padded = self._buffer('padded', (n_rows, n_dense), np.complex64)
        _pad_band(spectrum, self._gain, padded)
        dense = scipy.fft.ifft(padded, axis=-1, workers=workers, overwrite_x=True)
        parts = self._buffer('parts', (2, n_rows, lattice.n_phases, self._count + 2 * TAPS),
                             np.float32)
        _split_phases(dense.reshape(-1).view(np.float32), lattice.n_cells, self._first - TAPS,
                      *parts)
        planes = self._buffer('planes', (n_rows, lattice.n_phases, lattice.interpolator.n_planes,
                                         self._count), np.float32)
        polynomial_planes(*parts, lattice.interpolator.weights, lattice.interpolator.first,
                          planes)
        planes[..., :self._pad], planes[..., self._count - self._pad:] = 0.0, 0.0
        return planes

    def _buffer(self, name: str, shape, dtype) -> np.ndarray:
        """Memory that calls share, grown when needed."""
        size = math.prod(shape)
        if name not in self._buffers or self._buffers[name].size < size:
            self._buffers[name] = np.empty(size, dtype)
        return self._buffers[name][:size].reshape(shape)


@njit(parallel=True)
def _pad_band(spectrum, gain, out):
    """Spectra times the gain, with zeros between positive and negative frequencies or cropped."""
    n, n_out = spectrum.shape[1], out.shape[1]
    keep = min(n, n_out)
    upper, lower = (keep + 1) // 2, keep // 2
    for row in numba.prange(spectrum.shape[0]):
        for k in range(upper):
            out[row, k] = spectrum[row, k] * gain[k]
        for k in range(upper, n_out - lower):
            out[row, k] = 0.0
        for k in range(lower):
            out[row, n_out - lower + k] = spectrum[row, n - lower + k] * gain[n - lower + k]


@njit(parallel=True)
def _split_phases(dense, n_cells, first, real, imag):
    """Real and imaginary part of the cells from `first`, phase by phase; 0 outside."""
    n_rows, n_phases, length = real.shape
    start, stop = min(max(-first, 0), length), max(min(n_cells - first, length), 0)
    step = np.uint64(2 * n_phases)
    for row in numba.prange(n_rows):
        for phase in range(n_phases):
            for i in range(start):
                real[row, phase, i] = 0.0
                imag[row, phase, i] = 0.0
            source = np.uint64(2 * ((row * n_cells + first + start) * n_phases + phase))
            for i in range(stop - start):
                real[row, phase, start + i] = dense[source + np.uint64(i) * step]
                imag[row, phase, start + i] = dense[source + np.uint64(i) * step + np.uint64(1)]
            for i in range(stop, length):
                real[row, phase, i] = 0.0
                imag[row, phase, i] = 0.0


def _band_taper(n: int, oversampling: float) -> np.ndarray:
    """(n,) float32 gain by frequency: 1 in the band, smoothly to 0 at half the sample rate.

    Without it the ends of a profile, where sidelobes are cut off, would ring far inside.
    """
    beyond = 2 * np.abs(scipy.fft.fftfreq(n)) * oversampling - 1
    return np.cos(0.5 * np.pi * np.clip(beyond / (oversampling - 1), 0, 1)
                  ).astype(np.float32) ** 2
