# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Images that err more than predicted, because what is bright lies beyond them.

Errors have the power of the pulses, predictions are relative to that of an evenly bright image.
What is bright beyond an image cancels out in it, its errors hardly do: the image is dark. Or it
holds side lobes alone, that is the ends of the band. Where the pulses are at hand, some pixels of
such an image are correlated, which measures its error. That of an image that grew block by block
is told by how dark it is, and by its side lobes.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any, cast

import numpy as np

from ..backends import compilation_announced
from ..device_arrays import to_host
from ..geometry.grids import Grid
from ..planning.exact.pulse_power import side_lobes_db
from .image import BRIGHT_SURROUNDINGS, Report

if TYPE_CHECKING:
    from ..signal.pulses import PulseBlock
    from .methods import Method

# By how much the errors of echoes that see an image alike add up, and at most: as echoes add up
# in images of even scenes, less what these are brighter by. Measured, see docs/theory.md.
_ALIKE, _MOST_ALIKE = 0.25, 10 ** 0.35
_LEAST_DB = 1.0  # that counts
_TOLD_DB = 6.0  # images of noise, of which nothing is alike, reach 3.5 dB, and 5.5 beyond the band
_MOST_DB = 100.0  # of an image that is empty
_MOST_MEASURED = 3.5  # likewise at most: of ordinary images one in fifty is measured (measured)
_MEASURED, _MOST_TURNS = 128, 8  # pixels at a time: 0.4 dB of standard error if errors are even
_CERTAIN, _GOLDEN = 0.25, 0.618  # standard error over error, at which pixels are enough
_WHY = ('it is darker than pulses as strong let expect, or holds side lobes: what is bright lies '
        'beyond its edges; image a larger grid')
_RUN, _RUNS = 64, 128  # pixels of a large image that tell whether it may be dark

#: Values of an image by correlation at points (K, 3), metres: (K,) complex128, and (K,) bool,
#: whether profiles cover them.
Correlated = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]


def judged(report: Report, samples: np.ndarray, grid: Grid,
           reference: Callable[[], Correlated] | None = None) -> Report:
    """The report of an image that was formed, once its brightness is known.

    Parameters
    ----------
    report : Report
        As planned, with the power of the pulses and a plan that tells `echoes_alike`; any other
        is returned as it is.
    samples : complex64 array
        The image, or those of several channels one after the other, here or on a device.
    grid : Grid
        Where the pixels of one are.
    reference : callable, optional
        Gives what the pixels of one image should be, `Correlated`, where its pulses are at hand.
    """
    if not report.pulse_power or report.predicted_error_db is None:
        return report
    even = math.prod(grid.shape) * report.pulse_power
    lobes_db = side_lobes_db(report.band_end_power / report.pulse_power)
    power = _power_below(samples.reshape(-1), even * _MOST_MEASURED, lobes_db > 0)
    if power is None:
        return report
    alike = cast(Any, report.plan).echoes_alike * _ALIKE
    doubted = lobes_db > 0 or power < even * min(alike, _MOST_MEASURED)
    if reference and samples.ndim and power and doubted:
        with compilation_announced():
            error_db = _measured_db(samples, grid, reference())
        if error_db is not None:
            return _as_measured(report, error_db)
    if BRIGHT_SURROUNDINGS in report.errors_db:  # as AFBP has seen
        return report
    expected = even * min(alike, _MOST_ALIKE)
    dark_db = min(10 * math.log10(expected / power), _MOST_DB) if power else _MOST_DB
    excess_db = lobes_db + (dark_db if dark_db > _LEAST_DB else 0.0)
    if not excess_db:
        return report
    told = (f'the image may err {excess_db:.1f} dB more than planned: {_WHY}',)
    return report.amid_bright(excess_db, *(told if excess_db > _TOLD_DB else ()))


def correlated(method: Method, block: PulseBlock) -> Correlated:
    """What an image of a block by a method should be."""
    from ..signal.windows import window  # few images are dark
    from .correlation import correlate_pulses

    block, options = method.weighted(block), method.options
    if not options.compressed:
        weights = window(options.weighting, method.n_samples)
        block = dataclasses.replace(
            block, samples=block.samples * (weights / weights.sum()).astype(np.float32))
    return functools.partial(correlate_pulses, block, illumination=options.illumination)


def _power_below(flat: np.ndarray, most: float, any_power: bool) -> float | None:
    """Power of an image that is darker, or of any; None of others, of which a part may tell."""
    if not any_power and (step := flat.size // (_RUN * _RUNS)) > 3:
        some = flat[:_RUN * _RUNS * step].reshape(_RUNS, -1)[:, :_RUN]
        if _power(some) * step > 2 * most:
            return None
    power = _power(flat)
    return power if any_power or power < most else None


def _measured_db(samples: np.ndarray, grid: Grid, reference: Correlated) -> float | None:
    """Error of an image and its standard error, dB, by correlation of some of its pixels.

    Half of them are drawn all over the image, half of them by their power: errors may be alike
    everywhere, or lie where the image is bright. More are drawn while few hold the error. None
    where profiles cover no pixel.
    """
    flat = samples.reshape(-1)
    weight = np.abs(flat) ** 2
    weight = 0.5 * (weight + weight.mean(dtype=np.float64))
    until = weight.cumsum(dtype=np.float64)
    errors = np.zeros(0)
    for turn in range(_MOST_TURNS):
        place = (np.arange(_MEASURED) + (0.5 + turn * _GOLDEN) % 1) / _MEASURED
        drawn = np.searchsorted(until, until[-1] * place)
        points_m = grid.positions(*np.unravel_index(drawn, grid.shape)).reshape(-1, 3)
        known = np.isfinite(points_m).all(axis=1)
        drawn = drawn[known]
        try:
            expected, covered = reference(points_m[known])
        except ValueError:  # of profiles that nobody can correlate
            return None
        if not covered.any():
            return None
        errors = np.append(errors, (np.abs(flat[drawn] - expected) ** 2 / weight[drawn])[covered])
        mean, uncertain = float(errors.mean()), float(errors.std()) / math.sqrt(len(errors))
        if uncertain <= _CERTAIN * mean:
            break
    return 10 * math.log10(max(mean + uncertain, 1e-30))


def _as_measured(report: Report, error_db: float) -> Report:
    excess_db = error_db - cast(float, report.predicted_error_db)
    if excess_db <= 0:
        return report
    told = (f'the image errs {excess_db:.1f} dB more than planned, as some of its pixels tell: '
            f'{_WHY}',)
    return report.amid_bright(excess_db, *(told if excess_db > _TOLD_DB else ()))


def _power(values: np.ndarray) -> float:
    return float(to_host(np.vdot(values, values)).real)
