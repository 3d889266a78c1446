"""Image lines to which range profiles are added: their geometry on the device."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ....geometry.illumination import Illumination
from ....geometry.polar import PolarGrid
from ....planning.exact.illumination import LINES, LitLines, knot_positions
from ....planning.profiles import PhaseHistory, RangeGate, RangeResampling
from ..arrays import launch, pairs, xp
from ..illumination import Antennas
from ..profiles import Profiles
from ..transfers import in_pieces
from .kernels import ECHOES, FOLD, THREADS, add_lines, add_lit_lines, block_lines


class Lines:
    """Lines of one size along which range grows, prepared for adding any number of echoes.

    Parameters
    ----------
    profiles : Profiles
        That they read, with segments, in blocks of `kernels.FOLD`.
    layers : sequence of (callable, (5,) int64)
        What tells positions, ``locate(pixel, line)``: position and first to third derivative by
        the pixel number, each (..., 3) float64, metres, for broadcast numbers. Where the lines
        lie in the image: their number, the first pixel's real part, the steps to the next line,
        to the next pixel, and to the imaginary part.
    n_pixels : int
        Of a line.
    ramp : (n_pixels,) complex64
        Factor of each pixel of a line: the carrier phase that all lines share.
    lit : LitLines, optional
        Knots of the echoes' amplitudes.
    rows : slice, optional
        Which lines they are, of so many as `locate` knows, if not all; and these.
    n_lines : int
    """

    def __init__(self, profiles: Profiles, layers, n_pixels: int, ramp: np.ndarray,
                 lit: LitLines | None = None, rows: slice | None = None, n_lines: int = 0):
        self.profiles, segment = profiles, profiles.lattice.segment
        self._n_lines, self._ramp = int(layers[0][1][0]), xp.asarray(ramp)
        rows, n_lines = rows or slice(0, self._n_lines), n_lines or self._n_lines
        self._layers = [(xp.asarray(segment_middles(locate, rows, n_pixels, segment)),
                         xp.asarray(np.asarray(layout, np.int64))) for locate, layout in layers]
        self._knots = [None if lit is None else _Knots(locate, rows, n_lines, n_pixels, segment,
                                                      lit.apart) for locate, _ in layers]

    def add(self, samples, tx_m, rx_m, image, illumination: Illumination | None = None) -> None:
        """Add echoes to an image.

        Parameters
        ----------
        samples : (R, N) complex64 or (R, N, 2) integer
            Profiles of the echoes, of the host or of the device.
        tx_m, rx_m : (R, 3) float64
            Their phase centres, metres.
        image : (K,) float32 array of the device
            Real and imaginary parts of the image to add to.
        illumination : Illumination, optional
            Of the echoes, where lines are lit.
        """
        profiles, lattice = self.profiles, self.profiles.lattice
        segment = lattice.segment
        blocks = -(-len(self._ramp) // segment), -(-self._n_lines // block_lines(segment))
        centres = xp.asarray(np.concatenate([tx_m, rx_m], axis=1))
        antennas = illumination and Antennas(illumination)
        n_bytes = max(0 if knots is None else knots.echo_bytes for knots in self._knots)
        for echoes, some in in_pieces(samples, profiles.chunks(len(samples), ECHOES, n_bytes)):
            planes = profiles.planes(some)
            for (lines, layout), knots in zip(self._layers, self._knots, strict=True):
                given = (pairs(planes), lattice.n_phases, profiles.n_cells, segment,
                         centres[echoes], lines, profiles.range_at(segment), lattice.step_m,
                         profiles.cycles_per_step, profiles.cycles_at(segment), self._ramp, image,
                         layout)
                if knots is None:
                    launch(add_lines, blocks, THREADS, *given)
                else:
                    launch(add_lit_lines, blocks, THREADS, *given,
                           antennas.at_knots(knots.positions, echoes), *knots.places)


class _Knots:
    """Where amplitudes of echoes are found over some lines of a layer.

    Arguments are as of `Lines` and `knot_positions`.

    Attributes
    ----------
    positions : (3, K) float64 array of the device
        Metres.
    places : tuple
        The last arguments of `add_lit_lines`.
    echo_bytes : int
        Memory that the amplitudes of an echo take.
    """

    def __init__(self, locate: Callable, rows: slice, n_lines: int, n_pixels: int, segment: int,
                 apart: int):
        positions, _, between = knot_positions(locate, n_lines, n_pixels, segment, apart)
        group = rows.start // LINES
        self.positions = xp.asarray(np.ascontiguousarray(
            positions[:, group:-(-rows.stop // LINES)]).reshape(3, -1))
        self.places = (xp.asarray(between.reshape(-1)[rows].copy()), apart,
                       rows.start - group * LINES)
        self.echo_bytes = 4 * self.positions.shape[1]


def segment_middles(locate: Callable, rows: slice, n_pixels: int, segment: int) -> np.ndarray:
    """(S, 12, n_lines) float64 positions and derivatives in the middle of the segments of lines.

    `locate` and `rows` are as of `Lines`.
    """
    middle = np.arange(-(-n_pixels // segment)) * segment + segment // 2
    found = np.concatenate(locate(middle[:, None], np.arange(rows.start, rows.stop)), axis=-1)
    return np.ascontiguousarray(found.transpose(0, 2, 1))


def line_profiles(source: RangeGate | PhaseHistory, lattice: RangeResampling,
                  range_m: tuple[float, float]) -> Profiles:
    """Profiles as lines read them, see `Profiles`."""
    return Profiles(source, lattice, range_m, FOLD)


def polar_lines(polar: PolarGrid, profiles: Profiles, rows: slice | None = None,
                lit: LitLines | None = None) -> Lines:
    """Lines of a polar image at range baseband, (2, n, n_range) float32, or n `rows` of them.

    Their sum is that of `backends.reference.project_lines`.
    """
    rows = rows or slice(0, polar.n_alpha)
    n_lines, width = rows.stop - rows.start, polar.n_range
    cycles = 2 * (profiles.lattice.cell_m - polar.range_spacing_m) / profiles.wavelength_m
    layout = n_lines, 0, width, 1, n_lines * width
    return Lines(profiles, [(polar.locate, layout)], width, ramp(cycles, width), lit, rows,
                 polar.n_alpha)


def ramp(cycles: float, n: int) -> np.ndarray:
    """(n,) complex64 phasor that turns by so many cycles from pixel to pixel."""
    return np.exp(2j * np.pi * np.fmod(cycles * np.arange(n), 1.0)).astype(np.complex64)
