"""Second stage of AFBP: sub-aperture images fused by their spectra.

Zhang et al., section II.B: in unified polar coordinates the spectrum of a sub-aperture image is a
band whose place along the angular wavenumber is proportional to the sub-aperture's position and to
the range wavenumber (equation 16). The coarse image holds the band folded; unfolding it into the
spectrum of the full aperture and adding the bands interpolates and sums all images at once.
"""

from __future__ import annotations

import math

import numpy as np
import scipy.fft

from ..compilation import njit, numba
from .fusion_error import edge_taper
from .fusion_grid import FusionGrid
from .transform_length import quick_length

_BLOCK = 64  # tile of the transposition
_LINES_PER_CALL = 256  # of the fused image, bounds the work space


class SpectrumFusion:
    """Fuse sub-aperture images that share a grid, in any order, any subset.

    Parameters
    ----------
    grid : FusionGrid
        Of the sub-aperture images and of the fused one.
    keep : bool
        Keep each contribution, so that `remove` and replacing are possible and never leave a
        rounding behind: wavenumbers that a change concerns are summed again from the
        contributions, the others stay as they are. Takes about two to three times the memory of
        the fused spectrum more.

    Attributes
    ----------
    grid : FusionGrid
        As given.
    included : frozenset of int
        Sub-apertures in the image.
    """

    def __init__(self, grid: FusionGrid, *, keep: bool = False):
        self.grid, self._keep = grid, keep
        coarse = grid.coarse
        self._n_range = quick_length(coarse.n_range)
        step = 2 * math.pi / (self._n_range * coarse.range_spacing_m)
        # Tapers widen the band by little more than the inverse of the guards' length.
        margin = 4 * 2 * math.pi / (grid.range_guard * coarse.range_spacing_m)
        most = min(math.ceil((grid.half_range + margin) / step), (self._n_range - 1) // 2)
        self._bins = np.arange(-most, most + 1)
        self._wavenumber = grid.wavenumber_rad_per_m + self._bins * step
        self._taper = (edge_taper(grid.n_coarse, grid.n_guard, grid.beta).astype(np.float32),
                       edge_taper(coarse.n_range, grid.range_guard, grid.beta
                                  ).astype(np.float32))
        self._spectrum: np.ndarray | None
        self._contributions: dict[int, tuple[np.ndarray, np.ndarray]]
        self._changed: list[np.ndarray]  # first bins of bands that came or went
        self._included: set[int]
        self.clear()

    @property
    def included(self) -> frozenset[int]:
        """Sub-apertures in the image."""
        return frozenset(self._included)

    @property
    def spectrum_shape(self) -> tuple[int, int]:
        """Range and angular wavenumbers of the fused spectrum."""
        return len(self._bins), self.grid.n_fine

    def add(self, number: int, image: np.ndarray, centre_m: float) -> None:
        """Add a sub-aperture, or replace it where contributions are kept.

        Parameters
        ----------
        number : int
            Which sub-aperture; any number that tells it from the others.
        image : (n_alpha, n_range) complex64 or (2, n_alpha, n_range) float32
            On ``grid.coarse`` at range baseband, complex or as real and imaginary part.
        centre_m : float
            Middle of its band: of the derivatives of its half paths by direction over those by
            range, metres.

        Raises
        ------
        ValueError
            The image has another shape, the centre is not finite, or the sub-aperture is in
            already and contributions are not kept.
        """
        shape = (self.grid.n_coarse, self.grid.coarse.n_range)
        expected = shape if np.iscomplexobj(image) else (2, *shape)
        if image.shape != expected:
            raise ValueError(f'image.shape={image.shape}; expected {expected}')
        if not math.isfinite(centre_m):
            raise ValueError(f'centre_m={centre_m}; expected a finite number of metres')
        if number in self._included and not self._keep:
            raise ValueError(f'sub-aperture {number} is in the image already; fuse with keep=True '
                             'to replace contributions')
        folded = self.folded_spectrum(image)
        first = self._first_bins(centre_m)
        if self._keep:
            if number in self._contributions:
                self.remove(number)
            self._contributions[number] = folded, first
            self._changed.append(first)
        else:
            _add_bands(folded, first, self._whole())
        self._included.add(number)

    def remove(self, number: int) -> None:
        """Take a sub-aperture out of the image; needs ``keep=True``.

        Raises
        ------
        ValueError
            It is not in the image, or contributions are not kept.
        """
        if number not in self._contributions:
            raise ValueError(f'sub-aperture {number} cannot be removed: ' + (
                'it is not in the image' if self._keep else 'contributions are not kept'))
        self._changed.append(self._contributions.pop(number)[1])
        self._included.discard(number)

    def polar_image(self, centre_m: float = 0.0) -> np.ndarray:
        """Image of the sub-apertures that were added so far.

        Parameters
        ----------
        centre_m : float
            Middle of their bands, metres, where that is far from 0: the image is then given at
            baseband along direction, too.

        Returns
        -------
        (n_alpha, n_range) complex64
            On ``grid.polar``, at range baseband: times ``exp(-j 4 pi (r - r_0) / lambda)`` and
            ``exp(-j 4 pi centre_m (alpha - alpha_0) / lambda)``, r_0 and alpha_0 the first range
            and direction of ``grid.polar``.
        """
        return self._to_image(self._fused(), centre_m)

    def take_polar_image(self) -> np.ndarray:
        """As `polar_image`, in less memory: the fused spectrum is used up, nothing is included."""
        image = self._to_image(self._fused(), overwrite=True)
        self.clear()
        return image

    def clear(self) -> None:
        """Begin another aperture on the same grid: nothing is included any more."""
        self._spectrum, self._contributions, self._included = None, {}, set()
        self._changed = []

    def fused_spectrum(self) -> np.ndarray:
        """(range wavenumbers, angular wavenumbers) complex64 spectrum of what was added so far.

        Range wavenumbers ascend around the carrier's; angular ones start with zero, then the
        positive and the negative ones follow.
        """
        return self._fused().copy()

    def folded_spectrum(self, image: np.ndarray) -> np.ndarray:
        """(range wavenumbers, n_coarse) complex64 spectrum of a sub-aperture image, folded."""
        workers = numba.get_num_threads()
        parts = (image.real, image.imag) if np.iscomplexobj(image) else image
        tapered = np.empty(image.shape[-2:], np.complex64)
        _apply_taper(*parts, *self._taper, tapered)
        by_range = scipy.fft.fft(tapered, self._n_range, axis=1, workers=workers)
        folded = np.empty((len(self._bins), tapered.shape[0]), np.complex64)
        _transpose_bins(by_range, self._bins % self._n_range, folded)
        return scipy.fft.fft(folded, axis=1, workers=workers, overwrite_x=True)

    def _whole(self) -> np.ndarray:
        if self._spectrum is None:
            self._spectrum = np.zeros(self.spectrum_shape, np.complex64)
        return self._spectrum

    def _fused(self) -> np.ndarray:
        spectrum, n_coarse, n_fine = self._whole(), *self._sizes
        if not self._keep:
            return spectrum
        if n_coarse > n_fine or len(self._changed) * n_coarse > n_fine:
            spectrum[:] = 0.0
            for number in sorted(self._contributions):
                _add_bands(*self._contributions[number], spectrum)
        else:
            for first in self._changed:
                self._sum_again(first, spectrum)
        self._changed = []
        return spectrum

    def _sum_again(self, first, spectrum) -> None:
        """Sum the bands that reach into one that changed, in the order of a sum of all."""
        n_coarse, n_fine = self._sizes
        _clear_bands(first, n_coarse, spectrum)
        for number in sorted(self._contributions):
            folded, start = self._contributions[number]
            # Bins are proportional to the range wavenumber: extremes lie at its ends.
            low, high = sorted((int(start[0] - first[0]), int(start[-1] - first[-1])))
            turn = -((low - n_coarse) // -n_fine) * n_fine  # bands repeat with the grid
            if turn <= high + n_coarse:
                _add_overlap(folded, start, (start - first) % n_fine, spectrum)

    @property
    def _sizes(self) -> tuple[int, int]:
        return self.grid.n_coarse, self.grid.n_fine

    def _first_bins(self, centre_m: float) -> np.ndarray:
        """(range wavenumbers,) int64 where a band begins (Zhang et al., equations 16 and 17)."""
        middle = np.rint(self._wavenumber * (centre_m * self.grid.extent / (2 * math.pi)))
        return middle.astype(np.int64) - self.grid.n_coarse // 2

    def _to_image(self, spectrum, centre_m=0.0, *, overwrite: bool = False) -> np.ndarray:
        grid, workers = self.grid, numba.get_num_threads()
        polar = grid.polar
        by_alpha = scipy.fft.ifft(spectrum, axis=1, workers=workers, overwrite_x=overwrite)
        image = np.empty((polar.n_alpha, polar.n_range), np.complex64)
        # Guards moved the first range; the carrier is referred to that of the wanted grid.
        cycles = 2 * grid.range_guard * polar.range_spacing_m / grid.wavelength_m
        cycles -= 2 * centre_m / grid.wavelength_m * (polar.alpha - polar.alpha_start)
        scale = (grid.n_fine / grid.n_coarse * np.exp(2j * np.pi * np.fmod(cycles, 1.0))
                 ).astype(np.complex64)
        for start in range(0, polar.n_alpha, _LINES_PER_CALL):
            stop = min(start + _LINES_PER_CALL, polar.n_alpha)
            lines = np.zeros((stop - start, self._n_range), np.complex64)
            _transpose_back(by_alpha, grid.fine_guard + start, self._bins % self._n_range,
                            scale[start:stop], lines)
            lines = scipy.fft.ifft(lines, axis=1, workers=workers, overwrite_x=True)
            image[start:stop] = lines[:, grid.range_guard:grid.range_guard + polar.n_range]
        return image


@njit(parallel=True)
def _apply_taper(real, imag, along_alpha, along_range, out):
    for line in numba.prange(real.shape[0]):
        w = along_alpha[line]
        for i in range(real.shape[1]):
            z = real[line, i] + np.complex64(1j) * imag[line, i]
            out[line, i] = (w * along_range[i]) * z


@njit(parallel=True)
def _transpose_bins(by_range, bins, out):
    """``out[b, a] = by_range[a, bins[b]]``, tile by tile."""
    n_bins, n_lines = out.shape
    for tile in numba.prange((n_bins + _BLOCK - 1) // _BLOCK):
        stop = min((tile + 1) * _BLOCK, n_bins)
        for first in range(0, n_lines, _BLOCK):
            last = min(first + _BLOCK, n_lines)
            for b in range(tile * _BLOCK, stop):
                for a in range(first, last):
                    out[b, a] = by_range[a, bins[b]]


@njit(parallel=True)
def _transpose_back(by_alpha, first, bins, scale, out):
    """``out[a, bins[b]] = scale[a] * by_alpha[b, first + a]``, tile by tile."""
    n_lines, n_bins = out.shape[0], by_alpha.shape[0]
    for tile in numba.prange((n_bins + _BLOCK - 1) // _BLOCK):
        stop = min((tile + 1) * _BLOCK, n_bins)
        for begin in range(0, n_lines, _BLOCK):
            for a in range(begin, min(begin + _BLOCK, n_lines)):
                for b in range(tile * _BLOCK, stop):
                    out[a, bins[b]] = scale[a] * by_alpha[b, first + a]


@njit(parallel=True)
def _add_bands(folded, start, spectrum):
    """Bin n of the fine spectrum takes bin n mod n_coarse of the folded one."""
    n_bins, n_coarse = folded.shape
    n_fine = spectrum.shape[1]
    for b in numba.prange(n_bins):
        source, target = start[b] % n_coarse, start[b] % n_fine
        left = n_coarse
        while left > 0:
            count = min(left, min(n_coarse - source, n_fine - target))
            for i in range(count):
                spectrum[b, target + i] += folded[b, source + i]
            left -= count
            source, target = (source + count) % n_coarse, (target + count) % n_fine


@njit(parallel=True)
def _clear_bands(start, n_coarse, spectrum):
    """Set the bins of a band to zero."""
    n_bins, n_fine = spectrum.shape
    for b in numba.prange(n_bins):
        target = start[b] % n_fine
        for i in range(min(n_coarse, n_fine - target)):
            spectrum[b, target + i] = 0.0
        for i in range(n_coarse - (n_fine - target)):
            spectrum[b, i] = 0.0


@njit(parallel=True)
def _add_overlap(folded, start, shift, spectrum):
    """As `_add_bands`, but only bins that belong to a second band, `shift` bins before."""
    n_bins, n_coarse = folded.shape
    n_fine = spectrum.shape[1]
    for b in numba.prange(n_bins):
        # its start lies within the second band, its end does where that one begins, or both
        for part in range(2):
            skip = part * (n_fine - shift[b])
            left = n_coarse - part * n_fine - (1 - 2 * part) * shift[b]
            source, target = (start[b] + skip) % n_coarse, (start[b] + skip) % n_fine
            while left > 0:
                count = min(left, min(n_coarse - source, n_fine - target))
                for i in range(count):
                    spectrum[b, target + i] += folded[b, source + i]
                left -= count
                source, target = (source + count) % n_coarse, (target + count) % n_fine
