# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Autofocus of whole apertures against the image of the true positions."""

from __future__ import annotations

import dataclasses
import pathlib

import numpy as np
import pytest

from benchmarks.measured.image_arcsar import arm_angles
from benchmarks.support.references import exact_image
from benchmarks.support.track_errors import moved_rigidly
from sar_imaging.autofocus import (
    Autofocus,
    Geometry,
    GeometryModel,
    apply_geometry,
    nominal,
    with_range_bias,
    with_time_offset,
    with_track_error,
)
from sar_imaging.autofocus.search import detrend, differentiate, sharpness
from sar_imaging.autofocus.tiles import Tiles
from sar_imaging.geometry import MapGrid
from sar_imaging.quality import contrast, error_db
from sar_imaging.recordings import load
from sar_imaging.signal.range_compression import RangeCompressor
from sar_imaging.simulation import flawed_aperture

ARC = pathlib.Path(__file__).parents[2] / '../shared/data/arcsar_77ghz/Prova_Esterna_7.bin'


# Enough pulses for 30 cycles of vibration, and for errors of 10 wavelengths, at a quarter of the
# benchmark's cost.
SMALL = {'n_pulses': 128, 'half_scene_m': 14.0}


def run(case):
    """Result of autofocus and the error of its image against the truth's, dB."""
    model = None
    if case.kind == 'clock':
        def model(block):
            return with_time_offset(nominal(block), case.time_s, scale_s=0.05)
    result = Autofocus(case.grid, model=model, scale_m=0.1).process(case.stated)
    image = exact_image(case.grid, moved_rigidly(result.block, case.true, case.points_m))
    wanted = exact_image(case.grid, case.true)
    factor = np.vdot(image, wanted) / np.vdot(image, image)
    return result, error_db(factor * image, wanted)


@pytest.mark.parametrize(('kind', 'size', 'seed'), [
    ('smooth', 0.3, 1), ('smooth', 10.0, 3), ('vibration', 0.2, 2), ('clock', 0.05, 4)])
def test_errors_are_corrected_and_success_is_claimed(kind, size, seed):
    result, error = run(flawed_aperture(kind, size, seed, **SMALL))
    report = result.report
    assert report.accepted
    assert report.success, report.reason
    assert report.contrast_after > report.contrast_before
    assert error < -20.0  # the limit that a claim stands for; -25 and better measured
    # what is claimed is what is found: within 7 dB in all cases of the benchmark
    assert abs(report.estimated_error_db - error) < 10.0


def test_sharper_ghosts_do_not_replace_an_image():
    case = flawed_aperture('smooth', 0.3, 5, **SMALL)
    rng = np.random.default_rng(0)
    noise = (rng.standard_normal(case.stated.samples.shape)
             + 1j * rng.standard_normal(case.stated.samples.shape))
    block = dataclasses.replace(case.stated, samples=noise)
    image = exact_image(case.grid, block)
    result = Autofocus(case.grid, scale_m=0.1).process(block, image)
    assert not result.report.accepted  # though contrast would rise by a tenth
    assert not result.report.success
    assert 'perhaps ghosts' in result.report.reason
    assert result.image is image
    assert result.block is block


def test_focused_image_is_never_made_worse():
    case = flawed_aperture('smooth', 1e-6, 5, **SMALL)
    report = Autofocus(case.grid, scale_m=0.1).process(case.true).report
    assert report.success
    assert not report.accepted
    assert 'focused already' in report.reason


def test_few_pulses_are_left_alone():
    case = flawed_aperture('smooth', 0.3, 5, n_pulses=31, half_scene_m=5.0)
    result = Autofocus(case.grid).process(case.stated)
    assert not result.report.accepted
    assert '31 pulses are too few, at least 32' in result.report.reason
    assert result.block is case.stated


def test_image_of_zeros_is_left_alone():
    case = flawed_aperture('smooth', 0.1, 6, n_pulses=64)
    silent = dataclasses.replace(case.stated, samples=0 * case.stated.samples)
    result = Autofocus(case.grid).process(silent)
    assert not result.report.accepted
    assert result.block is silent


def test_tiles_are_the_exact_image():
    case = flawed_aperture('smooth', 1.0, 7, n_pulses=256)
    geometry = Geometry(case.stated.tx_m, case.stated.rx_m)
    tiles = Tiles(case.stated, geometry, case.points_m[:3], 64)
    true = Geometry(case.true.tx_m, case.true.rx_m)
    for some, block in ((geometry, case.stated), (true, case.true)):
        tile = tiles.focus(tiles.half_path_change(some))[..., 0]
        pixels = np.array([[tiles.position(k, x) for x in range(tile.shape[1])]
                           for k in range(3)])
        exact = exact_image(pixels, block)
        # Linear interpolation at four samples per resolution and one shift per sub-aperture of
        # four pulses: -23 dB or better
        assert error_db(tile, exact) < -20.0


def test_gradient_is_that_of_the_sharpness():
    case = flawed_aperture('smooth', 0.3, 8, n_pulses=128)
    tiles = Tiles(case.stated, Geometry(case.stated.tx_m, case.stated.rx_m),
                  case.points_m[:4], 64, n_segments=2)
    rng = np.random.default_rng(1)
    change, direction = rng.standard_normal((2, 4, 64)) * 1e-3
    value, gradient = sharpness(tiles, change)
    step = 1e-2
    numeric = (sharpness(tiles, change + step * direction)[0]
               - sharpness(tiles, change - step * direction)[0]) / (2 * step)
    # float32 images
    assert np.sum(gradient * direction) == pytest.approx(numeric, rel=1e-2, abs=1e-4 * value)


def test_model_derivatives_and_names():
    case = flawed_aperture('clock', 0.05, 9, n_pulses=128)
    model = with_range_bias(with_time_offset(
        with_track_error(nominal(case.stated), degree=2), case.time_s[:128], scale_s=0.05),
        scale_m=0.1)
    assert model.names[-2:] == ('time_offset_s', 'range_bias_m')
    assert len(model.names) == 8
    tiles = Tiles(case.stated, model(model.start), case.points_m[:2], 32)
    jacobian = differentiate(tiles, model, model.start)
    np.testing.assert_allclose(jacobian[..., -1], 1.0, rtol=1e-9)  # a bias adds to every path
    line = np.linspace(-1, 1, 32)[None] * np.ones((2, 1))
    assert np.abs(detrend(3 + 2 * line)).max() < 1e-12


def test_range_bias_moves_the_profiles():
    case = flawed_aperture('smooth', 1e-6, 10, n_pulses=64)
    block = case.true
    late = dataclasses.replace(block, radar=dataclasses.replace(
        block.radar, first_sample_delay_s=block.radar.first_sample_delay_s + 1e-8))
    bias_m = 1e-8 * 299792458.0 / 2
    back = apply_geometry(late, Geometry(block.tx_m, block.rx_m, bias_m))
    assert back.radar.range_start_m == pytest.approx(block.radar.range_start_m, abs=1e-9)


@pytest.mark.skipif(not ARC.exists(), reason='the arc SAR recording is not here')
def test_radius_of_the_rotating_arm():
    raw = load('arcsar_7', ARC, changes={'positions.arc.radius_m': 0.20}).block
    profiles = RangeCompressor.for_block(raw, window='taylor:4:35')(raw)
    angle = arm_angles(raw.n_pulses)
    point = (1.32, 2.96)
    seen = np.abs(angle - np.arctan2(point[1], point[0])) <= np.radians(35.0)  # its beam
    angle = angle[seen]

    def on_circle(parameters):
        out = parameters[0] * np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=-1)
        return Geometry(out[:, None], out[:, None])

    grid = MapGrid.from_size((*point, 0.0), 1.6, 1.6, 0.02)
    model = GeometryModel(['radius_m'], [0.20], [0.01], on_circle)
    result = Autofocus(grid, model=lambda _: model, n_phases=0).process(profiles.select(seen))
    assert result.report.accepted
    # 0.2108 m measured; the data's description has 0.2105 m
    assert result.report.parameters['radius_m'] == pytest.approx(0.2105, abs=1e-3)
    assert contrast(result.image) > 1.3 * result.report.contrast_before
    row, column = np.unravel_index(np.abs(result.image).argmax(), grid.shape)
    assert np.hypot(grid.x_m[column] - point[0], grid.y_m[row] - point[1]) < 0.05


def test_refusals():
    case = flawed_aperture('smooth', 0.1, 6, n_pulses=64)
    with pytest.raises(ValueError, match='offset_reach_s=1 needs a model with the parameter '
                       'time_offset_s; this one has track_0_1_m'):
        Autofocus(case.grid, offset_reach_s=1.0).process(case.stated)
    with pytest.raises(ValueError, match='n_points=2; expected 4 or more'):
        Autofocus(case.grid, n_points=2)
    with pytest.raises(ValueError, match='margin=0'):
        Autofocus(case.grid, margin=0.0)
    with pytest.raises(ValueError, match='n_phases=-1'):
        Autofocus(case.grid, n_phases=-1)
    with pytest.raises(ValueError, match='expected one finite number for each'):
        GeometryModel(['a'], [0.0, 1.0], [1.0], nominal(case.stated).function)
    with pytest.raises(ValueError, match='above 0'):
        GeometryModel(['a'], [0.0], [0.0], nominal(case.stated).function)
    bare = dataclasses.replace(case.stated, tx_m=None, rx_m=None)
    with pytest.raises(ValueError, match='autofocus corrects positions'):
        nominal(bare)
    with pytest.raises(ValueError, match='degree=0'):
        with_track_error(nominal(case.stated), degree=0)
