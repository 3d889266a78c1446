"""Accelerated fast backprojection (AFBP) of a whole aperture, Zhang et al. 2014.

Two stages with a seam between them: `SubapertureImager` backprojects sub-apertures onto a common
polar grid, `SpectrumFusion` joins their spectra. `AfbpImager` plans both for a target and chains
them, to a polar grid or to a map.
"""

from __future__ import annotations

import logging

import numpy as np
from tqdm import tqdm

from .. import backends
from ..backends.protocol import Backend
from ..geometry.grids import MapGrid
from ..geometry.polar import PolarGrid
from ..planning.afbp.edge_brightness import EdgeBrightness
from ..planning.afbp.plan import plan_afbp
from ..planning.memory import check_memory
from ..signal.pulses import PulseBlock
from ..signal.radar import RadarParameters

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
        Wanted error against time-domain correlation, dB.
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
    backend : str or Backend
        What computes the image: ``'auto'``, ``'cpu'``, ``'reference'`` or an object of your own.

    Attributes
    ----------
    plan : AfbpPlan
        What is computed, with which error by cause, time and memory.
    subapertures : SubaperturePlan
        Its first stage.
    stage : SubapertureImager
        Forms the images of the sub-apertures.
    fusion : SpectrumFusion
        Joins their spectra.
    predicted_error_db : float
        Predicted error against time-domain correlation, dB, of a scene that is evenly bright; once
        an image was formed whose edges were much brighter, of that image.
    warnings : tuple of str
        What may make the image worse than wanted, or ambiguous.

    Raises
    ------
    ValueError
        The geometry does not allow the target, with the reason; `Backprojector` images any.
    MemoryError
        The image does not fit into the memory that is available.

    Notes
    -----
    `sar_imaging.quality.verification.measure_error` checks an image on its brightest and on
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
                 progress: bool = False, backend: str | Backend = backends.AUTO):
        plan = self.plan = plan_afbp(
            grid, radar, n_samples, tx_m, rx_m, target_db=target_db,
            pulses_per_subaperture=pulses_per_subaperture, compressed=compressed,
            weighting=weighting)
        self.grid, self._progress = grid, progress
        self._pulse_weights = _checked_weights(pulse_weights, len(plan.tx_m))
        check_memory(plan.n_bytes, f'an image by AFBP of {_size(grid)} pixels',
                     'choose a smaller grid, a larger pixel spacing or a shorter aperture')
        self.subapertures = plan.subapertures
        self._backend = backends.backend(backend)
        self.stage = self._backend.SubapertureImager(plan.subapertures)
        self.fusion = self._backend.SpectrumFusion(plan.subapertures.fusion_grid)
        self.predicted_error_db, self.warnings = plan.predicted_error_db, plan.warnings
        for warning in self.warnings:
            _logger.warning(warning)

    def __str__(self) -> str:
        return str(self.plan)

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
        self.predicted_error_db = self.plan.predicted_error_db + uneven_db
        self.warnings = self.plan.warnings
        if uneven_db > _UNEVEN_DB:
            warning = (f'what lies right beyond the edges is {uneven_db:.1f} dB brighter than the '
                       'image, and so may be its error: image a larger grid')
            self.warnings = (*self.warnings, warning)
            _logger.warning(warning)

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
        if isinstance(self.grid, PolarGrid):
            cycles = np.fmod(2 * (plan.polar.range_m - plan.polar.range_start_m) / wavelength, 1.0)
            if not np.iscomplexobj(polar_image):
                polar_image = polar_image[0] + np.complex64(1j) * polar_image[1]
            return polar_image * np.exp(2j * np.pi * cycles).astype(np.complex64)
        return self._backend.form_map(polar_image, plan.fusion_grid, self.grid,
                                      overwrite=overwrite)


def _checked_weights(weights, n_pulses: int) -> np.ndarray | None:
    if weights is None:
        return None
    weights = np.asarray(weights, np.float32)
    if weights.shape != (n_pulses,) or not np.isfinite(weights).all():
        raise ValueError(f'pulse_weights.shape={weights.shape}; expected {n_pulses} finite '
                         'numbers, one for each pulse')
    return weights


def _size(grid: MapGrid | PolarGrid) -> str:
    n, m = ((grid.n_x, grid.n_y) if isinstance(grid, MapGrid) else (grid.n_range, grid.n_alpha))
    return f'{n} x {m}'
