# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Form one image per aperture from range profiles as they arrive."""

from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

import numpy as np

from ..backends import AUTO, CUDA
from ..backends.samples import to_device
from ..device_arrays import to_host
from ..geometry.grids import Grid
from ..geometry.illumination import AntennaPattern
from ..imaging.image import Image
from ..imaging.imager import Imager, plan_image
from ..imaging.methods import AFBP, EXACT, method_class
from ..quality.measures import FocusFigure, focus_figure
from ..signal.pulses import PulseBlock
from ..signal.pulses.apertures import (
    Aperture,
    AperturePulses,
    ApertureSequence,
    ApertureStatistics,
)

if TYPE_CHECKING:
    from ..backends.protocol import Backend


@dataclasses.dataclass(frozen=True)
class ApertureImage:
    """Image of one aperture.

    Parameters
    ----------
    image : complex64 array in the shape of the grid
        ``f(x) = sum_m sum_n s_mn(tau(x)) exp(+j 2 pi f_c tau(x))``; row 0 of a map is the largest
        y.
    grid : Grid
        Where the pixels are.
    stamp_ns : int
        Time of the middle of the aperture, nanoseconds since the epoch of the pulses' clock.
    aperture : int
        Number of the aperture, ``counter // pulses_per_aperture``.
    counters : (P,) uint32
        Counters of the pulses in the image, ascending.
    missing : (M,) int64
        Counters of the pulses that the aperture should have had, ascending.
    predicted_error_db : float or None
        Expected error against exact correlation, dB; None where it is not known.
    carrier_hz : float
        Of the radar that sent its pulses, hertz.
    pulses : PulseBlock or None
        The pulses themselves, where they were to be kept.
    method : str
        Imager that formed it, as `plan_image` names it.
    focus : object
        What autofocus has to tell of it; None where it was not tried.
    """

    image: np.ndarray
    grid: Grid
    stamp_ns: int
    aperture: int
    counters: np.ndarray
    missing: np.ndarray
    predicted_error_db: float | None
    carrier_hz: float
    pulses: PulseBlock | None = None
    method: str = EXACT
    focus: object | None = None

    @property
    def n_pulses(self) -> int:
        """Number of pulses in the image."""
        return len(self.counters)

    @property
    def n_missing(self) -> int:
        """Number of pulses that the aperture lacks."""
        return len(self.missing)

    @property
    def focus_figure(self) -> FocusFigure:
        """How much the image stands out from noise; computed at each call."""
        return focus_figure(self.image)


class ApertureImager(ApertureSequence):
    """Image range profiles while they arrive, one image per aperture.

    See `ApertureSequence` for what an aperture is. Its pulses may come in any order. Exact
    backprojection adds them to the image as they come; any other method images the whole aperture
    at its end.

    Parameters
    ----------
    grid : Grid
        Pixels to image.
    pulses_per_aperture : int
        Length of an aperture in pulses.
    min_pulse_fraction : float
        Share of its pulses, 0 to 1, that an aperture must have to be imaged; may be changed at
        any time through the attribute of this name.
    target_db : float
        Largest error against exact correlation to plan for, dB.
    height_m : (n_y, n_x) float64, optional
        Heights of the pixels instead of the plane of the grid, metres; NaN where there is none.
    keep_pulses : bool
        Keep the pulses of an aperture for its image.
    method : str
        As for `plan_image`. With ``'auto'`` apertures are imaged at their end until exact
        backprojection is chosen, and as they come from then on.
    illumination : AntennaPattern, optional
        As for `plan_image`; pulses then tell where the antenna looked. Pixels that no pulse lit
        are zero.
    backend : str or Backend
        As for `plan_image`. With ``'cuda'`` an image that grows stays on the device until its
        aperture ends.

    Raises
    ------
    ValueError
        A length or fraction is out of range, or the method knows no illumination.

    Examples
    --------
    >>> from sar_imaging import MapGrid
    >>> from sar_imaging.simulation import SCENARIOS
    >>> from sar_imaging.streaming.aperture import ApertureImager
    >>> live = ApertureImager(MapGrid((10_000.0, 0.0, 0.0), 25, 25, 0.5), pulses_per_aperture=200)
    >>> for block in SCENARIOS['psf']().blocks(50):  # as they arrive
    ...     for image in live.add(block):
    ...         print(len(image.counters), 'pulses,', image.image.shape)
    200 pulses, (25, 25)
    """

    def __init__(self, grid: Grid, *, pulses_per_aperture: int,
                 min_pulse_fraction: float = 0.5, target_db: float = -60.0,
                 height_m: np.ndarray | None = None, keep_pulses: bool = False,
                 method: str = EXACT, illumination: AntennaPattern | None = None,
                 backend: str | Backend = AUTO):
        super().__init__(pulses_per_aperture, ApertureStatistics(), min_pulse_fraction)
        self.grid = grid
        self._target_db = target_db
        self._height_m = height_m
        self._keep_pulses = keep_pulses
        self._method, self._grows, self._backend = method, method == EXACT, backend
        self._image: Image | None = None  # of the aperture being filled, where it grows
        self._illumination = illumination
        self._device_array = to_device(np.zeros((1, 1), np.complex64)) if backend == CUDA else None
        for name in (EXACT, AFBP) if method == AUTO else (method,):
            kind = method_class(name)  # known, and loaded before pulses come
            if illumination is not None and method != AUTO and not kind.ILLUMINATION:
                raise ValueError(f'method {name!r} knows no illumination; use {EXACT!r}')

    def _configure(self, block: PulseBlock) -> Imager:
        self._grows = self._method == EXACT
        return plan_image(self.grid, block.radar, block.n_samples, method=self._method,
                          target_db=self._target_db, height_m=self._height_m,
                          illumination=self._illumination, backend=self._backend)

    def _begin(self, number: int) -> Aperture:
        self._image = self._plan.new_image(like=self._device_array) if self._grows else None
        if self._grows and not self._keep_pulses:
            return Aperture(number, self._length)
        assert self._example is not None  # of the pulses that came
        return AperturePulses(number, self._length, self._example, [])

    def _fill(self, aperture: Aperture, block: PulseBlock) -> list[ApertureImage]:
        if self._image is not None:
            self._plan.accumulate(block, self._image)
        aperture.keep(block)
        self.statistics.imaged += block.n_pulses
        return []

    def _finish(self, aperture: Aperture) -> list[ApertureImage]:
        """An image, or a report why there is none."""
        if self._drop_short(aperture):
            return []
        image, self._image = self._image or self._plan(_pulses(aperture)), None
        report = image.report
        self._grows = report.method == EXACT
        self._warn(aperture.number, report.warnings)
        self.statistics.images += 1
        return [ApertureImage(
            to_host(image.samples), self.grid, aperture.centre_ns(), aperture.number,
            aperture.known.astype(np.uint32), aperture.missing, report.predicted_error_db,
            image.carrier_hz, _pulses(aperture) if self._keep_pulses else None, report.method)]


def _pulses(aperture: Aperture) -> PulseBlock:
    assert isinstance(aperture, AperturePulses)  # unless each block is added as it comes
    return aperture.block()
