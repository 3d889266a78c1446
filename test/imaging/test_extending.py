"""A method and a backend of somebody else: those of docs/extending.md, and what is refused."""

from __future__ import annotations

import dataclasses
import pathlib
import re
import types

import numpy as np
import pytest

from sar_imaging.backends import backend, reference
from sar_imaging.geometry.illumination import AntennaPattern, PatternCut, Pointing
from sar_imaging.imaging.imager import plan_image
from sar_imaging.imaging.methods import METHODS, Method
from sar_imaging.quality import error_db

PAGE = pathlib.Path(__file__).parents[2] / 'docs' / 'extending.md'


@pytest.fixture(scope='module')
def names():
    """What the examples of the page leave behind; its property test is one of them."""
    found = {}
    for code in re.findall(r'^```python\n(.*?)^```', PAGE.read_text(), re.DOTALL | re.MULTILINE):
        exec(code, found)
    return found


def test_the_method_of_the_page_is_as_good_as_it_says(names):
    report = names['image'].report
    assert report.method == 'nearest-sample' and report.reason == 'asked for'
    # Predicted is the error of clutter everywhere. One scatterer, of which 250 rows agree, is
    # better, by as much as the grid leaves out of what their errors spread over.
    found = names['error_db'](names['image'])
    assert report.predicted_error_db - 15.0 < found <= report.predicted_error_db
    assert 'nearest-sample' in str(report) and 'nearest-sample' not in METHODS


def test_options_reach_a_method_of_ones_own(names):
    """Channels, weights and accumulation are done around it."""
    profiles, grid = names['profiles'], names['grid']
    args = grid, profiles.radar, profiles.n_samples
    single = plan_image(*args, method=names['NearestSample'], per_channel=True)(profiles)
    assert single.shape == (profiles.n_channels, *grid.shape)
    whole = names['image'].samples
    np.testing.assert_allclose(single.samples.sum(axis=0), whole, atol=1e-5 * np.abs(whole).max())
    imager = plan_image(*args, method=names['NearestSample'])
    image = imager(profiles.select(slice(0, 20)))
    imager.accumulate(profiles.select(slice(20, None)), image)
    np.testing.assert_allclose(image.samples, whole, atol=1e-5 * np.abs(whole).max())
    with pytest.raises(ValueError, match="use 'exact' on terrain"):
        plan_image(*args, method=names['NearestSample'], height_m=np.zeros(grid.shape))(profiles)


def test_the_method_of_phase_histories(names):
    """It owes window and scale of range compression, heights and amplitudes of the antenna."""
    assert names['error'] < -130.0
    method, history, grid = (names[n] for n in ('FrequencyByFrequency', 'history', 'grid'))
    args = history.radar, history.n_samples
    heights = np.linspace(-1.0, 1.0, grid.n_x) * np.ones(grid.shape)
    heights[:2] = np.nan
    pattern = AntennaPattern(PatternCut.sinc(0.006), PatternCut.gaussian(0.5))
    lit = dataclasses.replace(history, pointing=Pointing.beside_track(
        history.phase_centre_m, -1, 0.0, 0.0))
    for block, options in ((history, {'height_m': heights}), (lit, {'illumination': pattern})):
        found, wanted = (plan_image(grid, *args, compressed=False, method=m, target_db=-90.0,
                                    **options)(block) for m in (method, 'exact'))
        assert found.samples.any() and not np.isnan(found.samples).any()
        assert error_db(found, wanted) < -80.0
    with pytest.raises(ValueError, match="compressed=False; use 'exact' for range profiles"):
        plan_image(grid, names['profiles'].radar, names['profiles'].n_samples,
                   method=method)(names['profiles'])


@pytest.mark.parametrize(('name', 'options', 'message'), [
    ('NearestSample', {'sharper': 2}, "'nearest-sample' has no option sharper; it has denser"),
    ('NearestSample', {'backend': 'reference'}, 'computes on the processor by itself'),
    ('NearestSample', {'illumination': AntennaPattern(PatternCut.sinc(0.1))},
     "'nearest-sample' knows no illumination"),
    ('FrequencyByFrequency', {'backend': reference}, 'computes on the processor by itself')])
def test_what_a_method_does_not_say_is_refused(names, name, options, message):
    profiles = names['profiles']
    with pytest.raises(ValueError, match=message):
        plan_image(names['grid'], profiles.radar, profiles.n_samples, method=names[name],
                   **options)


def test_blocks_are_checked_before_a_method_gets_them(names):
    profiles, grid = names['profiles'], names['grid']
    imager = plan_image(grid, profiles.radar, profiles.n_samples, method=names['NearestSample'])
    for block, message in (
            (dataclasses.replace(profiles, samples=profiles.samples * np.nan), 'NaN'),
            (dataclasses.replace(profiles, samples=profiles.samples[..., 1:]), 'this plan is for'),
            (dataclasses.replace(profiles, compressed=False), 'raw pulses')):
        with pytest.raises(ValueError, match=message):
            imager(block)


def test_the_backend_of_the_page_forms_the_image(names):
    # linear interpolation of band-limited noise: (2 pi F)^4 / 120 on average, F^4 = b^4 / 80
    # with b = 0.75 / 16 cycles per step
    expected_db = 10 * np.log10((2 * np.pi * 0.75 / 16) ** 4 / 80 / 120)
    assert names['error_db'](names['exact']) <= expected_db + 6.0  # one scatterer, not noise
    cpu = plan_image(names['grid'], names['profiles'].radar, names['profiles'].n_samples,
                     method='exact')(names['profiles'])
    assert not np.array_equal(cpu.samples, names['exact'].samples)  # it was the toy's work


def test_the_backend_of_the_page_does_the_other_stage_of_afbp(names, make_case):
    case = make_case(1e3, n=48, pulses=64)
    args = case.grid, case.block.radar, case.block.n_samples
    afbp = [plan_image(*args, method='afbp', target_db=-50.0, backend=b)(case.block).samples
            for b in (names['toy'], 'reference')]
    np.testing.assert_array_equal(*afbp)


def test_what_is_no_backend_is_told_what_it_lacks(names):
    assert backend(reference) is reference and backend(names['toy']) is names['toy']
    half = types.SimpleNamespace(Backprojection=reference.Backprojection, form_map=3)
    with pytest.raises(ValueError, match='expected auto, cpu, cuda, reference, or an object that '
                                         'has SubapertureImager, SpectrumFusion, form_map, too'):
        plan_image(names['grid'], names['profiles'].radar, names['profiles'].n_samples,
                   method='exact', backend=half)(names['profiles'])


class Nameless(Method):
    pass


@pytest.mark.parametrize('method', ['best', Nameless, dict, None, ['exact'], 3])
def test_what_is_no_method_is_told_what_is(names, method):
    with pytest.raises(ValueError, match="'exact'.*or a subclass of .*Method with a NAME"):
        plan_image(names['grid'], names['profiles'].radar, names['profiles'].n_samples,
                   method=method)
