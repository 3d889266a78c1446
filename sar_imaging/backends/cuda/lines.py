"""Image lines to which range profiles are added: their geometry on the device."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ...geometry.polar import PolarGrid
from ...planning.profiles.phase_history import PhaseHistory
from ...planning.profiles.range_gate import RangeGate
from ...planning.profiles.range_resampling import RangeResampling
from .arrays import launch, pairs, xp
from .line_kernels import ECHOES, FOLD, THREADS, add_lines, block_lines
from .profiles import Profiles
from .transfers import in_pieces


class Lines:
    """Lines of one size along which range grows, prepared for adding any number of echoes.

    Parameters
    ----------
    profiles : Profiles
        That they read, with segments, in blocks of `line_kernels.FOLD`.
    layers : sequence of (callable, (5,) int64)
        What tells positions, ``locate(pixel, line)``: position and first to third derivative by
        the pixel number, each (..., 3) float64, metres, for broadcast numbers. Where the lines
        lie in the image: their number, the first pixel's real part, the steps to the next line,
        to the next pixel, and to the imaginary part.
    n_pixels : int
        Of a line.
    ramp : (n_pixels,) complex64
        Factor of each pixel of a line: the carrier phase that all lines share.
    """

    def __init__(self, profiles: Profiles, layers, n_pixels: int, ramp: np.ndarray):
        self.profiles, segment = profiles, profiles.lattice.segment
        self._layers = [(xp.asarray(segment_middles(locate, layout[0], n_pixels, segment)),
                         xp.asarray(np.asarray(layout, np.int64))) for locate, layout in layers]
        self._n_lines, self._ramp = int(layers[0][1][0]), xp.asarray(ramp)

    def add(self, samples, tx_m, rx_m, image) -> None:
        """Add echoes to an image.

        Parameters
        ----------
        samples : (R, N) complex64 or (R, N, 2) integer
            Profiles of the echoes, of the host or of the device.
        tx_m, rx_m : (R, 3) float64
            Their phase centres, metres.
        image : (K,) float32 array of the device
            Real and imaginary parts of the image to add to.
        """
        profiles, lattice = self.profiles, self.profiles.lattice
        segment = lattice.segment
        blocks = -(-len(self._ramp) // segment), -(-self._n_lines // block_lines(segment))
        centres = xp.asarray(np.concatenate([tx_m, rx_m], axis=1))
        for echoes, some in in_pieces(samples, profiles.chunks(len(samples), ECHOES)):
            planes = profiles.planes(some)
            for lines, layout in self._layers:
                launch(add_lines, blocks, THREADS, pairs(planes), lattice.n_phases,
                       profiles.n_cells, segment, centres[echoes], lines,
                       profiles.range_at(segment), lattice.step_m, profiles.cycles_per_step,
                       profiles.cycles_at(segment), self._ramp, image, layout)


def segment_middles(locate: Callable, n_lines: int, n_pixels: int, segment: int) -> np.ndarray:
    """(S, 12, n_lines) float64 positions and derivatives in the middle of the segments of lines.

    `locate` is as of `Lines`.
    """
    middle = np.arange(-(-n_pixels // segment)) * segment + segment // 2
    found = np.concatenate(locate(middle[:, None], np.arange(n_lines)), axis=-1)
    return np.ascontiguousarray(found.transpose(0, 2, 1))


def line_profiles(source: RangeGate | PhaseHistory, lattice: RangeResampling,
                  range_m: tuple[float, float]) -> Profiles:
    """Profiles as lines read them, see `Profiles`."""
    return Profiles(source, lattice, range_m, FOLD)


def polar_lines(polar: PolarGrid, profiles: Profiles, width: int | None = None) -> Lines:
    """Lines of a polar image at range baseband, (2, n_alpha, width) float32.

    Their sum is that of `backends.reference.project_lines`. Lines may end in padding.
    """
    width = polar.n_range if width is None else width
    cycles = 2 * (profiles.lattice.cell_m - polar.range_spacing_m) / profiles.wavelength_m
    layout = polar.n_alpha, 0, width, 1, polar.n_alpha * width

    def locate(pixel, line):
        derivatives = polar.lines(polar.range_start_m + polar.range_spacing_m * pixel,
                                  polar.alpha_start + polar.alpha_spacing * line)
        return [d * polar.range_spacing_m ** order for order, d in enumerate(derivatives[:4])]

    return Lines(profiles, [(locate, layout)], polar.n_range, ramp(cycles, polar.n_range))


def ramp(cycles: float, n: int) -> np.ndarray:
    """(n,) complex64 phasor that turns by so many cycles from pixel to pixel."""
    return np.exp(2j * np.pi * np.fmod(cycles * np.arange(n), 1.0)).astype(np.complex64)
