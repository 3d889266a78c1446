"""Spatial matched-filter interpolation (omega-k with Stolt) for any number of channels.

Rosenberg & Gray, equations 9 to 12: a Fourier transform over slow time, the inner product of the
channels with the reference of the scene centre, the change of variables from (omega, k_u) to
(k_x, k_y) by a Hamming-windowed sinc, and a two-dimensional inverse Fourier transform. The cost
grows with the sum of samples and pixels, not with pixels times pulses as that of backprojection;
the price is a straight and evenly sampled track.
"""

from __future__ import annotations

import logging
import math

import numpy as np

from ..backends import AUTO
from ..backends.baselines import baseline
from ..backends.protocol import Backend
from ..geometry.grids import MapGrid
from ..planning.baselines.wavenumber import WavenumberPlan, plan_wavenumber
from ..planning.memory import check_memory
from ..signal.pulses import PulseBlock
from ..signal.radar import RadarParameters

_logger = logging.getLogger(__name__)


class WavenumberImager:
    """Image pulses of a straight, evenly sampled track in the wavenumber domain.

    The track may run in any direction and at any height, the grid may lie anywhere beside it:
    the transform images distance from the line of flight against position along it (the slant
    plane of the paper), and each pixel of the horizontal map grid is read at its own exact
    distance and position. The reference is that of the middle of the grid, and the Doppler band
    is taken around the grid's own, so squint and off-centre scenes need nothing special.

    Parameters
    ----------
    grid : MapGrid
        Where the pixels are.
    taps : int
        Samples over which the Hamming-windowed sinc of the Stolt interpolation spreads, even.
        They decide the error against time-domain correlation: some -55, -57, -62, -68 and
        -79 dB with 8, 16, 32, 64 and 256 of them.
    range_padding : float
        Period of the image in range over the extent of the grid in range, at least 1. Sets the
        spacing in k_x and with it the pass band of the interpolation. With 1, as published,
        scatterers near the near and far edge of the grid lose up to half their magnitude and
        appear at the opposite edge as well (6 dB lost and a ghost of equal strength at the
        very edge).
    azimuth_padding : float, optional
        Length of the slow-time transform over the number of pulses, at least 1; 1 as published,
        which wraps around. By default as long as it takes to keep the grid free of that.
    backend : str or Backend
        What computes the image, see `sar_imaging.backends`.

    Raises
    ------
    ValueError
        A parameter is out of range, or the backend offers no such images.

    Examples
    --------
    >>> plan = WavenumberImager(grid)    # doctest: +SKIP
    >>> image = plan(profiles)           # doctest: +SKIP
    """

    def __init__(self, grid: MapGrid, *, taps: int = 16, range_padding: float = 2.0,
                 azimuth_padding: float | None = None, backend: str | Backend = AUTO):
        if not isinstance(grid, MapGrid):
            raise ValueError(f'grid is a {type(grid).__name__}; the wavenumber imager images a '
                             'MapGrid: use exact backprojection')
        if taps < 2 or taps % 2:
            raise ValueError(f'taps={taps}; expected an even number, at least 2')
        if not (math.isfinite(range_padding) and range_padding >= 1):
            raise ValueError(f'range_padding={range_padding}; expected at least 1')
        if azimuth_padding is not None and not (math.isfinite(azimuth_padding)
                                                and azimuth_padding >= 1):
            raise ValueError(f'azimuth_padding={azimuth_padding}; expected at least 1 or None')
        self.grid, self._latest = grid, None
        self._options = {'taps': int(taps), 'range_padding': range_padding,
                         'azimuth_padding': azimuth_padding}
        self._image = baseline(backend, 'image_wavenumber')

    def plan(self, radar: RadarParameters, n_samples: int, tx_m, rx_m, *,
             compressed: bool = True) -> WavenumberPlan:
        """Plan for pulses from some phase centres, (P, C, 3), metres; the latest plan is kept.

        Raises
        ------
        ValueError
            As `plan_wavenumber`.
        MemoryError
            The image does not fit into the memory that is available.
        """
        plan = self._latest
        same = plan is not None and (plan.radar, plan.n_samples, plan.compressed) == (
            radar, n_samples, compressed)
        if not (same and plan.is_for(tx_m, rx_m)):
            plan = self._latest = plan_wavenumber(self.grid, radar, n_samples, tx_m, rx_m,
                                                  compressed=compressed, **self._options)
            check_memory(plan.n_bytes, 'an image in the wavenumber domain of '
                         f'{" x ".join(map(str, reversed(self.grid.shape)))} pixels',
                         'choose a smaller grid, or use backprojection')
            for warning in plan.warnings:
                _logger.warning(warning)
        return plan

    def __call__(self, block: PulseBlock) -> np.ndarray:
        """Image of one block.

        Parameters
        ----------
        block : PulseBlock
            Range profiles, or the phase history of a stepped-frequency radar, with phase centres;
            all pulses of the aperture, in order.

        Returns
        -------
        (n_y, n_x) complex64
            Image with the phase and scale of time-domain correlation of the band spectrum, row 0
            at the largest y.

        Raises
        ------
        ValueError
            The block has no positions, or as `plan`.
        """
        if not block.has_positions:
            raise ValueError('the block has no phase centres; imaging needs the transmit and '
                             'receive position of every pulse and channel')
        plan = self.plan(block.radar, block.n_samples, block.tx_m, block.rx_m,
                         compressed=block.compressed)
        return self._image(plan, block)
