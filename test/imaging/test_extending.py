"""A method and a backend of somebody else: those of docs/extending.md, and what is refused."""

from __future__ import annotations

import pathlib
import re
import types

import numpy as np
import pytest

from sar_imaging.backends import backend, reference
from sar_imaging.imaging.imager import plan_image
from sar_imaging.imaging.methods import METHODS, Method

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
