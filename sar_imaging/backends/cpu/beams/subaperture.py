"""Sub-aperture images by way of beams, where direct backprojection would read each pulse per line.

Seen from its own middle the echoes of a short sub-aperture differ by little more than a delay that
depends on direction alone: a beam is their sum with the delays of one direction, taken exactly,
bin by bin of the spectrum. A few beams, no more than the sub-aperture can resolve, hold the image;
the lines of the unified polar grid, whose coordinates bend away from the sub-aperture's own, are
interpolated from them.
"""

from __future__ import annotations

import math

import numpy as np

from ....compilation import numba
from ....planning.afbp.beam_gain import DEGREE, bins_per_run
from ....planning.afbp.beam_geometry import grid_edges
from ....planning.afbp.lit_subapertures import AmplitudeNodes
from ....planning.afbp.subapertures import SubaperturePlan
from ..fft.rows import transform_rows
from ..lines import segment_middles
from ..memory import WorkSpace
from ..profiles import spectra
from ..threads import job_counter
from . import interpolation as reading
from .accumulation import CELL_TAPS
from .forming import SpectrumBins, form_beams
from .lit_lines import LitLines
from .paths import CompiledBeamGeometry

_PAGE, _STRIDE = 512, 40  # complex samples


class BeamformedSubaperture:
    """Lines of the coarse grid of a plan, filled from the beams of a sub-aperture."""

    def __init__(self, plan: SubaperturePlan):
        polar, source, lattice, sampling = plan.coarse, plan.source, plan.lattice, plan.beams
        self._polar, self._source, self._lattice, self._sampling = polar, source, lattice, sampling
        self._buffer = WorkSpace()
        first = math.floor((plan.range_m[0] - source.range_start_m) / lattice.cell_m) - CELL_TAPS
        self._range_start_m = source.range_start_m + first * lattice.cell_m
        # Beyond the profile's ends a period repeats, what was recorded does not.
        n_cells = lattice.n_cells
        self._known = (0, n_cells) if source.periodic else tuple(
            min(max(end, 0), n_cells) for end in (-first, n_cells - first))
        gain = source.gain(lattice.n_padded)
        n_bins, per_bin = len(gain), 1 / (n_cells * lattice.cell_m)
        self._per_metre = 2 / source.radar.wavelength_m
        number = (np.arange(n_bins) - source.zero + n_bins // 2) % n_bins - n_bins // 2
        # Each bin's share is changed beforehand by what reading the cells takes from it.
        gain = sampling.range_gain(gain, number, n_cells)
        shift = np.fmod(number * (first / n_cells), 1.0)
        self._bins = SpectrumBins.of(
            gain * np.exp(2j * np.pi * shift), np.array([self._per_metre, per_bin]), source.zero,
            n_cells, bins_per_run(n_bins, n_bins * per_bin / self._per_metre))
        self._lines = segment_middles(polar.locate, np.arange(polar.n_alpha),
                                      polar.n_range, sampling.segment)
        self._edges = grid_edges(polar)
        self._lit = plan.lit and LitLines(polar, plan.lit.apart * sampling.segment)
        self._lit_apart = 0 if plan.lit is None else plan.lit.apart

    def fill(self, samples, tx_m, rx_m, image, weights=None,
             nodes: tuple[AmplitudeNodes, ...] | None = None) -> None:
        """Image of some echoes at range baseband; the arguments are those of `PolarLines.fill`.

        But for `nodes`, of each image that makes this one, in place of an illumination.

        Raises
        ------
        ValueError
            The plane is too steep below the echoes for their directions to be told apart.
        """
        n = len(nodes) if nodes else 1
        for part in range(n):
            some = slice(part, None, n)
            to = self._buffer('part', image.shape, np.float32) if part else image
            self._fill(np.ascontiguousarray(samples[some]), tx_m[some], rx_m[some], to,
                       weights if weights is None else weights[some], nodes and nodes[part])
            if part:
                image += to

    def _fill(self, samples, tx_m, rx_m, image, weights, nodes: AmplitudeNodes | None) -> None:
        geometry = CompiledBeamGeometry.of(self._polar, self._edges, tx_m, rx_m)
        if geometry is None:
            raise ValueError(f'the imaging plane, {self._polar.z_m:g} m high, is too steep below '
                             f'the phase centres around {tx_m.mean(axis=0).round(2)}; use exact '
                             'backprojection')
        start, spacing, n_beams = self._sampling.directions(geometry, tx_m, rx_m)
        directions = start + spacing * np.arange(n_beams)
        paired = geometry.uneven(tx_m, rx_m) < self._sampling.uneven_m
        beams = self._beams(samples, geometry.beam_path(tx_m, rx_m, directions), paired, weights)
        lit = self._lit and self._lit.parabolas(nodes, geometry,
                                                2 * math.pi * self._per_metre * spacing)
        self._read(beams, geometry, start, spacing, image, lit)

    def _beams(self, samples, path, paired, weights) -> np.ndarray:
        """(M, n_cells) complex64 beams at range baseband, valid until the next call."""
        n_beams, n_cells = len(path), self._lattice.n_cells
        group = self._sampling.group_of(n_beams)
        spectrum = spectra(self._source, samples, self._lattice.n_padded, self._buffer)
        stride = _uncrowded(n_cells + reading.TILE)
        beams = self._buffer('beams', (n_beams, stride), np.complex64)
        form_beams(spectrum, path, self._bins, self._sampling.between, weights, group, paired,
                   beams, self._buffer)
        transform_rows(beams[:, :n_cells], inverse=True)
        beams[:, :self._known[0]] = 0.0
        beams[:, self._known[1]:] = 0.0
        return beams

    def _read(self, beams, geometry, start, spacing, image, lit) -> None:
        polar, sampling, source = self._polar, self._sampling, self._source
        segment = sampling.segment
        cycles_per_m = self._per_metre
        # Half the curvature and twice the weight of the second order cancel.
        bend = -1 / (2 * np.pi * cycles_per_m * spacing ** 2)
        index = np.arange(reading.summed_cells(segment), dtype=np.float32) - segment // 2
        size = numba.get_num_threads() * reading.work_size(segment)
        work, jobs = self._buffer('read', (size,), np.float32), job_counter()
        reading.interpolate_beams(
            beams.reshape(-1).view(np.float32), (*beams.shape, *image.shape[1:], segment),
            self._lines, geometry.centre_m, np.array(polar.track),
            np.array([self._range_start_m, self._lattice.cell_m, polar.range_spacing_m]),
            np.array([start, spacing]), cycles_per_m, -cycles_per_m * source.phase_range_m,
            np.array([1 / geometry.range_m, bend]), _table(sampling.between.interpolator),
            _table(sampling.along), index, image.reshape(-1), work,
            jobs.ctypes.data, lit, self._lit_apart)


def _uncrowded(n_cells: int) -> int:
    """Cells between beams, so that neighbours do not compete for the same lines of the cache."""
    return n_cells + (_STRIDE - n_cells) % _PAGE


def _table(interpolator) -> np.ndarray:
    weights = np.zeros((DEGREE + 1, reading.STORED), np.float32)
    weights[:, :interpolator.weights.shape[1]] = interpolator.weights
    return weights
