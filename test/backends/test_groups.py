# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Maps from groups of echoes near the antenna, against time-domain correlation in float64.

Correlation is the reference backend's: it knows no group, grid or interpolator. What images err
more than predicted is allowed 3 dB: scenes of few scatterers are not evenly bright.
"""

from __future__ import annotations

import dataclasses
import functools
import math

import numba
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from sar_imaging.backends.cpu.backprojection import Backprojection
from sar_imaging.backends.cpu.groups import merge, part_weights, quad_width
from sar_imaging.backends.cpu.instructions import LANES
from sar_imaging.backends.reference.correlation import correlate_spectra
from sar_imaging.geometry import MapGrid
from sar_imaging.planning.costs import DEFAULT, costs, using
from sar_imaging.planning.exact import groups
from sar_imaging.planning.exact.backprojection import GridLines, plan_backprojection
from sar_imaging.planning.exact.groups import GROUP, plan_groups
from sar_imaging.planning.interpolators import design_interpolator
from sar_imaging.signal import SPEED_OF_LIGHT, RadarParameters

ALLOWED_DB = 3.0
CARRIER_HZ, SIDE = 24e9, 80
U = np.linspace(-0.5, 0.5, 90)


def track(kind, length, range_m, height_m):
    """(90, 3) phase centres beside the origin, some of them further along each kind of way."""
    path = np.stack([-range_m + 0 * U, length * U, height_m + 0 * U], axis=1)
    if kind == 'curved':
        path[:, 0] += 0.3 * length * (1 - 4 * U ** 2)
    elif kind == 'climbing':
        path[:, 2] += 0.5 * length * (U + 0.5)
    elif kind == 'squinted':
        path[:, 1] += 0.5 * range_m
    elif kind == 'retracing':
        path[:, 1] = length * (0.5 - 2 * np.abs(U))
    elif kind == 'stopping':
        path[30:60] = path[45]
    elif kind == 'perturbed':
        path += 0.003 * np.random.default_rng(4).standard_normal(path.shape)
    return path


class Near:
    """A map of 80 x 80 pixels, and the profiles of scatterers on it."""

    def __init__(self, tx, rx, grid, seed=1):
        rng = np.random.default_rng(seed)
        self.grid, self.tx, self.rx = grid, tx, rx
        bandwidth = SPEED_OF_LIGHT / (4 * grid.spacing_m)
        points = grid.points().reshape(-1, 3)[rng.integers(0, SIDE ** 2, 40)]
        tau = sum(np.linalg.norm(c[:, None] - points, axis=-1) for c in (tx, rx)) / SPEED_OF_LIGHT
        rate = 1.4 * bandwidth
        self.n_samples = int(1.6 * np.ptp(tau) * rate) + 200
        start_s = 0.5 * (tau.min() + tau.max()) - self.n_samples / 2 / rate
        baseband = (np.arange(self.n_samples) - self.n_samples // 2) * (rate / self.n_samples)
        inside = np.abs(baseband) <= bandwidth / 2
        frequency = CARRIER_HZ + baseband[inside]
        amplitude = np.exp(2j * np.pi * rng.random(40))
        self.spectra = np.stack([np.exp(-2j * np.pi * np.mod(f * tau, 1.0)) @ amplitude
                                 for f in frequency], axis=-1)
        samples = np.zeros((len(tx), self.n_samples), complex)
        samples[:, inside] = self.spectra * np.exp(
            2j * np.pi * np.mod(baseband[inside] * start_s, 1.0))
        samples = np.fft.ifft(np.fft.ifftshift(samples, axes=-1), norm='forward')
        self.samples = samples.astype(np.complex64)
        self.radar = RadarParameters(CARRIER_HZ, bandwidth, rate, start_s)
        self.cycles_per_m = (frequency[0] / SPEED_OF_LIGHT,
                             rate / self.n_samples / SPEED_OF_LIGHT)

    def plan(self, target_db):
        """Plan of an image, from groups though the map is small."""
        with using(dataclasses.replace(DEFAULT, point_pixel=1e3, line_pixel=1e3)):
            return plan_backprojection(self.grid, self.radar, self.n_samples, self.tx, self.rx,
                                       target_db, groups=True)

    def image(self, plan):
        """By the plan."""
        image = np.zeros(self.grid.shape, np.complex64)
        Backprojection(plan).add(self.samples, self.tx, self.rx, image)
        return image

    def error_db(self, image):
        """Error over the power of the image, dB, from pixels chosen by chance, the brighter the
        more often: of evenly chosen ones, one bright pixel more or less makes 5 dB."""
        power = np.abs(image.ravel().astype(complex)) ** 2
        chance = 0.5 / power.size + 0.5 * power / power.sum()
        number = np.random.default_rng(2).choice(power.size, 400, p=chance)
        wanted = correlate_spectra(
            self.cycles_per_m, self.spectra[:, None], self.tx[:, None], self.rx[:, None],
            self.grid.points().reshape(-1, 3)[number])
        error = np.mean(np.abs(image.ravel()[number] - wanted) ** 2 / chance[number])
        return 10 * np.log10(error / power.sum())


@functools.cache
def beside(kind):
    """Profiles from a track of 2 m, 8 m beside the map's middle."""
    tx = track(kind, 2.0, 8.0, 1.5)
    return Near(tx, tx, MapGrid((0.0, 0.0, 0.0), SIDE, SIDE, 0.05))


KINDS = 'straight', 'curved', 'climbing', 'squinted', 'retracing', 'stopping', 'perturbed'


@pytest.mark.parametrize('target_db', [-80.0, -60.0, -45.0])
@pytest.mark.parametrize('kind', KINDS)
def test_near_images_err_as_predicted(kind, target_db):
    near = beside(kind)
    plan = near.plan(target_db)
    assert plan.method == 'groups' and plan.predicted_error_db <= target_db
    assert near.error_db(near.image(plan)) <= plan.predicted_error_db + ALLOWED_DB


def test_profiles_take_a_higher_degree_where_it_saves_positions_within_cells(monkeypatch):
    tx = track('straight', 10.0, 200.0, 20.0)
    near = Near(tx, tx, MapGrid((0.0, 0.0, 0.0), SIDE, SIDE, 0.05))
    route = near.plan(-60.0).route
    assert (route.resampling.n_phases, route.resampling.interpolator.n_planes) == (1, 10)
    monkeypatch.setattr(groups, '_MOST_DEGREE', 3)
    cubic = near.plan(-60.0).route
    assert (cubic.resampling.n_phases, cubic.resampling.interpolator.n_planes) == (2, 8)
    seconds = [costs().seconds(one.operations(near.grid, len(near.tx))) for one in (route, cubic)]
    assert seconds[0] < seconds[1]


@pytest.mark.parametrize('target_db', [-80.0, -45.0])
def test_each_receiver_is_exact(target_db):
    """Three receivers side by side, a tenth of the range away from their transmitter."""
    tx = np.repeat(track('straight', 2.0, 8.0, 1.5)[::3], 3, axis=0)
    rx = tx + [-0.3, 0.7, 0.2] + np.tile([[0.0, 0.0, 0.0], [0.0, 0.006, 0.0], [0.0, 0.01, 0.003]],
                                         (30, 1))
    near = Near(tx, rx, MapGrid((0.0, 0.0, 0.0), SIDE, SIDE, 0.05))
    plan = near.plan(target_db)
    assert plan.method == 'groups'
    assert near.error_db(near.image(plan)) <= plan.predicted_error_db + ALLOWED_DB


def _turned(track_m, heading):
    return track_m @ np.array([[np.cos(heading), np.sin(heading), 0],
                               [-np.sin(heading), np.cos(heading), 0], [0, 0, 1]])


@settings(max_examples=12)
@given(kind=st.sampled_from(KINDS), range_m=st.floats(5.0, 40.0), height=st.floats(0.0, 0.7),
       length=st.floats(0.05, 0.6), heading=st.floats(-np.pi, np.pi), seed=st.integers(0, 99),
       target_db=st.sampled_from([-80.0, -60.0, -45.0]))
def test_any_near_image_errs_as_predicted(kind, range_m, height, length, heading, seed,
                                          target_db):
    tx = _turned(track(kind, length * range_m, range_m, height * range_m), heading)
    near = Near(tx, tx, MapGrid((0.0, 0.0, 0.0), SIDE, SIDE, range_m / 160), seed)
    plan = near.plan(target_db)
    if plan.method == 'groups':
        assert near.error_db(near.image(plan)) <= plan.predicted_error_db + ALLOWED_DB


def test_what_lies_beside_the_antenna_is_imaged_point_by_point():
    """A corner of the map lies beside the track; its rows would be read where nothing lies."""
    tx = track('straight', 2.0, 3.0, 0.5)
    near = Near(tx, tx, MapGrid((1.0, 3.0, 0.0), SIDE, SIDE, 0.13))
    plan = plan_backprojection(near.grid, near.radar, near.n_samples, tx, tx, -45.0, groups=True)
    with using(dataclasses.replace(DEFAULT, point_pixel=1e3)):
        route = plan_groups(near.grid, near.radar, near.n_samples, tx, tx, plan.range_m, -45.0)
    assert route.rest and 'elsewhere point by point' in str(route)
    covered = np.zeros(near.grid.shape, int)
    for (row, column), grid in [*route.rest, *((m.corner, m.grid) for m in route.maps)]:
        covered[row:row + grid.n_y, column:column + grid.n_x] += 1
    assert (covered == 1).all()
    plan = dataclasses.replace(plan, route=route)
    assert near.error_db(near.image(plan)) <= plan.predicted_error_db + ALLOWED_DB


def test_a_moving_window_is_planned_from_the_last_one(monkeypatch):
    """Its groups are as many as before, unless they take another time: then they are sought."""
    near = beside('straight')
    tx = near.tx

    def plan(centres, before=None):
        range_m = GridLines(near.grid, centres, centres).range_m
        with using(dataclasses.replace(DEFAULT, point_pixel=1e3)):
            return plan_groups(near.grid, near.radar, near.n_samples, centres, centres, range_m,
                               -60.0, before=before)

    first, moved, elsewhere = plan(tx), tx + [0.0, 0.1, 0.0], tx + [3.0, 1.5, 0.0]
    assert plan(elsewhere, first) == plan(elsewhere) != first
    monkeypatch.setattr('sar_imaging.planning.exact.groups._seek', None)  # not asked any more
    following = plan(moved, first)
    assert following.sought_ns == first.sought_ns
    one, other = first.maps[0], following.maps[0]
    assert (len(one.groups), one.n_parts) == (len(other.groups), other.n_parts)
    assert following.predicted_error_db <= -60.0


def test_threads_and_pieces_make_no_difference(monkeypatch):
    near = beside('curved')
    plan = near.plan(-60.0)
    image, threads = near.image(plan), numba.get_num_threads()
    try:
        numba.set_num_threads(1)
        np.testing.assert_array_equal(near.image(plan), image)
        monkeypatch.setattr('sar_imaging.backends.cpu.groups._CHUNK_BYTES', 1)
        np.testing.assert_array_equal(near.image(plan), image)
    finally:
        numba.set_num_threads(threads)


@pytest.mark.parametrize(('taps', 'apart'), [
    (6, 0.2), (8, 0.3), (10, 0.9), (6, 1 / 3), (6, 1.0),
    (8, 1.7), (6, 2.4)])  # lines of parts closer than those of the sum: weights were overrun
def test_lines_of_parts_are_summed_as_the_formula_says(taps, apart):
    rng = np.random.default_rng(taps)
    n_parts, n_range, n_alpha = 3, 32, 12
    n_lines = math.ceil((n_alpha - 1) * apart) + taps + 3  # as planned, at least
    group = np.zeros(1, GROUP)
    group['alpha'], group['alpha_spacing'] = -0.11, 1e-2 * apart
    group['coarse_spacing'], group['coarse'] = 1e-2, -0.11 - taps // 2 * 1e-2
    group['n_alpha'], group['n_range'], group['n_coarse'] = n_alpha, n_range, n_lines
    found = design_interpolator(1.8, taps=taps, degree=5)
    frequency = rng.uniform(-300, 300, n_parts)
    images = (rng.standard_normal((n_parts, n_lines, n_range))
              + 1j * rng.standard_normal((n_parts, n_lines, n_range))).astype(np.complex64)
    alpha = -0.11 + 1e-2 * apart * np.arange(n_alpha)
    v = (alpha - group['coarse']) / 1e-2
    t, low = v - np.floor(v), np.floor(v).astype(int)
    weight = t[:, None] ** np.arange(6) @ found.weights
    read = images[:, low[:, None] + found.first + np.arange(taps)]  # (P, n_alpha, taps, n_range)
    wanted = np.einsum('ak,pakr,pa->ar', weight, read,
                       np.exp(2j * np.pi * np.multiply.outer(frequency, alpha)))
    assert low.min() + found.first >= 0
    parts = images.transpose(2, 0, 1).reshape(-1, LANES, n_parts, n_lines).transpose(0, 2, 3, 1)
    parts = np.ascontiguousarray(np.stack([parts.real, parts.imag], axis=3))
    width = quad_width(taps, 1e-2 * apart, 1e-2)
    starts, weights = np.empty(3, np.int64), np.empty((3, width, 4), np.float32)
    phasors = np.empty((3, n_parts, 4, 2), np.float32)
    part_weights(group[0], frequency, found.first, found.weights.astype(float), starts, weights,
                 phasors)
    assert starts.min() >= 0 and starts.max() + width <= n_lines
    total = np.empty((n_alpha, 2, n_range), np.float32)
    merge(parts.ctypes.data, n_lines, starts, weights.ctypes.data, (0,) * width,
          (phasors.ctypes.data, n_parts), total.ctypes.data, n_range)
    error = np.linalg.norm(total[:, 0] + 1j * total[:, 1] - wanted) / np.linalg.norm(wanted)
    assert error < 3e-6  # weights, phasors and sums in float32
