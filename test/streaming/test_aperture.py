# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Apertures: when they close, what they contain, what happens to late and repeated pulses."""

import dataclasses

import numpy as np
import pytest

from benchmarks.support.references import exact_image
from sar_imaging.geometry.grids import MapGrid
from sar_imaging.geometry.illumination import AntennaPattern, PatternCut, Pointing
from sar_imaging.imaging.exact import Exact
from sar_imaging.imaging.imager import plan_image
from sar_imaging.planning.costs import DEFAULT, using
from sar_imaging.signal.pulses import PulseBlock, concatenate
from sar_imaging.signal.radar import SPEED_OF_LIGHT, RadarParameters
from sar_imaging.streaming.aperture import ApertureImager

GRID = MapGrid((1000.0, 0.0, 0.0), 24, 16, 0.25)
RADAR = RadarParameters(carrier_hz=10e9, bandwidth_hz=300e6, sample_rate_hz=600e6,
                        first_sample_delay_s=2 * 990.0 / SPEED_OF_LIGHT)
N_SAMPLES = 81
LENGTH = 40
INTERVAL_NS = 1_000_000
WRAP = 2**32


def profiles(counters, *, epoch_ns=0, radar=RADAR, n_samples=N_SAMPLES):
    """Noise profiles that depend on the counter alone, on a straight track along y."""
    counters = np.asarray(counters, np.int64)
    samples = np.stack([np.random.default_rng(int(c) % 1000).standard_normal((2, n_samples, 2))
                        for c in counters]).astype(np.float32).view(np.complex64)[..., 0]
    positions = np.zeros((len(counters), 2, 3))
    positions[..., 1] = ((counters % LENGTH) - LENGTH / 2)[:, None] + [-0.1, 0.1]
    return PulseBlock(radar, True, epoch_ns + counters * INTERVAL_NS,
                      (counters % WRAP).astype(np.uint32), samples, positions, positions)


def imager(**options):
    return ApertureImager(GRID, pulses_per_aperture=LENGTH, **options)


def events(stage, kind):
    return [e.text for e in stage.take_events() if e.kind == kind]


def assert_image_of(result, block):
    """Same image as of the block at once.

    Float32 sums in another order differ by 1e-6; parts of the block may be read through other
    polynomials, which differ by 1.5e-5 where the error of the image is 4.6e-5.
    """
    expected = exact_image(GRID, block)
    error = np.linalg.norm(result.image - expected) / np.linalg.norm(expected)
    assert error < 3e-5
    np.testing.assert_array_equal(result.counters, np.sort(block.counter))


def run(stage, blocks):
    return [image for block in blocks for image in stage.add(block)]


@pytest.mark.parametrize('options', [{'method': 'correlation'},
                                     {'method': 'correlation', 'keep_pulses': True}])
def test_pulses_light_what_their_beam_covers(options):
    """In any order; pixels that no pulse lit are zero."""
    block = profiles(range(LENGTH))
    block = dataclasses.replace(block, pointing=Pointing.steered(
        block.phase_centre_m, (1000.0, 1.0, 0.0)))
    pattern = AntennaPattern(PatternCut.uniform(0.002))  # 2 m of the grid's 3.75 m
    stage = imager(illumination=pattern, **options)
    [image] = run(stage, [block.select(slice(0, 40, 2)), block.select(slice(1, 40, 2))])
    expected = plan_image(GRID, RADAR, N_SAMPLES, illumination=pattern,
                          method=options.get('method', 'exact'))(block).samples
    np.testing.assert_allclose(image.image, expected, atol=1e-4 * abs(expected).max())
    beyond = abs(GRID.points()[..., 1] - 1.0) > 1.4
    assert beyond.any() and (image.image[beyond] == 0).all() and image.image.any()
    if image.pulses is not None:
        assert image.pulses.pointing.same_as(block.pointing)


def test_illumination_needs_a_method_that_knows_it():
    with pytest.raises(ValueError, match="'ffbp' knows no illumination"):
        imager(method='ffbp', illumination=AntennaPattern(PatternCut.sinc(0.1)))


def test_heights_are_those_of_the_pixels():
    heights = np.linspace(-2.0, 3.0, GRID.n_x * GRID.n_y).reshape(GRID.shape)
    heights[3, 4] = np.nan
    [result] = imager(height_m=heights, target_db=-80.0).add(profiles(range(LENGTH)))
    block = profiles(range(LENGTH))
    expected = exact_image(GRID, block, height_m=heights)
    np.testing.assert_array_equal(result.image, expected)
    assert result.image[3, 4] == 0


def test_an_aperture_is_imaged_when_its_last_pulse_came():
    stage = imager()
    assert run(stage, [profiles(range(0, 16)), profiles(range(16, 39))]) == []
    [result] = stage.add(profiles([39]))
    assert_image_of(result, profiles(range(LENGTH)))
    assert (result.aperture, result.n_pulses, result.n_missing) == (0, LENGTH, 0)
    assert result.image.dtype == np.complex64
    # Noise, beyond the band too, may be what is bright beyond the map and not alike: 5.3 dB.
    assert result.predicted_error_db < -80.0 + 6.0 and not stage.take_events()
    assert stage.flush() == []


def test_a_block_across_apertures_is_shared_out():
    stage = imager()
    first, second = run(stage, [profiles(range(0, 90))])
    assert_image_of(first, profiles(range(0, 40)))
    assert_image_of(second, profiles(range(40, 80)))
    assert [i.aperture for i in (first, second)] == [0, 1]


def test_a_block_around_a_whole_aperture_is_shared_out():
    """Ten pulses before it and ten behind."""
    stage = imager(min_pulse_fraction=0.0)
    before, whole, after = run(stage, [profiles(range(30, 90))]) + stage.flush()
    assert_image_of(before, profiles(range(30, 40)))
    assert_image_of(whole, profiles(range(40, 80)))
    assert_image_of(after, profiles(range(80, 90)))
    assert stage.statistics.duplicate == stage.statistics.late == 0


def test_an_aperture_is_closed_by_a_pulse_of_a_later_one():
    stage = imager()
    [result] = run(stage, [profiles(range(0, 30)), profiles(range(80, 90))])
    assert_image_of(result, profiles(range(0, 30)))
    assert result.missing.tolist() == list(range(30, 40))
    # Nobody else may have noticed: the stage before this one was down.
    assert events(stage, 'aperture') == ['no pulse came of apertures 1 (1)']
    assert stage.statistics.apertures_dropped == 1
    run(stage, [profiles(range(240, 250))])
    assert 'no pulse came of apertures 3..5 (3)' in events(stage, 'aperture')


def test_the_stamp_is_the_middle_of_the_aperture_even_when_its_ends_are_missing():
    stage = imager()
    [complete] = run(stage, [profiles(range(0, 40))])
    assert complete.stamp_ns == 19_500_000
    [partial] = run(stage, [profiles(range(43, 73)), profiles(range(80, 81))])
    assert partial.stamp_ns == 59_500_000


def test_too_few_pulses_are_dropped_and_reported():
    stage = imager(min_pulse_fraction=0.5)
    assert run(stage, [profiles(range(0, 19)), profiles(range(40, 60))]) == []
    assert stage.statistics.apertures_dropped == 1
    [text] = events(stage, 'aperture')
    assert 'aperture 0 dropped: 19 of 40 pulses' in text
    assert 'missing 19..39 (21)' in text
    [exactly_half] = stage.flush()
    assert exactly_half.n_pulses == 20


def test_pulses_in_any_order_within_the_aperture_are_used_once():
    stage = imager()
    blocks = [profiles(range(20, 30)), profiles(range(0, 10)), profiles(range(30, 36)),
              profiles(range(20, 30)), profiles([36, 37, 37, 38])]
    assert run(stage, blocks) == []
    [result] = stage.add(profiles([39]))
    assert_image_of(result, profiles([*range(10), *range(20, 40)]))
    assert stage.statistics.duplicate == 11
    assert stage.statistics.restarts == 0


def test_late_pulses_of_a_closed_aperture_are_counted():
    stage = imager()
    [result] = stage.add(profiles(range(0, 30))) + stage.flush()
    assert run(stage, [profiles(range(30, 40)), profiles(range(40, 50))]) == []
    assert result.n_pulses == 30
    assert stage.statistics.late == 10
    assert events(stage, 'late') == [
        'dropped pulses of an aperture that was closed before: 30..39 (10)']


@pytest.mark.parametrize('n_pulses', [40, 60, 120])
def test_a_looping_recording_gives_the_same_images_again(n_pulses):
    stage = imager(min_pulse_fraction=0.1)
    recording = [profiles(range(i, i + 10)) for i in range(0, n_pulses, 10)]
    images = run(stage, recording * 3) + stage.flush()
    per_loop = -(-n_pulses // LENGTH)
    assert [i.aperture for i in images] == list(range(per_loop)) * 3
    for i, image in enumerate(images):
        np.testing.assert_array_equal(image.image, images[i % per_loop].image)
    assert (stage.statistics.restarts, stage.statistics.images) == (2, len(images))
    assert len(events(stage, 'restart')) == 2


def test_a_restarted_radar_begins_a_new_aperture_at_once():
    stage = imager()
    images = run(stage, [profiles(range(80, 110)), profiles(range(0, 20), epoch_ns=10**10),
                         profiles(range(20, 40), epoch_ns=10**10)])
    assert [i.aperture for i in images] == [2, 0]
    assert images[1].stamp_ns == 10**10 + 19_500_000


def test_changed_profiles_close_the_aperture_and_are_planned_anew():
    stage = imager()
    faster = dataclasses.replace(RADAR, sample_rate_hz=900e6)
    images = run(stage, [profiles(range(0, 25)),
                         profiles(range(25, 60), radar=faster, n_samples=121)])
    images += stage.flush()
    assert [(i.aperture, i.n_pulses) for i in images] == [(0, 25), (1, 20)]
    assert 'aperture 0 dropped: 15 of 40' in ' '.join(e.text for e in stage.take_events())


def test_the_wrap_around_of_the_counter_goes_forward():
    stage = imager()
    number = (WRAP - 1) // LENGTH
    last = WRAP - number * LENGTH  # pulses in the shortened last aperture
    images = run(stage, [profiles(range(WRAP - last - 10, WRAP - last)),
                         profiles(range(WRAP - last, WRAP)), profiles(range(WRAP, WRAP + 40))])
    assert [(i.aperture, i.n_pulses, i.n_missing) for i in images] == [
        (number, last, 0), (0, 40, 0)]
    assert stage.statistics.restarts == 0


@pytest.mark.parametrize(('change', 'message'), [
    ({'compressed': False}, 'raw pulses; expected range profiles'),
    ({'tx_m': None, 'rx_m': None}, 'no phase centres')])
def test_blocks_that_cannot_be_imaged_are_refused(change, message):
    with pytest.raises(ValueError, match=message):
        imager().add(dataclasses.replace(profiles(range(4)), **change))


def test_profiles_that_miss_the_grid_leave_the_aperture_as_it_was():
    stage = imager(min_pulse_fraction=0.0)
    far = dataclasses.replace(profiles(range(4)), tx_m=np.full((4, 2, 3), 1e6),
                              rx_m=np.full((4, 2, 3), 1e6))
    with pytest.raises(ValueError, match='grid'):
        stage.add(far)
    assert stage.flush() == []
    assert 'aperture 0 dropped: 0 of 40' in events(stage, 'aperture')[0]


def test_read_only_profiles_are_enough():
    block = profiles(range(LENGTH))
    block.samples.flags.writeable = False
    [result] = imager().add(block)
    assert_image_of(result, concatenate([block]))


@pytest.mark.parametrize('options', [{'pulses_per_aperture': 0}, {'min_pulse_fraction': 1.5}])
def test_impossible_options_are_refused(options):
    with pytest.raises(ValueError, match=next(iter(options))):
        ApertureImager(GRID, **{'pulses_per_aperture': LENGTH} | options)


def test_a_reset_drops_the_aperture_being_filled():
    stage = imager()
    run(stage, [profiles(range(50, 75))])
    assert stage.reset() == 25
    assert stage.flush() == []
    # Earlier counters are neither late nor a restart: the sequence is a new one.
    [result] = run(stage, [profiles(range(0, LENGTH))])
    assert_image_of(result, profiles(range(0, LENGTH)))
    assert (stage.statistics.late, stage.statistics.restarts) == (0, 0)
    assert stage.reset() == 0


def test_pulses_are_kept_when_asked_for():
    stage = imager(keep_pulses=True)
    there = [5, 6, 7, *range(0, 5), *range(20, LENGTH)]
    [product] = stage.add(profiles(there))
    expected = profiles(sorted(there))
    np.testing.assert_array_equal(product.pulses.counter, expected.counter)
    np.testing.assert_array_equal(product.pulses.stamp_ns, expected.stamp_ns)
    np.testing.assert_array_equal(product.pulses.samples, expected.samples)
    np.testing.assert_array_equal(product.pulses.tx_m, expected.tx_m)
    [product] = imager().add(profiles(there))
    assert product.pulses is None


@pytest.mark.parametrize('method', ['afbp', 'auto'])
def test_whole_apertures_are_imaged_by_other_methods(make_case, method):
    """With costs that make exact backprojection slow `auto` takes AFBP."""
    case = make_case(1e3, pulses=256)
    stage = ApertureImager(case.grid, pulses_per_aperture=128, method=method, target_db=-50.0)
    block = case.block.select(np.r_[0:40, 50:256])  # ten pulses are lost
    with using(dataclasses.replace(DEFAULT, line_pixel=1e4, point_pixel=1e5,
                                   part_coefficient=1e3)):
        images = run(stage, [block.select(slice(n, n + 32)) for n in range(0, 246, 32)])
    images += stage.flush()
    assert [image.method for image in images] == ['afbp', 'afbp']
    assert images[0].missing.tolist() == list(range(40, 50)) and images[0].pulses is None
    for image, pulses in zip(images, (slice(0, 118), slice(118, 246)), strict=True):
        exact = exact_image(case.grid, block.select(pulses))
        error = np.linalg.norm(image.image - exact) / np.linalg.norm(exact)
        assert 20 * np.log10(error) <= min(-50.0, image.predicted_error_db + 3.0)


def test_auto_adds_pulses_as_they_come_once_exact_backprojection_is_chosen(make_case, monkeypatch):
    case = make_case(1e3, pulses=256)
    stage = ApertureImager(case.grid, pulses_per_aperture=128, method='auto')
    added, whole = [], Exact.image

    def counted(self, block, onto=None):
        added.append(block.n_pulses)
        return whole(self, block, onto)

    monkeypatch.setattr(Exact, 'image', counted)
    images = run(stage, [case.block.select(slice(n, n + 32)) for n in range(0, 256, 32)])
    assert [image.method for image in images] == ['exact', 'exact']
    assert added == [128, 32, 32, 32, 32]
