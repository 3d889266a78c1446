# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""AFBP against exact backprojection, whose own error against correlation is below -80 dB."""

import dataclasses
import re

import numpy as np
import pytest

from benchmarks.support.references import exact_image
from sar_imaging.backends import cpu
from sar_imaging.backends.cpu.beams import SubapertureImager
from sar_imaging.backends.cpu.fusion import SpectrumFusion
from sar_imaging.imaging.afbp import image_of_polar
from sar_imaging.imaging.imager import plan_image
from sar_imaging.planning.afbp.subapertures import cut_pulses, pieces_between_gaps
from sar_imaging.planning.aliasing_error import aliasing_error, guard_taper


def _error_db(image, reference):
    return 10 * np.log10(np.sum(np.abs(image - reference) ** 2)
                         / np.sum(np.abs(reference) ** 2))


def _imager(grid, block, target_db=-50.0, **options):
    return plan_image(grid, block.radar, block.n_samples, block.tx_m, block.rx_m, method='afbp',
                      target_db=target_db, **options)


def _stages(*arguments, **options):
    """The plan of an image and what computes it."""
    plan = _imager(*arguments, **options).report.plan
    return (plan, SubapertureImager(plan.subapertures),
            SpectrumFusion(plan.subapertures.fusion_grid))


def _polar_points(polar):
    return np.ascontiguousarray(polar.lines(polar.range_m[None, :], polar.alpha[:, None])[0])


@pytest.fixture(name='case', scope='module')
def case_fixture(make_case):
    return make_case(1e3, n=128, pulses=128, n_points=40)


GEOMETRIES = [
    {'range_m': 100.0}, {'range_m': 1e3}, {'range_m': 5e3}, {'range_m': 5e4},
    {'range_m': 1e3, 'channels': 5}, {'range_m': 5e3, 'channels': 5},
    {'range_m': 1e3, 'bend_m': 3.0}, {'range_m': 1e3, 'height_m': 500.0, 'heading_rad': 2.5}]


# Random scatterers, and how far they reach. The pulses tell 1.98 times the scene apart, which the
# prediction takes to be full.
CLUTTER = {'everywhere': (600, 2.0), 'beyond the scene': (300, 1.5)}


@pytest.mark.parametrize('clutter', CLUTTER)
@pytest.mark.parametrize('target_db', [-50.0, -70.0])
@pytest.mark.parametrize('options', GEOMETRIES, ids=str)
def test_target_is_met_and_predicted(make_case, options, target_db, clutter):
    n_points, extent = CLUTTER[clutter]
    case = make_case(n=128, pulses=128, n_points=n_points, extent=extent, **options)
    imager = _imager(case.grid, case.block, target_db=target_db)
    error = _error_db(imager(case.block), exact_image(case.grid, case.block))
    # Measured: 0.3 dB worse to 2.6 dB better than predicted where clutter is everywhere, 0.9 to
    # 3.6 dB better where less of it reaches into the guards. Few sub-apertures are predicted by 1
    # to 2 dB more, since rows at the ends of their bands may be bright by chance.
    better = 3.0 if clutter == 'everywhere' else 4.0
    assert error <= target_db and -better <= error - imager.report.predicted_error_db <= 1.0


@pytest.mark.parametrize('options', GEOMETRIES, ids=str)
def test_target_is_met_for_a_scene_that_ends(make_case, options):
    case = make_case(n=128, pulses=128, n_points=40, **options)
    imager = _imager(case.grid, case.block)
    error = _error_db(imager(case.block), exact_image(case.grid, case.block))
    assert error <= imager.report.predicted_error_db <= -50.0


def test_polar_output(case):
    polar = _imager(case.grid, case.block).report.plan.subapertures.polar
    imager = _imager(polar, case.block, target_db=-60.0)
    error = _error_db(imager(case.block), exact_image(_polar_points(polar), case.block))
    assert error <= -60.0 and imager.report.predicted_error_db <= -60.0


def test_polar_output_on_few_lines(case):
    """Lines further apart than the resolution are samples of the same image."""
    polar = _imager(case.grid, case.block).report.plan.subapertures.polar
    few = dataclasses.replace(polar, alpha_spacing=8 * polar.alpha_spacing,
                              n_alpha=polar.n_alpha // 8)
    imager = _imager(few, case.block)
    assert _error_db(imager(case.block), exact_image(_polar_points(few), case.block)) <= -50.0


@pytest.mark.parametrize('length', [4, 8, 16, 50, 128])
def test_any_length_of_subapertures(case, length):
    imager = _imager(case.grid, case.block, pulses_per_subaperture=length)
    assert imager.report.plan.subapertures.n_subapertures == -(-128 // length)
    assert _error_db(imager(case.block), exact_image(case.grid, case.block)) <= -50.0


def test_a_scene_no_wider_than_a_few_coarse_lines(make_case):
    """All of it has to lie where the taper over the guards is one."""
    case = make_case(1e4, n=48, spacing_m=0.15, pulses=512, aperture_m=600.0, n_points=40)
    imager = _imager(case.grid, case.block, pulses_per_subaperture=4)
    sizes = imager.report.plan.subapertures.sampling.sizes
    assert sizes.n_coarse - 2 * sizes.n_guard < 2
    error = _error_db(imager(case.block), exact_image(case.grid, case.block))
    # Measured: -53.4 dB, 1.4 dB worse than predicted; -47 dB with the taper half a line aside.
    assert error <= -52.0 and error <= imager.report.predicted_error_db + 2.0


def test_prefix_gives_the_image_of_its_pulses(case):
    plan, stage, fusion = _stages(case.grid, case.block, pulses_per_subaperture=16)
    for count in (1, 3, 8):
        for number in range(len(fusion.included), count):
            some = stage.plan.sampling.pulses[number]
            fusion.add(number, stage.image(number, case.block.select(some)),
                            stage.plan.sampling.centre[number])
        image = image_of_polar(plan, fusion.polar_image(), cpu)
        prefix = case.block.select(slice(0, 16 * count))
        assert _error_db(image, exact_image(case.grid, prefix)) <= -50.0


def test_a_subaperture_is_replaced_and_removed_without_trace(case):
    plan, stage, _ = _stages(case.grid, case.block, pulses_per_subaperture=32)
    pulses = stage.plan.sampling.pulses
    fusion = SpectrumFusion(plan.subapertures.fusion_grid, keep=True)
    parts = [stage.image(u, case.block.select(p)) for u, p in enumerate(pulses)]
    for number, part in enumerate(parts):
        fusion.add(number, part, stage.plan.sampling.centre[number])
    whole = fusion.polar_image()
    fusion.add(2, 3 * parts[2], stage.plan.sampling.centre[2])
    assert not np.array_equal(fusion.polar_image(), whole)
    fusion.add(2, parts[2], stage.plan.sampling.centre[2])
    np.testing.assert_array_equal(fusion.polar_image(), whole)
    fusion.remove(2)
    assert fusion.included == {0, 1, 3}
    without = np.concatenate([np.arange(128)[p] for u, p in enumerate(stage.plan.sampling.pulses)
                              if u != 2])
    assert _error_db(image_of_polar(plan, fusion.polar_image(), cpu),
                     exact_image(case.grid, case.block.select(without))) <= -50.0


@pytest.mark.parametrize('lines', [1, 4, 16], ids='every {}. line'.format)
def test_a_window_that_slides_leaves_no_trace(case, lines):
    """Bit for bit the spectrum of the window alone, also where bands wrap around and overlap."""
    polar = _imager(case.grid, case.block).report.plan.subapertures.polar
    polar = dataclasses.replace(polar, alpha_spacing=lines * polar.alpha_spacing,
                                n_alpha=polar.n_alpha // lines)
    _, stage, _ = _stages(polar, case.block, pulses_per_subaperture=8)
    parts = [(stage.image(u, case.block.select(p)), stage.plan.sampling.centre[u])
             for u, p in enumerate(stage.plan.sampling.pulses)]
    slides = SpectrumFusion(stage.plan.fusion_grid, keep=True)
    for number, part in enumerate(parts):
        slides.add(number, *part)
        if number >= 5:
            slides.remove(number - 5)
        fresh = SpectrumFusion(stage.plan.fusion_grid, keep=True)
        for i in range(max(0, number - 4), number + 1):
            fresh.add(i, *parts[i])
        np.testing.assert_array_equal(slides.polar_image(), fresh.polar_image())
        assert slides.included == fresh.included


def test_contributions_arrive_in_any_order(case):
    plan, stage, fusion = _stages(case.grid, case.block, pulses_per_subaperture=32)
    for number in (3, 0, 2, 1):
        part = stage.image(number, case.block.select(stage.plan.sampling.pulses[number]))
        # As real and imaginary part or as it comes from a message
        fusion.add(number, part if number % 2 else part[0] + 1j * part[1],
                        stage.plan.sampling.centre[number])
    image = image_of_polar(plan, fusion.take_polar_image(), cpu)
    assert _error_db(image, exact_image(case.grid, case.block)) <= -50.0
    assert not fusion.included


@pytest.mark.parametrize('heading_rad, over', [(0.0, True), (0.2, True), (3.0, True),
                                               (1.6, False), (-1.3, False)])
def test_the_map_lies_over_the_polar_image_where_range_follows_x(make_case, heading_rad, over):
    """Where they are told to be used up; the same bits as in memory of its own."""
    case = make_case(1e3, pulses=64, heading_rad=heading_rad)
    grid = dataclasses.replace(case.grid, n_x=20, n_y=17, spacing_m=1.6)  # coarse: there is room
    plan, stage, fusion = _stages(grid, case.block)
    for number, some in enumerate(stage.plan.sampling.pulses):
        fusion.add(number, stage.image(number, case.block.select(some)),
                        stage.plan.sampling.centre[number])
    whole = fusion.polar_image()
    lines = fusion.take_polar_image()
    expected = image_of_polar(plan, lines, cpu)
    np.testing.assert_array_equal(lines, whole)  # still the caller's
    np.testing.assert_array_equal(image_of_polar(plan, whole, cpu, overwrite=True), expected)
    image = image_of_polar(plan, lines, cpu, overwrite=True)
    np.testing.assert_array_equal(image, expected)
    assert np.shares_memory(image, lines) is over
    np.testing.assert_array_equal(_imager(grid, case.block)(case.block), expected)


def test_subapertures_do_not_reach_across_gaps(case):
    kept = np.r_[0:40, 75:128]
    block = case.block.select(kept)
    imager = _imager(case.grid, block)
    assert any(p.start == 40 for p in imager.report.plan.subapertures.sampling.pulses)
    assert _error_db(imager(block), exact_image(case.grid, block)) <= -50.0


def test_cut_covers_every_pulse_once():
    middles = np.zeros((100, 3))
    middles[:, 1] = np.r_[0:30, 60:130]
    cuts = cut_pulses(pieces_between_gaps(middles), 16)
    assert [i for c in cuts for i in range(c.start, c.stop)] == list(range(100))
    assert all(c.stop - c.start <= 16 for c in cuts) and 30 in [c.start for c in cuts]


def test_a_platform_that_stands_most_of_the_time_leaves_no_gaps():
    """Each step seemed a gap beside so many halts: sub-apertures had single pulses."""
    middles = np.zeros((100, 3))
    middles[:, 1] = np.r_[np.zeros(70), 1:31]
    assert pieces_between_gaps(middles) == [(0, 100)]
    middles[85:, 1] += 30
    assert pieces_between_gaps(middles) == [(0, 85), (85, 100)]


def test_perturbed_track(case):
    rng = np.random.default_rng(0)
    shake = np.cumsum(rng.normal(0, 0.003, (128, 1, 3)), axis=0)
    block = dataclasses.replace(case.block, tx_m=case.block.tx_m + shake,
                                rx_m=case.block.rx_m + shake)
    imager = _imager(case.grid, block)
    assert _error_db(imager(block), exact_image(case.grid, block)) <= -50.0


def test_few_pulses_for_the_scene_are_warned_about(case):
    block = case.block.select(slice(None, None, 4))
    imager = _imager(case.grid, block)
    assert 'ambiguous' in str(imager.report)
    assert 'ambiguous' not in str(_imager(case.grid, case.block).report)
    # The ambiguities are the pulses'; exact backprojection has the same.
    assert _error_db(imager(block), exact_image(case.grid, block)) <= -50.0


def test_profiles_that_end_in_the_guards_are_warned_about(case):
    assert 'profiles end' not in str(_imager(case.grid, case.block).report)
    block, cut = case.block, 50  # samples, of 64 beside the grid
    radar = dataclasses.replace(block.radar, first_sample_delay_s=block.radar.first_sample_delay_s
                                + cut / block.radar.sample_rate_hz)
    short = dataclasses.replace(block, radar=radar, samples=block.samples[..., cut:-cut])
    assert 'profiles end' in str(_imager(case.grid, short).report)


def test_impossible_plans_are_refused(make_case, case):
    around = make_case(20.0, n=128, pulses=64)
    with pytest.raises(ValueError, match='use exact backprojection'):
        _imager(around.grid, around.block)
    with pytest.raises(ValueError, match='target_db=-95'):
        _imager(case.grid, case.block, target_db=-95.0)


@pytest.mark.parametrize('range_m', [25.0, 30.0, 40.0, 60.0])
def test_scenes_wide_for_their_range_are_right_or_refused(make_case, range_m):
    case = make_case(range_m, n=128, pulses=96, aperture_m=6.0, n_points=40)
    try:
        imager = _imager(case.grid, case.block)
    except ValueError as refusal:
        assert 'exact backprojection' in str(refusal)
        assert range_m < 60.0
    else:
        assert _error_db(imager(case.block), exact_image(case.grid, case.block)) <= -50.0


def test_wrong_blocks_and_images_are_named(case):
    plan, stage, fusion = _stages(case.grid, case.block, pulses_per_subaperture=32)
    with pytest.raises(ValueError, match=re.escape('image.shape=(2, 3, 4)')):
        fusion.add(0, np.zeros((2, 3, 4), np.float32), 0.0)
    part = stage.image(0, case.block.select(slice(0, 32)))
    fusion.add(0, part, 0.0)
    for call, message in ((lambda: fusion.add(0, part, 0.0), 'in the image already'),
                          (lambda: fusion.add(1, part, np.nan), 'centre_m=nan'),
                          (lambda: fusion.remove(0), 'not kept'),
                          (lambda: stage.image(-1, case.block), 'number=-1')):
        with pytest.raises(ValueError, match=message):
            call()


@pytest.mark.parametrize('n, n_guard, beta', [(32, 4.0, 3.0), (35, 3.3, 0.7), (44, 6.4, 4.2),
                                              (300, 10.0, 5.0)])
def test_predicted_error_is_that_of_fft_interpolation(n, n_guard, beta):
    frequency = np.random.default_rng(1).uniform(-0.42, 0.42, 200) * n
    factor = 8
    cell, x = np.arange(n), np.arange(8 * n) / factor
    number = cell - n // 2
    spectrum = np.fft.fft(guard_taper(n, n_guard, beta)
                          * np.exp(2j * np.pi / n * np.outer(frequency, cell)))
    fine = np.zeros((len(frequency), n * factor), complex)
    fine[:, number] = spectrum[:, number]
    fine = np.fft.ifft(fine) * factor
    error = np.abs(fine - np.exp(2j * np.pi / n * np.outer(frequency, x))) ** 2
    inside = (x >= n_guard) & (x <= n - n_guard)
    predicted = aliasing_error(n, n_guard, beta, frequency[:, None]).mean()
    assert abs(10 * np.log10(predicted / error[:, inside].mean())) < 1.8  # measured: 0.1 to 1.5 dB
    assert aliasing_error(n, n_guard, beta, [0.51 * n]) == 2.0
