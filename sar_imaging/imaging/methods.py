# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""What `plan_image` asks of a method, and which methods there are.

A method is planned for the phase centres of some pulses and forms images of blocks from there.
"""

from __future__ import annotations

import dataclasses
import importlib
import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

from ..backends import AUTO, CUDA, check_illumination
from ..device_arrays import beside
from ..geometry.grids import Grid, TerrainGrid
from ..memory import IMAGE_BYTES, check_memory
from ..signal.pulses import PulseBlock, check_profiles
from ..signal.radar import RadarParameters, Waveform
from .image import Report

if TYPE_CHECKING:
    from ..backends.protocol import Backend
    from ..geometry.illumination import AntennaPattern, Illumination, Pointing

EXACT, AFBP = 'exact', 'afbp'
_ITSELF = AUTO, 'cpu'  # what a method that needs no backend may be asked for
#: Module and class of each method, imported when it is used first.
METHODS: Mapping[str, tuple[str, str]] = {
    EXACT: ('sar_imaging.imaging.exact', 'Exact'),
    AFBP: ('sar_imaging.imaging.afbp', 'Afbp'),
    'correlation': ('sar_imaging.imaging.correlation', 'Correlation'),
    'ffbp': ('sar_imaging.published.ffbp', 'Ffbp'),
    'wavenumber': ('sar_imaging.published.wavenumber', 'Wavenumber'),
    'zero-padding': ('sar_imaging.published.zero_padding', 'ZeroPadding')}


@dataclasses.dataclass(frozen=True)
class Options:
    """Options that all methods share; see `plan_image`."""

    target_db: float
    compressed: bool = True
    weighting: str = 'none'
    pulse_weights: np.ndarray | None = None
    backend: str | Backend = AUTO
    progress: bool = False
    illumination: AntennaPattern | None = None


class Method:
    """Base of an imaging method: one algorithm on one grid, planned for pulses from some places.

    Subclasses have a `NAME`, `plan` and `form`, and say in the attributes of the class what else
    they can do, as docs/extending.md shows. What they cannot do is refused.

    Parameters
    ----------
    grid : Grid
        Where the pixels are.
    radar, n_samples :
        As for `plan_image`; of profiles unless the method takes phase histories.
    options : Options
        What is asked for.
    own : mapping, optional
        Options of this method alone, by name.
    like : Method, optional
        Of another channel of the same image.

    Attributes
    ----------
    own : dict
        Options of this method alone, those that were not given as in `OWN`.
    report : Report
        Report of the plan.
    illumination : Illumination or None
        Illumination of the echoes that are planned for; None where all light all pixels alike.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging import MapGrid, plan_image
    >>> from sar_imaging.imaging.correlation import correlate_profiles
    >>> from sar_imaging.imaging.methods import Method
    >>> from sar_imaging.simulation import SCENARIOS
    >>> class Correlation(Method):
    ...     NAME = 'my correlation'
    ...     def plan(self, tx_m, rx_m):
    ...         return self.describe(predicted_error_db=-100.0)
    ...     def form(self, block):
    ...         values, _ = correlate_profiles(block, self.grid.points().reshape(-1, 3))
    ...         return values.astype(np.complex64).reshape(self.grid.shape)
    >>> block = next(SCENARIOS['psf']().blocks(pulses_per_block=20))
    >>> grid = MapGrid((10_000.0, 0.0, 0.0), 9, 9, 0.5)
    >>> image = plan_image(grid, block.radar, block.n_samples, method=Correlation)(block)
    >>> image.report.method, image.shape
    ('my correlation', (9, 9))
    """

    NAME: str
    OWN: Mapping[str, object] = {}  # names of options of its own, and what they are if left out
    TERRAIN = False  # images maps on heights
    ILLUMINATION = False  # weighs echoes by `illumination`
    PHASE_HISTORIES = False  # images stepped-frequency pulses as they come
    BACKENDS = False  # computes by the backend that is asked for, on a device too

    def __init__(self, grid: Grid, radar: RadarParameters, n_samples: int, options: Options,
                 own: Mapping[str, object] | None = None, like: Method | None = None):
        if isinstance(grid, TerrainGrid) and not self.TERRAIN:
            raise ValueError(f'method {self.NAME!r} images planes; use {EXACT!r} on terrain')
        if options.illumination is not None and not self.ILLUMINATION:
            raise ValueError(f'method {self.NAME!r} knows no illumination; use {EXACT!r} or '
                             f'{AFBP!r}')
        if not self.BACKENDS and options.backend not in _ITSELF:
            raise ValueError(f'backend={options.backend!r}: method {self.NAME!r} computes on the '
                             f'processor by itself; use backend={AUTO!r}, and samples that lie in '
                             "the host's memory")
        if options.illumination is not None:
            check_illumination(options.backend)
        if unknown := set(own or ()) - set(self.OWN):
            raise ValueError(f'method {self.NAME!r} has no option {", ".join(sorted(unknown))}; '
                             f'it has {", ".join(self.OWN) or "none of its own"}')
        self.grid, self.radar, self.n_samples = grid, radar, n_samples
        self.options, self.own, self.like = options, {**self.OWN, **(own or {})}, like
        self._centres: tuple[np.ndarray, np.ndarray] | None = None
        self._pointing: Pointing | None = None
        self.illumination: Illumination | None = None
        # The imager has seen to the image itself.
        self._fitting_bytes: int = (IMAGE_BYTES * math.prod(grid.shape) if like is None
                               else like._fitting_bytes)

    def plan(self, tx_m: np.ndarray, rx_m: np.ndarray) -> Report:
        """Plan for pulses from phase centres (P, C, 3), metres; say what images will be like."""
        raise NotImplementedError

    def form(self, block: PulseBlock) -> np.ndarray:
        """Samples of the image of a block, complex64, in the shape of the grid.

        The block is one of those that were planned for, finite, under its window over the pulses.
        """
        raise NotImplementedError

    def image(self, block: PulseBlock, onto: np.ndarray | None = None
              ) -> tuple[np.ndarray, Report]:
        """Image of a block, added to samples if there are some, and what is known of it."""
        check_profiles(block, self.radar, self.n_samples, compressed=self.options.compressed)
        samples = self.form(self.weighted(block))
        if onto is None:
            return samples, self.report
        onto += samples
        return onto, self.report

    def replan(self, tx_m: np.ndarray, rx_m: np.ndarray, reason: str,
               pointing: Pointing | None = None) -> None:
        """Plan for pulses from some places, for this reason.

        Raises
        ------
        ValueError
            Pixels are lit by a pattern, and nobody tells where the antenna looked.
        """
        pattern = self.options.illumination
        self.illumination = None
        if pattern is not None:
            from ..geometry.illumination import Illumination  # few images have a pattern

            self.illumination = Illumination.of_pulses(pattern, pointing, tx_m, rx_m)
        self._pointing = pointing
        self._centres = tx_m.copy(), rx_m.copy()
        self.report = dataclasses.replace(self.plan(tx_m, rx_m), reason=reason)

    def is_for(self, tx_m: np.ndarray, rx_m: np.ndarray,
               pointing: Pointing | None = None) -> bool:
        """Whether it was planned for these phase centres and directions."""
        return (self._centres is not None
                and all(map(np.array_equal, self._centres, (tx_m, rx_m)))
                and (self.illumination is None or self._pointing is not None
                     and self._pointing.same_as(pointing)))

    @property
    def uses_device(self) -> bool:
        """Whether a CUDA device computes its images."""
        return self.options.backend == CUDA

    @classmethod
    def takes_raw(cls, radar: RadarParameters) -> bool:
        """Whether it images raw pulses of a radar without range compression."""
        return cls.PHASE_HISTORIES and radar.waveform == Waveform.STEPPED_FREQUENCY

    def weights(self, block: PulseBlock) -> np.ndarray | None:
        """(P,) float32 window over the pulses of a block.

        Raises
        ------
        ValueError
            It is not as long as the block, or not finite.
        """
        if self.options.pulse_weights is None:
            return None
        weights = np.asarray(self.options.pulse_weights, np.float32)
        if weights.shape != (block.n_pulses,) or not np.isfinite(weights).all():
            raise ValueError(f'pulse_weights.shape={weights.shape}; expected {block.n_pulses} '
                             'finite numbers, one for each pulse')
        return weights

    def weighted(self, block: PulseBlock) -> PulseBlock:
        """The block under its window."""
        weights = self.weights(block)
        return block if weights is None else dataclasses.replace(
            block, samples=block.samples * beside(weights[:, None, None], block.samples))

    def describe(self, **known: Any) -> Report:
        """Report with the name of the method, the target, and what is known besides.

        Raises
        ------
        MemoryError
            What images take, ``n_bytes``, is more than the memory that is available.
        """
        report = Report(self.NAME, '', self.options.target_db, **known)
        if report.n_bytes > self._fitting_bytes:
            size = ' x '.join(map(str, reversed(self.grid.shape)))
            check_memory(report.n_bytes, f'an image of {size} pixels by method {self.NAME!r}',
                         'choose a smaller grid, a larger pixel spacing or fewer pulses')
            self._fitting_bytes = report.n_bytes
        return report

    def planned(self, plan: Any, **known: Any) -> Report:
        """Report of what a plan knows."""
        return self.describe(**{
            'predicted_error_db': plan.predicted_error_db, 'errors_db': {
                cause: error for cause, error in plan.errors_db.items() if math.isfinite(error)},
            'seconds': getattr(plan, 'seconds', None), 'n_bytes': plan.n_bytes,
            'warnings': plan.warnings, 'plan': plan, **known})


def method_class(method: str | type[Method]) -> type[Method]:
    """Class of a method, by its name or as somebody else wrote it.

    Raises
    ------
    ValueError
        There is no such method, or the class is none.
    """
    if isinstance(method, str) and method in METHODS:
        module, name = METHODS[method]
        return getattr(importlib.import_module(module), name)
    if (isinstance(method, type) and issubclass(method, Method)
            and isinstance(getattr(method, 'NAME', None), str)):
        return method
    raise ValueError(f'method={method!r}; use {AUTO!r}, one of {", ".join(map(repr, METHODS))} or '
                     'a subclass of sar_imaging.imaging.methods.Method with a NAME')
