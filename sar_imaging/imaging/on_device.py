"""Images of samples that lie on a CUDA device: formed there, and here where the device fails."""

from __future__ import annotations

import dataclasses
import logging
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from ..backends import CUDA, DeviceError
from ..backends.samples import compress
from ..device_arrays import beside, to_host
from ..signal.pulses import PulseBlock
from ..signal.range_compression import RangeCompressor
from .image import Report
from .methods import Method, Options

if TYPE_CHECKING:
    from .imager import Imager

_logger = logging.getLogger(__name__)


def prepared(planned: Method, compressor: RangeCompressor, block: PulseBlock) -> PulseBlock:
    """Range profiles of raw pulses, on the device where a device will image them."""
    if _images_there(planned):
        try:
            return compress(compressor, block, CUDA)
        except DeviceError as error:
            if planned.options.backend == CUDA:
                raise
            _logger.warning(f'{error}; the processor computes')
    return compress(compressor, block, planned.options.backend)


def _images_there(planned: Method) -> bool:
    """Whether a device will form the images of a method, which may have the choice."""
    chosen = getattr(planned, '_sum', None) or getattr(planned, '_backend', None)
    name = getattr(chosen, 'name', '') or getattr(chosen, '__name__', '').rpartition('.')[2]
    return CUDA in (name, planned.options.backend)


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
