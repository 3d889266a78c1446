"""Multichannel backprojection with the exact two-way path of every channel.

Rosenberg & Gray, equations 13 to 17 and 19: each range profile is read at the distance of each
pixel, its carrier phase is restored, and all pulses and channels are summed. The paper applies
the phase of a channel's offset to the profile read at the reference antenna's delay; here every
channel is read at its own delay, which needs no approximation.

Three ways lead to the same sum, and the geometry chooses the quickest that meets the error
target: a polar image around the aperture, interpolated to the map (its lines follow range
best); lines of the grid itself; and point by point, for grids near or around the antenna, for
terrain and for positions that form no grid.
"""

from __future__ import annotations

import logging
import math
from typing import TYPE_CHECKING

import numpy as np

from .. import backends
from ..geometry.grids import EvenGrid, Grid, MapGrid
from ..geometry.point_grids import as_grid
from ..planning.exact.backprojection import (
    LEAST_TARGET_DB,
    BackprojectionPlan,
    plan_backprojection,
)
from ..planning.exact.points import ImagePoints
from ..planning.memory import check_memory
from ..signal.pulses import PulseBlock, check_profiles
from ..signal.radar import RadarParameters

if TYPE_CHECKING:
    from ..backends.protocol import Backend, Backprojection
from .channels import Channels

_logger = logging.getLogger(__name__)


class Backprojector:
    """Backproject range profiles of one radar onto one grid.

    Pulses from the same places as those before them are imaged by the same plan.

    Parameters
    ----------
    grid : Grid or (..., 3) array_like
        Where the pixels are: any grid of `sar_imaging.geometry`, or positions in the imaging
        frame, metres, float64. A position with a NaN is no pixel; its value stays as it is, 0 in
        a new image.
    radar : RadarParameters
        Of the compressed profiles; a profile must be sampled at 1.25 times its bandwidth or more.
    n_samples : int
        Samples of each profile.
    target_db : float
        Wanted error against time-domain correlation, dB. Chooses the interpolation.
    height_m : (n_y, n_x) array_like, optional
        Heights of the pixels of a map in the imaging frame, metres, instead of its plane; row 0
        at the largest y. NaN where the height is not known: no pixel, as above.
    weights : (C,) complex array_like, optional
        Factor of each channel, such as its calibration or the steering of a beam.
    per_channel : bool
        One image per channel instead of their sum, of shape ``(C, ...)``: the input of
        along-track interferometry and clutter cancelling.
    midpoint : bool
        Replace both phase centres of a channel by their mean (displaced phase centre). For
        comparison: the exact path costs no more.
    backend : str or Backend
        What computes the image: ``'auto'``, ``'cpu'``, ``'reference'`` or an object of your own.

    Attributes
    ----------
    grid : Grid
        Where the pixels are; a `PointGrid` of an array of positions, a `TerrainGrid` of a map with
        heights.
    shape : tuple of int
        Of the image of one channel, or of the sum of the channels.
    predicted_error_db : float
        Predicted error against time-domain correlation of what was added so far, dB; with
        `midpoint`, of the same approximation.
    warnings : tuple of str
        What makes images worse than wanted; a call logs it, too.
    method : str
        How the latest pulses were added: ``'polar'``, ``'lines'`` or ``'points'``.

    Raises
    ------
    ValueError
        The profiles are sampled too coarsely, the target cannot be met in float32, or grid,
        heights or weights are no such arrays.
    MemoryError
        An image is larger than the memory that is available.

    Examples
    --------
    >>> plan = Backprojector(grid, profiles.radar, profiles.n_samples)    # doctest: +SKIP
    >>> image = plan(profiles)                                            # doctest: +SKIP
    """

    def __init__(self, grid: Grid | np.ndarray, radar: RadarParameters, n_samples: int, *,
                 target_db: float = -80.0, height_m=None, weights=None, per_channel: bool = False,
                 midpoint: bool = False, backend: str | Backend = backends.AUTO):
        if radar.sample_rate_hz < 1.25 * radar.bandwidth_hz:
            raise ValueError(
                f'profiles sampled at {radar.sample_rate_hz:g} Hz for a bandwidth of '
                f'{radar.bandwidth_hz:g} Hz; sample them at 1.25 times the bandwidth or more '
                '(parameter oversampling of the range compression)')
        if not LEAST_TARGET_DB <= target_db <= -20.0:
            raise ValueError(f'target_db={target_db}; expected -100 to -20 dB, float32 '
                             'arithmetic reaches -100 dB')
        self.radar, self.n_samples = radar, int(n_samples)
        self.target_db = float(target_db)
        self._channels = Channels(weights, per_channel, midpoint)
        self.grid = as_grid(grid, height_m)
        self.shape = self.grid.shape
        self._check_memory(1)
        self._pixels = (self.grid if isinstance(self.grid, MapGrid | EvenGrid)
                        else ImagePoints.of_grid(self.grid))
        self.predicted_error_db = -math.inf
        self.warnings: tuple[str, ...] = ()
        self.method = ''
        self._backend = backends.backend(backend)
        self._latest: dict[int, Backprojection] = {}  # of each channel, or of all at 0

    def __call__(self, block: PulseBlock) -> np.ndarray:
        """Image of one block.

        Parameters
        ----------
        block : PulseBlock
            Range profiles with phase centres.

        Returns
        -------
        (n_y, n_x) complex64
            ``f(x) = sum_m sum_n w_n s_mn(D_mn(x)) exp(+j k_c D_mn(x))``, row 0 at the largest y.
            For an array of points ``(...)``; one for each channel, ``(C, ...)``, with
            `per_channel`.

        Raises
        ------
        ValueError
            As `add`.
        MemoryError
            The images of the channels are larger than the memory that is available.
        """
        image, told = self.new_image(block.n_channels), self.warnings
        self.add(block, image)
        for warning in set(self.warnings) - set(told):
            _logger.warning(warning)
        return image

    def new_image(self, n_channels: int = 1) -> np.ndarray:
        """Zeros in the shape that `add` expects for blocks of this number of channels.

        Raises
        ------
        MemoryError
            The image is larger than the memory that is available.
        """
        self._check_memory(n_channels if self._channels.per_channel else 1)
        return np.zeros(self._channels.shape(self.shape, n_channels), np.complex64)

    def add(self, block: PulseBlock, image: np.ndarray) -> None:
        """Add the pulses of a block to an image (equation 17 is a sum).

        Pulses may come in any order and positions may repeat; each pulse is added. Ranges outside
        a profile contribute nothing, and an empty block does not either.

        Parameters
        ----------
        block : PulseBlock
            Range profiles with phase centres.
        image : (n_y, n_x) complex64
            Changed in place; contiguous in C order. Of the shape that `new_image` gives.

        Raises
        ------
        ValueError
            The block is not compressed, has no positions, does not match the plan or its weights,
            or none of its profiles reaches the grid.
        """
        check_profiles(block, self.radar, self.n_samples)
        self._channels.check(block.n_channels)
        self._check_image(image, self._channels.shape(self.shape, block.n_channels))
        nowhere = isinstance(self._pixels, ImagePoints) and self._pixels.empty
        if block.n_pulses == 0 or nowhere:
            return
        parts = self._channels.parts(block)
        images = image if self._channels.per_channel else [image]
        for number, (part, own) in enumerate(zip(parts, images, strict=True)):
            self._add_rows(number, *_as_rows(part.samples, part.tx_m, part.rx_m), own)

    def plan(self, tx_m, rx_m) -> BackprojectionPlan:
        """Plan for pulses from some phase centres, (P, C, 3), metres, before they come.

        Raises
        ------
        ValueError
            None of their profiles reaches the grid.
        """
        rows = (np.ascontiguousarray(a, np.float64).reshape(-1, 3) for a in (tx_m, rx_m))
        return self._planned_for(0, *rows).plan

    def _add_rows(self, channel, samples, tx_m, rx_m, image):
        backprojection = self._planned_for(channel, tx_m, rx_m)
        plan = backprojection.plan
        self.method = plan.method
        self.warnings = plan.warnings or self.warnings  # of the latest block that has one
        backprojection.add(samples, tx_m, rx_m, image)
        self.predicted_error_db = max(self.predicted_error_db, plan.predicted_error_db)

    def _planned_for(self, channel, tx_m, rx_m) -> Backprojection:
        """By the plan of these phase centres; the latest is kept for those that come again."""
        latest = self._latest.get(channel)
        if latest is None or not latest.plan.is_for(tx_m, rx_m):
            memory = next((other.memory for other in self._latest.values()), None)
            latest = self._latest[channel] = self._backend.Backprojection(plan_backprojection(
                self._pixels, self.radar, self.n_samples, tx_m, rx_m, self.target_db), memory)
        return latest

    def _check_memory(self, n_images):
        size = ' x '.join(map(str, reversed(self.shape)))
        count = f'{n_images} images' if n_images > 1 else 'an image'
        check_memory(8 * n_images * math.prod(self.shape), f'{count} of {size} pixels',
                     'choose a smaller grid or a larger pixel spacing')

    def _check_image(self, image, shape):
        if image.shape != shape or image.dtype != np.complex64 or not image.flags.c_contiguous:
            raise ValueError(f'image is {image.dtype} {image.shape}; expected complex64 {shape}, '
                             'contiguous in C order')


def _as_rows(samples, tx_m, rx_m):
    """Profiles and phase centres with one row per pulse and channel."""
    return (np.ascontiguousarray(samples).reshape(-1, samples.shape[-1]),
            *(np.ascontiguousarray(a).reshape(-1, 3) for a in (tx_m, rx_m)))
