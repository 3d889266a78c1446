# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Predicted errors on random radars, tracks and maps; `make prediction-campaign` has thousands."""

import dataclasses
import logging

import numpy as np
import pytest

from benchmarks.prediction_campaign import campaign_case, exceeds, measure
from benchmarks.support.random_cases import TRACKS, random_case
from sar_imaging.geometry import MapGrid
from sar_imaging.imaging.correlation import correlate, correlate_profiles
from sar_imaging.imaging.imager import plan_image
from sar_imaging.planning.costs import DEFAULT, using
from sar_imaging.quality.verification import measure_error
from sar_imaging.signal.pulses import PulseBlock
from sar_imaging.signal.spectra import band_spectrum
from sar_imaging.streaming.aperture import ApertureImager
from sar_imaging.streaming.fusion import LiveFusion
from sar_imaging.streaming.subapertures import LiveSubapertures

SEEDS = (1, 2, 3)
# Of an image above its prediction: an image of few scatterers has an error of its own, the
# campaign found 3 dB to hold in all cases.
ALLOWED_DB = 3.0


def _error_db(case, image, pulses=slice(None), n_pixels=100):
    return measure_error(image * np.float32(case.scale), case.grid, case.pulses.select(pulses),
                         n_pixels=n_pixels, n_brightest=60).error_db


def _exact(case):
    image = plan_image(case.grid, case.profiles.radar, case.profiles.n_samples, method='exact',
                       target_db=-80.0)(case.profiles)
    return image.report, image.samples


def _afbp(case, target_db=-60.0):
    p = case.pulses
    image = plan_image(case.grid, p.radar, p.n_samples, p.tx_m, p.rx_m, method='afbp',
                       target_db=target_db, compressed=p.compressed)(p)
    return image.report, image.samples


def _names_a_reason(warnings):
    return any('ambiguous' not in warning for warning in warnings)


# ------------------------------------------------------------------------------ any geometry

@pytest.mark.parametrize('method, seed, least_db', [
    ('zero-padding', 3365043, 40.0), ('zero-padding', 3365135, 30.0),
    ('wavenumber', 3365082, 30.0)])
def test_published_methods_keep_their_prediction(method, seed, least_db):
    """Their plans know nothing of what lies at the ends of profiles, nor beyond the band."""
    found = measure(campaign_case(seed), method)
    assert 'error_db' in found and not exceeds(found)
    assert found['error_db'] > found['planned_db'] + least_db


@pytest.mark.parametrize('seed', [3360109, 3360175, 3360297])
def test_images_of_few_cells_keep_their_prediction(seed):
    """They were 7 to 12 dB above it: two of FFBP in dark surroundings, and a volume by chance."""
    found = measure(campaign_case(seed), 'few cells')
    assert 'error_db' in found and not exceeds(found)


@pytest.mark.parametrize('seed', SEEDS)
@pytest.mark.parametrize('track', TRACKS)
def test_no_image_is_above_its_prediction(track, seed):
    case = random_case(seed, track)
    report, image = _exact(case)
    assert _names_a_reason(report.warnings) or (
        _error_db(case, image) <= report.predicted_error_db + ALLOWED_DB)
    try:
        report, image = _afbp(case)
    except ValueError as refusal:
        assert 'exact backprojection' in str(refusal)
    else:
        assert _names_a_reason(report.warnings) or (
            _error_db(case, image) <= report.predicted_error_db + ALLOWED_DB)


def test_few_echoes_hold_the_error_where_pulses_are_far_apart():
    """Of passes of eight echoes some have one two pulses, 240 m, from their middle.

    A third of the echoes was not looked at, all of these among them: 5 dB above the prediction.
    """
    case = random_case(3350754)
    report, image = _afbp(case, -45.22)
    assert _error_db(case, image) <= report.predicted_error_db + ALLOWED_DB


@pytest.mark.parametrize('seed', [
    890055, 890842, 891472, 900433, 900417, 901177, 901337, 912214, 912738, 920324, 912972,
    930730])
def test_images_that_erred_more_than_predicted_no_longer_do(seed):
    """By 3 to 19 dB: long segments and parts, steep tracks, platforms that stand still.

    Then three by lines: echoes from one place, scatterers at the ends of segments, and 77
    cycles of the carrier from one position of the profiles to the next. The last two by groups
    of a spiral, whose images are chirps from line to line of a part.
    """
    case = random_case(seed)
    report, image = _exact(case)
    assert _error_db(case, image) <= report.predicted_error_db + ALLOWED_DB


def test_profiles_that_end_near_the_pixels_are_told():
    """Two samples beyond two corners of the map: of 500 pixels none lay there, 3.6 dB above."""
    report, image = _exact(case := random_case(912803))
    (warning,) = report.warnings
    assert 'profiles end so near the pixels' in warning
    # measured: 7 dB below; scatterers lie in the middle of the map
    assert _error_db(case, image) <= report.predicted_error_db


def test_bands_grow_with_the_frequency_along_range():
    """Up to 1.38 times as wide as at the carrier, over a steep track: 9 dB above."""
    report, image = _afbp(case := random_case(890881), target_db=-60.0)
    assert _error_db(case, image) <= report.predicted_error_db


def test_middles_of_near_scenes_err_by_what_their_edges_do():
    """Frequencies at the guards are higher by a sixth than in the middle: 4.5 dB above."""
    report, image = _afbp(case := random_case(942299), target_db=-62.2)
    assert _error_db(case, image) <= report.predicted_error_db


def test_tapers_that_reach_the_last_bin_along_range_keep_it():
    """A band that fills 91 % of 80 ranges lost one bin of its spectrum: 3.6 dB above."""
    report, image = _afbp(case := random_case(1010262), target_db=-67.1)
    # measured: 3.0 dB below
    assert _error_db(case, image) <= report.predicted_error_db


@pytest.mark.parametrize('seed', [936007, 936012, 936029, 936035])
def test_wide_steep_and_uneven_apertures_have_images(seed):
    """Phases of neighbouring echoes differ by radians over a segment: fewer share a pass."""
    report, image = _afbp(case := random_case(seed))
    assert report.plan.subapertures.resampling.echoes_per_pass < 32
    # measured: 1.7 to 4.3 dB below
    assert _error_db(case, image) <= report.predicted_error_db


def test_an_aperture_that_takes_far_longer_than_exact_backprojection_is_refused():
    """Over 120 degrees of a scene of few pixels a sub-aperture image has thousands of ranges."""
    def wide(rng, u, length, centre):
        return centre + np.outer(u * 3.5 * np.linalg.norm(centre), [0, 1, 0])

    with pytest.raises(ValueError, match='times as long as exact backprojection point by point'):
        _afbp(random_case(961003, wide))


def test_noise_comes_from_all_echoes_alike():
    """Stronger than an accelerating radar's echoes, of which most see the scene alike: 5.8 dB."""
    case = campaign_case(2800130)
    p = case.pulses
    image = plan_image(case.grid, p.radar, p.n_samples, method='exact', target_db=-45.0,
                       compressed=False)(p)
    assert _error_db(case, image.samples) <= image.report.predicted_error_db + ALLOWED_DB


def test_predictions_of_the_exact_imager_are_tight():
    """Bounded from both sides: what an image loses to a wrong term shows."""
    above = []
    for track in TRACKS:
        case = random_case(1, track)
        report, image = _exact(case)
        above.append(_error_db(case, image, n_pixels=1000) - report.predicted_error_db)
    # Measured: -5.0 to -0.1, median -3.5 (100 pixels tell each within 2 dB alone). Before phases
    # were kept in float64 until their fraction of a cycle, images erred by 0.7 dB more.
    assert -6.0 <= min(above) and -4.0 <= np.median(above) <= -1.0


@pytest.mark.parametrize('seed', [427, 735, 842, 1000, 1019])
def test_rows_that_slant_across_the_ranges_end_as_well_as_they_begin(seed):
    """Corners were up to -33 dB off: the polar image ended before what their rows read."""
    case = random_case(seed)
    with using(dataclasses.replace(DEFAULT, line_pixel=1e6, point_pixel=1e5)):
        report, image = _exact(case)
    assert report.plan.method == 'groups'
    for corner in np.ndindex(2, 2):
        some = tuple(slice(0, 6) if end == 0 else slice(-6, None) for end in corner)
        points = case.grid.points()[some].reshape(-1, 3)
        reference, covered = correlate_profiles(case.pulses, points)
        assert covered.all()
        error = (np.mean(np.abs(image[some].ravel() - reference) ** 2)
                 / np.mean(np.abs(image) ** 2))
        # Measured: 3 dB above to 6 dB below the prediction; 36 pixels are few
        assert 10 * np.log10(error) <= report.predicted_error_db + 6.0


@pytest.mark.parametrize('seed', [1118, 1959])
def test_few_lines_are_corrected_as_well_as_predicted(seed):
    """On 36 and 48 lines corrections mixed tapered lines in: 4.5 and 3 dB above."""
    case = random_case(seed)
    report, image = _afbp(case, -49.0)
    # Measured: 0.6 dB above to 1.9 dB below
    assert _error_db(case, image) <= report.predicted_error_db + 2.0


@pytest.mark.parametrize(('options', 'target_db'), [
    ({'range_m': 60.0, 'height_m': 30.0}, -90.0), ({'range_m': 40.0, 'spacing_m': 0.1}, -80.0),
    ({'range_m': 60.0}, -80.0)], ids=str)
def test_near_images_err_as_predicted(make_case, options, target_db):
    """The third derivative of the path, a third wrong, costs 4 to 12 dB here."""
    case = make_case(**options)
    image = plan_image(case.grid, case.block.radar, case.block.n_samples, method='exact',
                       target_db=target_db)(case.block)
    report = image.report
    points = case.grid.points()[::2, ::2]
    reference = correlate(*band_spectrum(case.block), case.block.tx_m, case.block.rx_m, points)
    error = 10 * np.log10(np.sum(np.abs(image.samples[::2, ::2] - reference) ** 2)
                          / np.sum(np.abs(reference) ** 2))
    assert report.predicted_error_db <= target_db
    # Measured: 0.9 to 3.6 dB better than predicted
    assert -5.0 <= error - report.predicted_error_db <= 1.0


def test_a_halt_that_sees_little_is_not_counted_on():
    """The halt of 26 pulses is 8 dB fainter than the others: the error was 4.1 dB more."""
    report, image = _afbp(case := random_case(83043), target_db=-69.5)
    # measured: 2.6 dB below
    assert _error_db(case, image) <= report.predicted_error_db


def test_the_widest_of_uneven_subapertures_counts():
    """Between those looked at lay one several times as wide: the error was 5.4 dB more."""
    def hurry(rng, u, length, centre):
        along = np.append(0.0, np.cumsum(np.abs(np.sin(7 * u)) ** 6)[:-1])
        return centre + np.outer((along / along[-1] - 0.5) * length, [0.0, 1.0, 0.0])

    case = random_case(35, hurry)
    report, image = _afbp(case)
    assert _error_db(case, image) <= report.predicted_error_db


def test_profiles_that_begin_in_the_guards_fade_there():
    """Cut off at their first sample they made the error 6.2 dB more than predicted."""
    case = random_case(102016)
    p = case.profiles
    image = plan_image(case.grid, p.radar, p.n_samples, p.tx_m, p.rx_m, method='afbp',
                       target_db=-69.2)(p)
    assert not _names_a_reason(image.report.warnings)
    error = measure_error(image.samples, case.grid, p, n_pixels=100, n_brightest=60)
    # measured: 2.5 dB below
    assert error.error_db <= image.report.predicted_error_db


# --------------------------------------------------------------------------------- live AFBP

@dataclasses.dataclass(frozen=True)
class _Imaged:
    grid: MapGrid
    profiles: PulseBlock


def _live(case, n_pulses, length, **options):
    fusion = LiveFusion()
    stage = LiveSubapertures(case.grid, pulses_per_aperture=length, **options)
    block = case.profiles.select(slice(0, n_pulses))
    parts = [s for first in range(0, n_pulses, 16)
             for s in stage.add(block.select(slice(first, first + 16)))] + stage.flush()
    return [image for part in parts for image in fusion.add(part)] + fusion.flush(), parts, stage


@pytest.mark.parametrize('track', ['climbing', 'stopping', 'back and forth'])
def test_no_live_image_is_above_its_prediction(track):
    case = random_case(1, track)
    n = case.profiles.n_pulses
    images, _, stage = _live(case, n, n, target_db=-50.0)
    if not images:
        assert 'cannot be imaged' in stage.take_events()[-1].text
        return
    assert images[-1].n_missing == 0
    assert _error_db(case, images[-1].image) <= images[-1].predicted_error_db + ALLOWED_DB


def test_bright_surroundings_raise_the_prediction_of_live_images(make_case):
    """What is 30 dB brighter beyond the near edge goes through the tapers into the map."""
    case = make_case(1e3, pulses=96, aperture_m=60.0)
    block, rng = case.block, np.random.default_rng(1)
    ranges = block.radar.range_start_m + np.arange(block.n_samples) * block.radar.sample_spacing_m
    near = np.linalg.norm(case.grid.points() - block.tx_m[:, :1, None], axis=-1).min()
    predicted = []
    for brighter in (1.0, 30.0):
        spectrum = rng.normal(size=block.samples.shape) + 1j * rng.normal(size=block.samples.shape)
        samples = np.fft.ifft(spectrum * (np.abs(np.fft.fftfreq(block.n_samples)) <= 3 / 8))
        samples *= np.where(ranges < near - 6.0, brighter, 1.0)
        noise = dataclasses.replace(block, samples=samples.astype(np.complex64))
        images, _, _ = _live(_Imaged(case.grid, noise), 96, 96, target_db=-50.0)
        reference, _ = correlate_profiles(noise, case.grid.points()[::3, ::3].reshape(-1, 3))
        error = np.linalg.norm(images[-1].image[::3, ::3].ravel() - reference)
        predicted.append(images[-1].predicted_error_db)
        assert (20 * np.log10(error / np.linalg.norm(reference)) <= predicted[-1] + ALLOWED_DB)
    assert predicted[1] >= predicted[0] + 10.0


def test_windows_of_a_track_that_turns_back_are_as_good_as_predicted():
    """The widest window decides how fine the polar grid is: -17 dB where -51 were predicted."""
    case = random_case(3016)
    n = case.profiles.n_pulses // 2 * 2
    images, parts, _ = _live(case, n, n // 2, target_db=-41.0, sliding=True)
    assert len(images) >= 2 and all(image.n_pulses == n // 2 for image in images)
    first, last = images[0], images[-1]
    for image, pulses in ((first, slice(0, n // 2)), (last, slice(n // 2, n))):
        assert _error_db(case, image.image, pulses) <= image.predicted_error_db + ALLOWED_DB
    for sequence in {part.sequence for part in parts}:  # no pulse twice, none left out
        own = sorted((p.first_counter, p.n_pulses) for p in parts if p.sequence == sequence)
        assert all(a + length == b for (a, length), (b, _) in zip(own, own[1:], strict=False))


def _check_last_window(seed, target_db):
    """The last half of a wide case's pulses, as a window that slides, errs as predicted."""
    case = random_case(seed, family='wide')
    n = case.profiles.n_pulses // 2 * 2
    images, _, _ = _live(case, n, n // 2, target_db=target_db, sliding=True)
    assert images[-1].n_missing == 0
    assert _error_db(case, images[-1].image, slice(n // 2, n)) <= images[-1].predicted_error_db


def test_windows_of_a_wide_aperture_are_read_where_their_bands_lie():
    """Bands were taken for 1.5 times as far apart as they lie: -3 dB where -67 were predicted."""
    _check_last_window(1012112, target_db=-57.7)  # measured: 0.9 dB below


def test_maps_seen_at_45_degrees_are_covered_along_the_axis_that_they_are_read_along():
    """The middle of an uneven track saw another axis than the origin of the polar grid."""
    _check_last_window(1010432, target_db=-42.7)  # measured: 3.9 dB below


def test_a_window_is_read_by_the_ends_of_its_track():
    """Of a track that turns back they are neither the first pulse nor the last: 22 dB above."""
    case = campaign_case(2901040)
    images, _, _ = _live(case, 56, 28, target_db=-62.7, sliding=True)
    last = images[-1]  # measured: 4.0 dB below
    assert _error_db(case, last.image, slice(28, 56)) <= last.predicted_error_db + 1.0


def test_a_window_errs_as_its_newest_sub_aperture_tells():
    """It stood still and moves again; the window before was read 4 dB better, and counted."""
    case = random_case(1810176, family='far')
    images, _, _ = _live(case, 46, 23, target_db=-60.2, sliding=True)
    last = images[-1]  # measured: 0.1 dB above what is predicted, 3.2 dB above the mean
    assert _error_db(case, last.image, slice(23, 46)) <= last.predicted_error_db + 1.0


# --------------------------------------------------------------- ranges that leave the profiles

@pytest.fixture(name='short', scope='module')
def short_fixture(make_case):
    """A grid whose near sixth and far sixth lie beyond the profiles for some pulses."""
    case = make_case(1e3, n=96, pulses=96, aperture_m=60.0)
    return dataclasses.replace(case, grid=MapGrid(case.grid.centre_m, 280, 64, 0.25))


def _outside(case, margin=0):
    """(n_y, n_x) share of the pulses whose ranges are not so many samples within the profiles."""
    block, points = case.block, case.grid.points()
    place = [(np.linalg.norm(points - tx, axis=-1) - block.radar.range_start_m)
             / block.radar.sample_spacing_m for tx in block.tx_m[:, 0]]
    return np.mean([(v < margin) | (v > block.n_samples - 1 - margin) for v in place], axis=0)


def test_backprojector_says_which_share_leaves_the_profiles(short, caplog):
    block, outside = short.block, _outside(short)
    imager = plan_image(short.grid, block.radar, block.n_samples, method='exact', target_db=-80.0)
    with caplog.at_level(logging.WARNING):
        image = imager(block).samples
    report = imager.report
    (warning,) = report.warnings
    assert warning in caplog.text
    told = [float(word) for word, unit in zip(warning.split(), warning.split()[1:], strict=False)
            if unit == '%']
    # 24 x 24 pixels and all pulses are looked at
    assert told == pytest.approx([100 * (outside > 0).mean(), 100 * outside.mean()], abs=4.0)
    reference = correlate(*band_spectrum(block), block.tx_m, block.rx_m,
                          short.grid.points()[::4, ::4])
    n_end = next(int(word) for word, unit in zip(
        warning.split(), warning.split()[1:], strict=False) if unit == 'samples')
    inside = _outside(short, n_end)[::4, ::4] == 0  # for these the prediction holds
    error = np.sum(np.abs(image[::4, ::4] - reference)[inside] ** 2)
    error_db = 10 * np.log10(error / np.sum(np.abs(reference[inside]) ** 2))
    assert error_db <= report.predicted_error_db <= -75.0
    within = plan_image(MapGrid(short.grid.centre_m, 64, 64, 0.25), block.radar, block.n_samples,
                        method='exact', target_db=-80.0)
    report = within(block).report
    assert report.warnings == () and report.predicted_error_db <= -80.0


def test_other_imagers_say_so_too(short):
    block = short.block
    arguments = short.grid, block.radar, block.n_samples, block.tx_m, block.rx_m
    for method in ('afbp', 'ffbp'):
        report = plan_image(*arguments, method=method, target_db=-50.0).report
        assert any('leave the profiles' in warning for warning in report.warnings)
        assert report.predicted_error_db <= -45.0  # of the pixels within the profiles
    points = plan_image(short.grid.points(), *arguments[1:], method='exact').report
    assert 'leave the profiles' in points.warnings[0] and points.predicted_error_db <= -55.0
    for stage in (LiveSubapertures(short.grid, pulses_per_aperture=96),
                  ApertureImager(short.grid, pulses_per_aperture=96)):
        stage.add(block)
        stage.flush()
        assert any('leave the profiles' in event.text for event in stage.take_events())


@pytest.mark.parametrize('method', ['exact', 'afbp'])
def test_no_error_is_predicted_where_no_pixel_lies_within_all_profiles(short, method):
    block = short.block
    near = MapGrid((block.radar.range_start_m, 0.0, 0.0), 16, 128, 0.5)
    imager = plan_image(near, block.radar, block.n_samples, method=method, target_db=-50.0)
    report = imager(block).report
    assert report.predicted_error_db is None and 'error not predicted' in str(report)
    assert any('leave the profiles' in warning for warning in report.warnings)
    stage = ApertureImager(near, pulses_per_aperture=96, method=method)
    (live,) = stage.add(block) + stage.flush()
    assert live.predicted_error_db is None
