"""Azimuth upsampling: images of parts interpolated to the lines of their sum, on the device."""

from __future__ import annotations

import numpy as np

from ...geometry.polar import PolarGrid
from ...planning.exact.polar_image import TAPS, AzimuthParts
from .arrays import cuda, free_bytes, kernel, launch, xp
from .tiles import lines_of_grid

_MOST_BYTES, _SHARE = 1 << 30, 4  # of parts that are merged together, and of the free memory
_RANGES, _LINES, _PIXELS = 32, 8, 4  # threads of a block by axis, and ranges of a thread
_WIDTH = _RANGES * _PIXELS  # ranges of a block
_PARTS, _TAPS = 8, TAPS  # parts whose weights lie in shared memory
_SHARED, _PHASORS = (_PARTS * _LINES * TAPS, _PARTS * _LINES)


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
        size, n_parts = 2 * coarse.n_alpha * coarse.n_range, len(self._parts.echoes)
        at_once = min(_MOST_BYTES, free_bytes() // _SHARE) // (4 * size)
        at_once = max(1, min(n_parts, at_once))
        blocks = -(-fine.n_range // _WIDTH), -(-fine.n_alpha // _LINES)
        for first in range(0, n_parts, at_once):
            numbers = range(first, min(first + at_once, n_parts))
            # blocks read beyond the last range, and use nothing of it
            images = xp.zeros(len(numbers) * size + 2 * _WIDTH, np.float32)
            for k, number in enumerate(numbers):
                form(number, images[k * size:(k + 1) * size])
            launch(merge_parts, blocks, (_RANGES, _LINES), images, coarse.n_alpha,
                   self._phasors(numbers, coarse, -1), self._start, self._weights,
                   self._phasors(numbers, fine, 1), total)

    def _phasors(self, numbers: range, grid: PolarGrid, sign: int):
        """(P, n_alpha) complex64 carrier of each part's band along direction."""
        turn = np.multiply.outer(sign * self._parts.frequency[numbers], grid.alpha)
        return xp.asarray(np.exp(1j * np.fmod(turn, 2 * np.pi)).astype(np.complex64))


@kernel()
def merge_parts(images, n_coarse, down, start, weights, up, total):
    """Add interpolated images of parts to their sum; blocks of `_WIDTH` ranges and some lines.

    Parameters
    ----------
    images, n_coarse : (2 * P * n_alpha_coarse * n_range + 2 * _WIDTH,) float32, int
        Of the parts, real, then imaginary parts of each; n_alpha_coarse.
    down, up : (P, n_alpha_coarse), (P, n_alpha) complex64
        Factors of each coarse line, which take a part's carrier off, and of each fine line.
    start, weights : (n_alpha,) int32, (n_alpha, TAPS) float32
        First coarse line of each fine one, and weights.
    total : (2, n_alpha, n_range) float32
        Sum.
    """
    shared_re = cuda.shared.array(_SHARED, np.float32)
    shared_im = cuda.shared.array(_SHARED, np.float32)
    up_re = cuda.shared.array(_PHASORS, np.float32)
    up_im = cuda.shared.array(_PHASORS, np.float32)
    own_re = cuda.local.array(_TAPS, np.float32)
    own_im = cuda.local.array(_TAPS, np.float32)
    slow_re = cuda.local.array(_PIXELS, np.float32)
    slow_im = cuda.local.array(_PIXELS, np.float32)
    real = cuda.local.array(_PIXELS, np.float32)
    imag = cuda.local.array(_PIXELS, np.float32)
    top, own = cuda.blockIdx.y * _LINES, cuda.threadIdx.y
    thread, n_parts = own * _RANGES + cuda.threadIdx.x, down.shape[0]
    n_lines, n_range = total.shape[1], total.shape[2]
    line, first = min(top + own, n_lines - 1), cuda.blockIdx.x * _WIDTH + cuda.threadIdx.x
    apart, between = np.uint64(n_range), np.uint64(n_coarse * n_range)
    for p in range(_PIXELS):
        real[p], imag[p] = 0.0, 0.0
    for begin in range(0, n_parts, _PARTS):
        n_some = min(_PARTS, n_parts - begin)
        cuda.syncthreads()
        for item in range(thread, n_some * _LINES * _TAPS, _RANGES * _LINES):
            part, there = begin + item // (_LINES * _TAPS), item // _TAPS % _LINES
            k, there = item % _TAPS, min(top + there, n_lines - 1)
            turn, w = down[part, start[there] + k], weights[there, k]
            shared_re[item], shared_im[item] = w * turn.real, w * turn.imag
        for item in range(thread, n_some * _LINES, _RANGES * _LINES):
            turn = up[begin + item // _LINES, min(top + item % _LINES, n_lines - 1)]
            up_re[item], up_im[item] = turn.real, turn.imag
        cuda.syncthreads()
        for number in range(n_some):
            at = np.uint64((2 * (begin + number) * n_coarse + start[line]) * n_range + first)
            item = np.uint64((number * _LINES + own) * _TAPS)
            for p in range(_PIXELS):
                slow_re[p], slow_im[p] = 0.0, 0.0
            for k in range(_TAPS):
                at_k = item + np.uint64(k)
                own_re[k], own_im[k] = shared_re[at_k], shared_im[at_k]
            for k in range(_TAPS):
                cosine, sine = own_re[k], own_im[k]
                for p in range(_PIXELS):
                    # steps from range to range are constants of the instructions
                    re = images[at + np.uint64(p * _RANGES)]
                    im = images[at + between + np.uint64(p * _RANGES)]
                    slow_re[p] += re * cosine
                    slow_re[p] -= im * sine
                    slow_im[p] += re * sine
                    slow_im[p] += im * cosine
                at += apart
            cosine, sine = up_re[number * _LINES + own], up_im[number * _LINES + own]
            for p in range(_PIXELS):
                real[p] += slow_re[p] * cosine - slow_im[p] * sine
                imag[p] += slow_re[p] * sine + slow_im[p] * cosine
    for p in range(_PIXELS):
        i = first + p * _RANGES
        if i < n_range and top + own < n_lines:
            total[0, line, i] += real[p]
            total[1, line, i] += imag[p]
