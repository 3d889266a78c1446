"""Geometry of image lines to which range profiles are added."""

from __future__ import annotations

import numpy as np

from ...geometry.illumination import Illumination
from ...geometry.polar import PolarGrid
from ...planning.exact.lit_lines import LitLines, knot_positions
from .illumination import LitEchoes
from .line_kernels import LINES, project_lines
from .lit.tiles import LitTiles
from .profiles import Profiles


def line_middles(locate, n_lines: int, n_pixels: int, segment: int) -> np.ndarray:
    """Geometry of image lines as `project_lines` wants it.

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
    line = np.minimum(np.arange(-(-n_lines // LINES) * LINES), n_lines - 1)
    middles = segment_middles(locate, line, n_pixels, segment)
    middles = middles.reshape(len(middles), -1, LINES, 12)
    return np.ascontiguousarray(middles.transpose(1, 0, 3, 2))


def segment_middles(locate, line, n_pixels: int, segment: int) -> np.ndarray:
    """(S, n, 12) float64 positions and derivatives in the middle of the segments of n lines."""
    middle = np.arange(-(-n_pixels // segment)) * segment + segment // 2
    return np.concatenate(locate(middle[:, None], line), axis=-1)


class PolarLines:
    """Lines of a polar grid, prepared for adding any number of echoes.

    Cells of the profiles are about as long as the range spacing of the grid.
    """

    def __init__(self, polar: PolarGrid, profiles: Profiles, lit: LitLines | None = None):
        lattice = profiles.lattice
        self._polar, self._profiles = polar, profiles
        size = polar.n_alpha, polar.n_range, lattice.segment
        self._lines = line_middles(polar.locate, *size)
        self._knots = lit and knot_positions(polar.locate, *size, lit.apart)
        # from the phase that the kernel leaves to range baseband
        cycles = 2 * (lattice.cell_m - polar.range_spacing_m) / profiles.radar.wavelength_m
        self._ramp = _phasor(cycles * np.arange(polar.n_range))

    def add(self, samples, tx_m, rx_m, image, illumination: Illumination | None = None) -> None:
        """Add echoes to an image at range baseband.

        Parameters
        ----------
        samples, tx_m, rx_m :
            As for `project_lines`.
        image : (2, n_alpha, n_range or more) float32
            Real and imaginary part of the image times ``exp(-j 4 pi (r - r_0) / lambda)``, r_0
            the first range; changed in place, contiguous. Lines may end in padding.
        illumination : Illumination, optional
            Of the echoes, where lines are lit.
        """
        polar = self._polar
        layout = np.array([polar.n_alpha, 0, image.shape[-1], 1, image[0].size])
        project_lines(self._profiles, samples, tx_m, rx_m, [(self._lines, layout)], self._ramp,
                      image.reshape(-1), self._knots and [LitTiles(LitEchoes.of(illumination),
                                                                   *self._knots)])

    def fill(self, samples, tx_m, rx_m, image, weights=None,
             illumination: Illumination | None = None) -> None:
        """Image of echoes with weights, (R,) float32; otherwise as `add`."""
        image[:] = 0.0
        if weights is not None:
            samples = samples * weights[:, None]
        self.add(samples, tx_m, rx_m, image, illumination)


def shared_phase(profiles: Profiles, n_pixels: int) -> np.ndarray:
    """(n_pixels,) complex64 carrier phase that all lines of an image share."""
    cycles = profiles.cycles_per_step * profiles.lattice.n_phases * np.arange(n_pixels)
    return _phasor(cycles)


def _phasor(cycles) -> np.ndarray:
    return np.exp(2j * np.pi * np.fmod(cycles, 1.0)).astype(np.complex64)
