"""The backend 'auto' where there is a CUDA device: each plan goes where it is done soonest.

Both backends' times are predicted, transfers included. Where the device fails, or lacks memory,
the processor does the same, after one line in the log.
"""

from __future__ import annotations

import logging
import os

import numpy as np

from ..planning.exact.backprojection import BackprojectionPlan
from ..planning.plan import Plan
from . import cpu, device
from .device import DeviceError
from .protocol import Backend

_logger = logging.getLogger(__name__)


def __getattr__(name):
    return getattr(cpu, name)


def quicker(plan: Plan) -> Backend:
    """The backend that computes a plan sooner, by the times that both predict."""
    there = device.device_backend()
    return there if there.seconds(plan) < plan.seconds / _processors() else cpu


class Backprojection:
    """Adds range profiles to images, see `backends.protocol.Backprojection`.

    Attributes
    ----------
    name : str
        Backend that computes the plan: ``'cuda'`` or ``'cpu'``.
    """

    def __init__(self, plan: BackprojectionPlan, memory: object = None):
        self.plan, self._memory = plan, memory
        self.name, self._sum = 'cpu', None
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

    def add(self, samples, tx_m, rx_m, image) -> None:
        """Add echoes to an image, see `backends.protocol.Backprojection`."""
        if self.name == 'cuda':
            try:
                return self._sum.add(samples, tx_m, rx_m, image)
            except DeviceError as error:  # the image is as it was
                self._give_up(error)
        if self._sum is None:
            self._sum = cpu.Backprojection(self.plan, self._memory)
        return self._sum.add(np.asarray(samples), tx_m, rx_m, image)

    def _give_up(self, error: DeviceError) -> None:
        _logger.warning(f'{error}; the processor computes')
        self.name, self._sum = 'cpu', None


def _processors() -> int:
    try:
        return len(os.sched_getaffinity(0))
    except AttributeError:  # not Linux
        return os.cpu_count() or 1
