"""Quick images of few pixels, for the many trial geometries of a search."""

from __future__ import annotations

import numpy as np

from ....compilation import njit, numba
from ....signal.radar import RadarParameters
from ..line_kernels import _cos_cycles, _fraction, _sin_cycles

LENGTH = 16  # pixels of a piece of a line


class TrialImages:
    """See `backends.protocol.TrialImages`.

    Paths are quadratic along a piece and profiles linear between samples: good to a tenth or so,
    which is enough to tell a focused image from others.
    """

    length = LENGTH

    def __init__(self, radar: RadarParameters, samples: np.ndarray):
        self._radar = radar
        echoes = samples.reshape(-1, samples.shape[-1])
        planes = np.zeros((2, len(echoes), echoes.shape[1] + 3), np.float32)  # with zeros around
        planes[0, :, 1:-2], planes[1, :, 1:-2] = echoes.real, echoes.imag
        self._planes = planes.reshape(2, -1)

    def image(self, tx_m: np.ndarray, rx_m: np.ndarray, starts_m: np.ndarray,
              step_m: np.ndarray, range_bias_m: float = 0.0) -> np.ndarray:
        """See `backends.protocol.TrialImages.image`."""
        out, radar = np.zeros((2, len(starts_m) * LENGTH), np.float32), self._radar
        tx_m, rx_m = (np.ascontiguousarray(c).reshape(-1, 3) for c in (tx_m, rx_m))
        add_pieces(*self._planes, tx_m, rx_m, starts_m, step_m,
                   radar.range_start_m - radar.sample_spacing_m - range_bias_m,
                   radar.sample_spacing_m, radar.wavelength_m, *out)
        return out.reshape(2, -1, LENGTH)


@njit(parallel=True)
def add_pieces(real, imag, tx, rx, starts, direction, range_start, spacing, wavelength, out_re,
               out_im):
    """Backproject profiles onto short pieces of lines, see `TrialImages`.

    Profiles of the echoes, `real` and `imag`, (R * N,) float32, begin with a zero and end with
    two. Half path of sample 0 and between samples, and the wavelength, are metres. `out_re` and
    `out_im`, (K * `LENGTH`,) float32, are zero before, and changed in place.
    """
    n_echoes, n = len(tx), len(real) // len(tx)
    half, last = LENGTH // 2, np.float32(n - 2)
    one, turns = np.uint64(1), 2.0 / wavelength
    index = (np.arange(LENGTH) - half).astype(np.float32)
    for k in numba.prange(len(starts)):
        to = np.uint64(k * LENGTH)
        for echo in range(n_echoes):
            a = _half_path(starts, k, direction, 0.0, tx, rx, echo)
            b = _half_path(starts, k, direction, 1.0 * half, tx, rx, echo)
            c = _half_path(starts, k, direction, 1.0 * LENGTH, tx, rx, echo)
            slope, bend = (c - a) / LENGTH, (c - 2 * b + a) / (2 * half * half)
            p0 = np.float32(min(max((b - range_start) / spacing, -1e6), 1e6))
            p1, p2 = np.float32(slope / spacing), np.float32(bend / spacing)
            cycles = b * turns
            c0 = np.float32(cycles - np.floor(cycles))
            c1, c2 = np.float32(slope * turns), np.float32(bend * turns)
            base = np.uint64(echo * n)
            for i in range(np.uint64(LENGTH)):
                f = index[i]
                place = min(max(p0 + f * (p1 + f * p2), np.float32(0.0)), last)
                cell = np.int32(place)
                t = place - np.float32(cell)
                j = base + np.uint64(cell)
                re, im = real[j], imag[j]
                re += t * (real[j + one] - re)
                im += t * (imag[j + one] - im)
                g = _fraction(c0 + f * (c1 + f * c2))
                sine, cosine = _sin_cycles(g, g * g), _cos_cycles(g * g)
                out_re[to + i] += re * cosine - im * sine
                out_im[to + i] += re * sine + im * cosine


@njit(inline='always')
def _half_path(starts, k, direction, steps, tx, rx, echo):
    x = starts[k, 0] + steps * direction[0]
    y = starts[k, 1] + steps * direction[1]
    z = starts[k, 2] + steps * direction[2]
    return 0.5 * (
        np.sqrt((x - tx[echo, 0]) ** 2 + (y - tx[echo, 1]) ** 2 + (z - tx[echo, 2]) ** 2)
        + np.sqrt((x - rx[echo, 0]) ** 2 + (y - rx[echo, 1]) ** 2 + (z - rx[echo, 2]) ** 2))
