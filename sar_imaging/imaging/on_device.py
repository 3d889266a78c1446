"""Images of samples that lie on a CUDA device: formed there, and here where the device fails."""

from __future__ import annotations

import dataclasses
import logging
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from ..backends import AUTO, CUDA, DeviceError, backend
from ..device_arrays import beside, to_host
from ..signal.pulses import PulseBlock
from .image import Report
from .methods import Options

if TYPE_CHECKING:
    from ..backends.protocol import Backend
    from .imager import Imager

_logger = logging.getLogger(__name__)


def check_device_arrays(name: str | Backend) -> None:
    """Check that a backend takes samples that lie on a CUDA device.

    Raises
    ------
    ValueError
        It does not say so: it has no true attribute ``DEVICE_ARRAYS``.
    """
    if not getattr(backend(name), 'DEVICE_ARRAYS', False):
        raise ValueError(f'the samples lie on a CUDA device, where backend={name!r} does not '
                         f'reach them; use backend={CUDA!r} or {AUTO!r}, or copy them to the host '
                         'with samples.get()')


class FormedThere:
    """Images as an imager forms them, on the device.

    Parameters
    ----------
    here : Imager
        Whose images they are; it takes over where the device fails.
    make : callable
        Makes the same imager of other options.
    """

    def __init__(self, here: Imager, make: Callable[[Options], Imager]):
        self._here = here
        self._there = make(dataclasses.replace(here._options, backend=CUDA))

    def __call__(self, number: int, block: PulseBlock, onto=None) -> tuple[np.ndarray, Report]:
        """As `Imager._formed`."""
        try:
            return self._there._formed(number, block, onto)
        except DeviceError as error:
            _logger.warning(f'{error}; the processor computes')
        here = dataclasses.replace(block, samples=to_host(block.samples))
        samples, report = self._here._formed(number, here)
        samples = beside(samples, block.samples if onto is None else onto)
        return (samples if onto is None else np.add(onto, samples, out=onto)), report
