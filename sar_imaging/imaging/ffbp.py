"""Fast factorised backprojection (FFBP): the imager that AFBP is compared with.

Ulander, Hellsten & Stenström, IEEE Trans. AES 39, 2003; Zhang et al., section II.A and figure 2a.
Short sub-apertures are backprojected onto coarse polar grids around their own centres. Images of
neighbouring sub-apertures are then interpolated in two dimensions to a finer grid around their
common centre and summed, again and again, and at last to the requested grid.
"""

from __future__ import annotations

import logging

import numpy as np

from ..backends import AUTO
from ..backends.baselines import baseline
from ..backends.protocol import Backend
from ..geometry.grids import MapGrid
from ..geometry.polar import PolarGrid
from ..planning.baselines.ffbp_choice import plan_ffbp
from ..planning.memory import check_memory
from ..signal.pulses import PulseBlock, check_profiles
from ..signal.radar import RadarParameters

_logger = logging.getLogger(__name__)


class FfbpImager:
    """Fast factorised backprojection of one aperture.

    The two-way path of every channel is exact in the first stage. The error against time-domain
    correlation is that of the interpolations, one along range and one along direction per level.
    What they lose adds up in amplitude: larger merge factors make fewer of them.

    Parameters
    ----------
    grid, radar, n_samples, tx_m, rx_m, options :
        As for `planning.baselines.ffbp_choice.plan_ffbp`.
    backend : str or Backend
        What computes the image, see `sar_imaging.backends`.
    progress : bool
        Show a progress bar on standard error.

    Attributes
    ----------
    plan : FfbpPlan
        What is computed, with which error by cause, time and memory.
    stage : FactorisedImager
        Of the backend, which computes it.
    predicted_error_db : float
        Predicted error against time-domain correlation, dB, of a scene that is evenly bright.
    warnings : tuple of str
        What makes the image worse than predicted.

    Raises
    ------
    ValueError
        As `plan_ffbp`, or the backend offers no such images.
    MemoryError
        The image does not fit into the memory that is available.

    Examples
    --------
    >>> plan = FfbpImager(grid, profiles.radar, profiles.n_samples, profiles.tx_m,
    ...                   profiles.rx_m, target_db=-50.0)                 # doctest: +SKIP
    >>> image = plan(profiles)                                            # doctest: +SKIP
    """

    def __init__(self, grid: MapGrid | PolarGrid, radar: RadarParameters, n_samples: int, tx_m,
                 rx_m, *, backend: str | Backend = AUTO, progress: bool = False, **options):
        self.plan = plan_ffbp(grid, radar, n_samples, tx_m, rx_m, **options)
        check_memory(self.plan.n_bytes, 'an image by FFBP of '
                     f'{" x ".join(map(str, reversed(grid.shape)))} pixels',
                     'choose a smaller grid, a larger pixel spacing or a shorter aperture')
        self.predicted_error_db, self.warnings = self.plan.predicted_error_db, self.plan.warnings
        for text in self.warnings:
            _logger.warning(text)
        self.stage = baseline(backend, 'FactorisedImager')(self.plan)
        self._progress = progress

    def __call__(self, block: PulseBlock) -> np.ndarray:
        """Image of the aperture.

        Parameters
        ----------
        block : PulseBlock
            Range profiles of the planned aperture. Their own phase centres are used for the
            first stage; they may differ from the planned ones by a wavelength.

        Returns
        -------
        (n_y, n_x) or (n_alpha, n_range) complex64
            ``f(x) = sum_m sum_n s_mn(D_mn(x)) exp(+j k_c D_mn(x))`` at the pixels of the grid.

        Raises
        ------
        ValueError
            The block is not compressed, has no positions, or does not match the plan.
        """
        check_profiles(block, self.plan.radar, self.plan.n_samples)
        self._check_positions(block)
        return self.stage.image(block, progress=self._progress)

    def _check_positions(self, block):
        plan = self.plan
        if block.tx_m.shape != plan.tx_m.shape:
            raise ValueError(f'block.tx_m.shape={block.tx_m.shape}; this plan is for '
                             f'{plan.tx_m.shape}, pulses and channels of the whole aperture')
        off = max(float(np.abs(block.tx_m - plan.tx_m).max()),
                  float(np.abs(block.rx_m - plan.rx_m).max()))
        if off > plan.radar.wavelength_m:
            raise ValueError(f'phase centres of the block lie up to {off:.3f} m from the planned '
                             'ones; plan the imager with the positions of this aperture')
