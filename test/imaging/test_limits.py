"""Limits of imaging and of what stands before it, just inside and just outside."""

import dataclasses

import numpy as np
import pytest

from sar_imaging.geometry import MapGrid
from sar_imaging.geometry.track_prediction import predict_track
from sar_imaging.planning import memory
from sar_imaging.planning.afbp.aperture_cut import cut_pulses, pieces_between_gaps
from sar_imaging.planning.range_gate import RangeWindow
from sar_imaging.signal import RadarParameters
from sar_imaging.streaming.aperture import ApertureImager
from sar_imaging.streaming.fusion import LiveFusion
from sar_imaging.streaming.mosaic import StripMosaic
from sar_imaging.streaming.plan import extension
from sar_imaging.streaming.subapertures import LiveSubapertures

LENGTH, CUT = 96, 24
GRID = MapGrid((1e3, 0.0, 0.0), 8, 8, 0.5)


# ------------------------------------------------------------------------------- options

@pytest.mark.parametrize(('name', 'inside', 'outside'), [
    ('pulses_per_subaperture', (0, 96), (-1, 97)), ('target_db', (-85.0, -20.0), (-85.1, -19.9)),
    ('pulses_per_aperture', (1,), (0,))])
def test_options_of_live_subapertures(name, inside, outside):
    for value in inside:
        LiveSubapertures(GRID, **{'pulses_per_aperture': LENGTH} | {name: value})
    for value in outside:
        with pytest.raises(ValueError, match=f'{name}={value}'):
            LiveSubapertures(GRID, **{'pulses_per_aperture': LENGTH} | {name: value})


@pytest.mark.parametrize('make', [LiveFusion, lambda **o: ApertureImager(
    GRID, pulses_per_aperture=1, **o)])
def test_the_share_of_pulses_is_from_zero_to_one(make):
    for value in (0.0, 1.0):
        assert make(min_pulse_fraction=value).min_pulse_fraction == value
    for value in (-1e-9, 1 + 1e-9):
        with pytest.raises(ValueError, match='min_pulse_fraction'):
            make(min_pulse_fraction=value)


def test_memory_that_is_just_enough_is_enough(monkeypatch):
    monkeypatch.setattr(memory, 'available_bytes', lambda: 5_000_000)
    memory.check_memory(5_000_000, 'it', 'do something')
    with pytest.raises(MemoryError, match='it needs 5 MB, 5 MB are available; do something'):
        memory.check_memory(5_000_001, 'it', 'do something')


# ------------------------------------------------------------------------------- apertures

def test_an_image_needs_its_share_of_the_pulses_and_no_more(make_case):
    case = make_case(1e3, n=32, pulses=LENGTH, n_points=2, aperture_m=28.8)
    stage = LiveSubapertures(case.grid, pulses_per_aperture=LENGTH, pulses_per_subaperture=CUT)
    sent = stage.add(case.block)
    for share, n_images in ((0.5, 1), (0.5 + 1e-9, 0)):
        fusion = LiveFusion(min_pulse_fraction=share)
        images = [image for sub in sent[:2] for image in fusion.add(sub)] + fusion.flush()
        assert len(images) == n_images == 1 - fusion.statistics.apertures_dropped
        imager = ApertureImager(case.grid, pulses_per_aperture=LENGTH, min_pulse_fraction=share)
        images = imager.add(case.block.select(slice(0, 48))) + imager.flush()
        assert len(images) == n_images == 1 - imager.statistics.apertures_dropped
    assert ApertureImager(case.grid, pulses_per_aperture=LENGTH, min_pulse_fraction=0.0).flush() \
        == []


@pytest.mark.parametrize(('n_known', 'plans'), [(71, 1), (72, 2)])
def test_plans_are_made_ahead_from_three_quarters_on(make_case, n_known, plans):
    case = make_case(1e3, n=32, pulses=LENGTH, n_points=2, aperture_m=28.8)
    stage = LiveSubapertures(case.grid, pulses_per_aperture=LENGTH, pulses_per_subaperture=CUT)
    stage.add(case.block.select(slice(0, n_known)))
    stage.plan_ahead()
    assert stage.statistics.plans == plans


@pytest.mark.parametrize(('n_pulses', 'plans'), [(15, 0), (16, 1)])
def test_a_track_is_foreseen_from_sixteen_pulses_on(make_case, n_pulses, plans):
    case = make_case(1e3, n=32, pulses=LENGTH, n_points=2, aperture_m=28.8)
    stage = LiveSubapertures(case.grid, pulses_per_aperture=LENGTH)
    stage.add(case.block.select(slice(0, n_pulses)))
    assert stage.statistics.plans == plans


def test_maps_of_as_many_pixels_as_allowed_are_fused(make_case):
    case = make_case(1e3, n=32, pulses=LENGTH, n_points=2, aperture_m=28.8)
    [first, *_] = LiveSubapertures(case.grid, pulses_per_aperture=LENGTH,
                                   pulses_per_subaperture=CUT).add(case.block)
    LiveFusion(max_image_pixels=32 * 32).add(first)
    with pytest.raises(ValueError, match='max_image_pixels=1023'):
        LiveFusion(max_image_pixels=1023).add(first)


@pytest.mark.parametrize(('n_pulses', 'length', 'slack', 'expected'), [
    (100, 1, 1.0, (5, 5)), (100, 25, 1.0, (12, 13)), (100, 25, 0.0, (0, 0)),
    (101, 1, 1.0, (6, 6)), (90, 25, 0.0, (5, 5)), (100, 55, 1.0, (5, 5)),
    (100, 54, 1.0, (31, 31))])
def test_an_aperture_is_extended_by_a_twentieth_to_whole_subapertures(n_pulses, length, slack,
                                                                      expected):
    assert extension(n_pulses, length, slack) == expected


# ------------------------------------------------------------------------------- the cut

@pytest.mark.parametrize(('step_m', 'pieces'), [
    (3.99, [(0, 20)]), (4.01, [(0, 8), (8, 20)])])
def test_a_gap_is_four_times_the_usual_step(step_m, pieces):
    along = np.arange(20.0)
    along[8:] += step_m - 1
    middles = np.stack([along, 0 * along, 0 * along], axis=1)
    assert pieces_between_gaps(middles) == pieces


@pytest.mark.parametrize(('n', 'length', 'lengths'), [
    (20, 20, [20]), (20, 19, [10, 10]), (21, 10, [7, 7, 7]), (1, 1, [1]), (5, 2, [2, 1, 2])])
def test_subapertures_are_as_few_and_as_equal_as_possible(n, length, lengths):
    cuts = cut_pulses([(3, 3 + n)], length)
    assert sorted(c.stop - c.start for c in cuts) == sorted(lengths)
    assert cuts[0].start == 3 and cuts[-1].stop == 3 + n
    assert all(a.stop == b.start for a, b in zip(cuts[:-1], cuts[1:], strict=True))


def test_one_pulse_and_a_platform_that_stands_have_no_gaps():
    assert pieces_between_gaps(np.zeros((1, 3))) == [(0, 1)]
    still = np.zeros((9, 3))
    still[5:] = 7.0
    assert pieces_between_gaps(still) == [(0, 9)]


# ------------------------------------------------------------------------------- range window

RADAR = RadarParameters(10e9, 75e6, 150e6, 1e-6)  # oversampled twice: 48 samples beyond


def _around(first, last, n=1000):
    start, spacing = RADAR.range_start_m, RADAR.sample_spacing_m
    return RangeWindow.around(RADAR, n, (start + first * spacing, start + last * spacing))


@pytest.mark.parametrize(('first', 'last', 'expected'), [
    # First sample, how many, rise and fall: three tenths of 48.
    (200.2, 299.8, (152, 196, 14, 14)), (48.2, 299.8, (0, 348, 0, 14)),
    (49.2, 299.8, (1, 347, 14, 14)), (700.2, 951.8, (652, 348, 14, 0)),
    (700.2, 950.8, (652, 347, 14, 14)),
    # Nine tenths are worth a copy, more are not.
    (148.2, 999.0, (100, 900, 14, 0)), (147.2, 999.0, (0, 1000, 0, 0)),
    # A window of less than both of its slopes is none.
    (-47.8, -0.2, (0, 1000, 0, 0)), (30.2, 47.8, (0, 96, 0, 14)), (30.2, 46.8, (0, 1000, 0, 0))])
def test_a_window_keeps_what_its_slopes_need(first, last, expected):
    window = _around(first, last)
    assert (window.first, window.n_samples, window.n_rise, window.n_fall) == expected
    start = RADAR.range_start_m + expected[0] * RADAR.sample_spacing_m
    assert window.range_start_m == pytest.approx(start, abs=1e-9)


# ------------------------------------------------------------------------------- mosaic

@pytest.mark.parametrize(('off', 'taken'), [(9e-4, True), (-9e-4, True), (1.1e-3, False)])
def test_patches_may_be_off_the_lattice_by_a_thousandth_of_a_pixel(off, taken):
    mosaic = StripMosaic()
    image = np.ones((4, 4), np.complex64)
    mosaic.add(image, MapGrid((0.0, 0.0, 0.0), 4, 4, 0.2))
    grid = MapGrid((0.2 * (3 + off), 0.0, 0.0), 4, 4, 0.2)
    if taken:
        mosaic.add(image, grid)
        assert mosaic.form()[0].shape == (4, 7)
    else:
        with pytest.raises(ValueError, match='not on the lattice'):
            mosaic.add(image, grid)


def test_a_strip_has_as_many_pixels_as_allowed():
    image = np.ones((4, 4), np.complex64)
    for max_pixels, columns in ((28, 7), (27, 4), (16, 4)):
        mosaic = StripMosaic(max_pixels=max_pixels)
        for x in (0.0, 0.6):
            mosaic.add(image, MapGrid((x, 0.0, 0.0), 4, 4, 0.2))
        assert mosaic.form()[0].shape == (4, columns)
    with pytest.raises(ValueError, match='expected at most max_pixels=15'):
        StripMosaic(max_pixels=15).add(image, MapGrid((0.0, 0.0, 0.0), 4, 4, 0.2))


# ------------------------------------------------------------------------------- foreseen tracks

def _track(numbers, turns=1):
    """A parabola, and antennas that take turns."""
    n = np.asarray(numbers, float)
    place = np.stack([0.3 * n, 1e-3 * n**2, 0.05 * np.abs(n % turns - turns // 2)],
                     axis=-1)[:, None]
    return place, place + [0.0, 0.1, 0.0]


def _foreseen(n_known, n_wanted, turns=1):
    known, wanted = np.arange(n_known), np.arange(n_wanted)
    return predict_track(known, *_track(known, turns), wanted), _track(wanted, turns)


@pytest.mark.parametrize(('n_known', 'n_wanted', 'curved'), [
    # A quarter of the way that is wanted, and eight pulses.
    (26, 101, True), (25, 101, False), (8, 29, True), (7, 25, False)])
def test_a_curve_is_foreseen_from_a_quarter_of_it_on(n_known, n_wanted, curved):
    found, expected = _foreseen(n_known, n_wanted)
    error = max(np.abs(a - b).max() for a, b in zip(found, expected, strict=True))
    assert (error < 1e-6) == curved
    for a, b in zip(found, expected, strict=True):
        np.testing.assert_array_equal(a[:n_known], b[:n_known])  # as given


@pytest.mark.parametrize('turns', [2, 4])
def test_antennas_that_take_turns_are_foreseen_in_turn(turns):
    found, expected = _foreseen(64, 128, turns)
    height_m = np.ptp(expected[0][..., 2])
    # Least squares give the curve a part of the pattern: measured 4.7 %.
    assert np.abs(found[0][..., 2] - expected[0][..., 2]).max() < 0.08 * height_m


def test_one_pulse_tells_a_place_and_two_a_direction():
    known = np.array([5])
    tx_m, _ = predict_track(known, *_track(known), np.arange(4, 9))
    np.testing.assert_allclose(tx_m, np.broadcast_to(_track(known)[0], (5, 1, 3)))
    known = np.array([5, 7])
    tx_m, _ = predict_track(known, *_track(known), np.arange(5, 11))
    np.testing.assert_allclose(np.diff(tx_m[1:, 0, 0]), 0.3, atol=1e-9)
    with pytest.raises(ValueError, match='at least that of one pulse'):
        predict_track(known[:0], *(a[:0] for a in _track(known)), [1, 2])


def test_only_the_latest_pulses_count():
    """As many as are wanted: what was long ago is no part of the curve."""
    known, wanted = np.arange(-200, 40), np.arange(0, 60)
    tx_m, rx_m = _track(known)
    tx_m, rx_m = tx_m.copy(), rx_m.copy()
    tx_m[known <= -21], rx_m[known <= -21] = 1e3, -1e3
    found = predict_track(known, tx_m, rx_m, wanted)
    np.testing.assert_allclose(found[0], _track(wanted)[0], atol=1e-6)


def test_counters_are_those_of_the_pulses_that_are_there(make_case):
    case = make_case(1e3, n=32, pulses=LENGTH, n_points=2, aperture_m=28.8)
    late = dataclasses.replace(case.block, counter=case.block.counter + 2**20 * LENGTH)
    imager = ApertureImager(case.grid, pulses_per_aperture=LENGTH)
    [image] = imager.add(late)
    assert (image.aperture, image.n_missing) == (2**20, 0)
