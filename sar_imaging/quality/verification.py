# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Error of an image against time-domain correlation, estimated from a few of its pixels.

Correlation of every pixel takes hours where an imager takes seconds. The brightest pixels hold
most of the power of a radar image and are compared one by one; random ones stand for the rest.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..geometry.grids import Grid
from ..geometry.illumination import AntennaPattern
from ..imaging.correlation import correlate_pulses
from ..signal.pulses import PulseBlock

_PIXELS_AT_ONCE = 2 ** 22


@dataclasses.dataclass(frozen=True)
class Verification:
    """Error of an image as `measure_error` found it.

    Attributes
    ----------
    error_db : float
        Estimated error of the whole image, dB.
    n_pixels : int
        Random pixels compared.
    brightest_error_db : float
        Error of the brightest pixels alone, dB.
    n_brightest : int
        Brightest pixels compared.
    covered_share : float
        Share of the random pixels that the profiles cover, 0 to 1. The others were left out.

    Examples
    --------
    >>> from sar_imaging import MapGrid, plan_image
    >>> from sar_imaging.quality.verification import measure_error
    >>> from sar_imaging.simulation import SCENARIOS
    >>> block = next(SCENARIOS['psf']().blocks(50))
    >>> grid = MapGrid((10_000.0, 0.0, 0.0), 25, 25, 0.5)
    >>> image = plan_image(grid, block.radar, block.n_samples, method='exact')(block)
    >>> found = measure_error(image, grid, block, n_pixels=100, n_brightest=20)
    >>> found.n_pixels, found.n_brightest, found.covered_share
    (100, 20, 1.0)
    """

    error_db: float
    n_pixels: int
    brightest_error_db: float
    n_brightest: int
    covered_share: float = 1.0

    def __str__(self) -> str:
        left_out = ('' if self.covered_share == 1.0 else
                    f'; {1 - self.covered_share:.0%} of the pixels are left out, where ranges '
                    'come close to the end of a profile')
        return (f'{self.error_db:.1f} dB over the image ({self.n_pixels} random pixels), '
                f'{self.brightest_error_db:.1f} dB on the {self.n_brightest} brightest{left_out}')


def measure_error(image: ArrayLike, where: Grid | ArrayLike,
                  blocks: PulseBlock | Iterable[PulseBlock], *, n_pixels: int = 200,
                  n_brightest: int = 200, fit_scale: bool = False, seed: int = 0,
                  progress: bool = False, illumination: AntennaPattern | None = None
                  ) -> Verification:
    """Estimate the error of an image from exact correlation of some of its pixels.

    The error of a whole image is ``10 log10(sum |img - ref|^2 / sum |ref|^2)`` over its pixels,
    `ref` being `correlate_profiles` or, of raw pulses, `correlate`. `error_db` estimates just
    that, over the pixels that the profiles cover. Both sums are the sum over the brightest
    pixels of the image plus an estimate for the others, from uniformly random ones:

    - numerator: the mean ``|img - ref|^2`` of the random pixels times the number of others;
    - denominator: the power of the image in all others, which is known, times the ratio of
      ``sum |ref|^2`` to ``sum |img|^2`` over the random pixels. It is 1 but for the error
      itself, and makes the figure hold for bad images too.

    Where a delay comes close to the end of a profile, the value between its samples depends on
    samples that nobody has. Such pixels are left out of all sums; `covered_share` tells how many
    there are. Of the others' number and power the share is taken that random pixels show.

    Neither stratum would do alone. Random pixels miss the few that hold the power of a radar
    image, and with them an error that grows with brightness; dividing by the power of the random
    pixels would make the figure a matter of luck. Bright pixels say nothing about faint areas.
    With all pixels compared nothing is estimated. Error that is spread evenly is estimated from n
    random pixels with a standard deviation of ``4.3 / sqrt(n)`` dB, 0.3 dB for 200; error that
    sits in few places has more.

    `brightest_error_db` is the error by its definition over the brightest pixels alone.

    Parameters
    ----------
    image : complex array
        ``(n_y, n_x)`` on a map, ``(n_alpha, n_range)`` on a polar grid, ``(...)`` at points.
    where : Grid or (..., 3) float64
        Grid of the image, or the position of every pixel, metres. A position with a NaN is no
        pixel, as of terrain whose height is not known: it counts as one that is not covered.
    blocks : PulseBlock or iterable of PulseBlock
        All pulses of the image with phase centres: range profiles as `RangeCompressor` puts them
        out, of any waveform, or raw pulses of a stepped-frequency radar. Correlation is a sum
        over pulses, so that an aperture that does not fit into memory can come block by block.
        Profiles are read by `correlate_profiles` as samples of a signal in the waveform's band:
        what they hold beyond it, such as noise that was never filtered, counts as error. Raw
        pulses are taken by their spectra, without window and calibration.
    n_pixels, n_brightest : int
        Pixels to compare, at least one each; no more than there are.
    fit_scale : bool
        First multiply the image by the complex number that suits the compared pixels best: for
        images scaled otherwise than a plain sum of profiles, as those made from raw pulses are.
    seed : int
        Seed of the choice of random pixels.
    progress : bool
        Show a progress bar on standard error.
    illumination : AntennaPattern, optional
        With which the image was formed; the blocks tell where the antenna looked.

    Returns
    -------
    Verification

    Raises
    ------
    ValueError
        Shapes disagree, the image is not finite, a number of pixels is not positive, a block
        has no phase centres or cannot be correlated, or the profiles cover none of the pixels.

    Examples
    --------
    >>> from sar_imaging import MapGrid, plan_image
    >>> from sar_imaging.quality.verification import measure_error
    >>> from sar_imaging.simulation import SCENARIOS
    >>> block = next(SCENARIOS['psf']().blocks(50))
    >>> grid = MapGrid((10_000.0, 0.0, 0.0), 25, 25, 0.5)
    >>> image = plan_image(grid, block.radar, block.n_samples, target_db=-50.0)(block)
    >>> bool(measure_error(image, grid, block, n_pixels=100).error_db < -50.0)
    True
    """
    image = np.asarray(image)
    _check(image, where, n_pixels, n_brightest)
    flat = image.reshape(-1)
    power, bright = _survey(flat, min(n_brightest, flat.size))
    random = np.random.default_rng(seed).choice(flat.size, min(n_pixels, flat.size),
                                                replace=False, shuffle=False)
    others = random[~np.isin(random, bright)]
    chosen = np.concatenate([bright, others])
    points = _positions(where, image.shape, chosen)
    known = ~np.isnan(points).any(axis=1)
    reference, covered = np.zeros(len(points), np.complex128), np.zeros(len(points), bool)
    reference[known], covered[known] = correlate_pulses(
        blocks, points[known], illumination=illumination, progress=progress)
    if not covered.any():
        raise ValueError(f'none of {len(chosen)} pixels is covered by all profiles: their ranges '
                         'come close to the ends of profiles or leave them; compare an image of '
                         'a smaller area, or longer profiles')
    values = flat[chosen].astype(np.complex128)
    if fit_scale:
        factor = _ratio(np.vdot(values[covered], reference[covered]),
                        np.vdot(values[covered], values[covered]))
        values, power = factor * values, abs(factor) ** 2 * power
    left = power - _energy(values[:len(bright)])  # in all pixels but the brightest
    n_left = flat.size - len(bright)
    brightest, rest = (_Pixels(values[part], reference[part], covered[part])
                    for part in (slice(0, len(bright)), slice(len(bright), None)))
    error, expected = brightest.error, brightest.expected
    if rest.n_covered:
        share = n_left / len(others)
        error += share * rest.error
        expected += (left * _ratio(rest.power, rest.power_of_all)
                     * _ratio(rest.expected, rest.power) if left > 0 else share * rest.expected)
    return Verification(
        _error_db(error, expected), int(np.isin(random, chosen[covered]).sum()),
        _error_db(brightest.error, brightest.expected) if brightest.n_covered else math.nan,
        brightest.n_covered, float(np.isin(random, chosen[covered]).mean()))


class _Pixels:
    """Energies of some pixels, of those that the profiles cover unless told otherwise."""

    def __init__(self, values: np.ndarray, reference: np.ndarray, covered: np.ndarray) -> None:
        self.n_covered = int(covered.sum())
        self.power_of_all = _energy(values)
        values, reference = values[covered], reference[covered]
        self.power, self.expected = _energy(values), _energy(reference)
        self.error = _energy(values - reference)


def _check(image: np.ndarray, where: Grid | ArrayLike, n_pixels: int, n_brightest: int) -> None:
    if isinstance(where, Grid):
        expected = where.shape
    else:
        expected = np.shape(where)[:-1]
        if np.shape(where)[-1:] != (3,):
            raise ValueError(f'where has shape {np.shape(where)}; expected a grid, such as a '
                             'MapGrid, or positions (..., 3)')
    if image.shape != expected or image.size == 0:
        raise ValueError(f'image.shape={image.shape} does not match the {expected} pixels of '
                         'its grid; at least one pixel is needed')
    if n_pixels < 1 or n_brightest < 1:
        raise ValueError(f'n_pixels={n_pixels}, n_brightest={n_brightest}; expected at least '
                         'one each')


def _survey(flat: np.ndarray, n_brightest: int) -> tuple[float, np.ndarray]:
    """Energy of the whole image and indices of its brightest pixels, in bounded memory."""
    energy, indices, powers = 0.0, np.empty(0, np.intp), np.empty(0)
    for start in range(0, flat.size, _PIXELS_AT_ONCE):
        part = flat[start:start + _PIXELS_AT_ONCE]
        power = np.square(part.real, dtype=np.float64)
        power += np.square(part.imag, dtype=np.float64)
        energy += float(power.sum())
        powers = np.concatenate([powers, power])
        indices = np.concatenate([indices, np.arange(start, start + part.size)])
        if powers.size > n_brightest:
            keep = np.argpartition(powers, -n_brightest)[-n_brightest:]
            indices, powers = indices[keep], powers[keep]
    if not math.isfinite(energy):
        raise ValueError('the image contains NaN or infinity')
    return energy, indices


def _positions(where: Grid | ArrayLike, shape: tuple[int, ...], chosen: np.ndarray) -> np.ndarray:
    """(n, 3) float64 positions of pixels by their index in the flattened image."""
    if isinstance(where, Grid):
        return where.positions(*np.unravel_index(chosen, shape))
    return np.asarray(where, np.float64).reshape(-1, 3)[chosen]


def _energy(values: np.ndarray) -> float:
    return float(np.vdot(values, values).real)


def _ratio(numerator: complex, denominator: complex) -> Any:
    """Quotient; 1 where the image is zero, which no factor helps."""
    return numerator / denominator if denominator else 1.0


def _error_db(error: float, expected: float) -> float:
    if error == 0.0:
        return -math.inf
    return 10 * math.log10(error / expected) if expected else math.inf
