"""Second stage of AFBP: sub-aperture images fused by their spectra.

Zhang et al., section II.B; `backends.reference.fuse_bands` has the formulas. Unfolding the bands
that coarse images hold folded, and adding them in the spectrum of the full aperture, interpolates
and sums all images at once.
"""

from __future__ import annotations

import math

import numpy as np

from ....planning.afbp.polar_grids import UnifiedPolarGrids
from ....planning.guard_taper import guard_taper
from ..fft.columns import LANES, rows_to_transform, transform_columns
from ..memory import aligned_empty, aligned_zeros
from .bands import Band, add_band, add_transformed, clear_band
from .lines import finish_lines, fold_lines

_LINES_PER_CALL = 32  # of the fused image


class SpectrumFusion:
    """Fuse sub-aperture images that share a grid, see `backends.protocol.SpectrumFusion`.

    Where contributions are kept, removing and replacing leave no rounding behind: wavenumbers
    that a change concerns are summed again from the contributions, the others stay as they are.
    That takes about two to three times the memory of the fused spectrum more.
    """

    def __init__(self, grid: UnifiedPolarGrids, *, keep: bool = False):
        self.grid, self._keep = grid, keep
        n_coarse, n_fine = grid.n_coarse_range, grid.n_fine_range
        self._wavenumber = grid.range_wavenumbers
        self._shape = grid.n_fine, len(self._wavenumber)
        most = len(self._wavenumber) // 2
        # Turned by this along range, images have the lowest wavenumber at zero.
        turn = np.exp(2j * np.pi * (most * np.arange(n_coarse) % n_coarse) / n_coarse)
        self._taper = (guard_taper(grid.n_coarse, grid.n_guard, grid.beta).astype(np.float32),
                       (guard_taper(n_coarse, grid.range_guard, grid.beta) * turn
                        ).astype(np.complex64))
        self._coarse_rows = rows_to_transform(grid.n_coarse)
        self._fine_rows = rows_to_transform(grid.n_fine)
        place = grid.fine_range_guard + np.arange(grid.polar.n_range)
        self._turn_back = np.exp(-2j * np.pi * (most * place % n_fine) / n_fine
                                 ).astype(np.complex64)
        # kept from one sub-aperture to the next: fresh memory takes as long as the work
        self._lines = aligned_empty((grid.n_coarse, _padded(n_coarse)), np.complex64)
        self._memory: np.ndarray | None  # of the spectrum and, in its place, the image
        self._contributions: dict[int, tuple[np.ndarray, Band] | None]  # None if not kept
        self._changed: list[Band]  # that came or went
        self.clear()

    @property
    def included(self) -> frozenset[int]:
        """Sub-apertures in the image."""
        return frozenset(self._contributions)

    def add(self, number: int, image: np.ndarray, centre_m: float) -> None:
        """Add a sub-aperture, or replace it; see `backends.protocol.SpectrumFusion`."""
        self.grid.check_contribution(image, centre_m)
        if number in self._contributions and not self._keep:
            raise ValueError(f'sub-aperture {number} is in the image already; fuse with keep=True '
                             'to replace contributions')
        fold_lines(image, *self._taper, self._coarse_rows, self._lines)
        n_bins, band = len(self._wavenumber), self._band(centre_m)
        if self._keep:
            if number in self._contributions:
                self.remove(number)
            transform_columns(self._lines, n_bins)
            self._contributions[number] = self._lines[:, :n_bins].copy(), band
            self._changed.append(band)
        else:
            add_transformed(self._lines, n_bins, band, self._fine_rows, self._whole())
            self._contributions[number] = None

    def remove(self, number: int) -> None:
        """Take a sub-aperture out of the image; see `backends.protocol.SpectrumFusion`."""
        if not self._keep or number not in self._contributions:
            raise ValueError(f'sub-aperture {number} cannot be removed: ' + (
                'it is not in the image' if self._keep else 'contributions are not kept'))
        self._changed.append(self._contributions.pop(number)[1])

    def polar_image(self, centre_m: float = 0.0) -> np.ndarray:
        """Image of what was added so far; see `backends.protocol.SpectrumFusion`."""
        fused = self._fused()
        memory = aligned_empty(self._memory.shape, np.complex64)
        self._spectrum(memory)[:] = fused
        return self._to_image(memory, centre_m)

    def take_polar_image(self) -> np.ndarray:
        """As `polar_image`, in less memory: the fused spectrum is used up."""
        self._fused()
        image = self._to_image(self._memory)
        self.clear()
        return image

    def clear(self) -> None:
        """Begin another aperture on the same grid: nothing is included any more."""
        self._memory, self._contributions, self._changed = None, {}, []

    def _whole(self) -> np.ndarray:
        """Spectrum, with memory before it for the image.

        Line l of the image is written over from ``l n_range`` on, while line l of the spectrum,
        which it is made from, begins at ``ahead + (guard + l) n_padded``. The first must end
        before the second begins, for l up to the lines of a call further on:
        ``ahead >= n_alpha n_range - (guard + n_alpha) n_padded + lines n_range``.
        """
        if self._memory is None:
            polar, (n_fine, n_bins) = self.grid.polar, self._shape
            # Lines of the image may be longer than those of the spectrum that they replace, and
            # those of a call replace none that the call has still to read.
            ahead = _padded(max(0, polar.n_alpha * polar.n_range
                                - (self.grid.fine_guard + polar.n_alpha) * _padded(n_bins))
                            + _LINES_PER_CALL * polar.n_range)
            self._memory = aligned_zeros((ahead + n_fine * _padded(n_bins),), np.complex64)
        return self._spectrum(self._memory)

    def _spectrum(self, memory: np.ndarray) -> np.ndarray:
        """(n_fine, range wavenumbers, padded) at the end, rows in the order of their transform."""
        n_fine, n_bins = self._shape
        return memory[-n_fine * _padded(n_bins):].reshape(n_fine, -1)

    def _fused(self) -> np.ndarray:
        spectrum, n_coarse, n_fine = self._whole(), self.grid.n_coarse, self.grid.n_fine
        if not self._keep:
            return spectrum
        if n_coarse > n_fine or len(self._changed) * n_coarse > n_fine:
            self._changed = [Band.whole(*self._shape)]
        for band in self._changed:
            clear_band(*band, self._fine_rows, spectrum)
            # in the order of a sum of all
            for number in sorted(self._contributions):
                folded, other = self._contributions[number]
                add_band(folded, *other, *band, self._fine_rows, spectrum)
        self._changed = []
        return spectrum

    def _band(self, centre_m: float) -> Band:
        """Where a band lies, as `backends.reference.fuse_bands` says.

        As its middle only grows with the range wavenumber, or only falls where x_u is negative,
        an angular bin has range wavenumbers without gap.
        """
        n_coarse, n_bins = self.grid.n_coarse, len(self._wavenumber)
        middle = np.rint(self._wavenumber * (centre_m * self.grid.extent / (2 * math.pi)))
        first = middle.astype(np.int64) - n_coarse // 2
        ascending = first if centre_m >= 0 else first[::-1]
        row = np.arange(ascending[0], ascending[-1] + n_coarse)
        begin, end = (np.searchsorted(ascending, r, 'right') for r in (row - n_coarse, row))
        if centre_m < 0:
            begin, end = n_bins - end, n_bins - begin
        return Band(int(row[0]), begin, end)

    def _to_image(self, memory, centre_m=0.0) -> np.ndarray:
        """Image of a spectrum, over which it is written line by line."""
        grid, n_bins = self.grid, len(self._wavenumber)
        polar = grid.polar
        spectrum = self._spectrum(memory)
        gain = None
        if grid.between is not None:
            middle = centre_m * polar.alpha_spacing * 2 / grid.wavelength_m
            cycles = np.arange(grid.n_fine) / grid.n_fine - middle
            gain = grid.between.gain(cycles - np.rint(cycles))
        transform_columns(spectrum, n_bins, inverse=True, gain=gain)
        # Guards moved the first range; the carrier is referred to that of the wanted grid.
        cycles = 2 * grid.fine_range_guard * polar.range_spacing_m / grid.wavelength_m
        cycles -= 2 * centre_m / grid.wavelength_m * (polar.alpha - polar.alpha_start)
        scale = np.exp(2j * np.pi * np.fmod(cycles, 1.0)) / (grid.n_coarse * grid.n_coarse_range)
        scale = scale.astype(np.complex64)
        image = memory[:polar.n_alpha * polar.n_range].view(np.float32)
        width = 2 * polar.n_range
        for start in range(0, polar.n_alpha, _LINES_PER_CALL):
            stop = min(start + _LINES_PER_CALL, polar.n_alpha)
            finish_lines(spectrum[grid.fine_guard + start:grid.fine_guard + stop], n_bins,
                         grid.n_fine_range, grid.fine_range_guard, scale[start:stop],
                         self._turn_back, image[start * width:stop * width])
        return image.reshape(polar.n_alpha, 2, polar.n_range).swapaxes(0, 1)


def _padded(n: int) -> int:
    return -(-n // LANES) * LANES
