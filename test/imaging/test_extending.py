# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""A method and a backend of somebody else: those of docs/extending.md, and what is refused."""

from __future__ import annotations

import dataclasses
import pathlib
import re
import types

import numpy as np
import pytest

from sar_imaging.backends import backend, reference
from sar_imaging.backends.checks import BACKEND_CHECKS
from sar_imaging.geometry.illumination import AntennaPattern, PatternCut
from sar_imaging.imaging.checks import METHOD_CHECKS
from sar_imaging.imaging.correlation import correlate, correlate_profiles
from sar_imaging.imaging.imager import plan_image
from sar_imaging.imaging.methods import METHODS, Method
from sar_imaging.signal.spectra import band_spectrum

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


def test_the_page_tells_what_is_found(names):
    assert names['error'] < -130.0
    missing = [[told.split(':')[0] for told in names[of] if 'not offered' in told]
               for of in ('of_the_method', 'of_the_other')]
    assert missing == [['phase histories', 'terrain', 'illumination', 'backends'], ['backends']]
    assert len(names['of_the_backend']) == len(BACKEND_CHECKS)


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


class Right(Method):
    """Correlation, which lacks nothing."""

    NAME = 'right'

    def plan(self, tx_m, rx_m):
        return self.describe(predicted_error_db=-120.0)

    def form(self, block):
        values, _ = correlate_profiles(block, np.nan_to_num(self.grid.points()).reshape(-1, 3))
        return values.astype(np.complex64).reshape(self.grid.shape)


def _spoils(self, block):
    found = Right.form(self, block)
    block.samples[0] = 0
    return found


def _unscaled(self, block):
    frequencies_hz, spectra = band_spectrum(block)
    return correlate(frequencies_hz, spectra, block.tx_m, block.rx_m,
                     self.grid.points()).astype(np.complex64)


def _late(self, block):
    first, _ = self.first = getattr(self, 'first', (block.tx_m, None))
    n = min(len(first), block.n_pulses)
    return Right.form(self, dataclasses.replace(block.select(slice(0, n)), tx_m=first[:n]))


@pytest.mark.parametrize(('attributes', 'title', 'words'), [
    ({'OWN': {'weights': 1}}, 'class', 'got weights, which plan_image takes itself'),
    ({'OWN': ('denser',)}, 'class', r"mapping, got \('denser',\)"),
    ({'TERRAIN': None}, 'class', 'expected TERRAIN=True or False, got None'),
    ({'form': Method.form}, 'class', r'form\(block\), got none; write it'),
    ({'plan': Method.plan}, 'class', r'plan\(tx_m, rx_m\), got none; write it'),
    ({'plan': lambda self, *centres: self.describe()}, 'targets', 'got None; return self'),
    ({'plan': lambda self, *centres: self.describe(predicted_error_db=-np.inf)}, 'targets',
     'predict -200 dB'),
    ({'form': lambda self, block: Right.form(self, block) * 1.1}, 'targets',
     r'at most -117.0 dB .* got -20.0 dB; multiplied by 0.909'),
    ({'form': lambda self, block: Right.form(self, block)[1:]}, 'targets',
     r'expected a complex image of shape \(40, 48\), got complex64 \(39, 48\)'),
    ({'form': lambda self, block: Right.form(self, block).astype(complex)}, 'targets',
     'expected complex64, got complex128; end `form`'),
    ({'form': _spoils}, 'targets', 'work on a copy'),
    ({'form': _late}, 'pulses from other places', 'against time-domain correlation'),
    ({'image': lambda self, block, onto=None: (Right.form(self, block), self.report)},
     'images that grow', '0 everywhere: add echoes to the image in place'),
    ({'image': lambda self, block, onto=None: (self.form(block), self.report)},
     'channels and windows', '0 everywhere'),
    ({'TERRAIN': True}, 'terrain', 'expected 0 where no height is known'),
    ({'ILLUMINATION': True}, 'illumination', 'multiply what echo r adds'),
    ({'BACKENDS': True}, 'backends', 'use self.options.backend'),
    ({'PHASE_HISTORIES': True, 'form': _unscaled}, 'phase histories', 'the scale of range')])
def test_what_is_wrong_with_a_method_is_told(attributes, title, words):
    method = type('Wrong', (Right,), attributes)
    METHOD_CHECKS[title](Right, {})
    with pytest.raises(ValueError, match=words):
        METHOD_CHECKS[title](method, {})


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
    # with b = 0.75 / 128 cycles per step
    expected_db = 10 * np.log10((2 * np.pi * 0.75 / 128) ** 4 / 80 / 120)
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
