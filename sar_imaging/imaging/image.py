# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""What every imager returns: samples, where they are, and how good they are."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from ..signal.held_samples import HeldSamples

if TYPE_CHECKING:
    from ..geometry.grids import Grid
    from ..planning.plan import Plan
    from .radiometry import Radiometry


BRIGHT_SURROUNDINGS = 'bright surroundings'  # cause of an error


@dataclasses.dataclass(frozen=True)
class Report:
    """How an image is formed, and what is known of it beforehand.

    Attributes
    ----------
    method : str
        Imager, as `plan_image` names it.
    reason : str
        Why this one.
    target_db : float
        Wanted error against time-domain correlation, dB.
    predicted_error_db : float or None
        Predicted one, of the pixels that lie within the profiles of all pulses; None where the
        imager cannot tell.
    errors_db : mapping of str to float
        Its causes, dB; empty where the imager cannot tell.
    shares_db : mapping of str to float
        What causes may contribute, dB, where the error budget has a share for them.
    seconds : float or None
        Predicted time on one thread.
    n_bytes : int
        Memory that forming the image takes, the image included, bytes.
    warnings : tuple of str
        What makes the image worse than wanted, or ambiguous.
    plan : Plan, str or None
        How the imager goes about it: its words, where the report was read from a file; None where
        it has no plan to show.
    pulse_power : float or None
        Mean power of a pixel if the echoes in the image added up as noise does; None where the
        prediction does not depend on it.
    band_end_power : float
        What of `pulse_power` lies at the ends of the echoes' band, and not all over it.

    Examples
    --------
    >>> from sar_imaging import MapGrid, plan_image
    >>> from sar_imaging.simulation import SCENARIOS
    >>> block = next(SCENARIOS['psf']().blocks(50))
    >>> grid = MapGrid((10_000.0, 0.0, 0.0), 25, 25, 0.5)
    >>> imager = plan_image(grid, block.radar, block.n_samples, block.tx_m, block.rx_m)
    >>> report = imager.report  # known before a pulse is imaged
    >>> report.method, report.target_db, bool(report.predicted_error_db < -60.0)
    ('exact', -60.0, True)
    """

    method: str
    reason: str
    target_db: float
    predicted_error_db: float | None = None
    errors_db: Mapping[str, float] = dataclasses.field(default_factory=dict)
    shares_db: Mapping[str, float] = dataclasses.field(default_factory=dict)
    seconds: float | None = None
    n_bytes: int = 0
    warnings: tuple[str, ...] = ()
    plan: Plan | str | None = dataclasses.field(default=None, compare=False)
    pulse_power: float | None = dataclasses.field(default=None, compare=False, repr=False)
    band_end_power: float = dataclasses.field(default=0.0, compare=False, repr=False)

    def amid_bright(self, excess_db: float, *warnings: str) -> Report:
        """The report of an image that errs so much more, because its surroundings are bright."""
        if self.predicted_error_db is None:
            return self
        error_db = self.predicted_error_db + excess_db
        return dataclasses.replace(
            self, predicted_error_db=error_db, warnings=(*self.warnings, *warnings),
            errors_db={**self.errors_db, BRIGHT_SURROUNDINGS: error_db})

    def __str__(self) -> str:
        lines = [f'{self.method}: {self.reason}', *([] if self.plan is None else [str(self.plan)])]
        if self.predicted_error_db is None:
            lines.append('error not predicted')
        else:
            lines.append(f'error against time-domain correlation: {self.predicted_error_db:.1f} '
                         f'dB predicted, {self.target_db:g} dB wanted')
            lines += [f'  {cause:<24}{error:7.1f} dB'
                      + (f' of {self.shares_db[cause]:.1f} dB' if cause in self.shares_db else '')
                      for cause, error in self.errors_db.items()]
        if self.seconds is not None:
            lines.append(f'{self.seconds:.3g} s on one thread, {self.n_bytes / 1e6:.3g} MB')
        return '\n'.join([*lines, *(f'warning: {text}' for text in self.warnings)])


def error_in_words(error_db: float | None) -> str:
    """A predicted error, or that there is none."""
    return 'error not predicted' if error_db is None else f'predicted error {error_db:.0f} dB'


@dataclasses.dataclass(eq=False)
class Image(HeldSamples):
    """Complex image: its samples, their grid, and how it was formed.

    NumPy and arithmetic take it for its samples, and give an array: ``np.abs(image)``, ``image /
    n``, ``image == other``, ``image[0]``, ``image.real``. What the grid, the carrier and the
    report say need not hold for that array; ``dataclasses.replace(image, samples=image / n)`` says
    that it does. ``image /= n`` and ``image[0] = n`` change the samples in place.

    Attributes
    ----------
    samples : complex64 array
        ``f(x) = sum_m sum_n s_mn(D_mn(x)) exp(+j k_c D_mn(x))`` (Rosenberg & Gray, equation 17)
        in the shape of the grid, row 0 of a map at the largest y; ``(C, ...)`` where each channel
        has its image. The carrier is in it: the phase turns with the two-way path.
    grid : Grid
        Where the pixels are, imaging frame.
    carrier_hz : float
        Carrier frequency of the phases, hertz.
    report : Report
        How it was formed, with the error predicted for it.
    stamp_ns : int
        Time of the middle pulse, nanoseconds since the epoch of the pulses' clock; 0 for none.
    counters : (P,) int64
        Counters of the pulses in it, ascending.
    radiometry : Radiometry or None
        What the squared magnitude is, where the samples were calibrated.
    planned : Report or None
        Report before the image was seen, while pulses are added.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging import MapGrid, concatenate, plan_image
    >>> from sar_imaging.simulation import SCENARIOS
    >>> profiles = concatenate(list(SCENARIOS['psf']().blocks()))
    >>> grid = MapGrid((10_000.0, 0.0, 0.0), 25, 25, 0.5)
    >>> image = plan_image(grid, profiles.radar, profiles.n_samples)(profiles)
    >>> row, column = np.unravel_index(np.abs(image).argmax(), image.shape)
    >>> print(f'brightest at x = {grid.x_m[column]:.1f} m, y = {grid.y_m[row]:.1f} m')
    brightest at x = 10000.0 m, y = 0.0 m
    >>> image.samples.dtype.name, image.n_pulses, image.missing.size
    ('complex64', 200, 0)
    >>> mean = image / image.n_pulses
    >>> type(mean).__name__, mean.dtype.name
    ('ndarray', 'complex64')
    """

    samples: np.ndarray
    grid: Grid
    carrier_hz: float
    report: Report
    stamp_ns: int = 0
    counters: np.ndarray = dataclasses.field(default_factory=lambda: np.zeros(0, np.int64))
    radiometry: Radiometry | None = None
    planned: Report | None = dataclasses.field(default=None, repr=False)

    @property
    def n_pulses(self) -> int:
        """Number of pulses in the image."""
        return len(self.counters)

    @property
    def missing(self) -> np.ndarray:
        """(M,) int64 counters between the first pulse and the last that are not in the image."""
        if not len(self.counters):
            return np.zeros(0, np.int64)
        return np.setdiff1d(np.arange(self.counters[0], self.counters[-1] + 1), self.counters)
