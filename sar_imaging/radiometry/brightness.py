# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Cross section, beta nought, sigma nought and gamma nought of images, and their noise level."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from ..imaging.image import Image
from ..imaging.radiometry import Radiometry
from .constant import RadarConstant
from .response import ImageResponse

#: Name and meaning of each quantity.
QUANTITIES = {
    'rcs': 'radar cross section of a target at the pixel, m^2',
    'beta0': 'cross section for each square metre of the slant plane',
    'sigma0': 'cross section for each square metre of the ground',
    'gamma0': 'sigma nought over the cosine of the incidence angle'}

#: Quantities that need the normal of the ground, which a slant plane has not.
OF_THE_GROUND = 'sigma0', 'gamma0'
_EDGE_ON_RAD = math.radians(89.0)


def brightness(image: np.ndarray, response: ImageResponse, constant: RadarConstant,
               quantity: str = 'sigma0') -> np.ndarray:
    """Calibrated brightness of an image: beta, sigma or gamma nought, or cross section.

    Parameters
    ----------
    image : (n_y, n_x) complex
        Image, whose squared magnitude is taken.
    response : ImageResponse
        Response of the same grid and pulses.
    constant : RadarConstant
        Constant of the radar.
    quantity : str
        One of `QUANTITIES`. R. K. Raney et al., A plea for radar brightness, IGARSS 1994, tells
        when which is wanted.

    Returns
    -------
    (n_y, n_x) float64
        Linear; NaN where nothing is lit. Noise is in it, see `noise_equivalent`.

    Raises
    ------
    ValueError
        The image has another shape, there is no such quantity, or sigma or gamma nought are
        asked for in the slant plane.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging import MapGrid, RadarParameters
    >>> from sar_imaging.radiometry import RadarConstant, brightness, image_response
    >>> radar = RadarParameters(10e9, 300e6, 400e6, first_sample_delay_s=6e-7)
    >>> track = np.zeros((64, 1, 3))
    >>> track[:, 0, 1:] = np.stack([np.linspace(-5, 5, 64), np.full(64, 50.0)], axis=-1)
    >>> grid = MapGrid((80.0, 0.0, 0.0), 16, 16, 0.5)
    >>> response = image_response(grid, radar, track, track)
    >>> sigma0 = brightness(np.full(grid.shape, 0.01j), response, RadarConstant(gain=100.0))
    >>> print(f'{10 * np.log10(np.median(sigma0)):.1f} dB')
    -26.3 dB
    """
    image = np.asarray(image)
    if image.shape != response.amplitude.shape:
        raise ValueError(_shape_error(image, response))
    return (np.abs(image).astype(np.float64) ** 2
            / (constant.gain * response.amplitude) ** 2 / _divisor(response, quantity))


def calibrated(image: Image, response: ImageResponse, constant: RadarConstant,
               quantity: str = 'sigma0') -> Image:
    """Scale an image so that its squared magnitude is a calibrated brightness.

    Phases stay, and so does everything that is written or measured of images.

    Parameters
    ----------
    image, response, constant, quantity
        As of `brightness`.

    Returns
    -------
    Image
        complex64; 0 where nothing is lit. Its `radiometry` says what it is.

    Raises
    ------
    ValueError
        As `brightness`.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging import MapGrid, concatenate, plan_image
    >>> from sar_imaging.radiometry import RadarConstant, brightness, calibrated, image_response
    >>> from sar_imaging.simulation import SCENARIOS
    >>> block = concatenate(list(SCENARIOS['psf']().blocks()))
    >>> grid = MapGrid((9_800.0, 0.0, -1_990.0), 12, 12, 0.5)
    >>> image = plan_image(grid, block.radar, block.n_samples)(block)
    >>> response = image_response(grid, block.radar, block.tx_m, block.rx_m)
    >>> scaled = calibrated(image, response, RadarConstant(gain=1e8))
    >>> bool(np.allclose(np.abs(scaled) ** 2, brightness(image, response, RadarConstant(1e8))))
    True
    """
    if image.shape != response.amplitude.shape:
        raise ValueError(_shape_error(image, response))
    scale = 1 / (constant.gain * response.amplitude * np.sqrt(_divisor(response, quantity)))
    scale = np.nan_to_num(scale).astype(np.float32)
    return dataclasses.replace(image, samples=image.samples * scale,
                               radiometry=radiometry_of(response, constant, quantity))


def radiometry_of(response: ImageResponse, constant: RadarConstant, quantity: str) -> Radiometry:
    """Medians over the pixels that are lit, for images that are scaled to a quantity."""
    noise = _median(noise_equivalent(response, constant, quantity))
    return Radiometry(quantity, constant.gain, 10 * math.log10(noise) if noise > 0 else math.nan,
                      math.degrees(_median(response.incidence_rad)))


def _median(values: np.ndarray) -> float:
    known = values[np.isfinite(values)]
    return float(np.median(known)) if known.size else math.nan


def noise_equivalent(response: ImageResponse, constant: RadarConstant,
                     quantity: str = 'sigma0') -> np.ndarray:
    """Noise-equivalent level by pixel: brightness that noise alone has on average.

    Parameters
    ----------
    response, constant, quantity
        As of `brightness`.

    Returns
    -------
    (n_y, n_x) float64
        Linear; NaN where nothing is lit or the constant knows no noise.

    Examples
    --------
    >>> import numpy as np
    >>> from sar_imaging import MapGrid, RadarParameters
    >>> from sar_imaging.radiometry import RadarConstant, image_response, noise_equivalent
    >>> radar = RadarParameters(10e9, 300e6, 400e6, first_sample_delay_s=6e-7)
    >>> track = np.zeros((64, 1, 3))
    >>> track[:, 0, 1:] = np.stack([np.linspace(-5, 5, 64), np.full(64, 50.0)], axis=-1)
    >>> response = image_response(MapGrid((80.0, 0.0, 0.0), 16, 16, 0.5), radar, track, track)
    >>> level = noise_equivalent(response, RadarConstant(gain=100.0, noise_power=1e-8))
    >>> print(f'{10 * np.log10(np.median(level)):.1f} dB')
    -48.2 dB
    """
    return (constant.noise_power * response.noise_gain
            / (constant.gain * response.amplitude) ** 2 / _divisor(response, quantity))


def quantities_of(response: ImageResponse) -> tuple[str, ...]:
    """Quantities that pixels have: those of the ground not, where they lie in the slant plane."""
    edge_on = _median(response.incidence_rad) > _EDGE_ON_RAD
    return tuple(name for name in QUANTITIES if not (edge_on and name in OF_THE_GROUND))


def _divisor(response: ImageResponse, quantity: str) -> np.ndarray | float:
    if quantity not in QUANTITIES:
        raise ValueError(f'quantity={quantity!r}; expected one of {", ".join(QUANTITIES)}')
    if quantity not in quantities_of(response):
        raise ValueError(f'{quantity} is by square metre of the ground, and the pixels lie in the '
                         'slant plane, which the radar sees edge-on; take a map, or beta0 or rcs')
    if quantity == 'rcs':
        return 1.0
    if quantity == 'beta0':
        return response.slant_area_m2
    return (response.area_m2 if quantity == 'sigma0'
            else response.area_m2 * np.cos(response.incidence_rad))


def _shape_error(image: np.ndarray | Image, response: ImageResponse) -> str:
    return (f'image.shape={image.shape}; the response is for an image of '
            f'{response.amplitude.shape}')
