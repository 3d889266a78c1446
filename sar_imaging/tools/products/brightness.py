# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Images as calibrated brightness, by a radar constant in a file."""

from __future__ import annotations

import argparse
import dataclasses
import math
from pathlib import Path
from typing import Any

import numpy as np

from sar_imaging.configuration.scene_grid import GridChoice
from sar_imaging.geometry.illumination import Illumination
from sar_imaging.imaging.image import Image
from sar_imaging.radiometry import (
    QUANTITIES,
    ImageResponse,
    RadarConstant,
    calibrated,
    image_response,
    volume_scale,
)
from sar_imaging.radiometry.brightness import OF_THE_GROUND

from ...recordings.pulse_source import PulseSource, SourceError, pointing_of


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments that ask for calibrated brightness."""
    parser.add_argument('--brightness', choices=QUANTITIES, metavar='QUANTITY',
                        help='scale the image so that its squared magnitude is '
                             f'{", ".join(QUANTITIES)}; needs --radar-constant')
    parser.add_argument('--radar-constant', type=Path, metavar='FILE',
                        help='YAML of `sar-imaging radar-constant`')


def constant_of(arguments: argparse.Namespace) -> RadarConstant | None:
    """The constant that the arguments name; None where no brightness is asked for.

    Raises
    ------
    SourceError
        One of the two arguments is missing, the file is not one, or the quantity is of the
        ground and the image lies in the slant plane.
    """
    if (arguments.brightness is None) != (arguments.radar_constant is None):
        raise SourceError('--brightness and --radar-constant belong together: give both; '
                          '`sar-imaging radar-constant` measures one at a reflector')
    if arguments.plane == 'slant' and arguments.brightness in OF_THE_GROUND:
        raise SourceError(f'{arguments.brightness} is by square metre of the ground, whose normal '
                          'the slant plane has not; leave out --plane slant, or ask for beta0 or '
                          'rcs')
    try:
        return (None if arguments.radar_constant is None
                else RadarConstant.load(arguments.radar_constant))
    except ValueError as error:
        raise SourceError(str(error)) from error


def respond(source: PulseSource, choice: GridChoice) -> ImageResponse:
    """Response of an image of all pulses of a source, weighed by its antenna as the image is."""
    looks = pointing_of(source)
    illumination = None if looks is None else Illumination.of_pulses(
        source.illumination, looks, source.tx_m, source.rx_m)
    return image_response(choice.grid, source.radar, source.tx_m, source.rx_m,
                          illumination=illumination, weighted=illumination is not None,
                          weighting=source.window)


def calibrate_image(response: ImageResponse, image: Image, quantity: str,
                    constant: RadarConstant) -> tuple[Image, dict[str, Any]]:
    """The image as calibrated brightness, and its figures in dB."""
    scaled = calibrated(image, response, constant, quantity)
    power = np.abs(scaled.samples).astype(np.float64) ** 2
    told = scaled.radiometry
    return scaled, {
        'quantity': quantity, 'gain_m': constant.gain,
        'median_db': _decibels(np.median(power[power > 0])) if power.any() else None,
        'noise_equivalent_db': (None if math.isnan(told.noise_equivalent_db)
                                else round(told.noise_equivalent_db, 3)),
        'incidence_deg': round(told.incidence_deg, 2)}


def calibrate_volume(source: PulseSource, image: Image, constant: RadarConstant
                     ) -> tuple[Image, dict[str, Any]]:
    """A volume as cross sections of points, and what quality.json tells of it."""
    scale = volume_scale(image.grid, source.tx_m, source.rx_m, constant,
                         pattern=source.illumination, pointing=pointing_of(source))
    for number, layer in enumerate(image.samples):
        layer *= scale.factors(slice(number, number + 1))[0]
    told = scale.radiometry
    noise = told.noise_equivalent_db
    return dataclasses.replace(image, radiometry=told), {'brightness': {
        'quantity': told.quantity, 'gain_m': constant.gain,
        'noise_equivalent_db': None if math.isnan(noise) else round(noise, 3)}}


def _decibels(power: float) -> float | None:
    return round(10 * math.log10(power), 3) if power > 0 else None
