"""Published methods that images are compared with: each a plan, and the backend that follows it.

- FFBP: Ulander, Hellsten & Stenström, IEEE Trans. AES 39, 2003; Zhang et al., section II.A;
- the wavenumber domain: Rosenberg & Gray, equations 9 to 12;
- zero-padded profiles: Rosenberg & Gray, equations 13 to 19.
"""

from __future__ import annotations

import numpy as np

from ..backends import optional_entry
from ..planning.baselines.ffbp_choice import plan_ffbp
from ..planning.baselines.wavenumber import plan_wavenumber
from ..planning.baselines.zero_padding import plan_zero_padding
from ..signal.pulses import PulseBlock, check_profiles
from .image import Report
from .methods import Method


class Ffbp(Method):
    """Fast factorised backprojection: maps and polar grids that lie on one side of the track.

    For its options see `planning.baselines.ffbp_choice.plan_ffbp`.
    """

    NAME = 'ffbp'
    OWN = {'pulses_per_subaperture': 16, 'merge_factor': None, 'kernel': None,
           'range_oversampling': None, 'angle_oversampling': None}

    def plan(self, tx_m, rx_m) -> Report:
        """See `Method`."""
        stage = optional_entry(self.options.backend, 'FactorisedImager')
        plan = plan_ffbp(self.grid, self.radar, self.n_samples, tx_m, rx_m,
                         target_db=self.options.target_db, **self.own)
        report = self.planned(plan)
        self._stage = stage(plan)
        return report

    def form(self, block: PulseBlock) -> np.ndarray:
        """See `Method`."""
        check_profiles(block, self.radar, self.n_samples)
        return self._stage.image(block, progress=self.options.progress)


class Wavenumber(Method):
    """Imaging in the wavenumber domain: maps beside a straight, evenly sampled track.

    The cost grows with the sum of samples and pixels, not with pixels times pulses as that of
    backprojection. The track may run in any direction and at any height. For the options see
    `planning.baselines.wavenumber.plan_wavenumber`.
    """

    NAME = 'wavenumber'
    OWN = {'taps': None, 'range_padding': 2.0, 'azimuth_padding': None}

    def plan(self, tx_m, rx_m) -> Report:
        """See `Method`."""
        self._image = optional_entry(self.options.backend, 'image_wavenumber')
        return self.planned(plan_wavenumber(self.grid, self.radar, self.n_samples, tx_m, rx_m,
                                            target_db=self.options.target_db, **self.own))

    def form(self, block: PulseBlock) -> np.ndarray:
        """See `Method`."""
        check_profiles(block, self.radar, self.n_samples)
        return self._image(self.report.plan, block)


class ZeroPadding(Method):
    """Backprojection of zero-padded profiles: any grid, any track; `exact` errs less in less time.

    For its options see `planning.baselines.zero_padding.plan_zero_padding`. Ranges outside a
    profile contribute nothing. Equation 18, the image at baseband, is `quality.to_baseband`.
    """

    NAME = 'zero-padding'
    OWN = {'interpolator': 'sinc', 'ratio': None, 'delay': 'exact'}

    def plan(self, tx_m, rx_m) -> Report:
        """See `Method`."""
        self._image = optional_entry(self.options.backend, 'image_zero_padded')
        return self.planned(plan_zero_padding(self.grid, self.radar, self.n_samples, tx_m, rx_m,
                                              target_db=self.options.target_db, **self.own))

    def form(self, block: PulseBlock) -> np.ndarray:
        """See `Method`."""
        check_profiles(block, self.radar, self.n_samples)
        return self._image(self.report.plan, block)
