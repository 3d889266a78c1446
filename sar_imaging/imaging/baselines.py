"""Methods that images are compared with: their imagers as `plan_image` uses them."""

from __future__ import annotations

import numpy as np

from ..planning.baselines.wavenumber import fewest_taps
from ..signal.pulses import PulseBlock
from .correlation import correlate_profiles
from .ffbp import FfbpImager
from .image import Report
from .methods import Method
from .wavenumber import WavenumberImager
from .zero_padding import ZeroPaddedBackprojector, predicted_error_db

_CORRELATION_DB = -200.0  # float64: it is what errors are stated against
_RATIOS = (2, 4, 8, 16)  # of zero-padding


class Ffbp(Method):
    """Fast factorised backprojection: what AFBP is compared with."""

    NAME = 'ffbp'
    OWN = {'pulses_per_subaperture': 16, 'merge_factor': None, 'kernel': None,
           'range_oversampling': None, 'angle_oversampling': None}

    def plan(self, tx_m, rx_m) -> Report:
        """See `Method`."""
        options = self.options
        self._imager = FfbpImager(self.grid, self.radar, self.n_samples, tx_m, rx_m,
                                  target_db=options.target_db, backend=options.backend,
                                  progress=options.progress, **self.own)
        return self.planned(self._imager.plan)

    def form(self, block: PulseBlock) -> np.ndarray:
        """See `Method`."""
        return self._imager(block)


class Wavenumber(Method):
    """Imaging in the wavenumber domain: maps beside a straight, evenly sampled track."""

    NAME = 'wavenumber'
    OWN = {'taps': None, 'range_padding': 2.0, 'azimuth_padding': None}

    def plan(self, tx_m, rx_m) -> Report:
        """See `Method`; as few taps as meet the target unless told."""
        own = {**self.own, 'taps': self.own['taps'] or fewest_taps(self.options.target_db)}
        self._imager = WavenumberImager(self.grid, backend=self.options.backend, **own)
        return self.planned(self._imager.plan(self.radar, self.n_samples, tx_m, rx_m))

    def form(self, block: PulseBlock) -> np.ndarray:
        """See `Method`."""
        return self._imager(block)


class ZeroPadding(Method):
    """`ZeroPaddedBackprojector`: backprojection as Rosenberg & Gray publish it."""

    NAME = 'zero-padding'
    OWN = {'interpolator': 'sinc', 'ratio': None, 'delay': 'exact'}

    def plan(self, tx_m, rx_m) -> Report:
        """See `Method`."""
        own = dict(self.own)
        if own['ratio'] is None:  # the least that meets the target
            own['ratio'] = next((r for r in _RATIOS if predicted_error_db(
                own['interpolator'], r, self.radar) <= self.options.target_db), _RATIOS[-1])
        self._imager = ZeroPaddedBackprojector(self.grid, self.radar, self.n_samples, tx_m, rx_m,
                                               backend=self.options.backend, **own)
        return self.planned(self._imager.plan)

    def form(self, block: PulseBlock) -> np.ndarray:
        """See `Method`."""
        return self._imager(block)


class Correlation(Method):
    """Time-domain correlation, float64: the reference; hours for large images."""

    NAME = 'correlation'

    def plan(self, tx_m, rx_m) -> Report:
        """See `Method`."""
        return self.describe(predicted_error_db=_CORRELATION_DB)

    def form(self, block: PulseBlock) -> np.ndarray:
        """See `Method`."""
        points = self.positions()
        image, _ = correlate_profiles(block, points.reshape(-1, 3), backend=self.options.backend)
        return image.astype(np.complex64).reshape(points.shape[:-1])
