"""Phasors of echoes along segments of image lines: as the kernel expands them, and as they are.

Along a segment a phasor is a cubic in the pixel number, less what all echoes of a pass share, and
the amplitude a parabola; of the product the cubic is kept. What that leaves out is computed here
pair by pair of an echo and a pixel, since it is the largest where amplitudes are.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

import numpy as np

from ...geometry.half_paths import pair_lengths, pair_paths
from ...geometry.polar import PolarGrid
from ...signal.radar import RadarParameters
from ..lit_pairs import LitPairs
from ..profiles.range_resampling import RangeResampling, middle_of_pass
from .grid_lines import GridLines


@dataclasses.dataclass(frozen=True, eq=False)
class ImageLines:
    """Lines of an image, as pairs of an echo and a pixel are looked up.

    Attributes
    ----------
    locate : callable
        ``locate(pixel, line)`` gives positions (..., 3), metres, and their first derivatives by
        the pixel number.
    positions : callable
        ``positions(line, pixel)`` gives positions alone.
    n_lines, n_pixels : int
        Size of the image.
    flat : bool
        They lie side by side on a plane.
    """

    locate: Callable
    positions: Callable
    n_lines: int
    n_pixels: int
    flat: bool = True

    @classmethod
    def of_polar(cls, polar: PolarGrid) -> ImageLines:
        """Lines of a polar image."""
        return cls(polar.locate, polar.positions, *polar.shape)

    @classmethod
    def of_grid(cls, lines: GridLines) -> ImageLines:
        """Lines of a map or plane, or of the middle layer of a volume."""
        locate = lines.locate(len(lines.layouts) // 2)
        return cls(locate, lambda line, pixel: locate(pixel, line)[0], lines.n_lines,
                   lines.n_pixels, lines.layers_together == 1)


@dataclasses.dataclass(frozen=True, eq=False)
class Echoes:
    """Echoes that are added in passes.

    Attributes
    ----------
    tx_m, rx_m : (R, 3) float64
        Phase centres, metres.
    starts : tuple of int
        First echo of each part that is added by itself.
    radar : RadarParameters
        Of their profiles.
    """

    tx_m: np.ndarray
    rx_m: np.ndarray
    starts: tuple[int, ...]
    radar: RadarParameters


class SegmentPhasors:
    """Phasors of pairs along segments of one length.

    Parameters
    ----------
    pairs : LitPairs
        Of the lines and echoes.
    lines : ImageLines
        Of the image.
    echoes : Echoes
        Whose phasors they are.
    lattice : RangeResampling
        How the lines read the profiles.

    Attributes
    ----------
    drift : (n,) float64
        How far the pixels drift over half a segment, lattice steps.
    squares : (n,) float64
        Squared error by the expansion of path and phasor alone.
    """

    def __init__(self, pairs: LitPairs, lines: ImageLines, echoes: Echoes,
                 lattice: RangeResampling):
        line, pixel = pairs.index
        half, radar = lattice.segment // 2, echoes.radar
        middle = pixel // lattice.segment * lattice.segment + half
        numbers = pairs.echoes, middle_of_pass(pairs.echoes, echoes.starts, len(echoes.tx_m))
        at = lines.locate(middle, line)
        path, shared = (pair_paths(echoes.tx_m[n], echoes.rx_m[n], at) for n in numbers)
        length = pair_lengths(echoes.tx_m[pairs.echoes], echoes.rx_m[pairs.echoes],
                              pairs.points_m)
        self._place, self._half, k = pixel - middle, half, radar.wavenumber_rad_per_m
        f, away = self._place, length - path[0]
        self.drift = np.abs(path[1] - lattice.cell_m) * (half / lattice.step_m)
        a, b, c = (k * (path[n] - shared[n]) / math.factorial(n) for n in (1, 2, 3))
        self._cubic = _economised(a, b, c, half)
        self._exact = np.exp(1j * k * (away - f * (
            shared[1] + f * (shared[2] / 2 + f * shared[3] / 6))))
        # The envelope is read where a parabola leads.
        beside = radar.half_band_rad_per_m / math.sqrt(3) * (
            away - f * (path[1] + f * path[2] / 2))
        self._beside = (pairs.amplitude * beside) ** 2
        self._true = pairs.amplitude * self._exact
        self.squares = self._beside + pairs.amplitude ** 2 * np.abs(
            _polynomial(self._cubic, f) - self._exact) ** 2

    def lit_squares(self, values) -> np.ndarray:
        """(n,) squared errors with amplitudes (n, 3) at the ends and in the middle of segments."""
        f, half, cubic = self._place, self._half, self._cubic
        w0 = values[:, 1]
        w1 = 0.5 * (values[:, 2] - values[:, 0]) / half
        w2 = (0.5 * (values[:, 2] + values[:, 0]) - w0) / half ** 2
        quartic = cubic[3] * w1 + cubic[2] * w2
        product = (cubic[0] * w0 - half ** 4 / 8 * quartic, cubic[1] * w0 + cubic[0] * w1,
                   cubic[2] * w0 + cubic[1] * w1 + cubic[0] * w2 + half ** 2 * quartic,
                   cubic[3] * w0 + cubic[2] * w1 + cubic[1] * w2)
        return self._beside + np.abs(_polynomial(product, f) - self._true) ** 2


def _economised(a, b, c, half: int) -> tuple[np.ndarray, ...]:
    """Cubic of ``exp(j (a f + b f^2 + c f^3))`` over `half` pixels on either side."""
    quartic = a ** 4 / 24 - b ** 2 / 2 - a * c - 0.5j * a ** 2 * b
    return (1 - half ** 4 / 8 * quartic, 1j * a, half ** 2 * quartic - a ** 2 / 2 + 1j * b,
            -a * b + 1j * (c - a ** 3 / 6))


def _polynomial(coefficients, f) -> np.ndarray:
    c0, c1, c2, c3 = coefficients
    return c0 + f * (c1 + f * (c2 + f * c3))
