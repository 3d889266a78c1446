"""Published methods that images are compared with: each a plan, and the backend that follows it.

- FFBP: Ulander, Hellsten & Stenström, IEEE Trans. AES 39, 2003; Zhang et al., section II.A;
- the wavenumber domain: Rosenberg & Gray, equations 9 to 12;
- zero-padded profiles: Rosenberg & Gray, equations 13 to 19.
"""

from __future__ import annotations

import numpy as np

from ..imaging.image import Report
from ..imaging.methods import Method
from ..signal.pulses import PulseBlock, check_profiles
from .ffbp_choice import plan_ffbp
from .ffbp_imager import FactorisedImager
from .wavenumber_imager import image_wavenumber
from .wavenumber_plan import plan_wavenumber
from .zero_padding_imager import image_zero_padded
from .zero_padding_plan import plan_zero_padding


class Ffbp(Method):
    """Fast factorised backprojection: maps and polar grids that lie on one side of the track.

    For its options see `published.ffbp_choice.plan_ffbp`.
    """

    NAME = 'ffbp'
    OWN = {'pulses_per_subaperture': 16, 'merge_factor': None, 'kernel': None,
           'range_oversampling': None, 'angle_oversampling': None}

    def plan(self, tx_m, rx_m) -> Report:
        """See `Method`."""
        plan = plan_ffbp(self.grid, self.radar, self.n_samples, tx_m, rx_m,
                         target_db=self.options.target_db, **self.own)
        report = self.planned(plan)
        self._stage = FactorisedImager(plan)
        return report

    def form(self, block: PulseBlock) -> np.ndarray:
        """See `Method`."""
        check_profiles(block, self.radar, self.n_samples)
        return self._stage.image(block, progress=self.options.progress)


class Wavenumber(Method):
    """Imaging in the wavenumber domain: maps beside a straight, evenly sampled track.

    The cost grows with the sum of samples and pixels, not with pixels times pulses as that of
    backprojection. The track may run in any direction and at any height. For the options see
    `published.wavenumber_plan.plan_wavenumber`.
    """

    NAME = 'wavenumber'
    OWN = {'taps': None, 'range_padding': 2.0, 'azimuth_padding': None}

    def plan(self, tx_m, rx_m) -> Report:
        """See `Method`."""
        return self.planned(plan_wavenumber(self.grid, self.radar, self.n_samples, tx_m, rx_m,
                                            target_db=self.options.target_db, **self.own))

    def form(self, block: PulseBlock) -> np.ndarray:
        """See `Method`."""
        check_profiles(block, self.radar, self.n_samples)
        return image_wavenumber(self.report.plan, block)


class ZeroPadding(Method):
    """Backprojection of zero-padded profiles: any grid, any track; `exact` errs less in less time.

    For its options see `published.zero_padding_plan.plan_zero_padding`. Ranges outside a
    profile contribute nothing. Equation 18, the image at baseband, is `quality.to_baseband`.
    """

    NAME = 'zero-padding'
    OWN = {'interpolator': 'sinc', 'ratio': None, 'delay': 'exact'}

    def plan(self, tx_m, rx_m) -> Report:
        """See `Method`."""
        return self.planned(plan_zero_padding(self.grid, self.radar, self.n_samples, tx_m, rx_m,
                                              target_db=self.options.target_db, **self.own))

    def form(self, block: PulseBlock) -> np.ndarray:
        """See `Method`."""
        check_profiles(block, self.radar, self.n_samples)
        return image_zero_padded(self.report.plan, block)
