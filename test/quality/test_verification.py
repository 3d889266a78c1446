# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from sar_imaging.geometry import MapGrid
from sar_imaging.geometry.polar import PolarGrid
from sar_imaging.imaging.correlation import correlate
from sar_imaging.imaging.imager import plan_image
from sar_imaging.quality.verification import measure_error
from sar_imaging.signal.spectra import band_spectrum

POLAR = PolarGrid((0.0, 0.0, 0.0), (0.0, 1.0), -1, 0.0, 990.0, 0.3, 41, -0.01, 0.0005, 37)


@dataclasses.dataclass(frozen=True)
class Reference:
    """A small recording, a grid around its scatterers, and the exact image."""

    block: object
    grid: MapGrid
    image: np.ndarray

    def noise(self, level_db, seed):
        """Complex Gaussian noise at a level below the mean power of the image."""
        rng = np.random.default_rng(seed)
        scale = np.sqrt(np.mean(np.abs(self.image) ** 2) / 2) * 10 ** (level_db / 20)
        return scale * (rng.standard_normal((*self.grid.shape, 2)) @ [1, 1j])


@pytest.fixture(name='reference', scope='module')
def reference_fixture(make_case):
    case = make_case(1000.0, channels=2, n=80, pulses=9, n_points=3)
    image = _correlate(case.block, case.grid.points())
    return Reference(case.block, case.grid, image)


def _correlate(block, points):
    return correlate(*band_spectrum(block), block.tx_m, block.rx_m, points)


def _error_db(image, reference):
    return 10 * np.log10(np.sum(np.abs(image - reference) ** 2) / np.sum(np.abs(reference) ** 2))


def test_all_pixels_give_the_error_by_its_definition(reference):
    image = reference.image + reference.noise(-15, 1)
    result = measure_error(image, reference.grid, reference.block, n_pixels=10 ** 9,
                           n_brightest=50)
    assert result.n_pixels == image.size and result.n_brightest == 50
    # Blocks and points of other sizes sum in another order: 1e-12 of an error at 0.03.
    assert result.error_db == pytest.approx(_error_db(image, reference.image), abs=1e-6)
    bright = np.argsort(np.abs(image), axis=None)[-50:]
    expected = _error_db(image.flat[bright], reference.image.flat[bright])
    assert result.brightest_error_db == pytest.approx(expected, abs=1e-6)


@settings(max_examples=12, deadline=None)
@given(level_db=st.floats(-70, -30), seed=st.integers(0, 10 ** 6))
def test_a_random_subset_estimates_the_error_of_the_whole_image(reference, level_db, seed):
    image = reference.image + reference.noise(level_db, seed)
    result = measure_error(image, reference.grid, reference.block, n_pixels=300,
                           n_brightest=1, seed=seed)
    # Five standard deviations, 4.3 / sqrt(300) = 0.25 dB each, and 0.1 dB for the denominator.
    assert result.error_db == pytest.approx(_error_db(image, reference.image), abs=1.35)


@settings(max_examples=12, deadline=None)
@given(kind=st.sampled_from(['even', 'proportional']), seed=st.integers(0, 10 ** 6))
def test_neither_bright_nor_faint_pixels_are_forgotten(reference, kind, seed):
    # Both errors are -40 dB of the whole. Random pixels alone would mostly underrate the second
    # one, by up to 15 dB and sometimes overrate it by 10: 65 % of the power is in 1 % of the
    # pixels.
    noise = reference.noise(-40, seed)
    if kind == 'proportional':
        noise *= np.abs(reference.image) / np.sqrt(np.mean(np.abs(reference.image) ** 2))
    image = reference.image + noise
    result = measure_error(image, reference.grid, reference.block, n_pixels=100, seed=seed)
    # Five standard deviations of 4.3 / sqrt(100) dB.
    assert result.error_db == pytest.approx(_error_db(image, reference.image), abs=2.15)


@settings(max_examples=8, deadline=None)
@given(cuts=st.lists(st.integers(0, 9), max_size=4).map(sorted))
def test_blocks_may_be_streamed(reference, cuts):
    image = reference.image + reference.noise(-30, 3)
    whole = measure_error(image, reference.grid, reference.block)
    edges = [0, *cuts, 9]
    parts = (reference.block.select(slice(a, b))
             for a, b in zip(edges[:-1], edges[1:], strict=True))
    streamed = measure_error(image, reference.grid, parts)
    assert streamed.error_db == pytest.approx(whole.error_db, abs=1e-6)
    assert streamed.brightest_error_db == pytest.approx(whole.brightest_error_db, abs=1e-6)


def test_polar_grids_and_points(reference):
    points = POLAR.lines(POLAR.range_m, POLAR.alpha[:, None])[0]
    image = _correlate(reference.block, points)
    noise = 1 + 0.01 * np.random.default_rng(0).standard_normal(image.shape)
    results = [measure_error(image * noise, where, reference.block, n_pixels=image.size)
               for where in (POLAR, points)]
    assert results[0] == results[1]
    assert results[0].error_db == pytest.approx(_error_db(image * noise, image), abs=1e-6)


def test_pixels_without_a_position_are_left_out(reference):
    """As of terrain whose height is not known; nothing was added there."""
    points = reference.grid.points()
    points[:20, :30] = np.nan
    left = np.isfinite(points).all(axis=-1)
    image = np.where(left, reference.image + reference.noise(-15, 1), 0.0)
    result = measure_error(image, points, reference.block, n_pixels=image.size)
    assert result.covered_share == pytest.approx(left.mean())
    assert result.error_db == pytest.approx(_error_db(image[left], reference.image[left]),
                                            abs=1e-6)


@settings(max_examples=8, deadline=None)
@given(gain=st.floats(0.1, 10), turn=st.floats(0, 6.28))
def test_scale(reference, gain, turn):
    factor = gain * np.exp(1j * turn)
    image = factor * reference.image
    plain = measure_error(image, reference.grid, reference.block, n_pixels=image.size)
    expected = 20 * np.log10(abs(factor - 1) + 1e-12)
    if expected > -100:  # below, the order of summation counts
        assert plain.error_db == pytest.approx(expected, abs=1e-3)
        assert plain.brightest_error_db == pytest.approx(expected, abs=1e-3)
    fitted = measure_error(image, reference.grid, reference.block, fit_scale=True)
    # The series that profiles are read by: -153.5 and -165.6 dB.
    assert fitted.error_db < -150 and fitted.brightest_error_db < -160


@pytest.mark.parametrize('gain', [0.2, 5.0j])
def test_with_a_fitted_scale_the_unit_of_the_image_does_not_matter(reference, gain):
    image = reference.image + reference.noise(-40, 2)
    errors = [measure_error(factor * image, reference.grid, reference.block, fit_scale=True,
                            n_pixels=300).error_db for factor in (1.0, gain)]
    assert errors[1] == pytest.approx(errors[0], abs=1e-5)  # complex64


@pytest.mark.parametrize('progress', [False, True])
def test_progress_is_shown_if_wanted(reference, progress, capsys):
    measure_error(reference.image, reference.grid, reference.block, n_pixels=10,
                  progress=progress)
    assert ('verification' in capsys.readouterr().err) is progress


def test_an_image_of_nothing_is_wrong_by_all_there_is(reference):
    image = np.zeros(reference.grid.shape, np.complex64)
    for fit_scale in (False, True):
        result = measure_error(image, reference.grid, reference.block, fit_scale=fit_scale)
        assert result.error_db == result.brightest_error_db == 0.0


def test_backprojection_is_as_good_as_it_says(reference):
    image = plan_image(reference.grid, reference.block.radar, reference.block.n_samples,
                       method='exact', target_db=-80.0)(reference.block)
    result = measure_error(image, reference.grid, reference.block)
    # five deviations of the estimate
    assert result.error_db < image.report.predicted_error_db + 1.5
    assert '(200 random pixels)' in str(result) and 'the 200 brightest' in str(result)


@pytest.mark.parametrize(('change', 'message'), [
    ({'image': np.ones((3, 4))}, r'image.shape=\(3, 4\) does not match the \(80, 80\) pixels'),
    ({'image': np.full((80, 80), np.nan)}, 'NaN or infinity'),
    ({'where': np.zeros((80, 80, 2))}, r'expected a grid, such as a MapGrid, or positions'),
    ({'where': POLAR}, r'does not match the \(37, 41\) pixels'),
    ({'n_pixels': 0}, 'n_pixels=0, n_brightest=200; expected at least one each'),
    ({'n_brightest': 0}, 'n_brightest=0'),
])
def test_bad_input_is_named(reference, change, message):
    good = {'image': reference.image, 'where': reference.grid, 'blocks': reference.block}
    with pytest.raises(ValueError, match=message):
        measure_error(**(good | change))


def test_blocks_without_positions_are_refused(reference):
    block = dataclasses.replace(reference.block, tx_m=None, rx_m=None)
    with pytest.raises(ValueError, match='no phase centres'):
        measure_error(reference.image, reference.grid, [block])
