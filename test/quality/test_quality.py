# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
import json
import math
import pathlib
import re

import numpy as np
import pytest
from scipy import integrate, optimize

from sar_imaging import quality
from sar_imaging.geometry.grids import MapGrid
from sar_imaging.quality.interpolation import interpolate_cut, interpolate_image
from sar_imaging.signal.radar import SPEED_OF_LIGHT

K_C = 4 * math.pi * 10e9 / SPEED_OF_LIGHT


def sinc_power(x):
    return np.sinc(x) ** 2


@pytest.fixture(scope='module')
def sinc_truth():
    """Closed forms of the unweighted sinc, nulls at the integers, window of six nulls."""
    half = optimize.brentq(lambda x: sinc_power(x) - 0.5, 0.1, 0.9)
    side = optimize.minimize_scalar(lambda x: -sinc_power(x), bounds=(1.2, 1.8), method='bounded',
                                    options={'xatol': 1e-10})
    lobe = integrate.quad(sinc_power, 0, 1, epsabs=1e-13)[0]
    rest = integrate.quad(sinc_power, 1, 6, epsabs=1e-13, limit=200)[0]
    return {'irw': 2 * half, 'pslr': 10 * np.log10(-side.fun), 'islr': 10 * np.log10(rest / lobe)}


class TestImpulseResponse:
    # spacing 0.7 of the null distance is 1.43 samples per Nyquist interval
    @pytest.mark.parametrize('spacing', [0.05, 0.31, 0.7])
    @pytest.mark.parametrize('shift', [0.0, 0.013, 0.127])
    def test_unweighted_sinc_equals_the_closed_form(self, sinc_truth, spacing, shift):
        x = np.arange(-12, 12, spacing)
        cut = np.sinc(x - shift) * np.exp(0.7j)
        got = quality.impulse_response(cut, spacing, half_width_m=6.0)
        # the issue asks for 0.05 dB; the interpolation error of -75 dB allows 0.002 dB
        assert got.islr_db == pytest.approx(sinc_truth['islr'], abs=0.002)
        assert got.pslr_db == pytest.approx(sinc_truth['pslr'], abs=0.005)
        assert got.irw_m == pytest.approx(sinc_truth['irw'], rel=3e-4)
        assert got.peak_m == pytest.approx(shift - x[0], abs=1e-3)
        assert got.peak_db == pytest.approx(0.0, abs=0.002)
        # a null is found to half a fine step; its energy is zero there, so ISLR does not care
        np.testing.assert_allclose(got.nulls_m, (-1, 1), atol=spacing / 64 + 1e-3)
        np.testing.assert_allclose(got.window_m, (-6, 6), atol=1e-9)

    def test_textbook_value(self, sinc_truth):
        assert sinc_truth['islr'] == pytest.approx(-10.5, abs=0.05)

    def test_window_that_ends_with_the_cut_needs_no_further_samples(self, sinc_truth):
        x = np.arange(-60, 61) / 10
        got = quality.impulse_response(np.sinc(x).astype(complex), 0.1, half_width_m=6.0)
        assert got.islr_db == pytest.approx(sinc_truth['islr'], abs=0.002)

    def test_amplitude_without_phase(self, sinc_truth):
        x = np.arange(-8, 8, 0.2)
        got = quality.impulse_response(np.abs(np.sinc(x - 0.03)), 0.2, half_width_m=6.0)
        assert got.islr_db == pytest.approx(sinc_truth['islr'], abs=0.002)
        assert got.irw_m == pytest.approx(sinc_truth['irw'], rel=3e-4)

    def test_hamming_weighting_lowers_sidelobes_and_widens_the_lobe(self):
        x = np.arange(-10, 10, 0.25)
        cut = 0.54 * np.sinc(x) + 0.23 * (np.sinc(x - 1) + np.sinc(x + 1))
        got = quality.impulse_response(cut, 0.25, half_width_m=8.0)
        assert got.irw_m == pytest.approx(1.303, abs=0.005)  # Harris 1978, -3 dB width in bins
        assert got.pslr_db == pytest.approx(-42.7, abs=0.15)  # continuous-aperture value

    def test_shorter_cut_shortens_the_window_and_says_so(self):
        x = np.arange(-3, 5.0001, 0.1)
        got = quality.impulse_response(np.sinc(x), 0.1, half_width_m=6.0)
        np.testing.assert_allclose(got.window_m, (-3, 5), atol=1e-3)

    def test_chosen_peak_is_the_near_one_not_the_strong_one(self):
        x = np.arange(0, 40, 0.2)
        cut = np.sinc(x - 10) + 3 * np.sinc(x - 30)
        got = quality.impulse_response(cut, 0.2, half_width_m=4.0, peak_near_m=10.3)
        # the slope of the other's sidelobes, 3 / 20, over the curvature pi^2 / 3 pulls 0.046
        assert got.peak_m == pytest.approx(10.0, abs=0.05)
        assert quality.impulse_response(cut, 0.2).peak_m == pytest.approx(30.0, abs=0.01)

    @pytest.mark.parametrize('cut, reason', [
        (np.sinc(np.arange(-8, 8, 0.2)) + np.sinc(np.arange(-8, 8, 0.2) - 1.6), 'first minimum'),
        (np.sinc(np.arange(0.4, 8, 0.2)), 'end of the cut'),
        (np.sinc(np.arange(-0.6, 8, 0.2)), 'ends before'),
    ])
    def test_overlapping_or_cut_off_responses_are_refused(self, cut, reason):
        with pytest.raises(quality.UnmeasurableError, match=reason):
            quality.impulse_response(cut, 0.2)

    @pytest.mark.parametrize(('depth_db', 'deep'), [(6.05, True), (5.95, False)])
    def test_a_first_minimum_is_deep_from_6_db_on(self, depth_db, deep):
        r = 10 ** (-depth_db / 20)
        cut = (1 + r + (1 - r) * np.cos(np.pi / 4 * np.arange(-10, 10.01, 0.25))) / 2
        if deep:
            got = quality.impulse_response(cut, 0.25)
            assert got.peak_m == pytest.approx(10.0, abs=0.01)
            np.testing.assert_allclose(got.nulls_m, (-4, 4), atol=0.05)
        else:
            with pytest.raises(quality.UnmeasurableError, match='only 5.[89][0-9]* dB below'):
                quality.impulse_response(cut, 0.25)

    @pytest.mark.parametrize('cut', [np.ones((4, 4)), np.ones(3), np.zeros(9),
                                     np.array([1, np.nan, 1, 1])])
    def test_senseless_cuts_are_refused(self, cut):
        with pytest.raises(ValueError, match='cut'):
            quality.impulse_response(cut, 0.1)


class TestInterpolation:
    @pytest.mark.parametrize('cycles', [0.0, 0.1, 0.27, 0.35])
    def test_interior_error_stays_below_minus_75_db(self, cycles):
        at = np.linspace(14, 45, 400)
        got = interpolate_cut(np.exp(2j * np.pi * cycles * np.arange(60)), at)
        assert np.abs(got - np.exp(2j * np.pi * cycles * at)).max() < 10 ** (-75 / 20)

    def test_error_half_a_sample_from_the_edge(self):
        n, at = np.arange(40), np.array([0.5, 38.5])
        for cycles in (0.0, 0.1, 0.3):
            got = interpolate_cut(np.exp(2j * np.pi * cycles * n), at)
            assert np.abs(got - np.exp(2j * np.pi * cycles * at)).max() < 10 ** (-35 / 20)

    def test_image_is_separable(self):
        rows, columns = np.arange(40), np.arange(50)
        image = np.exp(2j * np.pi * (0.2 * rows[:, None] - 0.3 * columns))
        r, c = np.array([15.3, 20.0, 24.5]), np.array([17.25, 30.5, 21.0])
        np.testing.assert_allclose(interpolate_image(image, r, c),
                                   np.exp(2j * np.pi * (0.2 * r - 0.3 * c)), atol=4e-4)

    def test_positions_outside_are_refused(self):
        with pytest.raises(ValueError, match='outside the samples 0 ... 9'):
            interpolate_cut(np.ones(10), [9.5])


def point_response(grid, scatterers, *, centre=(0.0, 0.0, 0.0), aperture_m=60.0, n_pulses=80,
                   bandwidth_hz=300e6, n_frequencies=480, direction=(0.0, 1.0, 0.0)):
    """Exact monostatic image: float64 sum over pulses and frequencies, separable per pulse."""
    centre, direction = np.asarray(centre, float), np.asarray(direction, float)
    along = (np.arange(n_pulses) - (n_pulses - 1) / 2) * aperture_m / n_pulses
    k_step = 4 * np.pi * bandwidth_hz / n_frequencies / SPEED_OF_LIGHT
    image = np.zeros(grid.shape, complex)
    points = grid.points()
    for u in along:
        antenna = centre + u * direction
        pixel = np.linalg.norm(points - antenna, axis=-1)
        for position, amplitude in scatterers:
            d = pixel - np.linalg.norm(np.asarray(position, float) - antenna)
            # the sum of exp(j n k d) over the n_frequencies centred steps
            kernel = np.divide(np.sin(n_frequencies * k_step * d / 2), np.sin(k_step * d / 2),
                               out=np.full(d.shape, float(n_frequencies)), where=d != 0)
            image += amplitude * kernel * np.exp(1j * K_C * d)
    return image


# Rosenberg & Gray, table 1, as one channel: 10 GHz, 300 MHz, 10 km, nulls 0.5 m and 2.5 m apart
PAPER = {'aperture_centre_m': (0.0, 0.0, 0.0), 'wavenumber_rad_per_m': K_C,
         'cut_half_width_range_m': 3.0, 'cut_half_width_azimuth_m': 15.0}


@pytest.fixture(scope='module')
def grid():
    return MapGrid.from_size((10_000.0, 0.0, 0.0), 7.0, 34.0, 0.125)


class TestMeasureScatterer:
    def test_paper_geometry(self, grid, sinc_truth):
        truth = (10_000.031, 0.27, 0.0)  # between the pixels
        image = point_response(grid, [(truth, 2 - 1j)])
        got = quality.measure_scatterer(image.astype(np.complex64), grid, truth, name='a',
                                        **PAPER)
        null_range = SPEED_OF_LIGHT / 2 / 300e6
        null_azimuth = 2 * np.pi / K_C * 10_000 / 60.0
        assert got.reason == ''
        assert abs(got.position_error_range_m) < 0.125 / 50
        assert abs(got.position_error_azimuth_m) < 0.125 / 10  # azimuth nulls are 20 pixels apart
        assert got.irw_range_m == pytest.approx(sinc_truth['irw'] * null_range, rel=2e-3)
        assert got.irw_azimuth_m == pytest.approx(sinc_truth['irw'] * null_azimuth, rel=2e-3)
        # the windows are 6.00 nulls; 80 pulses make a periodic sinc and the response bends by
        # 0.01 m over the azimuth window, which moves the ratios by some 0.01 dB
        assert got.islr_range_db == pytest.approx(sinc_truth['islr'], abs=0.03)
        assert got.islr_azimuth_db == pytest.approx(sinc_truth['islr'], abs=0.03)
        assert got.pslr_range_db == pytest.approx(sinc_truth['pslr'], abs=0.03)
        assert got.pslr_azimuth_db == pytest.approx(sinc_truth['pslr'], abs=0.03)
        np.testing.assert_allclose(got.window_range_m, (-3, 3), atol=1e-6)
        np.testing.assert_allclose(got.window_azimuth_m, (-15, 15), atol=1e-6)
        assert got.peak_amplitude == pytest.approx(math.sqrt(5) * 80 * 480, rel=1e-3)

    def test_signs_of_the_position_error(self, grid):
        image = point_response(grid, [((10_000.1, -0.4, 0.0), 1.0)])
        got = quality.measure_scatterer(image, grid, (10_000.0, 0.0, 0.0), **PAPER)
        assert got.position_error_range_m == pytest.approx(0.1, abs=0.0025)
        assert got.position_error_azimuth_m == pytest.approx(-0.4, abs=0.0125)

    @pytest.mark.parametrize('plane_z_m', [0.0, 35.0, -120.0])
    def test_layover_keeps_distance_and_direction(self, plane_z_m):
        position, centre = np.array([410.0, -220.0, 60.0]), np.array([-900.0, 300.0, 850.0])
        shown = np.array([*quality.project_on_plane(position, centre, plane_z_m), plane_z_m])
        assert np.linalg.norm(shown - centre) == pytest.approx(
            np.linalg.norm(position - centre), rel=1e-12)
        across, along = (position - centre)[:2], (shown - centre)[:2]
        assert across @ along == pytest.approx(np.hypot(*across) * np.hypot(*along), rel=1e-12)

    def test_oblique_look_from_above_and_layover(self, sinc_truth):
        """Range 57 degrees off the axes, 45 degrees down, the scatterer 2 m above the plane."""
        centre = np.array([-3_000.0, -5_000.0, 6_000.0])
        truth = np.array([1.03, -2.06, 2.0])
        grid = MapGrid.from_size((0.0, 0.0, 0.0), 24.0, 24.0, 0.125)
        horizontal = (truth - centre)[:2] / np.hypot(*(truth - centre)[:2])
        direction = (-horizontal[1], horizontal[0], 0.0)
        image = point_response(grid, [(truth, 1.0)], centre=centre, direction=direction,
                               aperture_m=100.0)
        got = quality.measure_scatterer(
            image, grid, truth, aperture_centre_m=centre, wavenumber_rad_per_m=K_C,
            cut_half_width_range_m=4.0, cut_half_width_azimuth_m=7.0)
        slant = np.linalg.norm(truth - centre)
        # on the plane the range null spacing is stretched by the cosine of the grazing angle
        cosine = np.hypot(*(truth - centre)[:2]) / slant
        assert got.irw_range_m == pytest.approx(
            sinc_truth['irw'] * SPEED_OF_LIGHT / 2 / 300e6 / cosine, rel=5e-3)
        assert got.irw_azimuth_m == pytest.approx(
            sinc_truth['irw'] * 2 * np.pi / K_C * slant / 100.0, rel=5e-3)
        assert abs(got.position_error_range_m) < 0.01
        assert abs(got.position_error_azimuth_m) < 0.02

    def test_grid_smaller_than_the_window_shortens_it(self):
        grid = MapGrid.from_size((10_000.0, 0.0, 0.0), 4.0, 20.0, 0.125)
        image = point_response(grid, [((10_000.0, 0.0, 0.0), 1.0)])
        got = quality.measure_scatterer(image, grid, (10_000.0, 0.0, 0.0), **PAPER)
        # within a point of the cut, an eighth of a pixel
        np.testing.assert_allclose(got.window_range_m, (-2, 2), atol=0.02)
        np.testing.assert_allclose(got.window_azimuth_m, (-10, 10), atol=0.02)
        assert got.reason == ''

    def test_neighbour_in_the_window_leaves_the_sidelobes_out(self, grid):
        truths = [(9_999.0, 0.0, 0.0), (10_001.0, 0.0, 0.0)]
        image = point_response(grid, [(t, 1.0) for t in truths])
        got = quality.measure_scatterer(image, grid, truths[0], neighbours_m=truths[1:], **PAPER)
        assert 'range: another scatterer stands in the sidelobe window' in got.reason
        assert math.isnan(got.islr_range_db) and math.isnan(got.pslr_range_db)
        assert got.irw_range_m == pytest.approx(0.443, rel=0.03)
        assert math.isfinite(got.islr_azimuth_db)

    def test_overlapping_neighbours_give_no_range_figures(self, grid):
        truths = [(10_000.0, 0.0, 0.0), (10_000.8, 0.0, 0.0)]  # 1.6 nulls apart, in phase
        image = point_response(grid, [(truths[0], 1.0), (truths[1], np.exp(0.8j * K_C))])
        got = quality.measure_scatterer(image, grid, truths[0], neighbours_m=truths[1:], **PAPER)
        assert math.isnan(got.irw_range_m)
        assert 'range: the first minimum is only' in got.reason

    def test_strong_neighbour_is_not_taken_for_the_scatterer(self, grid):
        # Inside the ellipse of 1 m by 5 m that is searched: 0.55 and 0.8 of its radii.
        truths = [(9_999.9, 0.0, 0.0), (10_000.45, 4.0, 0.0)]
        image = point_response(grid, list(zip(truths, (1.0, 3.0), strict=True)))
        got = quality.measure_scatterer(image, grid, truths[0], **PAPER)
        assert got.position_error_azimuth_m == pytest.approx(4.0, abs=0.01)  # taken, unknown
        got = quality.measure_scatterer(image, grid, truths[0], neighbours_m=truths[1:], **PAPER)
        # Sidelobes of the neighbour, 9.5 dB stronger, pull the peak by less than a sixth of a
        # pixel: 2 and 20 mm measured.
        assert abs(got.position_error_range_m) < 0.01
        assert abs(got.position_error_azimuth_m) < 0.04
        assert got.peak_amplitude == pytest.approx(80 * 480, rel=0.05)

    @pytest.mark.parametrize('offset', [(0.9, 0.0), (0.0, -4.5), (0.7, 3.1), (1.3, 0.0),
                                        (0.0, 5.5), (-1.0, 3.9)])
    def test_the_search_reaches_a_third_of_the_windows(self, grid, offset):
        image = point_response(grid, [((10_000.0 + offset[0], offset[1], 0.0), 1.0)])
        got = quality.measure_scatterer(image, grid, (10_000.0, 0.0, 0.0), **PAPER)
        inside = np.hypot(offset[0] / 1.0, offset[1] / 5.0) < 1
        error = got.position_error_range_m, got.position_error_azimuth_m
        assert np.allclose(error, offset, atol=0.02) == inside, got.reason

    @pytest.mark.parametrize('truth, reason', [
        ((10_000.0, 99.0, 0.0), 'outside the image'),
        ((10_001.0, 0.0, 0.0), 'no local maximum'),
    ])
    def test_missing_scatterers_have_a_reason_and_null_in_json(self, grid, truth, reason):
        x = grid.x_m - 10_000.0
        image = np.exp(1j * K_C * np.hypot(grid.x_m, grid.y_m[:, None])) * np.exp(x)
        got = quality.measure_scatterer(image, grid, truth, **PAPER)
        fields = json.loads(json.dumps(got.as_json(), allow_nan=False))
        assert reason in fields['reason']
        assert fields['irw_range_m'] is None and fields['window_range_m'] == [None, None]

    def test_sample_image_reproduces_the_pixels_and_the_function_between(self, grid):
        truth = (10_000.0, 0.0, 0.0)
        image = point_response(grid, [(truth, 1.0)])
        points = np.array([[10_000.0, 0.0], [10_000.21, -3.3], [9_998.77, 2.06]])
        got = quality.sample_image(image, grid, points, aperture_centre_m=(0, 0, 0),
                                   wavenumber_rad_per_m=K_C)
        for value, point in zip(got, points, strict=True):
            spot = MapGrid((*point, 0.0), 1, 1, 0.1)
            exact = quality.to_baseband(point_response(spot, [(truth, 1.0)]), spot, (0, 0, 0),
                                        K_C)[0, 0]
            assert abs(value - exact) < 2e-4 * 80 * 480  # -75 dB of the peak

    def test_image_of_another_shape_is_refused(self, grid):
        with pytest.raises(ValueError, match='does not match grid.shape'):
            quality.to_baseband(np.ones((3, 3)), grid, (0, 0, 0), K_C)


class TestMeasures:
    def test_distortion_of_a_scaled_image(self):
        reference = np.exp(1j * np.arange(12.0)).reshape(3, 4)
        image = 1.1 * reference
        assert quality.error_db(image, reference) == pytest.approx(-20.0)
        assert quality.signal_to_distortion_db(image, reference) == pytest.approx(20.0)
        assert quality.mean_square_error(image, reference) == pytest.approx(0.01)

    def test_single_precision_images_lose_nothing(self):
        reference = np.full((500, 500), 1e4, np.complex64)
        image = reference * np.complex64(1 + 2 ** -20)
        assert quality.error_db(image, reference) == pytest.approx(20 * math.log10(2 ** -20),
                                                                   abs=0.3)  # one float32 rounding

    def test_equal_images(self):
        assert quality.error_db(np.ones(4), np.ones(4)) == -math.inf

    def test_entropy_and_contrast_closed_forms(self):
        one = np.zeros((8, 8), complex)
        one[3, 4] = 2j
        assert quality.entropy(one) == 0.0
        assert quality.contrast(one) == pytest.approx(math.sqrt(63))
        assert quality.entropy(np.full((8, 8), 3.0)) == pytest.approx(math.log(64))
        assert quality.contrast(np.full((8, 8), 3.0)) == pytest.approx(0.0, abs=1e-12)

    def test_contrast_of_speckle_is_one(self):
        rng = np.random.default_rng(1)
        speckle = rng.standard_normal((300, 300)) + 1j * rng.standard_normal((300, 300))
        # 90 000 samples: the estimate's standard deviation is about 0.005
        assert quality.contrast(speckle) == pytest.approx(1.0, abs=0.03)

    @pytest.mark.parametrize('call, reason', [
        (lambda: quality.error_db(np.ones(3), np.ones(4)), 'does not match'),
        (lambda: quality.error_db(np.ones(3), np.zeros(3)), 'reference is zero'),
        (lambda: quality.entropy(np.zeros(3)), 'zero everywhere'),
    ])
    def test_undefined_measures_are_refused(self, call, reason):
        with pytest.raises(ValueError, match=reason):
            call()


def test_example_of_the_documentation(capsys):
    page = pathlib.Path(__file__).parents[2] / 'docs' / 'evaluate.md'
    [code] = re.findall(r'^```python\n(.*?)^```', page.read_text(), re.DOTALL | re.MULTILINE)
    exec(code, {})
    assert capsys.readouterr().out == 'ISLR -10.50 dB in range, -10.53 dB in azimuth\n'
