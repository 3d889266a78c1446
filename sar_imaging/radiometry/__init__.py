# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Calibrated brightness: from image samples to radar cross sections and backscatter coefficients.

- `constant`: the radar constant, which ties samples to square metres; reflectors of known size;
- `response`: what an image makes of a target and of noise at each pixel: spreading, antenna
  pattern, area of a resolution cell;
- `brightness`: cross section, beta nought, sigma nought, gamma nought and noise-equivalent level;
- `scale`: what samples are multiplied by, for any part of a large image, for images as they come
  and for points in volumes;
- `speckle`: mean power over looks, and how many looks an image has.
"""

from .brightness import QUANTITIES, brightness, calibrated, noise_equivalent
from .constant import RadarConstant, noise_power, trihedral_cross_section_m2
from .response import ImageResponse, image_response
from .scale import BrightnessScale, KnotResponse, LiveCalibration, volume_scale
from .speckle import equivalent_looks, multilook

__all__ = ['QUANTITIES', 'BrightnessScale', 'ImageResponse', 'KnotResponse', 'LiveCalibration',
           'RadarConstant', 'brightness', 'calibrated', 'equivalent_looks', 'image_response',
           'multilook', 'noise_equivalent', 'noise_power', 'trihedral_cross_section_m2',
           'volume_scale']
