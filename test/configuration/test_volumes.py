# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Volumes in a configuration: cells, distances, memory and what cannot be."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from sar_imaging.configuration import check, derive
from sar_imaging.configuration.constraints import check_settings
from sar_imaging.configuration.derived import see_scene
from sar_imaging.configuration.report import rows

from .conftest import MACHINE, make_acquisition, make_imaging


def make_volume(**changes):
    return make_imaging(**{'mode': 'volume', 'volume_height': 20.0, 'volume_spacing': 0.5}
                        | changes)


def test_a_volume_has_layers_from_the_grid_up():
    imaging = make_volume()
    assert imaging.volume.shape == (41, 501, 501) and imaging.n_pixels == 41 * 501**2
    assert (imaging.top_m, imaging.middle_grid.z_m) == (20.0, 10.0)
    assert make_volume(volume_spacing=0.0).volume.shape == (201, 501, 501)
    flat = make_imaging(volume_height=20.0)
    assert (flat.volume, flat.top_m, flat.middle_grid) == (None, 0.0, flat.grid)


@pytest.mark.parametrize('centre_m', [(-800.0, 0.0, 600.0), (-800.0, 0.0, 8.0),
                                      (-60.0, 10.0, -30.0)])
def test_distances_and_directions_are_those_of_the_cells(centre_m):
    acquisition, imaging = make_acquisition(centre_m=centre_m), make_volume()
    scene = see_scene(acquisition, imaging)
    cells = imaging.volume.positions(*np.ix_(*(np.unique(np.linspace(0, n - 1, 21).astype(int))
                                               for n in imaging.volume.shape)))
    track = acquisition.track(imaging.pulses_per_aperture)[[0, 64, 128, 192, 255]]
    distance = np.linalg.norm(cells[..., None, :] - track, axis=-1)
    # the nearest cell and the five pulses are not quite the nearest: some decimetres
    assert scene.near_m == pytest.approx(distance.min(), abs=1.5)
    assert scene.far_m == pytest.approx(distance.max(), abs=0.1)
    sight = cells - np.array(centre_m)
    cosine = sight[..., 1] / np.linalg.norm(sight, axis=-1)
    assert scene.direction == pytest.approx((cosine.min(), cosine.max()), abs=0.02)
    assert scene.range_m == pytest.approx(math.dist(centre_m, (0.0, 0.0, 10.0)))


def test_work_and_memory_are_those_of_all_cells():
    imaging = make_volume()
    derived = derive(make_acquisition(), imaging, MACHINE)
    one = derive(make_acquisition(), make_imaging(), MACHINE)
    assert derived.n_pixels == 41 * one.n_pixels
    assert derived.imaging_s == pytest.approx(41 * one.imaging_s)
    [memory] = [m for m in derived.memory if m.node == 'backprojection']
    assert memory.n_bytes > 3 * 8 * derived.n_pixels and '3 x 8 B/cell' in memory.formula
    table = {name: (value, meaning) for name, value, meaning in rows(
        make_acquisition(), imaging, MACHINE, derived)}
    assert table['image'] == ('501 x 501 x 41', 'cells, 10.3 million')


@pytest.mark.parametrize(('changes', 'text'), [
    ({'max_image_pixels': 10_000_000}, 'the grid has 501 x 501 x 41 cells, more than '
     'max_image_pixels=10000000; raise grid.spacing=0.1 or volume.spacing=0.5'),
    ({'method': 'afbp'}, 'method: afbp images maps, not volumes'),
    ({'autofocus_time_offset': 1.0}, 'volume, which has no autofocus; set both to 0.0')])
def test_what_cannot_be_is_an_error(changes, text):
    assert [f for f in check_settings(make_volume(), MACHINE)] == []
    [finding] = check_settings(make_volume(**changes), MACHINE)
    assert finding.severity == 'error' and text in finding.text


def test_a_volume_beyond_the_memory_is_an_error():
    small = dataclasses.replace(MACHINE, memory_bytes=200_000_000)
    [finding] = check_settings(make_volume(), small)
    assert 'a volume of 501 x 501 x 41 cells and its message need 247 MB' in finding.text


@pytest.mark.parametrize(('name', 'value', 'text'), [
    ('volume_height', 0.0, 'volume.height=0 in mode volume; expected the positive height'),
    ('volume_height', math.inf, 'volume.height=inf in mode volume'),
    ('volume_spacing', -0.1, 'volume.spacing=-0.1; expected a positive distance')])
def test_heights_that_make_no_sense_are_refused(name, value, text):
    with pytest.raises(ValueError, match=text):
        make_volume(**{name: value})


def test_what_follows_from_a_straight_track_is_a_warning_of_volumes():
    """A raster need not have the errors of one of its rows."""
    slow = make_acquisition(prf_hz=20.0)
    found = {mode: check(slow, imaging, MACHINE, derive(slow, imaging, MACHINE))
             for mode, imaging in (('image', make_imaging()), ('volume', make_volume()))}
    assert any(f.from_track and f.severity == 'error' for f in found['image'])
    assert not any(f.from_track and f.severity == 'error' for f in found['volume'])
    assert any('a straight track is assumed' in f.text for f in found['volume'])
    assert not any('a straight track is assumed' in f.text for f in found['image'])
