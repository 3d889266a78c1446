"""Accelerated fast backprojection (AFBP) of a whole aperture, Zhang et al. 2014.

Two stages with a seam between them: `SubapertureImager` backprojects sub-apertures onto a common
polar grid, `SpectrumFusion` joins their spectra. `AfbpImager` plans both for a target and chains
them, to a polar grid or to a map.
"""

from __future__ import annotations

import logging

import numpy as np
from tqdm import tqdm

from ..backends.cpu.fusion.spectra import SpectrumFusion
from ..backends.cpu.fusion.to_map import form_map
from ..backends.cpu.subapertures import SubapertureImager
from ..geometry.grids import MapGrid
from ..geometry.polar import PolarGrid
from ..planning.afbp.edge_brightness import EdgeBrightness
from ..planning.afbp.subapertures import plan_subapertures
from ..planning.aliasing_error import EVERYTHING
from ..planning.error_budget import total_db
from ..planning.polar_cover import cover_for_fusion, map_coverage
from ..planning.profiles.phase_history import RangeBand
from ..planning.profiles.profile_reach import reach_warning, some_pixels
from ..signal.pulses import PulseBlock
from ..signal.radar import SPEED_OF_LIGHT, RadarParameters

_UNEVEN_DB = 3.0  # by which edges may be brighter without a word
_logger = logging.getLogger(__name__)


class AfbpImager:
    """Image of one aperture by AFBP.

    Parameters
    ----------
    grid : MapGrid or PolarGrid
        Where the pixels are. The origin of a polar grid should lie in the middle of the aperture.
    radar : RadarParameters
        Of the compressed profiles, or of the phase histories.
    n_samples : int
        Samples of a profile, or frequencies of a pulse.
    tx_m, rx_m : (P, C, 3) array_like
        Phase centres of the whole aperture, metres; multichannel paths are exact.
    target_db : float
        Wanted error against exact backprojection, dB.
    pulses_per_subaperture : int, optional
        Length of the sub-apertures; the quickest if left out.
    compressed : bool
        False when the blocks to come are stepped-frequency phase histories, which are then
        imaged without range compression before: quicker, unless the scene is much shorter than
        the unambiguous range.
    weighting : str
        Spectral weighting of phase histories, see `sar_imaging.signal.windows`; profiles have
        theirs.
    pulse_weights : (P,) array_like, optional
        Window over the aperture.
    progress : bool
        Show a progress bar on standard error.

    Attributes
    ----------
    subapertures : SubaperturePlan
        Plan of the first stage.
    stage : SubapertureImager
        First stage.
    fusion : SpectrumFusion
        Second stage.
    predicted_error_db : float
        Predicted error against exact backprojection, dB, of a scene that is evenly bright; once
        an image was formed whose edges were much brighter, of that image.
    warnings : tuple of str
        What may make the image worse than wanted, or ambiguous.

    Raises
    ------
    ValueError
        The geometry does not allow the target, with the reason; `Backprojector` images any.

    Notes
    -----
    `sar_imaging.imaging.verification.measure_error` checks an image on its brightest and on
    random pixels against correlation.

    Examples
    --------
    >>> plan = AfbpImager(grid, profiles.radar, profiles.n_samples, profiles.tx_m,
    ...                   profiles.rx_m)                                    # doctest: +SKIP
    >>> image = plan(profiles)                                            # doctest: +SKIP
    """

    def __init__(self, grid: MapGrid | PolarGrid, radar: RadarParameters, n_samples: int, tx_m,
                 rx_m, *, target_db: float = -50.0, pulses_per_subaperture: int | None = None,
                 compressed: bool = True, weighting: str = 'none', pulse_weights=None,
                 progress: bool = False):
        if not -90.0 <= target_db <= -20.0:
            raise ValueError(f'target_db={target_db}; expected -90 to -20 dB')
        tx_m, rx_m = np.asarray(tx_m, np.float64), np.asarray(rx_m, np.float64)
        if tx_m.shape != rx_m.shape or tx_m.ndim != 3 or tx_m.shape[-1] != 3 or not tx_m.size:
            raise ValueError(f'tx_m.shape={tx_m.shape}, rx_m.shape={rx_m.shape}; expected '
                             '(pulses, channels, 3) for both')
        self.grid, self._progress, self._cover = grid, progress, None
        self._pulse_weights = _checked_weights(pulse_weights, len(tx_m))
        polar, oversampling, ratio, coverage = grid, (1.0, 1.0), (1, 1), EVERYTHING
        if compressed and weighting != 'none':
            raise ValueError(f'weighting={weighting!r} is for phase histories (compressed=False); '
                             'profiles are weighted by range compression')
        band = None if compressed else RangeBand(radar, n_samples, weighting)
        self._periodic = band is not None
        if isinstance(grid, MapGrid):
            self._cover, target_db = cover_for_fusion(grid, tx_m, rx_m, radar, n_samples,
                                                      target_db, band)
            polar, oversampling = self._cover.polar, self._cover.oversampling
            ratio = self._cover.ratio
            coverage = map_coverage(polar, grid, self._cover)
        self.subapertures = plan_subapertures(
            polar, radar, n_samples, tx_m, rx_m, target_db=target_db,
            pulses_per_subaperture=pulses_per_subaperture, oversampling=oversampling,
            ratio=ratio, coverage=coverage, band=band)
        self.stage = SubapertureImager(self.subapertures)
        self.fusion = SpectrumFusion(self.subapertures.fusion_grid)
        self.predicted_error_db = self.subapertures.predicted_error_db
        if self._cover is not None:
            self.predicted_error_db = total_db(self.predicted_error_db, self._cover.resampling_db,
                                               self._cover.profile_db)
        self._even_db = self.predicted_error_db
        self.warnings = self._plan_warnings = (
            *self.subapertures.warnings, *self._reach_warnings(tx_m, rx_m),
            *_sampling_warnings(polar, radar, tx_m, rx_m))
        for warning in self.warnings:
            _logger.warning(warning)

    def __str__(self) -> str:
        return '\n'.join([f'AFBP: {self.subapertures}', *self.warnings])

    def __call__(self, block: PulseBlock) -> np.ndarray:
        """Image of the aperture.

        Parameters
        ----------
        block : PulseBlock
            Range profiles, or phase histories, of the pulses that were planned for, in their
            order.

        Returns
        -------
        (n_y, n_x) or (n_alpha, n_range) complex64
            ``f(x) = sum_m sum_n s_mn(D_mn(x)) exp(+j k_c D_mn(x))``. A map may lie in the larger
            memory of the polar image that it was made from; a copy of it lets go of the rest.

        Raises
        ------
        ValueError
            The block does not match the plan.
        """
        s = self.subapertures.sampling
        if block.n_pulses != s.pulses[-1].stop:
            raise ValueError(f'block has {block.n_pulses} pulses; the plan is for '
                             f'{s.pulses[-1].stop}')
        self.fusion.clear()
        parts, brightness = None, EdgeBrightness(self.subapertures.fusion_grid, s.coverage)
        for number, some in enumerate(tqdm(s.pulses, desc='sub-apertures',
                                           unit='sub-aperture', disable=not self._progress)):
            weights = None if self._pulse_weights is None else self._pulse_weights[some]
            parts = self.stage.image(number, block.select(some), weights, parts)
            brightness.add(parts)
            self.fusion.add(number, parts, s.centre[number])
        self._judge_edges(brightness.uneven_db)
        return self.form(self.fusion.take_polar_image(planes=True), overwrite=True)

    def _judge_edges(self, uneven_db: float) -> None:
        """Predictions are for scenes that are as bright beyond their edges as within."""
        self.predicted_error_db, self.warnings = self._even_db, self._plan_warnings
        self.predicted_error_db += uneven_db
        if uneven_db > _UNEVEN_DB:
            warning = (f'what lies right beyond the edges is {uneven_db:.1f} dB brighter than the '
                       'image, and so may be its error: image a larger grid')
            self.warnings = (*self.warnings, warning)
            _logger.warning(warning)

    def _reach_warnings(self, tx_m, rx_m) -> list[str]:
        """Of profiles; phase histories repeat."""
        plan = self.subapertures
        warning = None if self._periodic else reach_warning(
            some_pixels(self.grid), tx_m.reshape(-1, 3), rx_m.reshape(-1, 3), plan.radar,
            plan.n_samples)
        return [] if warning is None else [warning]

    def form(self, polar_image: np.ndarray, *, overwrite: bool = False) -> np.ndarray:
        """Image on the grid from the fused polar image at range baseband.

        Parameters
        ----------
        polar_image : (n_alpha, n_range) complex64 or (2, n_alpha, n_range) float32
            From `SpectrumFusion`, complex or as real and imaginary part.
        overwrite : bool
            It is not needed any more: a map may be written over it, see `fusion_map.form_map`.

        Returns
        -------
        (n_y, n_x) or (n_alpha, n_range) complex64
        """
        plan = self.subapertures
        wavelength = plan.radar.wavelength_m
        if self._cover is None:
            cycles = np.fmod(2 * (plan.polar.range_m - plan.polar.range_start_m) / wavelength, 1.0)
            if not np.iscomplexobj(polar_image):
                polar_image = polar_image[0] + np.complex64(1j) * polar_image[1]
            return polar_image * np.exp(2j * np.pi * cycles).astype(np.complex64)
        return form_map(polar_image, plan.fusion_grid, self.grid, overwrite=overwrite)


def _checked_weights(weights, n_pulses: int) -> np.ndarray | None:
    if weights is None:
        return None
    weights = np.asarray(weights, np.float32)
    if weights.shape != (n_pulses,) or not np.isfinite(weights).all():
        raise ValueError(f'pulse_weights.shape={weights.shape}; expected {n_pulses} finite '
                         'numbers, one for each pulse')
    return weights


def _sampling_warnings(polar: PolarGrid, radar: RadarParameters, tx_m, rx_m):
    """Ambiguities that the pulses themselves cause, in any imager."""
    if len(tx_m) < 3:
        return
    middles = 0.5 * (tx_m + rx_m).mean(axis=1)
    step = float(np.median(np.linalg.norm(np.diff(middles, axis=0), axis=1)))
    width = polar.n_alpha * polar.alpha_spacing
    shortest = SPEED_OF_LIGHT / (radar.carrier_hz + radar.bandwidth_hz / 2)
    if 2 * step * width > shortest:
        yield (f'pulses are {step:.3g} m apart; scatterers within the scene, {width:.3g} wide in '
               f'direction cosine, are ambiguous beyond {shortest / (2 * width):.3g} m')
