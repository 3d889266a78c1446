# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Whole small images by every backend against correlation, and what the reference is besides."""

import subprocess
import sys
import types

import numpy as np
import pytest

from sar_imaging.backends import BACKENDS, CUDA, backend, device_backend, reference
from sar_imaging.backends.checks import BACKEND_CHECKS, check_backend
from sar_imaging.planning.exact.backprojection import plan_backprojection
from sar_imaging.planning.exact.polar_image import AzimuthParts

# A third one, of somebody who wrote no more than the entries that a backend must have.
OWN = types.SimpleNamespace(**{entry: getattr(reference, entry) for entry in (
    'Backprojection', 'SubapertureImager', 'SpectrumFusion', 'form_map')})


class Watched:
    """A backend, and the names that were looked up in it."""

    def __init__(self, made):
        self.made, self.names = made, set()

    def __getattr__(self, name):
        self.names.add(name)
        return getattr(self.made, name)


@pytest.mark.parametrize('title', BACKEND_CHECKS)
@pytest.mark.parametrize('name', BACKENDS)
def test_backends_do_what_plans_say(name, title):
    if name == CUDA and device_backend() is None:
        pytest.skip('there is no CUDA device; the simulator runs its kernels in test_cuda_*.py')
    watched = Watched(backend(name))
    assert 'not offered' not in BACKEND_CHECKS[title](watched)
    # Checks that look up nothing but its entries find the reference in OWN.
    looks_beyond = bool(watched.names - vars(OWN).keys())
    assert looks_beyond == (title in ('correlation', 'trial images') or any(
        part in title for part in ('groups of echoes', 'under a pattern')))
    if looks_beyond:
        assert 'not offered' in BACKEND_CHECKS[title](OWN)


class Asked(Exception):
    """Carries the plan that somebody is asked to compute."""

    def __init__(self, plan, memory=None):
        super().__init__(plan)
        raise self


@pytest.mark.parametrize(('title', 'method'), [
    ('exact map along lines', 'lines'), ('exact map of receivers far apart', 'lines'),
    ('exact map nearby', 'points'), ('exact points, one without position', 'points'),
    ('exact plane', 'lines'), ('exact volume', 'lines'), ('exact map from a polar image', 'polar'),
    ('exact map from polar images of parts', 'polar'), ('AFBP', None), ('AFBP by beams', None)])
def test_all_routes_are_checked(title, method):
    with pytest.raises(Asked) as asked:
        BACKEND_CHECKS[title](types.SimpleNamespace(Backprojection=Asked, SubapertureImager=Asked))
    plan, = asked.value.args
    if method is None:
        assert (plan.beams is not None) == ('beams' in title)
    else:
        assert plan.method == method
        parts = isinstance(getattr(plan.route, 'parts', None), AzimuthParts)
        assert parts == ('parts' in title)


def _changed(entry, method, change):
    """A backend of which one method of an entry is another."""
    def changed(self, *arguments, **options):
        return change(getattr(super(made, self), method), *arguments, **options)

    made = type(entry, (getattr(reference, entry),), {method: changed})
    return types.SimpleNamespace(**{**vars(OWN), entry: made})


def _sum_of(change):
    def add(whole, samples, tx_m, rx_m, image):
        found = np.zeros_like(image)
        whole(samples, tx_m, rx_m, found)
        image += change(found)
    return _changed('Backprojection', 'add', add)


@pytest.mark.parametrize(('made', 'title', 'words'), [
    (_sum_of(lambda f: 2 * f), 'exact map along lines', 'multiplied by 0.5'),
    (_sum_of(np.conj), 'exact map along lines', 'its conjugate fits'),
    (_sum_of(lambda f: f[::-1]), 'exact map along lines', 'its rows are in reverse order'),
    (_sum_of(lambda f: f[:, ::-1]), 'exact map along lines', 'its columns are in reverse'),
    (_sum_of(lambda f: f.T), 'exact map along lines', 'its axes are exchanged'),
    (_sum_of(np.abs), 'exact map along lines', 'its phases do not'),
    (_sum_of(lambda f: 0 * f), 'exact map along lines', '0 everywhere: add echoes to the image'),
    (_sum_of(lambda f: f * np.float32(1.004)), 'exact map along lines', 'compute more exactly'),
    (_sum_of(lambda f: f * np.nan), 'exact map along lines', '2304 of 2304 pixels are NaN'),
    (_sum_of(lambda f: f[0, 0]), 'exact map along lines', 'compare it echo by echo'),
    (_sum_of(lambda f: f + 1), 'exact points, one without position', 'leave them as they are'),
    (_changed('SpectrumFusion', 'add', lambda whole, number, image, centre_m: whole(
        number, image, 0.0)), 'AFBP', 'against time-domain correlation'),
    (_changed('SpectrumFusion', 'remove', lambda whole, number: None),
     'contributions of sub-apertures', 'keep the numbers'),
    (_changed('SpectrumFusion', 'remove', lambda whole, number: None), 'what fusion refuses',
     'removing what was not kept: expected a ValueError'),
    (types.SimpleNamespace(**{**vars(OWN), 'form_map': lambda image, grid: None}),
     'arguments of the entries', r'expected form_map\(.*got \(image, grid\); take'),
    (types.SimpleNamespace(**vars(OWN), TrialImages=type('TrialImages', (), {
        'length': 4, '__init__': lambda *args: None,
        'image': lambda self, tx_m, rx_m, starts_m, step_m: np.ones((2, len(starts_m), 4))})),
     'trial images', 'against time-domain correlation')])
def test_what_is_wrong_with_a_backend_is_told(made, title, words):
    with pytest.raises(ValueError, match=words):
        BACKEND_CHECKS[title](made)


def test_all_faults_are_told_at_once(monkeypatch):
    for title in BACKEND_CHECKS.keys() - {'arguments of the entries', 'correlation', 'AFBP'}:
        monkeypatch.delitem(BACKEND_CHECKS, title)
    assert len(check_backend('reference')) == 3

    def broken(*arguments, **options):
        raise IndexError('list index out of range')

    made = types.SimpleNamespace(**{**vars(OWN), 'form_map': broken})
    with pytest.raises(ValueError, match='2 of 3 checks failed\n- arguments of the entries: '
                                         'expected form_map.*\n- AFBP: IndexError in broken, '):
        check_backend(made)


def test_only_windows_and_interpolators_of_the_plan_are_left(make_scene, error_db):
    """Along lines of a map whose profiles are used to their ends nothing is approximated."""
    scene = make_scene(1000.0, n=24)
    plan = plan_backprojection(scene.grid, scene.block.radar, scene.block.n_samples,
                               *scene.echoes[1:], -60.0)
    image = np.zeros(scene.grid.shape, np.complex64)
    backend('reference').Backprojection(plan).add(*scene.echoes, image)
    assert error_db(image, scene.correlation(scene.grid.points())) < -140.0  # complex64: -150 dB


def test_backends_are_chosen_by_name():
    assert backend() is backend('auto') is backend('cpu') is not backend('reference')
    with pytest.raises(ValueError, match="backend='gpu'; expected auto, cpu, cuda, reference"):
        backend('gpu')
    with pytest.raises(AttributeError, match='no attribute'):
        _ = backend('cpu').project


def test_the_reference_knows_no_compiler():
    code = ("import sys; from sar_imaging.backends import backend; backend('reference').form_map;"
            "sys.exit('numba' in sys.modules)")
    subprocess.run([sys.executable, '-c', code], check=True)


def test_exact_backprojection_does_not_load_afbp():
    code = ("import sys; from sar_imaging.backends import backend; backend('cpu').Backprojection;"
            "sys.exit('sar_imaging.backends.cpu.beams' in sys.modules)")
    subprocess.run([sys.executable, '-c', code], check=True)
