# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Images with illumination against weighted correlation, by every method and pointing."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from benchmarks.support.lit_cases import lit_case
from benchmarks.support.stripmap import Stripmap
from sar_imaging.backends import cpu, reference
from sar_imaging.geometry import MapGrid
from sar_imaging.geometry.illumination import AntennaPattern, Illumination, PatternCut, Pointing
from sar_imaging.imaging.correlation import correlate_profiles
from sar_imaging.imaging.imager import plan_image
from sar_imaging.planning.afbp.subapertures import plan_subapertures
from sar_imaging.planning.costs import DEFAULT, using
from sar_imaging.planning.exact.illumination import LineAmplitudes
from sar_imaging.planning.polar_cover import cover_map
from sar_imaging.quality.verification import measure_error
from sar_imaging.signal import SPEED_OF_LIGHT, PulseBlock, RadarParameters

RANGE_M = 800.0
RADAR = RadarParameters(9.6e9, 150e6, 225e6, 2 * (RANGE_M - 100) / SPEED_OF_LIGHT)
N_SAMPLES = 384
GRID = MapGrid((0.0, RANGE_M, 0.0), 96, 96, 0.5)
PATTERNS = {'narrow': AntennaPattern(PatternCut.sinc(0.04), PatternCut.gaussian(0.2)),
            'wide': AntennaPattern(PatternCut.gaussian(0.3)),
            'flat': AntennaPattern(PatternCut.uniform(0.05, 0.02), PatternCut.cosine(0.3))}


def _block(pointing, n_pulses=256, n_channels=1, length_m=60.0, seed=0):
    """Clutter, as noise in the band of the radar, from a straight track."""
    rng = np.random.default_rng(seed)
    centres = np.zeros((n_pulses, n_channels, 3))
    centres[..., 0] = np.linspace(-length_m / 2, length_m / 2, n_pulses)[:, None]
    centres[..., 2] = 150.0
    rx = centres + [[[0.2 * c, 0.0, 0.0] for c in range(n_channels)]]
    bins = rng.normal(size=(2, n_pulses, n_channels, N_SAMPLES))
    spectrum = bins[0] + 1j * bins[1]
    spectrum[..., np.abs(np.fft.fftfreq(N_SAMPLES)) > 1 / 3] = 0
    samples = np.fft.ifft(spectrum).astype(np.complex64)
    number = np.arange(n_pulses)
    return PulseBlock(RADAR, True, number * 1_000_000, number, samples, centres, rx,
                      pointing=pointing(centres[:, 0], number / n_pulses))


POINTINGS = {
    'beside': lambda c, t: Pointing.beside_track(c, 1, 0.18),
    'squinted': lambda c, t: Pointing.beside_track(c, 1, 0.18, 0.015),
    'steered': lambda c, t: Pointing.steered(c, (3.0, RANGE_M, 0.0)),
    'rotating': lambda c, t: Pointing.rotating(t, 0.05, math.pi / 2 - 0.02, 0.18),
}


def _error_db(image, block, pattern, n=200):
    points = GRID.points().reshape(-1, 3)
    some = np.random.default_rng(1).choice(len(points), n, replace=False)
    expected, covered = correlate_profiles(block, points[some], illumination=pattern)
    assert covered.all()
    wrong = image.samples.ravel()[some] - expected
    return 10 * np.log10((np.abs(wrong) ** 2).sum() / (np.abs(expected) ** 2).sum())


@pytest.mark.parametrize('pointing', POINTINGS)
@pytest.mark.parametrize('method, target_db', [('exact', -60.0), ('afbp', -50.0)])
def test_images_keep_their_prediction(pointing, method, target_db):
    block = _block(POINTINGS[pointing], 192, 2, 40.0)
    for pattern in PATTERNS.values():
        image = plan_image(GRID, RADAR, N_SAMPLES, method=method, target_db=target_db,
                           illumination=pattern)(block)
        report = image.report
        assert report.errors_db['illumination'] < target_db
        assert report.predicted_error_db <= target_db
        # as images of few pixels agree with predictions for large ones
        assert _error_db(image, block, pattern) <= report.predicted_error_db + 2.0
        assert 'illumination' in str(report) and not report.warnings


@settings(max_examples=4)
@given(seed=st.integers(0, 99), width=st.floats(0.03, 0.4), squint=st.floats(-0.02, 0.02),
       target_db=st.sampled_from([-40.0, -60.0]), direct=st.booleans())
def test_subaperture_images_are_those_of_the_formula(seed, width, squint, target_db, direct):
    block = _block(lambda c, t: Pointing.beside_track(c, 1, 0.18, squint), 128, 2, 30.0, seed)
    pattern = AntennaPattern(PatternCut.sinc(width), PatternCut.gaussian(0.3))
    lit = Illumination.of_pulses(pattern, block.pointing, block.tx_m, block.rx_m)
    rows = block.tx_m.reshape(-1, 3), block.rx_m.reshape(-1, 3)
    polar = cover_map(GRID, *rows, RADAR, N_SAMPLES, -50.0, -50.0, fused=True,
                      illumination=lit).polar
    plan = plan_subapertures(polar, RADAR, N_SAMPLES, block.tx_m, block.rx_m,
                             target_db=target_db, illumination=lit)
    if direct and plan.beams is not None:
        plan = dataclasses.replace(plan, beams=None, amplitudes=dataclasses.replace(
            plan.amplitudes, lines=LineAmplitudes(1, 1.0, -90.0)))
    number = len(plan.sampling.pulses) // 2
    some = block.select(plan.sampling.pulses[number])
    found, expected = (b.SubapertureImager(plan).image(number, some) for b in (cpu, reference))
    error = ((found - expected) ** 2).sum() / (expected ** 2).sum()
    # What compiled code approximates beyond the formula is a part of the sub-apertures' error.
    allowed_db = max(plan.errors_db['sub-aperture images'], plan.errors_db['illumination'], -95.0)
    assert 10 * np.log10(error) <= allowed_db + 6.0


def test_channels_of_a_steered_antenna_have_beams_of_their_own():
    """Seen from one place they differ by -54 dB; beams are chosen where adding pulses is dear."""
    block, pattern = _block(POINTINGS['steered'], 192, 2, 40.0), PATTERNS['narrow']
    with using(dataclasses.replace(DEFAULT, line_pixel=50.0)):
        image = plan_image(GRID, RADAR, N_SAMPLES, method='afbp', target_db=-64.0,
                           illumination=pattern)(block)
    plan = image.report.plan.subapertures
    assert plan.beams.n_weighed == 2 and plan.amplitudes.by_channel and not image.report.warnings
    # -67.0 dB, 1.4 below the prediction
    assert _error_db(image, block, pattern) <= image.report.predicted_error_db <= -64.0
    some = block.select(plan.sampling.pulses[0])
    found, expected, together = (b.SubapertureImager(dataclasses.replace(
        plan, beams=dataclasses.replace(plan.beams, n_weighed=n))).image(0, some)
        for b, n in ((cpu, 2), (reference, 2), (cpu, 1)))
    error, mixed = (((other - expected) ** 2).sum() / (expected ** 2).sum()
                    for other in (found, together))
    # -65.6 dB: parabolas between nodes are within the error of the amplitudes, -70.5 dB
    assert 10 * np.log10(error) <= plan.errors_db['illumination'] + 6.0 and mixed > 10 * error


def test_dark_subapertures_take_no_time_and_the_quicker_method_is_found():
    """A strip of which each pulse lights a part: both methods count what is lit."""
    block = _block(POINTINGS['beside'], 512, length_m=240.0)
    pattern = PATTERNS['narrow']
    lit, bare = (plan_image(GRID, RADAR, N_SAMPLES, block.tx_m, block.rx_m, target_db=-50.0,
                            method='afbp', **more).report for more in (
        {'illumination': pattern, 'pointing': block.pointing}, {}))
    plan = lit.plan.subapertures
    assert 0 < len(plan.amplitudes.seen) < plan.n_subapertures and lit.seconds < bare.seconds
    exact = plan_image(GRID, RADAR, N_SAMPLES, block.tx_m, block.rx_m, target_db=-50.0,
                       method='exact', illumination=pattern, pointing=block.pointing)
    assert exact.report.seconds < plan_image(GRID, RADAR, N_SAMPLES, block.tx_m, block.rx_m,
                                             target_db=-50.0, method='exact').report.seconds
    image = plan_image(GRID, RADAR, N_SAMPLES, illumination=pattern, target_db=-50.0,
                       method='afbp')(block)
    assert _error_db(image, block, pattern) <= image.report.predicted_error_db + 2.0


@pytest.mark.parametrize('seed', [
    83048,  # four echoes light a corner of the map
    83068,  # a few light the map, others only what lies beside it
    91072,  # patterns end in the map, at the highest frequencies along direction
    91084,  # eight echoes of a pass whose middle one is dark
])
def test_what_few_echoes_light_keeps_its_prediction(seed):
    """Errors of 17 dB above their predictions and less, found at random."""
    case = lit_case(seed)
    block = case.block
    image = plan_image(case.grid, block.radar, block.n_samples, method='exact',
                       target_db=case.target_db, illumination=case.pattern)(block)
    found = measure_error(image.samples, case.grid, block, n_pixels=600,
                          illumination=case.pattern)
    # 1.3 dB above at most
    assert found.error_db < image.report.predicted_error_db + 2.0 and not image.report.warnings


def test_images_grow_block_by_block():
    block, pattern = _block(POINTINGS['rotating']), PATTERNS['narrow']
    imager = plan_image(GRID, RADAR, N_SAMPLES, method='exact', illumination=pattern)
    image = imager.new_image()
    for start in range(0, block.n_pulses, 64):
        imager.accumulate(block.select(slice(start, start + 64)), image)
    assert _error_db(image, block, pattern) <= -60.0 + 2.0


def test_pulses_that_light_nothing_add_nothing():
    """The beginning of a stripmap, whose profiles do not reach the grid, is no mistake."""
    block, pattern = _block(POINTINGS['beside'], 32), PATTERNS['narrow']
    away = block.tx_m + [5000.0, 0.0, 0.0]
    imager = plan_image(GRID, RADAR, N_SAMPLES, method='exact', illumination=pattern)
    image = imager(dataclasses.replace(block, tx_m=away, rx_m=away))
    assert not image.samples.any() and not image.report.warnings
    imager.accumulate(block, image)
    assert image.samples.any()


def test_wrong_use_is_told():
    block = _block(POINTINGS['beside'], 64)
    imager = plan_image(GRID, RADAR, N_SAMPLES, illumination=PATTERNS['narrow'])
    with pytest.raises(ValueError, match='Pointing.beside_track'):
        imager(dataclasses.replace(block, pointing=None))

    class Bare:
        Backprojection = SubapertureImager = SpectrumFusion = form_map = print

    with pytest.raises(ValueError, match='knows no illumination'):
        plan_image(GRID, RADAR, N_SAMPLES, illumination=PATTERNS['narrow'], backend=Bare())


@pytest.mark.parametrize('length', [12, 16, 24])
def test_few_subapertures_that_light_a_pixel_in_part_keep_their_prediction(length):
    """13 pulses light a pixel of this case: errors were 7 dB above the prediction.

    Of all sub-apertures two hold the power, by chance unlike, and only lit echoes of these count.
    """
    case = lit_case(111008)
    rng = np.random.default_rng([111008, 3])
    pattern = AntennaPattern(case.cut(rng.uniform(0.5, 8.0)))
    image = plan_image(case.grid, case.block.radar, case.block.n_samples, method='afbp',
                       target_db=-60.0, illumination=pattern,
                       pulses_per_subaperture=length)(case.block)
    found = measure_error(image, case.grid, case.block, illumination=pattern)
    assert image.report.warnings == ()
    assert found.error_db <= image.report.predicted_error_db + 3.0


def test_a_spaceborne_stripmap_is_that_of_the_closed_form():
    """30 s of flight, 0.64 s in the beam: azimuth width, peak, and contrast over noise."""
    strip = Stripmap(carrier_hz=1.25e9, bandwidth_hz=1.5e6, repetition_hz=300.0, in_beam_s=0.64,
                     n_samples=160)
    [block] = strip.blocks(strip.n_pulses)
    offset = np.linspace(-40, 40, 161)
    line = np.array(strip.target_m) + offset[:, None] * [1.0, 0.0, 0.0]
    imager = plan_image(line, strip.radar, strip.n_samples, method='exact', target_db=-60.0,
                        illumination=strip.pattern)
    found, expected = np.abs(imager(block).samples), np.abs(strip.response(offset))
    # Of pulses 23 m apart and angles of 4 mrad the sum is the integral to a thousandth or so.
    np.testing.assert_allclose(found, expected, atol=2e-3 * expected.max())
    assert strip.width_m(offset, found) == pytest.approx(strip.width_m(offset, expected), rel=5e-3)
    assert not imager.report.warnings  # dark pairs leave the profiles, lit ones do not

    # Noise: power sum(w^2) = 3/8 n_illuminated with the pattern, n without: the contrast grows by
    # (sum w^2)^2 / sum(w^2) over (sum w)^2 / n, that is 3/2 n / n_illuminated.
    grid = MapGrid(strip.target_m, 64, 32, 25.0)
    [noise] = strip.blocks(strip.n_pulses, noise=1.0, amplitude=0.0)
    [echo] = strip.blocks(strip.n_pulses)
    contrast = []
    for pattern in (strip.pattern, None):
        imager = plan_image(grid, strip.radar, strip.n_samples, method='exact', target_db=-60.0,
                            illumination=pattern)
        power = np.mean(np.abs(imager(noise).samples) ** 2)
        imager = plan_image(line[80:81], strip.radar, strip.n_samples, method='exact',
                            target_db=-60.0, illumination=pattern)
        contrast.append(np.abs(imager(echo).samples[0]) ** 2 / power)
    # Without a pattern the pulses count whose profiles reach the middle of the map.
    first = strip.radar.range_start_m
    last = first + (strip.n_samples - 1) * strip.radar.sample_spacing_m
    path = np.linalg.norm(block.tx_m[:, 0] - strip.target_m, axis=1)
    n_reached = ((first < path) & (path < last)).sum()
    growth = 1.5 * n_reached / (strip.in_beam_s * strip.repetition_hz)
    # of some hundred independent pixels the mean power is known to a few per cent
    assert contrast[0] / contrast[1] == pytest.approx(growth, rel=0.15)
    assert growth > 50
