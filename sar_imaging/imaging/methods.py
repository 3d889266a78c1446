"""The imagers behind `plan_image`, each brought to the same shape.

A method is planned for the phase centres of some pulses and forms images of blocks from there.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping

import numpy as np

from ..backends import AUTO
from ..backends.protocol import Backend
from ..geometry.grids import MapGrid
from ..geometry.point_grids import as_grid
from ..planning.baselines.wavenumber import fewest_taps
from ..planning.error_budget import AFBP_SHARES, EXACT_SHARES, ErrorBudget
from ..planning.memory import IMAGE_BYTES
from ..planning.plan import Plan
from ..signal.pulses import PulseBlock
from ..signal.radar import RadarParameters, Waveform
from .afbp import AfbpImager
from .backprojection import Backprojector
from .correlation import correlate_profiles
from .ffbp import FfbpImager
from .image import Report
from .wavenumber import WavenumberImager
from .zero_padding import ZeroPaddedBackprojector, predicted_error_db

EXACT, AFBP = 'exact', 'afbp'
_CORRELATION_DB = -200.0  # float64: it is what errors are stated against
_RATIOS = (2, 4, 8, 16)  # of zero-padding


@dataclasses.dataclass(frozen=True)
class Options:
    """Options that all methods share; see `plan_image`."""

    target_db: float
    height_m: np.ndarray | None = None
    compressed: bool = True
    weighting: str = 'none'
    pulse_weights: np.ndarray | None = None
    backend: str | Backend = AUTO
    progress: bool = False


class Method:
    """One imager, planned for pulses from some places.

    Parameters
    ----------
    grid, radar, n_samples :
        As for `plan_image`; of profiles unless the method takes phase histories.
    tx_m, rx_m : (P, C, 3) float64
        Phase centres, metres.
    options : Options
        What is asked for.
    reason : str
        Why this method.

    Attributes
    ----------
    report : Report
        Of the plan.
    """

    NAME: str
    TERRAIN = False  # images maps on heights
    PHASE_HISTORIES = False  # images stepped-frequency pulses as they come

    def __init__(self, grid, radar: RadarParameters, n_samples: int, tx_m, rx_m,
                 options: Options, reason: str):
        if options.height_m is not None and not self.TERRAIN:
            raise ValueError(f'method {self.NAME!r} images planes; use {EXACT!r} on terrain')
        self.grid, self.radar, self.n_samples = grid, radar, n_samples
        self.options, self._imager = options, None
        self.replan(tx_m, rx_m, reason)

    def replan(self, tx_m, rx_m, reason: str) -> None:
        """Plan for pulses from other places."""
        self._centres = tx_m, rx_m
        self.report = dataclasses.replace(self.plan(tx_m, rx_m), reason=reason)

    @classmethod
    def takes_raw(cls, radar: RadarParameters) -> bool:
        """Whether it images raw pulses of a radar without range compression."""
        return cls.PHASE_HISTORIES and radar.waveform == Waveform.STEPPED_FREQUENCY

    @property
    def compressed(self) -> bool:
        """Whether its blocks hold range profiles."""
        return self.options.compressed

    def is_for(self, tx_m, rx_m) -> bool:
        """Whether it was planned for these phase centres."""
        return all(map(np.array_equal, self._centres, (tx_m, rx_m)))

    def plan(self, tx_m, rx_m) -> Report:
        """Plan, and say what the image will be like."""
        raise NotImplementedError

    def form(self, block: PulseBlock) -> np.ndarray:
        """Samples of the image of a block, complex64, in the shape of the grid."""
        raise NotImplementedError

    def image(self, block: PulseBlock) -> tuple[np.ndarray, Report]:
        """Samples, and the report with what the image itself told."""
        return self.form(self._weighted(block)), self.report

    def add(self, block: PulseBlock, samples: np.ndarray) -> Report:
        """Add the image of a block to samples, in place."""
        more, report = self.image(block)
        samples += more
        return report

    def _weighted(self, block: PulseBlock) -> PulseBlock:
        weights = self.options.pulse_weights
        if weights is None:
            return block
        weights = np.asarray(weights, np.float32)
        if weights.shape != (block.n_pulses,) or not np.isfinite(weights).all():
            raise ValueError(f'pulse_weights.shape={weights.shape}; expected {block.n_pulses} '
                             'finite numbers, one for each pulse')
        return dataclasses.replace(block, samples=block.samples * weights[:, None, None])

    def describe(self, **known) -> Report:
        """Report with the name of the method, the target, and what is known besides."""
        return Report(self.NAME, '', self.options.target_db, **known)

    def planned(self, plan: Plan) -> Report:
        """Report of what a plan knows."""
        return self.describe(
            predicted_error_db=plan.predicted_error_db, errors_db=plan.errors_db,
            seconds=getattr(plan, 'seconds', None), n_bytes=plan.n_bytes, warnings=plan.warnings,
            plan=str(plan))

    def positions(self) -> np.ndarray:
        """(..., 3) float64 positions of the pixels, metres."""
        return as_grid(self.grid).points()


class Exact(Method):
    """`Backprojector`: any grid, any track."""

    NAME, TERRAIN = EXACT, True

    def plan(self, tx_m, rx_m) -> Report:
        """See `Method`."""
        if self._imager is None:  # its memory serves pulses from all places
            self._imager = Backprojector(
                self.grid, self.radar, self.n_samples, target_db=self.options.target_db,
                height_m=self.options.height_m, backend=self.options.backend)
        if not tx_m.size:
            return self.describe()
        plan = self._imager.plan(tx_m, rx_m)
        return self.describe(
            predicted_error_db=plan.predicted_error_db, errors_db=plan.errors_db,
            shares_db=ErrorBudget(self.options.target_db, EXACT_SHARES).shares_db,
            seconds=plan.seconds, warnings=plan.warnings, plan=str(plan),
            n_bytes=plan.n_bytes + IMAGE_BYTES * math.prod(self._imager.shape))

    def form(self, block: PulseBlock) -> np.ndarray:
        """See `Method`."""
        image = self._imager.new_image()
        self._imager.add(block, image)
        return image

    def add(self, block: PulseBlock, samples: np.ndarray) -> Report:
        """See `Method`; takes no memory for another image."""
        self._imager.add(self._weighted(block), samples)
        return self.report


class Afbp(Method):
    """`AfbpImager`: maps and polar grids that lie on one side of the track."""

    NAME, PHASE_HISTORIES = AFBP, True

    def plan(self, tx_m, rx_m) -> Report:
        """See `Method`."""
        options = self.options
        self._imager = AfbpImager(self.grid, self.radar, self.n_samples, tx_m, rx_m,
                                  target_db=options.target_db, compressed=options.compressed,
                                  weighting=options.weighting, backend=options.backend,
                                  progress=options.progress)
        plan = self._imager.plan
        return self.describe(
            predicted_error_db=plan.predicted_error_db, errors_db=plan.errors_db,
            shares_db=ErrorBudget(options.target_db, AFBP_SHARES).shares_db,
            seconds=plan.seconds, n_bytes=plan.n_bytes, warnings=plan.warnings,
            plan=str(plan.subapertures))

    @property
    def within_reach(self) -> bool:
        """Whether nothing is known that may make the error larger than predicted."""
        return not self._imager.subapertures.warnings

    def form(self, block: PulseBlock) -> np.ndarray:
        """See `Method`."""
        return self._imager(block)

    def image(self, block: PulseBlock) -> tuple[np.ndarray, Report]:
        """See `Method`: bright surroundings raise the predicted error."""
        samples, imager = self.form(self._weighted(block)), self._imager
        errors = dict(self.report.errors_db)
        if imager.predicted_error_db > self.report.predicted_error_db:
            errors['bright surroundings'] = imager.predicted_error_db
        return samples, dataclasses.replace(
            self.report, predicted_error_db=imager.predicted_error_db, errors_db=errors,
            warnings=imager.warnings)


class Ffbp(Method):
    """`FfbpImager`: what AFBP is compared with."""

    NAME = 'ffbp'

    def plan(self, tx_m, rx_m) -> Report:
        """See `Method`."""
        options = self.options
        self._imager = FfbpImager(self.grid, self.radar, self.n_samples, tx_m, rx_m,
                                  target_db=options.target_db, backend=options.backend,
                                  progress=options.progress)
        return self.planned(self._imager.plan)

    def form(self, block: PulseBlock) -> np.ndarray:
        """See `Method`."""
        return self._imager(block)


class Wavenumber(Method):
    """`WavenumberImager`: maps beside a straight, evenly sampled track."""

    NAME = 'wavenumber'

    def plan(self, tx_m, rx_m) -> Report:
        """See `Method`."""
        if not isinstance(self.grid, MapGrid):
            raise ValueError(f'method {self.NAME!r} images maps; use {EXACT!r} for other grids')
        if self._imager is None:
            self._imager = WavenumberImager(self.grid, taps=fewest_taps(self.options.target_db),
                                            backend=self.options.backend)
        return self.planned(self._imager.plan(self.radar, self.n_samples, tx_m, rx_m))

    def form(self, block: PulseBlock) -> np.ndarray:
        """See `Method`."""
        return self._imager(block)


class ZeroPadding(Method):
    """`ZeroPaddedBackprojector`: backprojection as Rosenberg & Gray publish it."""

    NAME = 'zero-padding'

    def plan(self, tx_m, rx_m) -> Report:
        """See `Method`."""
        ratio = next((r for r in _RATIOS if predicted_error_db('sinc', r, self.radar)
                      <= self.options.target_db), _RATIOS[-1])
        self._imager = ZeroPaddedBackprojector(
            self.grid, self.radar, self.n_samples, tx_m, rx_m, interpolator='sinc', ratio=ratio,
            backend=self.options.backend)
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


METHODS: Mapping[str, type[Method]] = {
    method.NAME: method for method in (Exact, Afbp, Ffbp, Wavenumber, ZeroPadding, Correlation)}


def named_method(method: str | type[Method]) -> tuple[str, Mapping[str, type[Method]]]:
    """Name of a method, and all methods by name; with a class that somebody else wrote.

    Raises
    ------
    ValueError
        There is no such method, or the class is none.
    """
    if isinstance(method, str) and method in (AUTO, *METHODS):
        return method, METHODS
    if (isinstance(method, type) and issubclass(method, Method)
            and isinstance(getattr(method, 'NAME', None), str)):
        return method.NAME, {**METHODS, method.NAME: method}
    raise ValueError(f'method={method!r}; use {AUTO!r}, one of {", ".join(map(repr, METHODS))} or '
                     'a subclass of sar_imaging.imaging.methods.Method with a NAME')
