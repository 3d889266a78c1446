# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Sliding and strip map apertures of live AFBP, against exact backprojection."""

import dataclasses
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from benchmarks.support.references import exact_image
from sar_imaging.geometry import MapGrid
from sar_imaging.streaming.fusion import LiveFusion
from sar_imaging.streaming.mosaic import StripMosaic, patch_beside
from sar_imaging.streaming.subapertures import LiveSubapertures

LENGTH, CUT = 48, 8  # pulses of an aperture and of a sub-aperture


def _error_db(image, reference):
    return 10 * np.log10(np.sum(np.abs(image - reference) ** 2)
                         / np.sum(np.abs(reference) ** 2))


def _exact(case, pulses, grid):
    return exact_image(grid, case.block.select(pulses), target_db=-90.0)


def _subapertures(case, pulses=slice(None), **options):
    stage = LiveSubapertures(case.grid, pulses_per_aperture=LENGTH, pulses_per_subaperture=CUT,
                             **options)
    block = case.block.select(pulses)
    return [s for i in range(0, block.n_pulses, CUT)
            for s in stage.add(block.select(slice(i, i + CUT)))] + stage.flush()


def _fuse(fusion, subapertures):
    return [image for s in subapertures for image in fusion.add(s)] + fusion.flush()


def test_before_anything_came_nothing_is_counted(make_case):
    stage = LiveSubapertures(make_case(1e3, n=16).grid, pulses_per_aperture=LENGTH)
    assert not any(dataclasses.astuple(stage.statistics))


# ------------------------------------------------------------------------------- sliding

@pytest.fixture(name='case', scope='module')
def case_fixture(make_case):
    angle = (np.arange(4 * LENGTH) - 2 * LENGTH) * 0.6 / 500
    arc = np.c_[500 * (np.cos(angle) - 1), 500 * np.sin(angle), 0 * angle]
    return make_case(1e3, n=64, pulses=4 * LENGTH, n_points=20, track_m=arc)


@pytest.fixture(name='sliding', scope='module')
def sliding_fixture(case):
    return _subapertures(case, sliding=True)


def test_every_subaperture_gives_an_image_of_one_aperture(case, sliding):
    fusion = LiveFusion()
    images = _fuse(fusion, sliding)
    assert len(images) == (4 * LENGTH - LENGTH) // CUT + 1
    for k, result in enumerate(images):
        start = k * CUT
        if k % 3 == 0:
            assert _error_db(result.image,
                             _exact(case, slice(start, start + LENGTH), case.grid)) <= -60.0
        assert (result.n_pulses, result.n_missing, result.n_subapertures) == (LENGTH, 0, 6)
        assert abs(result.stamp_ns - (start + (LENGTH - 1) / 2)) <= 1
        assert result.aperture == (start + LENGTH - 1) // LENGTH
    assert fusion.statistics.duplicate == fusion.statistics.late == 0


def test_a_window_is_the_same_whatever_came_before_it(case, sliding):
    """Nothing accumulates: to the last bit what its sub-apertures give by themselves."""
    images = _fuse(LiveFusion(), sliding)
    anchor = [s for s in sliding if s.sequence == sliding[-1].sequence - 1]
    alone = LiveFusion(min_pulse_fraction=0.0)
    [last] = [i for i in _fuse(alone, anchor[-6:]) if i.n_subapertures == 6]
    np.testing.assert_array_equal(images[-1].image, last.image)


def test_what_ends_a_window_comes_first(case, sliding):
    """The image on the newer polar grid is made once the older one's went on, or with the next."""
    stage = LiveSubapertures(case.grid, pulses_per_aperture=LENGTH, pulses_per_subaperture=CUT,
                             sliding=True)
    at_once, later = [], []
    for i in range(0, case.block.n_pulses, CUT):
        at_once.append(stage.add(case.block.select(slice(i, i + CUT))))
        later.append(stage.catch_up())
        assert stage.catch_up() == []
    # The last sub-aperture of an aperture closes it, and the first aperture has one grid.
    assert [len(some) for some in at_once] == [1] * 6 + [1, 1, 1, 1, 1, 2] * 3
    assert [len(some) for some in later] == [0] * 6 + [1, 1, 1, 1, 1, 0] * 3
    assert all(two[0].sequence == one[0].sequence + 1
               for one, two in zip(at_once, later, strict=True) if two)
    images = _fuse(LiveFusion(), [s for pair in zip(at_once, later, strict=True)
                                  for some in pair for s in some])
    for one, other in zip(images, _fuse(LiveFusion(), sliding), strict=True):
        np.testing.assert_array_equal(one.image, other.image)


def test_windows_are_not_imaged_again_when_their_aperture_is_planned_anew(sliding):
    first = [s for s in sliding if s.sequence == sliding[0].sequence]
    fusion = LiveFusion()
    before = [i for s in first[:8] for i in fusion.add(s)]
    after = [i for s in first[:10]
             for i in fusion.add(dataclasses.replace(s, revision=s.revision + 1))]
    assert fusion.statistics.revisions == 1
    stamps = [i.stamp_ns for i in before + after]
    assert len(before) == 3 and len(after) == 2 and sorted(set(stamps)) == stamps
    assert {i.n_subapertures for i in before + after} == {6}


def test_a_window_with_missing_subapertures(case, sliding):
    lost = 9 * CUT  # first counter
    images = _fuse(LiveFusion(images_every=2), [s for s in sliding if s.first_counter != lost])
    stops = [LENGTH + 2 * CUT * k for k in range(10)]
    stops[2] += CUT  # the one that ends with the lost sub-aperture
    assert len(images) == len(stops)
    for result, stop in zip(images, stops, strict=True):
        pulses = np.arange(stop - LENGTH, stop)
        pulses = pulses[pulses // CUT != lost // CUT]
        assert _error_db(result.image, _exact(case, pulses, case.grid)) <= -60.0
        assert (result.n_pulses, result.n_missing) == (len(pulses), LENGTH - len(pulses))


def test_subapertures_of_a_window_may_change_places(case, sliding):
    order = np.arange(len(sliding))
    order[[14, 16]] = order[[16, 14]]  # an older one comes after a newer one of both anchors
    fusion = LiveFusion()
    images = _fuse(fusion, [sliding[i] for i in order])
    np.testing.assert_array_equal(images[-1].image, _fuse(LiveFusion(), sliding)[-1].image)
    assert fusion.statistics.late == 0


@settings(max_examples=25, deadline=None)
@given(data=st.data(), every=st.integers(0, 3))
def test_any_choice_in_any_order_is_accounted_for(case, sliding, data, every):
    """Whatever a network does to messages, each is used once or counted, and memory is bounded."""
    numbers = data.draw(st.lists(st.integers(0, len(sliding) - 1), max_size=25))
    fusion = LiveFusion(images_every=every, min_pulse_fraction=0.0)
    images = _fuse(fusion, [sliding[n] for n in numbers])
    counts = fusion.statistics
    assert counts.fused + counts.duplicate + counts.late == len(numbers)
    assert counts.images == len(images)
    assert all(0 < i.n_subapertures <= LENGTH // CUT and np.isfinite(i.image).all()
               and i.n_pulses + i.n_missing <= LENGTH for i in images)


def test_a_short_flight_gives_one_image_of_what_came(case):
    images = _fuse(LiveFusion(), _subapertures(case, slice(0, 4 * CUT), sliding=True))
    assert [(i.n_subapertures, i.n_pulses, i.n_missing) for i in images] == [
        (4, 4 * CUT, LENGTH - 4 * CUT)]
    assert _error_db(images[0].image, _exact(case, slice(0, 4 * CUT), case.grid)) <= -60.0


def test_a_gap_of_more_than_an_aperture_begins_anew(case):
    pulses = np.r_[0:LENGTH + 10, 3 * LENGTH:4 * LENGTH]
    images = _fuse(LiveFusion(), _subapertures(case, pulses, sliding=True))
    assert images[-1].n_pulses == LENGTH
    assert _error_db(images[-1].image,
                     _exact(case, slice(3 * LENGTH, None), case.grid)) <= -60.0


# ------------------------------------------------------------------------------- compiling

def test_nothing_is_left_to_compile():
    program = """
import numpy as np
from sar_imaging.geometry import MapGrid
from sar_imaging.backends.cpu import beams, fft, fusion, lines, polar_to_map, profiles
from sar_imaging.streaming.fusion import LiveFusion
from sar_imaging.backends import compile_beforehand
from sar_imaging.streaming.subapertures import LiveSubapertures
from sar_imaging.signal import PulseBlock, RadarParameters

def compiled():
    return {name: len(kernel.signatures)
            for module in (beams, fft, fusion, lines, polar_to_map, profiles)
            for name, kernel in vars(module).items() if hasattr(kernel, 'signatures')}

compile_beforehand('SubapertureImager')
first_stage = compiled()
assert all(first_stage[name] for name in ('_project_lines', '_form_beams', 'interpolate_beams'))
assert not first_stage['_fold_lines']
compile_beforehand('SpectrumFusion')
before = compiled()
assert all(n for name, n in before.items() if name in ('_fold_lines', '_restore_carrier'))
n = np.arange(96)
centres = np.zeros((96, 2, 3))
centres[..., 1] = n[:, None] * 0.3
radar = RadarParameters(10e9, 300e6, 400e6, 2 * 985.0 / 3e8)
block = PulseBlock(radar, True, n, n, np.zeros((96, 2, 80)), centres, centres)
for sliding in (False, True):
    first = LiveSubapertures(MapGrid((1000.0, 9.0, 0.0), 40, 48, 0.25), pulses_per_aperture=48,
                             pulses_per_subaperture=8, sliding=sliding)
    for writeable in (False, True):
        second = LiveFusion(images_every=1)
        for sub in first.add(block):
            sub.image.flags.writeable = writeable
            second.add(sub)
        assert second.statistics.images > 6
        first.reset()
fft.transform_rows(np.zeros((3, 3000), np.complex64), inverse=True)
fft.transform_columns(np.zeros((3000, 64), np.complex64), 50)
assert compiled() == before, (compiled(), before)
"""
    run = subprocess.run([sys.executable, '-c', program], capture_output=True, text=True)
    assert run.returncode == 0, run.stderr


# ------------------------------------------------------------------------------- strip map

@pytest.fixture(name='strip', scope='module')
def strip_fixture(make_case):
    """Three apertures of 14 m along y, scatterers over 55 m."""
    u = np.arange(3 * LENGTH)
    case = make_case(600.0, n=220, pulses=3 * LENGTH, n_points=60,
                     track_m=np.c_[0 * u, (u - 1.5 * LENGTH) * 0.3, 0 * u])
    template = MapGrid((600.0, 3.1, 0.0), 40, 72, 0.25)
    return type(case)(template, case.block, case.points)


def test_patches_follow_the_platform_and_join_to_a_strip(strip):
    subapertures = _subapertures(strip, follow_m=(0.0, -600.0))  # to the right of +y
    images = _fuse(LiveFusion(), subapertures)
    mosaic = StripMosaic()
    for k, result in enumerate(images):
        middle = (k - 1) * LENGTH * 0.3
        assert abs(result.grid.centre_m[1] - middle) <= 1.0  # what was foreseen, in pixels
        steps = (np.subtract(result.grid.centre_m, strip.grid.centre_m) / 0.25)[:2]
        np.testing.assert_allclose(steps, np.rint(steps), atol=1e-6)
        exact = _exact(strip, slice(k * LENGTH, (k + 1) * LENGTH), result.grid)
        assert _error_db(result.image, exact) <= -60.0
        mosaic.add(result.image, result.grid)
    image, grid = mosaic.form()
    assert image.shape == grid.shape and grid.n_x == 40
    assert grid.n_y * grid.spacing_m == pytest.approx(2 * LENGTH * 0.3 + 18, abs=1.5)
    # every patch shows around its middle, in its place
    for result in images:
        row, column = (round(float(v)) for v in grid.to_pixels(*result.grid.centre_m[:2]))
        np.testing.assert_array_equal(image[row - 20:row + 20, column - 10:column + 10],
                                      result.image[36 - 20:36 + 20, 20 - 10:20 + 10])


@pytest.mark.parametrize('beyond_m', [0.5, 1.0, 4.0, 10.0])
def test_a_scatterer_beyond_a_dark_patch_errs_as_if_it_were_inside(make_case, beyond_m):
    """What a patch lacks in light does not lower the error that its surroundings bring along."""
    u = np.arange(LENGTH)
    case = make_case(600.0, n=220, pulses=LENGTH, n_points=1, extent=0.0,
                     track_m=np.c_[0 * u, (u - (LENGTH - 1) / 2) * 0.3, 0 * u])
    bright, dark = (type(case)(MapGrid((600.0, y, 0.0), 40, 72, 0.25), case.block, case.points)
                    for y in (0.0, -9.0 - beyond_m))
    [result] = _fuse(LiveFusion(), _subapertures(dark))
    error = np.sum(np.abs(result.image - _exact(dark, slice(None), dark.grid)) ** 2)
    inside = np.sum(np.abs(_exact(bright, slice(None), bright.grid)) ** 2)
    # Measured 4 dB better to 1.4 dB worse, since the prediction is an average over scenes; of the
    # dark patch's own power it is up to 13 dB more.
    assert 10 * np.log10(error / inside) <= result.predicted_error_db + 3.0


def test_patches_of_a_leg_do_not_swing_with_the_heading(make_case):
    """Five degrees to and fro would move patches 600 m away by 100 m; a turn moves them."""
    u = np.arange(4 * LENGTH)
    heading = np.deg2rad(np.where(u < 3 * LENGTH, 5 * np.sin(u / 30), 40))
    track = np.cumsum(0.3 * np.c_[np.sin(heading), np.cos(heading), 0 * u], axis=0)
    case = make_case(600.0, n=64, pulses=4 * LENGTH, track_m=track)
    patches = {s.aperture: s for s in _subapertures(case, follow_m=(0.0, -600.0))}
    offset = [np.subtract(patches[k].map_grid.centre_m,
                          track[k * LENGTH:(k + 1) * LENGTH].mean(axis=0))[:2] for k in range(4)]
    assert np.ptp(offset[:3], axis=0).max() <= 4.0  # apertures are foreseen, by less than 14 m
    assert np.linalg.norm(offset[3] - offset[2]) > 300.0


@settings(max_examples=50, deadline=None)
@given(heading=st.floats(-np.pi, np.pi), ahead=st.floats(-1e4, 1e4), left=st.floats(-1e4, 1e4))
def test_patches_lie_where_they_should_on_the_lattice(heading, ahead, left):
    grid = MapGrid((3.0, -7.0, 5.0), 10, 21, 0.3)
    u = np.array([np.cos(heading), np.sin(heading)])
    patch = patch_beside(grid, np.array([100.0, 200.0]), u, (ahead, left))
    wanted = [100.0, 200.0] + ahead * u + left * np.array([-u[1], u[0]])
    assert np.abs(np.subtract(patch.centre_m[:2], wanted)).max() <= 0.15 + 1e-6
    steps = np.subtract(patch.centre_m, grid.centre_m) / 0.3
    np.testing.assert_allclose(steps, np.rint(steps), atol=1e-6)
    assert (patch.shape, patch.spacing_m, patch.z_m) == (grid.shape, 0.3, 5.0)


def test_a_strip_is_bounded_and_takes_the_nearest_patch():
    mosaic = StripMosaic(max_pixels=250)
    for k in range(30):  # 10 x 10 pixels, each 6 pixels above the one before
        mosaic.add(np.full((10, 10), k + 1, np.complex64),
                   MapGrid((5.0, 1.2 * k, 0.0), 10, 10, 0.2))
    image, grid = mosaic.form()
    # Three patches fit: 22 rows, the middles 6 apart.
    assert image[:, 0].real.tolist() == [30.0] * 8 + [29.0] * 6 + [28.0] * 8
    assert grid.y_m[0] == pytest.approx(1.2 * 29 + 0.9)
    mosaic.clear()
    with pytest.raises(ValueError, match='no patch yet'):
        mosaic.form()


@pytest.mark.parametrize('grid', [
    MapGrid((0.1, 0.0, 0.0), 4, 4, 0.2), MapGrid((0.0, 0.0, 0.0), 4, 4, 0.3),
    MapGrid((0.0, 0.0, 1.0), 4, 4, 0.2)], ids=['lattice', 'spacing', 'height'])
def test_patches_of_another_lattice_are_refused(grid):
    mosaic = StripMosaic()
    mosaic.add(np.zeros((4, 4), np.complex64), MapGrid((0.0, 0.0, 0.0), 4, 4, 0.2))
    with pytest.raises(ValueError, match='not on the lattice'):
        mosaic.add(np.zeros((4, 4), np.complex64), grid)
    with pytest.raises(ValueError, match='max_pixels=15'):
        StripMosaic(max_pixels=15).add(np.zeros((4, 4), np.complex64), grid)
    with pytest.raises(ValueError, match='max_pixels=0'):
        StripMosaic(max_pixels=0)


# ------------------------------------------------------------------------------- options

@pytest.mark.parametrize('options', [
    {'pulses_per_aperture': 0}, {'pulses_per_subaperture': LENGTH + 1}, {'target_db': -95.0}])
def test_impossible_options_are_refused(case, options):
    with pytest.raises(ValueError, match=next(iter(options))):
        LiveSubapertures(case.grid, **{'pulses_per_aperture': LENGTH} | options)


@pytest.mark.parametrize('options', [{'images_every': -1}, {'min_pulse_fraction': 1.5}])
def test_impossible_options_of_the_fusion_are_refused(options):
    with pytest.raises(ValueError, match=next(iter(options))):
        LiveFusion(**options)
