# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Grids chosen from radar, track and swath: closed forms, and what the profiles cover."""

from __future__ import annotations

import numpy as np
import pytest

from sar_imaging.configuration.scene_grid import PIXEL_BYTES, Coverage, choose_grid
from sar_imaging.geometry import MapGrid
from sar_imaging.signal.radar import SPEED_OF_LIGHT, RadarParameters

CENTRE = (0.0, 0.0, 0.0)


def make_coverage(*, length_m=40.0, step_m=0.25, turned_deg=0.0, width_m=120.0, start_m=None):
    """A straight track 707 m beside and 707 m above the scene."""
    y = np.arange(-length_m / 2, length_m / 2 + step_m / 2, step_m)
    track = np.column_stack([np.full_like(y, -707.0), y, np.full_like(y, 707.0)])
    angle = np.radians(turned_deg)
    track[:, :2] = track[:, :2] @ [[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]]
    start = 1000.0 - width_m / 2 if start_m is None else start_m
    radar = RadarParameters(carrier_hz=10e9, bandwidth_hz=300e6, sample_rate_hz=400e6,
                            first_sample_delay_s=2 * start / SPEED_OF_LIGHT)
    return Coverage(radar, int(width_m / radar.sample_spacing_m) + 1, track[:, None],
                    track[:, None])


def test_spacing_is_half_the_finer_resolution():
    choice = choose_grid(make_coverage(), CENTRE)
    # c / 2B / cos(45 degrees), and lambda R / 2 L
    assert choice.range_resolution_m == pytest.approx(0.4997 * np.sqrt(2), rel=1e-3)
    assert choice.azimuth_resolution_m == pytest.approx(0.02998 * 999.8 / 80.0, rel=1e-3)
    assert choice.spacing_m == 0.15  # the two-digit number below 0.187
    assert isinstance(choice.grid, MapGrid) and choice.plane == 'ground'
    assert 'two pixels' in choice.reasons[0] and '--spacing' in choice.reasons[0]


@pytest.mark.parametrize('turned_deg', [0.0, 30.0, 135.0])
def test_footprint_is_covered_and_unambiguous_and_not_much_smaller(turned_deg):
    coverage = make_coverage(turned_deg=turned_deg)
    choice = choose_grid(coverage, CENTRE)
    corners = choice.grid.points()[::choice.grid.n_y - 1, ::choice.grid.n_x - 1].reshape(-1, 3)
    ranges = np.linalg.norm(corners[:, None] - coverage.tx_m[:, 0], axis=-1)
    near, far = coverage.swath_m
    assert near - 1 <= ranges.min() and ranges.max() <= far + 1  # half a pixel of rounding
    along = coverage.tx_m[-1, 0] - coverage.tx_m[0, 0]
    along = along / np.linalg.norm(along)
    repeat = 0.02998 * 999.8 / (2 * 0.25)
    assert np.abs(corners @ along).max() <= repeat / 2 + 0.2
    # the ground strip of 115 m / cos(45) by 60 m; what a turned rectangle leaves of it
    share = choice.size_m[0] * choice.size_m[1] / (115 * np.sqrt(2) * repeat)
    assert share > (0.9 if turned_deg == 0.0 else 0.18)


def test_dense_pulses_leave_the_swath_as_the_limit():
    coverage = make_coverage(step_m=0.05)
    grid = choose_grid(coverage, CENTRE, spacing_m=0.5).grid
    assert grid.n_y * 0.5 > 150.0  # 300 m without ambiguity, cut by what profiles cover
    edge = grid.positions([0, 0, -1, -1], [0, -1, 0, -1])
    assert coverage.covers(0.99 * edge).all()


def test_area_and_size_are_taken_as_told():
    corners = [(-30.0, -20.0, 0.0), (10.0, 15.0, 0.0)]
    choice = choose_grid(make_coverage(), CENTRE, area_m=corners, spacing_m=0.5)
    assert choice.size_m == pytest.approx((60.0, 40.0))
    assert 'names' in choice.reasons[0]
    choice = choose_grid(make_coverage(), (5.0, 6.0, 7.0), size_m=(20.0, 10.0), spacing_m=0.5)
    assert choice.grid == MapGrid((5.0, 6.0, 7.0), 41, 21, 0.5)
    assert choice.reasons == ()


def test_an_area_is_cut_to_what_profiles_cover():
    coverage = make_coverage()
    corners = np.array([(-400.0, -50.0, 0.0), (400.0, 50.0, 0.0)])
    choice = choose_grid(coverage, CENTRE, area_m=corners, spacing_m=0.5)
    assert choice.size_m[0] / choice.size_m[1] == pytest.approx(8.0, rel=0.05)
    ranges = np.linalg.norm(choice.grid.points()[::-1, [0, -1]].reshape(-1, 3)
                            - coverage.tx_m[len(coverage.tx_m) // 2, 0], axis=-1)
    near, far = coverage.swath_m
    # the far edge ends where the swath does, the near one is as far from the middle
    assert near < ranges.min() and far - 3.0 < ranges.max() <= far + 0.5
    assert 'as far as its profiles cover it' in choice.reasons[0]


def test_memory_bounds_the_footprint():
    free = choose_grid(make_coverage(), CENTRE)
    memory = 0.1 * PIXEL_BYTES * np.prod(free.grid.shape)
    bound = choose_grid(make_coverage(), CENTRE, memory_bytes=memory)
    assert bound.spacing_m == free.spacing_m
    assert np.prod(bound.grid.shape) == pytest.approx(0.1 * np.prod(free.grid.shape), rel=0.02)
    assert '--memory' in bound.reasons[-1]
    with pytest.raises(MemoryError, match='larger --spacing'):
        choose_grid(make_coverage(), CENTRE, size_m=(100.0, 100.0), memory_bytes=memory)


def test_slant_plane_holds_track_and_scene():
    choice = choose_grid(make_coverage(), CENTRE, plane='slant', size_m=(30.0, 20.0))
    normal = np.cross(*choice.grid.steps_m)
    assert abs(normal @ (-707.0, 0.0, 707.0)) < 1e-9 * np.linalg.norm(normal) * 1000
    # range is not stretched by the grazing angle
    assert choice.range_resolution_m == pytest.approx(0.4997, rel=1e-3)
    assert choice.size_m == pytest.approx((30.0, 20.0), abs=0.2)


def test_a_circle_around_the_scene():
    angle = np.linspace(0, 2 * np.pi, 18001)
    track = np.column_stack([700 * np.cos(angle), 700 * np.sin(angle), 0 * angle + 700])
    straight = make_coverage()
    circle = Coverage(straight.radar, straight.n_samples, track[:, None], track[:, None])
    choice = choose_grid(circle, CENTRE)
    assert choice.azimuth_resolution_m < 0.015  # lambda / 4 at most, over the cosine of elevation
    assert choice.size_m[0] == pytest.approx(choice.size_m[1], rel=0.02)


def test_what_cannot_be_chosen_is_refused():
    coverage = make_coverage()
    with pytest.raises(ValueError, match=r'all profiles cover .* --centre'):
        choose_grid(coverage, (300.0, 0.0, 0.0))
    with pytest.raises(ValueError, match='plane='):
        choose_grid(coverage, CENTRE, plane='sky')
    for wrong in ({'spacing_m': 0.0}, {'size_m': (1.0, float('nan'))}):
        with pytest.raises(ValueError, match='expected a positive number'):
            choose_grid(coverage, CENTRE, **wrong)
