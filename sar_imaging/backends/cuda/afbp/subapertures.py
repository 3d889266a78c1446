"""Backprojection of one sub-aperture onto its coarse polar grid on the device."""

from __future__ import annotations

import math

import numpy as np

from ....geometry.illumination import Illumination
from ....geometry.polar import PolarGrid
from ....planning.afbp.beam_geometry import BeamGeometry, grid_edges
from ....planning.afbp.beams import CELL_TAPS
from ....planning.afbp.lit_subapertures import node_pulses
from ....planning.afbp.subapertures import SubaperturePlan
from ....planning.exact.polar_image import positions_of
from ....signal.pulses import PulseBlock
from ..arrays import (
    complex_samples,
    given,
    launch,
    on_device,
    reports_failures,
    require_device,
    xp,
)
from ..illumination import Antennas
from ..known import refuse_unknown
from ..lines.lines import line_profiles, polar_lines
from ..profiles import profile_spectra
from ..transfers import to_host
from .beam_kernels import (
    BEAMS,
    THREADS,
    fit_parabolas,
    form_beams,
    interpolate_beams,
    interpolate_lit_beams,
)


class SubapertureImager:
    """Images of the sub-apertures of a plan, see `backends.protocol.SubapertureImager`.

    Images are arrays of the device, unless memory of the host is given for one.

    Raises
    ------
    DeviceError
        There is no device, it fails, or it lacks memory.
    """

    @reports_failures
    def __init__(self, plan: SubaperturePlan):
        require_device()
        refuse_unknown(plan)
        self.plan = plan
        self._lines = _Beams(plan) if plan.beams else polar_lines(
            plan.coarse, line_profiles(plan.source, plan.lattice, plan.range_m),
            lit=plan.lit and plan.lit.lines)

    @reports_failures
    def image(self, number: int, block: PulseBlock, weights=None, out=None):
        """Backproject one sub-aperture, see `backends.protocol.SubapertureImager`."""
        plan = self.plan
        plan.check_block(number, block)
        there = self.project(block.samples, block.tx_m, block.rx_m, weights,
                             plan.illumination_of(block))
        if out is None or on_device(out):
            return given(there)
        out[...] = to_host(there)
        return out

    @reports_failures
    def project(self, samples, tx_m, rx_m, weights=None,
                illumination: Illumination | None = None):
        """The same of samples that may lie on the device, unchecked.

        Parameters
        ----------
        samples : (P, C, N) complex64, or (P, C, N, 2) integer
            Of the pulses of a sub-aperture, of the host or the device.
        tx_m, rx_m : (P, C, 3) float64
            Phase centres, metres.
        weights : (P,) float32, optional
            Window over the pulses.
        illumination : Illumination, optional
            Of the echoes, where the plan has it.
        """
        plan = self.plan
        echoes = complex_samples(samples).reshape(-1, plan.n_samples)
        if weights is not None:
            echoes = echoes * xp.asarray(np.repeat(weights, plan.n_channels))[:, None]
        there = xp.zeros((2, plan.coarse.n_alpha, plan.coarse.n_range), np.float32)
        self._lines.add(echoes, tx_m.reshape(-1, 3), rx_m.reshape(-1, 3), there.reshape(-1),
                        illumination)
        return there


class _Beams:
    """Lines of the coarse grid of a plan, read from the beams of a sub-aperture."""

    def __init__(self, plan: SubaperturePlan):
        source, lattice, sampling = plan.source, plan.lattice, plan.beams
        self._plan, self._edges = plan, grid_edges(plan.coarse)
        n_bins, n_cells = lattice.n_padded, lattice.n_cells
        first = math.floor((plan.range_m[0] - source.range_start_m) / lattice.cell_m) - CELL_TAPS
        self._range_start_m = source.range_start_m + first * lattice.cell_m
        # beyond the profile's ends a period repeats, what was recorded does not
        self._known = (0, n_cells) if source.periodic else tuple(
            min(max(end, 0), n_cells) for end in (-first, n_cells - first))
        number = (np.arange(n_bins) - source.zero + n_bins // 2) % n_bins - n_bins // 2
        # each bin's share is changed beforehand by what reading the cells takes from it
        gain = sampling.range_gain(source.gain(n_bins), number, n_cells)
        turn = np.exp(2j * np.pi * np.fmod(number * (first / n_cells), 1.0))
        self._gain = xp.asarray((gain * turn).astype(np.complex64))
        self._numbers = xp.asarray(number.astype(np.int32))
        self._cycles_per_m = 2 / source.radar.wavelength_m
        self._scales = xp.asarray(np.array([self._cycles_per_m, 1 / (n_cells * lattice.cell_m)]))
        self._table = xp.asarray(np.exp(sampling.between.log_gain).astype(np.float32))
        self._weights = [xp.asarray(v.weights) for v in (sampling.between.interpolator,
                                                         sampling.along)]
        self._lit = plan.lit and _LitLines(plan.coarse, plan.lit.apart * sampling.segment)

    def add(self, samples, tx_m, rx_m, image, illumination: Illumination | None = None) -> None:
        """Image of some echoes at range baseband, (2 * n_alpha * n_range,) float32, in place.

        Raises
        ------
        ValueError
            The plane is too steep below the echoes for their directions to be told apart.
        """
        polar, sampling = self._plan.coarse, self._plan.beams
        geometry = BeamGeometry.of(polar, self._edges, tx_m, rx_m)
        if geometry is None:
            raise ValueError(f'the imaging plane, {polar.z_m:g} m high, is too steep below the '
                             f'phase centres around {tx_m.mean(axis=0).round(2)}; use exact '
                             'backprojection')
        start, spacing, n_beams = sampling.directions(geometry, tx_m, rx_m)
        path = geometry.beam_path(tx_m, rx_m, start + spacing * np.arange(n_beams))
        beams = self._beams(samples, path)
        lit = () if self._lit is None else self._lit.parabolas(
            illumination, geometry, (tx_m, rx_m), start + spacing * np.arange(n_beams),
            self._cycles_per_m)
        self._read(beams, geometry, start, spacing, image.reshape(2, *polar.shape), lit)

    def _beams(self, samples, path):
        """(M, n_cells) complex64 beams at range baseband."""
        source, lattice, between = self._plan.source, self._plan.lattice, self._plan.beams.between
        spectra = profile_spectra(source, samples, lattice.n_padded) * self._gain
        beams = xp.zeros((len(path), lattice.n_cells), np.complex64)
        launch(form_beams, (-(-lattice.n_padded // THREADS), -(-len(path) // BEAMS)), THREADS,
               spectra, xp.asarray(path), xp.asarray(np.gradient(path, axis=0)), self._scales,
               self._numbers, self._table, 1 / between.step, beams)
        beams = xp.fft.ifft(beams, axis=-1, norm='forward').astype(np.complex64, copy=False)
        beams[:, :self._known[0]] = 0.0
        beams[:, self._known[1]:] = 0.0
        return beams

    def _read(self, beams, geometry: BeamGeometry, start: float, spacing: float, image,
              lit: tuple) -> None:
        polar, source, sampling = self._plan.coarse, self._plan.source, self._plan.beams
        centre = geometry.centre_m
        grid = np.array([polar.range_start_m, polar.range_spacing_m, polar.alpha_start,
                         polar.alpha_spacing, polar.height_m ** 2, *polar.track, polar.side,
                         polar.origin_m[0] - centre[0], polar.origin_m[1] - centre[1]])
        # of the formula's e, but for the distance's part; k = 2 pi cycles per metre
        bend = -1 / (2 * 2 * np.pi * self._cycles_per_m * spacing ** 2)
        middle = np.array([centre[2] - polar.z_m, 1 / geometry.range_m, bend,
                           source.phase_range_m])
        scale = np.array([start, spacing, self._range_start_m, self._plan.lattice.cell_m,
                          self._cycles_per_m])
        launch(interpolate_lit_beams if lit else interpolate_beams, (
            -(-polar.n_range // THREADS), polar.n_alpha), THREADS, beams,
               *(xp.asarray(v) for v in (grid, middle, scale)), *self._weights,
               sampling.between.interpolator.first, sampling.along.first, image, *lit)


class _LitLines:
    """Knots of the amplitudes along the lines of a coarse grid, so many pixels apart."""

    def __init__(self, polar: PolarGrid, apart: int):
        self._apart, self._shape = apart, (polar.n_alpha, -(-polar.n_range // apart) + 1)
        positions = positions_of(polar)(np.arange(self._shape[1]) * apart,
                                        np.arange(polar.n_alpha)[:, None])[0]
        self._positions = xp.asarray(np.ascontiguousarray(positions.reshape(-1, 3).T))

    def parabolas(self, illumination: Illumination, geometry: BeamGeometry, echoes, directions,
                  cycles_per_m: float) -> tuple:
        """The last arguments of `interpolate_lit_beams`.

        Parameters
        ----------
        illumination : Illumination
            Of the echoes.
        geometry : BeamGeometry
            Of the sub-aperture.
        echoes : (tx_m, rx_m)
            Phase centres of the echoes, (R, 3) float64 each, metres.
        directions : (M,) float64
            Of the beams.
        cycles_per_m : float
            Carrier phase per metre of half path, cycles.
        """
        nodes, spacing = node_pulses(len(echoes[0])), directions[1] - directions[0]
        slope = geometry.slope(*(c[nodes] for c in echoes), directions)
        antennas = Antennas(illumination.select(nodes))
        found = xp.empty((self._positions.shape[1], 3), np.float32)
        launch(fit_parabolas, -(-len(found) // THREADS), THREADS, antennas.axes, antennas.table,
               antennas.place, self._positions,
               xp.asarray(np.array([*geometry.centre_m, *geometry.polar.track, directions[0],
                                    spacing])),
               xp.asarray(2 * math.pi * cycles_per_m * spacing * slope), found)
        return found.reshape(*self._shape, 3), self._apart
