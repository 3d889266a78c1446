"""Images of sub-apertures from their beams on the device, several in one launch of each kernel."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ....geometry.illumination import Illumination
from ....geometry.polar import PolarGrid
from ....planning.afbp.beams import CELL_TAPS, BeamGeometry, grid_edges
from ....planning.afbp.lit_subapertures import AmplitudeNodes
from ....planning.afbp.subapertures import SubaperturePlan
from ..arrays import launch, pairs, xp
from ..illumination import Antennas
from ..profiles import profile_spectra
from .forming import (
    BEAMS,
    SPACING,
    START,
    beam_paths,
    form_beams,
    form_single_beams,
)
from .reading import fit_parabolas, interpolate_beams, interpolate_lit_beams

_THREADS = 128
_KEPT = 1024  # sub-apertures whose geometry is kept for the next image


class Beams:
    """Lines of the coarse grid of a plan, read from the beams of sub-apertures."""

    def __init__(self, plan: SubaperturePlan):
        source, lattice, sampling, polar = plan.source, plan.lattice, plan.beams, plan.coarse
        self._plan, self._edges, self._geometries = plan, grid_edges(polar), {}
        n_bins, n_cells = lattice.n_padded, lattice.n_cells
        first = math.floor((plan.range_m[0] - source.range_start_m) / lattice.cell_m) - CELL_TAPS
        # beyond the profile's ends a period repeats, what was recorded does not
        self._known = (0, n_cells) if source.periodic else tuple(
            min(max(end, 0), n_cells) for end in (-first, n_cells - first))
        number = (np.arange(n_bins) - source.zero + n_bins // 2) % n_bins - n_bins // 2
        # each bin's share is changed beforehand by what reading the cells takes from it
        gain = sampling.range_gain(source.gain(n_bins), number, n_cells)
        turn = np.exp(2j * np.pi * np.fmod(number * (first / n_cells), 1.0))
        self._gain = xp.asarray((gain * turn).astype(np.complex64))
        self._cycles_per_m = 2 / source.radar.wavelength_m
        self._scales = xp.asarray(np.array([self._cycles_per_m, 1 / (n_cells * lattice.cell_m)]))
        self._track = xp.asarray(np.array([*polar.track, *polar.across]))
        self._grid = xp.asarray(np.array([
            polar.range_start_m, polar.range_spacing_m, polar.alpha_start, polar.alpha_spacing,
            polar.height_m ** 2, *polar.track, polar.side, *polar.origin_m[:2],
            source.range_start_m + first * lattice.cell_m, lattice.cell_m, self._cycles_per_m,
            source.phase_range_m]))
        self._table = xp.asarray(np.exp(sampling.between.log_gain).astype(np.float32))
        self._weights = [xp.asarray(v.weights) for v in (sampling.between.interpolator,
                                                         sampling.along)]
        self._lit = plan.lit and _LitLines(polar, plan.lit.apart * sampling.segment)
        # neighbours that may share phases, as the processor's do
        self._form = form_beams if sampling.group >= BEAMS else form_single_beams

    @property
    def image_bytes(self) -> int:
        """Memory that a sub-aperture takes besides its echoes, with transforms."""
        plan, coarse = self._plan, self._plan.coarse
        n_beams = plan.beams.n_beams(coarse.n_alpha * coarse.alpha_spacing)
        return int(8 * (3 * n_beams * plan.lattice.n_cells + coarse.n_alpha * coarse.n_range))

    def images(self, samples, weights, pieces: Sequence[slice], tx_m, rx_m,
               nodes: Sequence[AmplitudeNodes | None]):
        """Images of some sub-apertures at range baseband.

        Parameters
        ----------
        samples : (R, N) complex64 array of the device
            Profiles, or phase histories.
        weights : (R,) float32 array of the device
            Window over the echoes.
        pieces : sequence of slice
            Echoes of each sub-aperture.
        tx_m, rx_m : (R, 3) float64
            Phase centres, metres.
        nodes : sequence of AmplitudeNodes or None
            Of each, where the plan has illumination.

        Returns
        -------
        (G, 2, n_alpha, n_range) float32 array of the device

        Raises
        ------
        ValueError
            The plane is too steep below the echoes for their directions to be told apart.
        """
        polar = self._plan.coarse
        found = [self._geometry(tx_m[piece], rx_m[piece]) for piece in pieces]
        rows = np.array([(piece.start, piece.stop - piece.start, n_beams)
                         for piece, (_, n_beams, _) in zip(pieces, found, strict=True)])
        own = xp.asarray(np.array([values for _, _, values in found]))
        most, there = int(rows[:, 2].max()), xp.asarray(rows)
        beams = self._beams(samples, weights, rows, there, own,
                            np.concatenate([tx_m, rx_m], axis=1))
        images = xp.empty((len(pieces), 2, *polar.shape), np.float32)
        lit = () if self._lit is None else self._lit.parabolas(
            nodes, found, (there, own, self._grid), self._cycles_per_m)
        between, along = self._plan.beams.between.interpolator, self._plan.beams.along
        launch(interpolate_lit_beams if lit else interpolate_beams,
               (-(-polar.n_range // _THREADS), polar.n_alpha, len(pieces)), _THREADS, pairs(beams),
               self._plan.lattice.n_cells, most, there, own, self._grid, *self._weights,
               between.first, along.first, images, *lit)
        return images

    def _geometry(self, tx_m, rx_m) -> tuple[BeamGeometry, int, tuple]:
        """Of a sub-aperture: also how many beams, and its row of `forming.OWN`."""
        key = tx_m.tobytes() + rx_m.tobytes()
        if key not in self._geometries:
            if len(self._geometries) == _KEPT:
                self._geometries.clear()
            polar, sampling = self._plan.coarse, self._plan.beams
            geometry = BeamGeometry.of(polar, self._edges, tx_m, rx_m)
            if geometry is None:
                raise ValueError(f'the imaging plane, {polar.z_m:g} m high, is too steep below '
                                 f'the phase centres around {tx_m.mean(axis=0).round(2)}; use '
                                 'exact backprojection')
            start, spacing, n_beams = sampling.directions(geometry, tx_m, rx_m)
            # of the formula's e, but for the distance's part; k = 2 pi cycles per metre
            bend = -1 / (2 * 2 * np.pi * self._cycles_per_m * spacing ** 2)
            centre = geometry.centre_m
            self._geometries[key] = geometry, n_beams, (
                *centre, centre[2] - polar.z_m, geometry.range_m, start, spacing, *geometry.known,
                bend)
        return self._geometries[key]

    def _beams(self, samples, weights, rows, there, own, centres):
        """(G, M, n_cells) complex64 beams at range baseband; `there` is `rows` on the device."""
        source, lattice, between = self._plan.source, self._plan.lattice, self._plan.beams.between
        spectra = xp.ascontiguousarray(profile_spectra(source, samples, lattice.n_padded))
        n, n_echoes, most = len(rows), int(rows[:, 1].max()), int(rows[:, 2].max())
        path = xp.empty((n, most, n_echoes), np.float64)
        launch(beam_paths, (-(-most * n_echoes // _THREADS), n), _THREADS, xp.asarray(centres),
               there, own, self._track, path)
        beams = xp.empty((n, most, lattice.n_cells), np.complex64)
        launch(self._form, (-(-lattice.n_cells // _THREADS), -(-most // BEAMS), n), _THREADS,
               pairs(spectra), weights, there, path, self._scales, self._table, 1 / between.step,
               self._gain, source.zero, pairs(beams))
        beams = xp.fft.ifft(beams, axis=-1, norm='forward').astype(np.complex64, copy=False)
        for unknown in (slice(0, self._known[0]), slice(self._known[1], lattice.n_cells)):
            if unknown.start < unknown.stop:
                beams[..., unknown] = 0.0
        return beams


class _LitLines:
    """Knots of the amplitudes along the lines of a coarse grid, so many pixels apart."""

    def __init__(self, polar: PolarGrid, apart: int):
        self._apart, self._shape = apart, (polar.n_alpha, -(-polar.n_range // apart) + 1)
        positions = polar.locate(np.arange(self._shape[1]) * apart,
                                 np.arange(polar.n_alpha)[:, None])[0]
        self._positions = xp.asarray(np.ascontiguousarray(positions.reshape(-1, 3).T))

    def parabolas(self, nodes: Sequence[AmplitudeNodes], geometries, told: tuple,
                  cycles_per_m: float) -> tuple:
        """The last arguments of `interpolate_lit_beams`.

        Parameters
        ----------
        nodes : sequence of AmplitudeNodes
            Of each sub-aperture.
        geometries : sequence of tuple
            From `Beams._geometry`.
        told : tuple
            The kernels' `rows`, `own` and `grid`.
        cycles_per_m : float
            Carrier phase per metre of half path, cycles.
        """
        most = max(n_beams for _, n_beams, _ in geometries)
        phase = np.zeros((len(nodes), most, 3))
        for number, (geometry, n_beams, own) in enumerate(geometries):
            spacing = own[SPACING]
            slope = geometry.slope(nodes[number].tx_m, nodes[number].rx_m,
                                   own[START] + spacing * np.arange(n_beams))
            phase[number, :n_beams] = 2 * math.pi * cycles_per_m * spacing * slope
        lit = [one.illumination for one in nodes]
        antennas = Antennas(Illumination(lit[0].pattern, *(np.concatenate(
            [getattr(one, name) for one in lit]) for name in ('centre_m', 'axes'))))
        found = xp.empty((len(lit), self._positions.shape[1], 3), np.float32)
        launch(fit_parabolas, (-(-found.shape[1] // _THREADS), len(found)), _THREADS,
               antennas.axes, antennas.table, antennas.place, self._positions, *told,
               xp.asarray(phase), found)
        return found.reshape(len(found), *self._shape, 3), self._apart
