"""Backprojection of zero-padded profiles as Rosenberg & Gray publish it, for comparison.

Equations 13 to 19: the spectrum of each profile is padded with zeros by a ratio (14), the profile
is modulated back to the carrier (15) and each pixel takes the nearest sample (16). Further
interpolators read the same zero-padded profile at baseband and apply the exact carrier phase. Each
knows its error beforehand. `sar_imaging.imaging.exact` is faster and more accurate.
Equation 18, the image at baseband, is `sar_imaging.quality.to_baseband`.
"""

from __future__ import annotations

import math

import numpy as np

from ..backends import AUTO
from ..backends.baselines import baseline
from ..backends.protocol import Backend
from ..geometry.grids import Grid
from ..planning.baselines.zero_padding import (
    DELAYS,
    INTERPOLATORS,
    plan_zero_padding,
    predicted_error_db,
)
from ..planning.memory import check_memory
from ..planning.profiles.profile_reach import covered_ranges
from ..signal.pulses import PulseBlock, check_profiles
from ..signal.radar import RadarParameters

__all__ = ['DELAYS', 'INTERPOLATORS', 'ZeroPaddedBackprojector', 'predicted_error_db']


class ZeroPaddedBackprojector:
    """Backproject zero-padded range profiles of one radar onto a grid or any points.

    Parameters
    ----------
    grid, radar, n_samples, tx_m, rx_m, options :
        As for `planning.baselines.zero_padding.plan_zero_padding`.
    backend : str or Backend
        What computes the image, see `sar_imaging.backends`.

    Attributes
    ----------
    plan : ZeroPaddingPlan
        What is computed, with which error and memory.

    Raises
    ------
    ValueError
        An option is unknown or out of range, points are malformed, the profiles are sampled
        below their bandwidth, or the backend offers no such images.
    MemoryError
        The image does not fit into the memory that is available.

    Examples
    --------
    >>> plan = ZeroPaddedBackprojector(grid, radar, n_samples, ratio=100)    # doctest: +SKIP
    >>> image = plan(profiles)                                               # doctest: +SKIP
    """

    def __init__(self, grid: Grid | np.ndarray, radar: RadarParameters, n_samples: int,
                 tx_m=None, rx_m=None, *, backend: str | Backend = AUTO, **options):
        self.plan = plan_zero_padding(grid, radar, n_samples, tx_m, rx_m, **options)
        check_memory(self.plan.n_bytes, f'an image of {math.prod(self.plan.grid.shape)} pixels '
                     'from zero-padded profiles', 'choose a smaller grid or a smaller ratio')
        self._image = baseline(backend, 'image_zero_padded')

    def __call__(self, block: PulseBlock) -> np.ndarray:
        """Image of one block.

        Ranges outside a profile contribute nothing.

        Parameters
        ----------
        block : PulseBlock
            Range profiles with phase centres.

        Returns
        -------
        complex64 array
            ``f(x) = sum_m sum_n s_mn(tau) exp(+j w_c tau)`` (equation 17) at the points, in
            their shape; ``(n_y, n_x)`` for a grid, row 0 at the largest y.

        Raises
        ------
        ValueError
            The block is not compressed, has no positions, does not match the plan, or none of
            its profiles reaches a point.
        """
        plan = self.plan
        check_profiles(block, plan.radar, plan.n_samples)
        image, n_reads = self._image(plan, block)
        if block.n_pulses and not n_reads:
            start, stop = covered_ranges(plan.radar, plan.n_samples + 1)
            raise ValueError(f'no point lies within the profiles, which cover {start:.1f} to '
                             f'{stop:.1f} m; move the points or the range window')
        return image
