# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Parameters of calibrated brightness, and images scaled to it before they are published."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from sar_imaging.configuration.radiometry import (
    FILE as FILE_NAME,
    NONE,
    QUANTITY as QUANTITY_NAME,
    WINDOW as WINDOW_NAME,
    constant_of,
)
from sar_imaging.geometry.illumination import AntennaPattern
from sar_imaging.imaging.image import Image
from sar_imaging.radiometry import QUANTITIES, LiveCalibration
from sar_imaging.signal.pulses import PulseBlock
from sar_imaging.signal.windows import parse_window

from ..runtime.health import Health, Part
from ..runtime.parameters import Parameter, one_of, refused

QUANTITY = Parameter(
    QUANTITY_NAME, NONE, 'What the squared magnitude of images is: '
    f'{", ".join(QUANTITIES)}; {NONE}: as the samples are.', check=one_of(NONE, *QUANTITIES))
CONSTANT_FILE = Parameter(
    FILE_NAME, '', 'YAML file with the radar constant, as `sar-imaging '
    'radar-constant` writes it.')
WINDOW = Parameter(
    WINDOW_NAME, NONE, 'Window of the range profiles, as of range_compression.',
    check=parse_window)
PARAMETERS = (QUANTITY, CONSTANT_FILE, WINDOW)
COUNTERS = ('brightness_median_db', 'noise_equivalent_db', 'incidence_deg', 'responses_computed',
            'calibration_seconds')
FAULTS = ('images_not_calibrated',)


class ImageBrightness:
    """Scales images to a calibrated brightness, and counts what came of it.

    Parameters
    ----------
    parameters : mapping
        Values of `PARAMETERS`.
    pattern : AntennaPattern or None
        That images are weighed by.
    health : Health or Part
        Counters, with `COUNTERS` and `FAULTS`, and log.

    Attributes
    ----------
    told : str
        What to add to the log line of the latest image.

    Raises
    ------
    ConfigurationError
        The parameters contradict each other, or name no radar constant.
    """

    def __init__(self, parameters: Mapping[str, Any], pattern: AntennaPattern | None,
                 health: Health | Part):
        with refused('parameter '):
            constant = constant_of(parameters)
        self._calibration = constant and LiveCalibration(
            constant, parameters[QUANTITY.name], pattern=pattern,
            weighting=parameters[WINDOW.name])
        self._health = health
        self.told = ''

    def factors(self, image: Image, pulses: Callable[[], PulseBlock]
                ) -> Callable[[], dict[str, object]]:
        """Function that returns what `write_sicd` takes for scale factors; nothing uncalibrated.

        The arguments are those of `calibrated`, whose ValueError it raises.
        """
        def tell() -> dict[str, object]:
            if self._calibration is None:
                return {}
            response, constant = self._calibration.response(image, pulses())
            return {'response': response, 'constant': constant}

        return tell

    def calibrated(self, image: Image, pulses: Callable[[], PulseBlock]) -> Image | None:
        """The image as brightness, or as it is where that is not wanted.

        None where the brightness cannot be told, which is counted and reported.

        Parameters
        ----------
        image : Image
            As formed.
        pulses : callable
            Returns the pulses that it was formed from, or raises ValueError.
        """
        if self._calibration is None:
            return image
        began, self.told = time.perf_counter(), ''
        try:
            scaled = self._calibration(image, pulses())
        except ValueError as error:
            self._health.count('images_not_calibrated')
            self._health.warning(f'the image is not published, its brightness cannot be told: '
                                 f'{error}')
            return None
        for name in ('noise_equivalent_db', 'incidence_deg'):
            self._health.set(name, getattr(scaled.radiometry, name))
        median = median_db(scaled.samples)
        self.told = f', median {median:.1f} dB of {scaled.radiometry}'
        self._health.set('brightness_median_db', median)
        self._health.set('responses_computed', self._calibration.computed)
        self._health.set('calibration_seconds', time.perf_counter() - began)
        return scaled


def median_db(samples: np.ndarray) -> float:
    """Median power of the pixels that are lit, dB; NaN where none is."""
    some = samples.ravel()[::max(1, samples.size // 2**16)]  # enough to a hundredth of a dB
    power = np.square(np.abs(some[some != 0]), dtype=np.float64)
    return float(10 * np.log10(np.median(power))) if power.size else np.nan
