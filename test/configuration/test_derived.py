# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Derived quantities against closed forms written down here, and against brute force."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import assume, given, settings, strategies as st
from scipy.optimize import brentq

from sar_imaging.configuration import derive
from sar_imaging.configuration.derived import see_scene, width_factor
from sar_imaging.configuration.report import rows
from sar_imaging.geometry.grids import MapGrid
from sar_imaging.signal.radar import SPEED_OF_LIGHT, Waveform
from sar_imaging.signal.range_compression import RangeCompressor

from .conftest import MACHINE, make_acquisition, make_imaging, numbers, profile_setups

C = SPEED_OF_LIGHT


def test_a_configuration_worked_out_by_hand(acquisition, imaging, machine):
    d = derive(acquisition, imaging, machine)
    # 800 m across and 600 m up: 1000 m, cosine of the grazing angle 0.8.
    assert d.scene.range_m == pytest.approx(1000.0)
    assert d.range_null_m == pytest.approx(C / (2 * 300e6 * 0.8))
    assert d.pulse_spacing_m == pytest.approx(0.25)
    assert d.aperture_m == pytest.approx(63.75)
    assert d.aperture_s == pytest.approx(1.28)
    assert d.unambiguous_range_m == pytest.approx(C / 400)
    assert d.ambiguity_m == pytest.approx(C / 10e9 * 1000 / 0.5)
    assert d.largest_prf_hz == pytest.approx(400e6 / 1200)
    assert d.input_rate == pytest.approx(200 * 2 * 1200 * 8)
    assert d.n_pixels == 501 * 501
    assert d.imaging_s == pytest.approx(501 * 501 * 256 * 2 / 1e9)
    # The raw recording holds 1200 - 400 samples of whole pulses, from 850 m on.
    assert d.window_m[0] == pytest.approx(850.0)
    assert d.window_m[1] == pytest.approx(850 + 800 * C / 800e6,
                                          abs=d.profile_radar.sample_spacing_m)
    assert d.unambiguous_depth_m == math.inf


@given(range_m=numbers(50.0, 1e5), wavelengths=numbers(2e3, 1e5), step=numbers(0.05, 2.0),
       carrier=numbers(1e9, 1e11), share=numbers(0.001, 1.0))
def test_small_angles_have_the_textbook_resolution(range_m, wavelengths, step, carrier, share):
    """``lambda R / 2 L`` and ``c / 2 B`` in the slant plane, where the angle is small."""
    wavelength = C / carrier
    n = max(2, round(wavelengths * wavelength / step))
    length = n * step
    assume(length < 0.1 * range_m)
    bandwidth = share * carrier
    acquisition = make_acquisition(
        compressed=True, carrier_hz=carrier, bandwidth_hz=bandwidth, sample_rate_hz=2 * bandwidth,
        n_channels=1, centre_m=(-range_m, 0.0, 0.0), velocity_m_per_s=(0.0, step * 100.0, 0.0),
        prf_hz=100.0)
    d = derive(acquisition, make_imaging(pulses_per_aperture=n), MACHINE)
    # sin and tan differ from their angle, at most 0.05, by less than a part in 500
    assert d.azimuth_null_m == pytest.approx(wavelength * range_m / (2 * length), rel=2e-3)
    assert d.range_null_m == pytest.approx(C / (2 * bandwidth), rel=1e-9)
    assert d.aperture_m == pytest.approx((n - 1) * step, rel=1e-9)


@given(setup=profile_setups())
@settings(max_examples=40)
def test_rates_and_ambiguities_of_any_setup(setup):
    acquisition, imaging = setup
    d = derive(acquisition, imaging, MACHINE)
    step = math.hypot(*acquisition.velocity_m_per_s) / acquisition.prf_hz
    shortest = C / (acquisition.radar.carrier_hz + acquisition.radar.bandwidth_hz / 2)
    assert d.unambiguous_direction * 2 * step == pytest.approx(shortest)
    # At the lowest pulse rate the scene is just as wide as what is unambiguous.
    at_least = dataclasses.replace(acquisition, prf_hz=max(d.least_prf_hz, 1e-9))
    assert derive(at_least, imaging, MACHINE).unambiguous_direction == pytest.approx(
        max(d.needed_direction, shortest * 1e-9 / (2 * step * acquisition.prf_hz)), rel=1e-6)
    channels = acquisition.n_channels
    assert d.input_rate == pytest.approx(acquisition.prf_hz * channels * acquisition.n_samples * 8)
    assert d.profile_block_bytes == imaging.pulses_per_block * channels * d.n_profile * 8
    assert 0.0 <= d.scene.direction_extent <= 2.0
    assert d.scene.near_m <= d.scene.range_m * (1 + 1e-9) <= d.scene.far_m * (1 + 2e-9)
    twice = dataclasses.replace(acquisition, prf_hz=2 * acquisition.prf_hz)
    assert derive(twice, imaging, MACHINE).input_rate == pytest.approx(2 * d.input_rate)


@given(setup=profile_setups())
@settings(max_examples=40)
def test_the_scene_is_what_brute_force_sees(setup):
    acquisition, imaging = setup
    grid = imaging.grid
    scene = see_scene(acquisition, imaging)
    u = np.asarray(acquisition.velocity_m_per_s) / math.hypot(*acquisition.velocity_m_per_s)
    x, y = (np.linspace(a[0], a[-1], 15) for a in (grid.x_m, grid.y_m))
    points = np.stack([*np.meshgrid(x, y), np.full((15, 15), grid.z_m)], axis=-1).reshape(-1, 3)
    ends = acquisition.track(imaging.pulses_per_aperture)[[0, -1]]
    track = ends[0] + np.linspace(0, 1, 17)[:, None] * (ends[1] - ends[0])
    distance = np.linalg.norm(track[:, None] - points, axis=-1)
    # The pixels and positions sampled here are not the very nearest ones.
    slack = np.ptp(x) / 14 + np.ptp(y) / 14 + np.linalg.norm(track[1] - track[0]) + 1e-6
    assert scene.near_m - 1e-6 <= distance.min() <= scene.near_m + slack
    assert scene.far_m == pytest.approx(distance.max(), rel=1e-9)
    seen = points - np.asarray(acquisition.centre_m)
    r = np.linalg.norm(seen, axis=1)
    assume(r.min() > 1e-3)
    cosines = seen @ u / r
    # Directions sampled along the edge miss the extremes by less than half a step of the edge.
    miss = 0.5 * max(np.ptp(x), np.ptp(y)) / 32 / r.min() + 1e-9
    assert scene.direction[0] <= cosines.min() + miss
    assert scene.direction[1] >= cosines.max() - miss
    assert -1 - 1e-9 <= scene.direction[0] <= scene.direction[1] <= 1 + 1e-9


def test_a_dive_looks_straight_ahead_within_the_grid():
    diving = make_acquisition(centre_m=(5.0, 3.0, 40.0), velocity_m_per_s=(0.0, 0.0, -50.0))
    assert see_scene(diving, make_imaging()).direction[1] == pytest.approx(1.0)


def test_a_slanting_dive_looks_straight_ahead_within_the_grid_and_along_its_edge_beyond():
    imaging = make_imaging(grid=MapGrid.from_size((0.0, 0.0, 10.0), 50.0, 50.0, 0.1))
    # From 30 m above the grid the line of flight meets it 18 m on.
    diving = make_acquisition(centre_m=(-8.0, -1.0, 40.0), velocity_m_per_s=(30.0, 6.0, -50.0))
    assert see_scene(diving, imaging).direction[1] == pytest.approx(1.0)
    beyond = make_acquisition(centre_m=(-8.0, -1.0, 40.0), velocity_m_per_s=(90.0, 0.0, -50.0))
    assert see_scene(beyond, imaging).direction[1] == pytest.approx(np.cos(
        np.arctan2(30.0, 33.0) - np.arctan2(50.0, 90.0)))


@pytest.mark.parametrize('name', ['pulses_per_aperture', 'pulses_per_block', 'queue_depth',
                                  'worker_queue_size'])
def test_lengths_are_at_least_one(name):
    assert getattr(make_imaging(**{name: 1}), name) == 1
    with pytest.raises(ValueError, match=f'{name}=0; expected at least 1'):
        make_imaging(**{name: 0})


def test_from_ten_thousand_on_the_report_counts_in_thousands(imaging):
    def text(prf_hz):
        acquisition = make_acquisition(prf_hz=prf_hz)
        return ' '.join(value for _, value, _ in rows(
            acquisition, imaging, MACHINE, derive(acquisition, imaging, MACHINE)))

    assert '9990 Hz' in text(9990.0) and '10 kHz' in text(10_000.0)


def test_both_sides_of_the_track():
    acquisition = make_acquisition(centre_m=(0.0, 0.0, 500.0))
    assert see_scene(acquisition, make_imaging()).both_sides
    beside = make_imaging(grid=MapGrid.from_size((300.0, 0.0, 0.0), 50.0, 50.0, 0.1))
    assert not see_scene(acquisition, beside).both_sides


def test_width_factors_are_those_of_the_windows_page():
    # Without a window sin(x) / x = sqrt(1/2); the others stand in signal/windows.py, to 1e-3.
    sinc = 2 * brentq(lambda x: math.sin(math.pi * x) / (math.pi * x) - math.sqrt(0.5), 0.1, 0.9)
    assert width_factor('none') == pytest.approx(sinc, rel=1e-4)
    for window, expected in {'hamming': 1.303, 'hann': 1.441, 'taylor:4:35': 1.184,
                             'kaiser:6': 1.402}.items():
        assert width_factor(window) == pytest.approx(expected, abs=1e-3)


@given(looking=numbers(0.0, math.tau), squint=numbers(-1.0, 1.0), height=numbers(10.0, 800.0))
def test_turning_everything_changes_nothing(looking, squint, height):
    """Resolution and ambiguity depend on the angle between track and scene alone."""
    def setup(turn):
        c, s = math.cos(turn), math.sin(turn)
        across, along = -1000.0, 1000.0 * squint
        return make_acquisition(
            centre_m=(c * across - s * along, s * across + c * along, height),
            velocity_m_per_s=(-s * 50.0, c * 50.0, 0.0))

    small = make_imaging(grid=MapGrid.from_size((0.0, 0.0, 0.0), 0.0, 0.0, 0.1))
    one, other = (derive(setup(turn), small, MACHINE) for turn in (0.0, looking))
    for name in ('range_null_m', 'azimuth_null_m', 'aperture_rad', 'ambiguity_m'):
        assert getattr(one, name) == pytest.approx(getattr(other, name), rel=1e-9), name


def test_phase_histories_are_unambiguous_over_n_cells():
    acquisition = make_acquisition(waveform=Waveform.STEPPED_FREQUENCY, sample_rate_hz=300e6,
                                   n_samples=400, first_sample_delay_s=2 * 1000.0 / C)
    d = derive(acquisition, make_imaging(), MACHINE)
    assert d.unambiguous_depth_m == pytest.approx(400 * C / (2 * 300e6))
    assert d.window_m[1] - d.window_m[0] == pytest.approx(
        d.unambiguous_depth_m, abs=2 * d.profile_radar.sample_spacing_m)


def test_profiles_are_those_of_range_compression(acquisition, imaging, machine):
    d = derive(acquisition, imaging, machine)
    compressor = RangeCompressor(acquisition.radar, acquisition.n_samples)
    assert (d.profile_radar, d.n_profile) == (compressor.output_radar, compressor.n_output)


def test_the_range_window_is_that_of_range_compression(acquisition, machine):
    d = derive(acquisition, make_imaging(near_range=950.0, far_range=1050.0), machine)
    compressor = RangeCompressor(acquisition.radar, acquisition.n_samples,
                                 range_window_m=(950.0, 1050.0))
    assert d.n_profile == compressor.n_output
    assert d.window_m[0] <= 950.0 < 1050.0 <= d.window_m[1]
    with pytest.raises(ValueError, match='far_range=10 lies before near_range=20'):
        make_imaging(near_range=20.0, far_range=10.0)


@given(n=st.integers(1, 64), spacing=numbers(0.0, 5.0))
def test_an_array_only_lengthens_the_aperture(n, spacing):
    d = [derive(make_acquisition(n_channels=n, channel_spacing_m=s), make_imaging(), MACHINE)
         for s in (0.0, spacing)]
    assert d[1].azimuth_null_m <= d[0].azimuth_null_m * (1 + 1e-9)
    if n == 1:
        assert d[0] == d[1]


def test_a_platform_that_stands_still_is_refused(imaging, machine):
    with pytest.raises(ValueError, match='the platform stands still.*give its velocity'):
        derive(make_acquisition(velocity_m_per_s=(0.0, 0.0, 0.0)), imaging, machine)


@pytest.mark.parametrize(('mode', 'node'), [('image', 'backprojection'),
                                            ('subapertures', 'afbp_fusion')])
def test_calibrated_images_take_a_scale_and_a_second_image(acquisition, imaging, machine, mode,
                                                           node):
    plain, calibrated = (
        {m.node: m.n_bytes for m in derive(acquisition, dataclasses.replace(
            imaging, mode=mode, radiometry_quantity=quantity), machine).memory}
        for quantity in ('none', 'sigma0'))
    more = {name: calibrated[name] - plain[name] for name in plain}
    assert more.pop(node) == pytest.approx(12 * imaging.n_pixels, abs=1)  # 8 and 4 bytes
    assert not any(more.values())
