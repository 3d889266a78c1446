# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Steps of autofocus by themselves: bright points are kept apart, a phase becomes parameters."""

from __future__ import annotations

import numpy as np
import pytest

from sar_imaging.autofocus import Geometry, nominal, with_track_error
from sar_imaging.autofocus.residual import Residual, absorb
from sar_imaging.autofocus.search import search
from sar_imaging.simulation import flawed_aperture


@pytest.fixture(scope='module')
def aperture():
    return flawed_aperture('smooth', 1e-6, 3, n_pulses=128, half_scene_m=14.0)


def test_points_are_followed_to_the_peaks_of_their_tiles_each_once(aperture):
    model = with_track_error(nominal(aperture.true), scale_m=0.01)
    bright = aperture.points_m[:aperture.n_bright]
    # Each point comes twice, a fifth of a metre beside its place: within its tile.
    beside = np.concatenate([bright + [0.2, 0.0, 0.0], bright - [0.0, 0.2, 0.0]])
    found = search(aperture.true, model, beside).points
    distance = np.linalg.norm(bright[:, None] - found, axis=-1)
    assert distance.min(axis=0).max() < 0.2  # less than a pixel of the tiles; 0.16 m measured
    assert len(set(distance.argmin(axis=0))) == len(found)
    # The tiles of the others hold a brighter one.
    assert len(found) >= 7


def test_a_phase_that_grows_over_the_scene_becomes_parameters(aperture):
    """From the path of each point to Legendre coefficients, closed form, and back."""
    block = aperture.true
    points = aperture.points_m[:24]
    model = with_track_error(nominal(block), scale_m=0.5)
    wanted = np.zeros(len(model.names))
    wanted[[1, 3, 7, 12]] = 0.03, -0.02, 0.04, 0.02

    def coefficients(geometry: Geometry):
        path = np.linalg.norm(points[:, None] - geometry.tx_m[:, 0], axis=-1)
        u = np.linspace(-1.0, 1.0, block.n_pulses)
        basis = np.linalg.qr(np.polynomial.legendre.legvander(u, 5))[0][:, 2:]
        phase = block.radar.wavenumber_rad_per_m * path @ basis / np.sqrt(block.n_pulses)
        return phase - phase.mean(axis=0)

    start = np.zeros(len(wanted))
    left = coefficients(model(start)) - coefficients(model(wanted))
    residual = Residual(np.zeros(block.n_pulses), 0.0, 1.0, 1.0, left)
    found = absorb(residual, model, start, points, block.radar.wavenumber_rad_per_m)
    remaining = coefficients(model(found)) - coefficients(model(wanted))
    # What the expected size of the parameters holds back: 0.5 % measured.
    assert np.linalg.norm(remaining) < 0.03 * np.linalg.norm(left)
