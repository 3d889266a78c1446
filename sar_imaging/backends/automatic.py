# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""The backend 'auto' where there is a CUDA device: each plan goes where it is done soonest.

Both backends' times are predicted, transfers included. Where the device fails, or lacks memory,
the processor does the same, after one line in the log.
"""

from __future__ import annotations

import dataclasses
import logging
import os
from collections.abc import Mapping
from types import ModuleType
from typing import TYPE_CHECKING, Any

import numpy as np

from ..device_arrays import on_device
from ..geometry.grids import MapGrid
from ..planning.afbp.polar_grids import UnifiedPolarGrids
from ..planning.afbp.subapertures import SubaperturePlan
from ..planning.costs import costs
from ..planning.exact.backprojection import BackprojectionPlan
from ..signal.pulses import PulseBlock
from ..signal.radar import RadarParameters
from . import cpu, device
from .device import DeviceError
from .protocol import Backend

if TYPE_CHECKING:
    from ..planning.afbp.plan import AfbpPlan

_logger = logging.getLogger(__name__)
_BYTES = 8  # of a complex sample
_TRIALS, _TRIAL_PIXELS = 100, 2048  # of a search, about
DEVICE_ARRAYS = True  # are taken where a device computes, and where it fails
GROUPS = False  # of echoes: plans are for either


def __getattr__(name: str) -> Any:
    return getattr(cpu, name)


def _there() -> Any:
    """The device's backend: this one is chosen where there is a device."""
    return device.device_backend()


def quicker(plan: BackprojectionPlan | AfbpPlan) -> Backend | ModuleType:
    """The backend that computes a plan sooner, by predicted times; the log says why."""
    there = _there()
    return _sooner(there, there.seconds(plan), plan.seconds, 'the image')


def _sooner(there: Backend | ModuleType, device_s: float, thread_s: float, what: str
            ) -> Backend | ModuleType:
    """The device's backend where its predicted time is less than that of all processors."""
    here_s = thread_s / _processors()
    chosen = there if device_s < here_s else cpu
    _logger.info(f'{what} takes {device_s:.2g} s on the CUDA device, transfers included, and '
                 f'{here_s:.2g} s on the processor: the '
                 f'{"processor" if chosen is cpu else "device"} computes it')
    return chosen


class Backprojection:
    """Adds range profiles to images, see `backends.protocol.Backprojection`.

    Attributes
    ----------
    name : str
        Backend that computes the plan: ``'cuda'`` or ``'cpu'``.
    """

    def __init__(self, plan: BackprojectionPlan, memory: object = None) -> None:
        self.plan, self._memory = plan, memory
        self.name = 'cpu'
        self._sum: Any = None
        chosen = quicker(plan)
        if chosen is not cpu:
            try:
                self._sum, self.name = chosen.Backprojection(plan), 'cuda'
            except ValueError as error:  # what the device's backend does not compute
                _logger.info(f'{error}; the processor computes')
            except DeviceError as error:
                self._give_up(error)

    @property
    def memory(self) -> object:
        """Work space of the processor's backend, see `backends.protocol.Backprojection`."""
        return self._memory if self._sum is None or self.name == 'cuda' else self._sum.memory

    def add(self, samples: np.ndarray, tx_m: np.ndarray, rx_m: np.ndarray, image: np.ndarray
            ) -> None:
        """Add echoes to an image, see `backends.protocol.Backprojection`."""
        if self.name == 'cuda':
            try:
                self._sum.add(samples, tx_m, rx_m, image)
                return
            except DeviceError as error:  # the image is as it was
                self._give_up(error)
        if self._sum is None:
            self._sum = cpu.Backprojection(self.plan, self._memory)
        self._sum.add(_fetched(samples), tx_m, rx_m, image)

    def _give_up(self, error: DeviceError) -> None:
        _logger.warning(f'{error}; the processor computes')
        self.name, self._sum = 'cpu', None


class _Handed:
    """Work that a device begins and the processor goes on with where the device fails."""

    def __init__(self, device_s: float, thread_s: float, what: str, *made: Any, **options: Any
                 ) -> None:
        self._made, self._options, self._on_device = made, options, False
        self._work: Any = None
        there = _there()
        if _sooner(there, device_s, thread_s, what) is not cpu:
            try:
                self._work = getattr(there, type(self).__name__)(*made, **options)
                self._on_device = True
            except ValueError as error:  # what the device's backend does not compute
                _logger.info(f'{error}; the processor computes')
            except DeviceError as error:
                _logger.warning(f'{error}; the processor computes')
        if self._work is None:
            self._work = self._begin_here()

    def _begin_here(self) -> Any:
        """The processor's, as far as the work has come."""
        return getattr(cpu, type(self).__name__)(*map(_here, self._made), **self._options)

    def _do(self, entry: str, *arguments: Any) -> Any:
        if self._on_device:
            try:
                return getattr(self._work, entry)(*arguments)
            except DeviceError as error:
                _logger.warning(f'{error}; the processor computes')
                self._on_device, self._work = False, self._begin_here()
        return getattr(self._work, entry)(*map(_here, arguments))


class SubapertureImager(_Handed):
    """Images of sub-apertures where they are formed, see `backends.protocol.SubapertureImager`."""

    def __init__(self, plan: SubaperturePlan) -> None:
        self.plan = plan
        n_echoes = plan.sampling.pulses[0].stop * plan.n_channels
        counts = plan.image_operations(n_echoes)
        n_bytes = _BYTES * (n_echoes * plan.n_samples + plan.coarse.n_alpha * plan.coarse.n_range)
        super().__init__(_device_seconds({**counts, 'subaperture': 1}, n_bytes),
                         costs().seconds(counts), 'a sub-aperture image', plan)

    def image(self, number: int, block: PulseBlock, weights: np.ndarray | None = None,
              out: np.ndarray | None = None) -> np.ndarray:
        """See `backends.protocol.SubapertureImager`."""
        return self._do('image', number, block, weights, out)


class SpectrumFusion(_Handed):
    """Sub-aperture images fused while they come, see `backends.protocol.SpectrumFusion`.

    Spectra and sums stay on the device. What was added is remembered, all but the latest in the
    host's memory, so that the processor can go on with it.
    """

    def __init__(self, grid: UnifiedPolarGrids, *, keep: bool = False) -> None:
        self.grid = grid
        self._added: dict[int, tuple[np.ndarray, float]] = {}
        counts = grid.operations(1)
        super().__init__(
            _device_seconds(counts, _BYTES * grid.polar.n_alpha * grid.polar.n_range),
            costs().seconds(counts), 'a fused image', grid, keep=keep)

    @property
    def included(self) -> frozenset[int]:
        """Sub-apertures in the image."""
        return self._work.included

    def add(self, number: int, image: np.ndarray, centre_m: float) -> None:
        """See `backends.protocol.SpectrumFusion`."""
        self._do('add', number, image, centre_m)
        if self._added:  # the device is done with it
            latest, (former, former_m) = next(reversed(self._added.items()))
            self._added[latest] = _fetched(former), former_m
        self._added[number] = image, centre_m

    def remove(self, number: int) -> None:
        """See `backends.protocol.SpectrumFusion`."""
        self._do('remove', number)
        del self._added[number]

    def polar_image(self, centre_m: float = 0.0) -> np.ndarray:
        """See `backends.protocol.SpectrumFusion`."""
        return self._do('polar_image', centre_m)

    def take_polar_image(self) -> np.ndarray:
        """See `backends.protocol.SpectrumFusion`."""
        image = self._do('take_polar_image')
        self._added.clear()
        return image

    def clear(self) -> None:
        """See `backends.protocol.SpectrumFusion`."""
        self._do('clear')
        self._added.clear()

    def _begin_here(self) -> Any:
        made = super()._begin_here()
        for number, added in self._added.items():
            made.add(number, *map(_fetched, added))
        return made


class TrialImages(_Handed):
    """Quick images for a search, see `backends.protocol.TrialImages`: some hundred of them."""

    def __init__(self, radar: RadarParameters, samples: np.ndarray) -> None:
        pixels = samples[..., 0].size * _TRIALS * _TRIAL_PIXELS
        counts = {'point_pixel': pixels, 'image': _TRIALS}
        super().__init__(_device_seconds(counts, _BYTES * samples.size), costs().seconds(counts),
                         'a search by trial images', radar, samples)

    @property
    def length(self) -> int:
        """Pixels of a piece of a line."""
        return self._work.length

    def image(self, tx_m: np.ndarray, rx_m: np.ndarray, starts_m: np.ndarray, step_m: np.ndarray,
              range_bias_m: float = 0.0) -> np.ndarray:
        """See `backends.protocol.TrialImages.image`."""
        return self._do('image', tx_m, rx_m, starts_m, step_m, range_bias_m)


def form_map(polar_image: np.ndarray, fusion: UnifiedPolarGrids, grid: MapGrid,
             centre_m: float = 0.0, *, overwrite: bool = False) -> np.ndarray:
    """Map where it is formed, see `backends.protocol.Backend`; a polar image of a device there."""
    counts, n_pixels = {'map_pixel': grid.n_x * grid.n_y}, polar_image[0].size
    there = _there()
    if not on_device(polar_image):
        there = _sooner(there, _device_seconds(counts, _BYTES * (n_pixels + grid.n_x * grid.n_y)),
                        costs().seconds(counts), 'a map')
    if there is not cpu:
        try:
            return there.form_map(polar_image, fusion, grid, centre_m)
        except DeviceError as error:
            _logger.warning(f'{error}; the processor computes')
    return cpu.form_map(_fetched(polar_image), fusion, grid, centre_m, overwrite=overwrite)


def _here(argument: Any) -> Any:
    """An array or a block of the device as one of the host; anything else as it is."""
    if isinstance(argument, PulseBlock):
        return dataclasses.replace(argument, samples=_fetched(argument.samples))
    return _fetched(argument)


def _fetched(array: Any) -> Any:
    """An array of the device as one of the host; DeviceError where that fails."""
    return device.require_device().to_host(array) if on_device(array) else array


def sooner_there(counts: Mapping[str, float], n_samples: int, what: str) -> bool:
    """Whether the device does operations sooner, with so many samples sent there or fetched."""
    device_s = _device_seconds(counts, _BYTES * n_samples)
    return _sooner(_there(), device_s, costs().seconds(counts), what) is not cpu


def _device_seconds(counts: Mapping[str, float], n_bytes: float) -> float:
    return _there().device_costs().seconds({**counts, 'transferred_byte': n_bytes})


def _processors() -> int:
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:  # not Linux
        return os.cpu_count() or 1
