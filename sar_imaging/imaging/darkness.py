# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Images that are darker than their pulses let expect, and err more than predicted.

Errors have the power of the pulses, predictions are relative to that of an evenly bright image.
What is bright beyond an image cancels out in it, its errors hardly do.
"""

from __future__ import annotations

import math
from typing import Any, cast

import numpy as np

from ..device_arrays import to_host
from .image import Report

# By how much the errors of echoes that see an image alike add up, and at most: as echoes add up
# in images of even scenes, less what these are brighter by. Measured, see docs/theory.md.
_ALIKE, _MOST_ALIKE = 0.25, 10 ** 0.35
_LEAST_DB = 1.0  # that counts
_TOLD_DB = 6.0  # images of noise, of which nothing is alike, reach 3.5 dB, and 5.5 beyond the band
_MOST_DB = 100.0  # of an image that is empty
_RUN, _RUNS = 64, 128  # pixels of a large image that tell whether it may be dark


def judged(report: Report, samples: np.ndarray, n_pixels: int) -> Report:
    """The report of an image that was formed, once its brightness is known.

    Parameters
    ----------
    report : Report
        As planned, with the power of the pulses and a plan that tells `echoes_alike`; any other
        is returned as it is.
    samples : complex64 array
        The image, or those of several channels one after the other, here or on a device.
    n_pixels : int
        Pixels of one.
    """
    if not report.pulse_power or report.predicted_error_db is None:
        return report
    flat, most = samples.reshape(-1), n_pixels * report.pulse_power * _MOST_ALIKE
    bright = most / 10 ** (_LEAST_DB / 10)
    if (step := flat.size // (_RUN * _RUNS)) > 3:
        some = flat[:_RUN * _RUNS * step].reshape(_RUNS, -1)[:, :_RUN]
        if _power(some) * step > 2 * bright:
            return report
    power = _power(flat)
    if power > bright:
        return report
    alike = cast(Any, report.plan).echoes_alike
    expected = most * min(alike * _ALIKE / _MOST_ALIKE, 1.0)
    dark_db = min(10 * math.log10(expected / power), _MOST_DB) if power else _MOST_DB
    if dark_db <= _LEAST_DB:
        return report
    told = (f'the image is {dark_db:.1f} dB darker than pulses as strong let expect, and so much '
            'larger may be its error: what is bright lies beyond its edges; image a larger grid',)
    return report.amid_bright(dark_db, *(told if dark_db > _TOLD_DB else ()))


def _power(values: np.ndarray) -> float:
    return float(to_host(np.vdot(values, values)).real)
