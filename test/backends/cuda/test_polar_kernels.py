# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Azimuth upsampling and interpolation to a map against their formulas."""

import dataclasses

import numpy as np
import pytest

from sar_imaging.backends.cuda.arrays import xp
from sar_imaging.backends.cuda.backprojection import AzimuthUpsampling
from sar_imaging.backends.cuda.polar_to_map import polar_to_map
from sar_imaging.backends.cuda.transfers import to_host
from sar_imaging.backends.reference import polar_to_map as formula
from sar_imaging.backends.reference.upsample_azimuth import upsample_azimuth
from sar_imaging.geometry import MapGrid
from sar_imaging.geometry.polar import PolarGrid
from sar_imaging.planning.exact.polar_image import DEGREE, TAPS, AzimuthParts
from sar_imaging.planning.interpolators import design_interpolator
from sar_imaging.planning.polar_cover import DEAPODISED_TAPS, TAPS as MAP_TAPS

FLOAT32_DB = -120.0  # of sums of some dozen products


def noise(*shape):
    rng = np.random.default_rng(5)
    return rng.standard_normal((2, *shape)).astype(np.float32)


def test_azimuth_upsampling(error_db):
    fine = PolarGrid((0.0, 0.0, 50.0), (0.0, 1.0), -1, 0.0, 500.0, 0.5, 9, -0.05, 0.002, 41)
    coarse = dataclasses.replace(fine, n_alpha=24, alpha_spacing=0.0061, alpha_start=-0.0805)
    parts = AzimuthParts((slice(0, 5), slice(5, 9), slice(9, 10)),
                         np.array([-300.0, 40.0, 2000.0]), coarse, fine,
                         design_interpolator(1.6, taps=TAPS, degree=DEGREE), -60.0, 0.0)
    images = [noise(24, 9) * (number + 1) for number in range(3)]
    before = noise(41, 9)
    total = xp.asarray(before.copy())

    def form(number, image):
        image += xp.asarray(images[number].reshape(-1))

    AzimuthUpsampling(parts).add_all(form, total)
    added = to_host(total) - before
    wanted = upsample_azimuth([i[0] + 1j * i[1] for i in images], parts)
    assert error_db(added[0] + 1j * added[1], wanted) < FLOAT32_DB


@pytest.mark.parametrize(('axis', 'taps'), [(0, MAP_TAPS), (1, DEAPODISED_TAPS)])
def test_polar_to_map(error_db, axis, taps):
    track, side = ((0.0, 1.0), -1) if axis == 0 else ((1.0, 0.0), 1)
    polar = PolarGrid((3.0, -2.0, 40.0), track, side, 0.0, 480.0, 0.5, 90, -0.06, 0.0025, 49)
    centre = (500.0, 1.0, 0.0) if axis == 0 else (1.0, 500.0, 0.0)
    grid = MapGrid(centre, 12, 5, 1.9) if axis == 0 else MapGrid(centre, 5, 12, 1.9)
    image = noise(49, 90)
    interpolators = {'between': design_interpolator(1.5, taps=taps, degree=5),
                     'along': design_interpolator(1.5, taps=MAP_TAPS, degree=5)}
    before = noise(*grid.shape)
    onto = xp.asarray((before[0] + 1j * before[1]).astype(np.complex64))
    there = onto.copy()
    polar_to_map(xp.asarray(image), polar, grid, there, axis=axis, wavelength_m=0.03,
                 cycles_per_alpha=150.0, **interpolators)
    wanted = formula.polar_to_map(image[0] + 1j * image[1], polar, grid, axis=axis,
                                  wavelength_m=0.03, **interpolators)
    _, alpha = polar.from_map(grid.x_m, grid.y_m[:, None])
    wanted = wanted * np.exp(2j * np.pi * 150.0 * (alpha - polar.alpha_start))
    # the polynomials of sine and cosine err by -108 dB
    assert error_db(to_host(there) - to_host(onto), wanted) < -105.0
