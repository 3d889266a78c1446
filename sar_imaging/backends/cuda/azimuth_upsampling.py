"""Azimuth upsampling: images of parts interpolated to the lines of their sum, on the device."""

from __future__ import annotations

import math

import numpy as np

from ...geometry.polar import PolarGrid
from ...planning.exact.azimuth_upsampling import TAPS, AzimuthParts
from .arrays import cuda, free_bytes, kernel, launch, xp
from .tiles import lines_of_grid

_MOST_BYTES, _SHARE = 1 << 30, 4  # of parts that are merged together, and of the free memory
_RANGES, _LINES = 32, 8  # of a block of threads
_TAPS = TAPS


class AzimuthUpsampling:
    """Interpolates images of parts to the lines of their sum.

    `backends.reference.upsample_azimuth` has the formula. Several parts are merged at a time.

    Parameters
    ----------
    parts : AzimuthParts
        How the echoes are cut, and the grids.
    lines : slice, optional
        Of the sum, where only some are wanted.

    Attributes
    ----------
    coarse, fine : PolarGrid
        Lines of the parts that are read, and those of the sum.
    read : slice
        The former among those of the parts.
    """

    def __init__(self, parts: AzimuthParts, lines: slice | None = None):
        coarse, fine, interpolator = parts.coarse, parts.fine, parts.interpolator
        v = (fine.alpha - coarse.alpha_start) / coarse.alpha_spacing
        floor = np.clip(np.floor(v), -interpolator.first,
                        coarse.n_alpha - TAPS - interpolator.first)
        powers = (v - floor)[:, None] ** np.arange(len(interpolator.weights))
        weights = powers @ interpolator.weights.astype(np.float64)
        start = (floor + interpolator.first).astype(np.int32)
        self.read = slice(0, coarse.n_alpha)
        if lines is not None:
            start, weights = start[lines], weights[lines]
            read = self.read = slice(int(start[0]), int(start[-1]) + TAPS)
            coarse, fine = lines_of_grid(coarse, read), lines_of_grid(fine, lines)
            start = start - np.int32(read.start)
        self._start = xp.asarray(start)
        self._weights = xp.asarray(weights.astype(np.float32))
        self._parts, self.coarse, self.fine = parts, coarse, fine

    def add_all(self, form, total) -> None:
        """Add the images of all parts to the sum.

        Parameters
        ----------
        form : callable
            ``form(number, image)`` adds a part to its image, (2 * n_alpha_coarse * n_range,)
            float32 array of the device: real, then imaginary part.
        total : (2, n_alpha, n_range) float32 array of the device
            Sum; changed in place.
        """
        coarse, fine = self.coarse, self.fine
        shape, n_parts = (2, coarse.n_alpha, coarse.n_range), len(self._parts.echoes)
        at_once = min(_MOST_BYTES, free_bytes() // _SHARE) // (4 * math.prod(shape))
        at_once = max(1, min(n_parts, at_once))
        blocks = -(-fine.n_range // _RANGES), -(-fine.n_alpha // _LINES)
        for first in range(0, n_parts, at_once):
            numbers = range(first, min(first + at_once, n_parts))
            images = xp.zeros((len(numbers), *shape), np.float32)
            for image, number in zip(images, numbers, strict=True):
                form(number, image.reshape(-1))
            launch(merge_parts, blocks, (_RANGES, _LINES), images,
                   self._phasors(numbers, coarse, -1), self._start, self._weights,
                   self._phasors(numbers, fine, 1), total)

    def _phasors(self, numbers: range, grid: PolarGrid, sign: int):
        """(P, n_alpha) complex64 carrier of each part's band along direction."""
        turn = np.multiply.outer(sign * self._parts.frequency[numbers], grid.alpha)
        return xp.asarray(np.exp(1j * np.fmod(turn, 2 * np.pi)).astype(np.complex64))


@kernel()
def merge_parts(images, down, start, weights, up, total):
    """Add interpolated images of parts to their sum; blocks of ranges and lines.

    Parameters
    ----------
    images : (P, 2, n_alpha_coarse, n_range) float32
        Of the parts.
    down, up : (P, n_alpha_coarse), (P, n_alpha) complex64
        Factors of each coarse line, which take a part's carrier off, and of each fine line.
    start, weights : (n_alpha,) int32, (n_alpha, TAPS) float32
        First coarse line of each fine one, and weights.
    total : (2, n_alpha, n_range) float32
        Sum.
    """
    i = cuda.blockIdx.x * cuda.blockDim.x + cuda.threadIdx.x
    line = cuda.blockIdx.y * cuda.blockDim.y + cuda.threadIdx.y
    if i >= total.shape[2] or line >= total.shape[1]:
        return
    real, imag = np.float32(0.0), np.float32(0.0)
    for part in range(images.shape[0]):
        slow_re, slow_im = np.float32(0.0), np.float32(0.0)
        for k in range(_TAPS):
            coarse = start[line] + k
            turn, w = down[part, coarse], weights[line, k]
            cosine, sine = w * turn.real, w * turn.imag
            re, im = images[part, 0, coarse, i], images[part, 1, coarse, i]
            slow_re += re * cosine - im * sine
            slow_im += re * sine + im * cosine
        cosine, sine = up[part, line].real, up[part, line].imag
        real += slow_re * cosine - slow_im * sine
        imag += slow_re * sine + slow_im * cosine
    total[0, line, i] += real
    total[1, line, i] += imag
