"""Whole small images by the reference backend, against correlation and the compiled backend."""

import dataclasses
import inspect
import subprocess
import sys

import numpy as np
import pytest

from sar_imaging.backends import BACKENDS, CUDA, backend
from sar_imaging.backends.protocol import (
    Backend,
    Backprojection,
    SpectrumFusion,
    SubapertureImager,
)
from sar_imaging.geometry import PlaneGrid, PointGrid, VolumeGrid
from sar_imaging.imaging.correlation import correlate, correlate_profiles
from sar_imaging.planning.afbp.beams import plan_beams
from sar_imaging.planning.afbp.polar_grids import cover_for_fusion
from sar_imaging.planning.afbp.subapertures import plan_subapertures
from sar_imaging.planning.exact.backprojection import plan_backprojection
from sar_imaging.planning.exact.points import ImagePoints
from sar_imaging.planning.exact.polar_image import AzimuthParts, plan_polar
from sar_imaging.planning.plan import total_db
from sar_imaging.planning.profiles import PhaseHistory

# that of devices is tested in test/backends/cuda
NAMES = [name for name in BACKENDS if name != CUDA]
# Predictions are for scenes that are evenly bright; some dozen scatterers differ by chance.
CHANCE_DB = 0.5


def exact(block, points):
    """Image at points by correlation, in float64."""
    flat = points.reshape(-1, 3)
    if block.compressed:
        image = correlate_profiles(block, flat)[0]
    else:
        k, radar = block.n_samples, block.radar
        hertz = radar.carrier_hz + (np.arange(k) - (k - 1) / 2) * radar.bandwidth_hz / k
        cycles = np.fmod(hertz * radar.first_sample_delay_s, 1.0)
        image = correlate(hertz, block.samples * np.exp(-2j * np.pi * cycles) / k, block.tx_m,
                          block.rx_m, flat)
    return image.reshape(points.shape[:-1])


def backprojected(name, plan, echoes, shape):
    image = np.zeros(shape, np.complex64)
    backend(name).Backprojection(plan).add(*echoes, image)
    return image


def hills(grid):
    """Points of a map on a hill, one of which has no position."""
    points = grid.points()
    points[..., 2] += 3.0 * np.exp(-(points[..., 1] / 4.0) ** 2)
    points[5, 7, 2] = np.nan
    return points


@pytest.mark.parametrize('target_db', [-80.0, -60.0])
@pytest.mark.parametrize(('route', 'options'), [
    ('lines', {'range_m': 1000.0, 'height_m': 300.0}),
    ('lines', {'range_m': 1000.0, 'apart_m': 40.0, 'channels': 2}),
    ('points', {'range_m': 30.0, 'aperture_m': 3.0}),
    ('hills', {'range_m': 500.0, 'height_m': 100.0}),
    ('wall', {'range_m': 300.0, 'height_m': 20.0}),
    ('volume', {'range_m': 1000.0, 'height_m': 300.0}),
    ('polar', {'range_m': 1000.0, 'bend_m': 3.0}),
    ('parts', {'range_m': 400.0, 'pulses': 200, 'aperture_m': 60.0})])
def test_exact_backprojection(make_scene, error_db, route, options, target_db):
    scene = make_scene(**options)
    grid, block, echoes = scene.grid, scene.block, scene.echoes
    args = block.radar, block.n_samples, *echoes[1:], target_db
    x, y, z = grid.centre_m
    if route == 'wall':
        grid = PlaneGrid((x, y - 5.0, z), (0.02, 0.25, 0.0), (0.1, 0.0, 0.3), 40, 20)
    elif route == 'volume':
        grid = VolumeGrid((x - 4.0, y - 4.0, z), (0.25, 0.0, 0.0), (0.0, 0.25, 0.01),
                          (0.0, 0.0, 0.5), 30, 25, 3)
    points, shape = grid.points(), grid.shape
    if route == 'hills':
        points = hills(grid)
        plan = plan_backprojection(ImagePoints.of_grid(PointGrid(points)), *args)
    else:
        plan = plan_backprojection(grid, *args)
    if route in ('polar', 'parts'):  # a route for larger images than these
        polar = plan_polar(grid, *echoes[1:], block.radar, block.n_samples, target_db)
        plan = dataclasses.replace(plan, route=polar)
        assert isinstance(polar.parts, AzimuthParts) == (route == 'parts')
    image, compiled = (backprojected(name, plan, echoes, shape) for name in ('reference', 'cpu'))
    known = np.isfinite(points).all(axis=-1)
    routes = {'hills': 'points', 'parts': 'polar', 'wall': 'lines', 'volume': 'lines'}
    assert plan.method == routes.get(route, route)
    allowed_db = plan.predicted_error_db + CHANCE_DB
    assert error_db(image[known], exact(block, points[known])) <= allowed_db
    assert error_db(compiled, image) <= allowed_db
    assert not image[~known].any()


def test_only_windows_and_interpolators_of_the_plan_are_left(make_scene, error_db):
    """Along lines of a map whose profiles are used to their ends nothing is approximated."""
    scene = make_scene(1000.0, n=24)
    plan = plan_backprojection(scene.grid, scene.block.radar, scene.block.n_samples,
                               *scene.echoes[1:], -60.0)
    image = backprojected('reference', plan, scene.echoes, scene.grid.shape)
    # Knab's series errs by -130 dB, complex64 rounds to -150 dB.
    assert error_db(image, exact(scene.block, scene.grid.points())) < -125.0


def _afbp_plan(scene, target_db, route):
    """Plan of the sub-apertures, and the predicted error of the map."""
    grid, block = scene.grid, scene.block
    band = None if block.compressed else PhaseHistory(block.radar, block.n_samples)
    centres = block.tx_m, block.rx_m
    cover, polar_db = cover_for_fusion(grid, *centres, block.radar, block.n_samples, target_db,
                                       band)
    plan = plan_subapertures(cover.polar, block.radar, block.n_samples, *centres,
                             target_db=polar_db, cover=cover, band=band,
                             pulses_per_subaperture=16 if route == 'beams' else 48)
    beams = None
    if route == 'beams':  # a route for larger images than these
        some = [tuple(a[p].reshape(-1, 3) for a in centres) for p in plan.sampling.pulses]
        beams = plan_beams(plan.coarse, plan.radar, plan.lattice, some, target_db - 6.0,
                           plan.range_m[1] - plan.range_m[0])
        assert beams is not None
    plan = dataclasses.replace(plan, beams=beams)
    return plan, total_db(plan.predicted_error_db, cover.resampling_db, cover.profile_db)


def _fused(name, plan, scene, weights):
    made = backend(name)
    stage, fusion = made.SubapertureImager(plan), made.SpectrumFusion(plan.fusion_grid)
    for number, pulses in enumerate(plan.sampling.pulses):
        image = stage.image(number, scene.block.select(pulses), weights[pulses])
        fusion.add(number, image, plan.sampling.centre[number])
    return made.form_map(fusion.take_polar_image(), plan.fusion_grid, scene.grid,
                         overwrite=True)


@pytest.mark.parametrize('target_db', [-50.0, -60.0])
@pytest.mark.parametrize(('route', 'options'), [
    ('directly', {'range_m': 1000.0, 'height_m': 300.0}),
    ('directly', {'range_m': 3000.0, 'history': True}),
    ('beams', {'range_m': 3000.0, 'channels': 2, 'bend_m': 2.0}),
    ('beams', {'range_m': 1000.0, 'history': True})])
def test_afbp(make_scene, error_db, route, options, target_db):
    scene = make_scene(pulses=144, **options)
    plan, predicted_db = _afbp_plan(scene, target_db, route)
    block = scene.block
    weights = (0.5 + 0.5 * np.sin(0.02 * np.arange(block.n_pulses))).astype(np.float32)
    image, compiled = (_fused(name, plan, scene, weights) for name in ('reference', 'cpu'))
    weighted = dataclasses.replace(block, samples=block.samples * weights[:, None, None])
    assert error_db(image, exact(weighted, scene.grid.points())) <= predicted_db + CHANCE_DB
    assert error_db(compiled, image) <= predicted_db + CHANCE_DB


def test_fusion_keeps_contributions_as_the_compiled_one_does(make_scene, error_db):
    """Added, replaced, removed, and given at baseband along direction."""
    plan, _ = _afbp_plan(make_scene(1000.0, pulses=144), -50.0, 'directly')
    rng, grid = np.random.default_rng(5), plan.fusion_grid
    shape = 4, 2, grid.n_coarse, grid.n_coarse_range
    images = rng.standard_normal(shape).astype(np.float32)
    made = [backend(name).SpectrumFusion(grid, keep=True) for name in NAMES]
    for fusion in made:
        for number in range(3):
            fusion.add(number, images[number], 10.0 * number)
        fusion.add(1, images[3][0] + 1j * images[3][1], -7.0)
        fusion.remove(0)
        assert fusion.included == {1, 2}
    compiled, image = (fusion.polar_image(15.0) for fusion in made)
    # float32 in transforms and tapers
    assert error_db(compiled, image) < -125.0
    whole = made[1].polar_image()
    np.testing.assert_array_equal(made[1].take_polar_image(), whole)
    assert whole.any() and not made[1].included
    assert not made[1].polar_image().any()


def test_bad_contributions_are_refused_alike(make_scene):
    plan, _ = _afbp_plan(make_scene(1000.0, pulses=144), -50.0, 'directly')
    grid = plan.fusion_grid
    image = np.zeros((2, grid.n_coarse, grid.n_coarse_range), np.float32)
    for name in NAMES:
        made = backend(name)
        fusion = made.SpectrumFusion(grid)
        fusion.add(0, image, 0.0)
        with pytest.raises(ValueError, match='already; fuse with keep=True'):
            fusion.add(0, image, 0.0)
        with pytest.raises(ValueError, match='contributions are not kept'):
            fusion.remove(0)
        with pytest.raises(ValueError, match=r'image.shape=\(3,\)'):
            fusion.add(1, np.zeros(3), 0.0)
        with pytest.raises(ValueError, match='centre_m=nan'):
            fusion.add(1, image, np.nan)
        whole = dataclasses.replace(grid, alpha_oversampling=1.0)
        with pytest.raises(ValueError, match='not sampled finely enough'):
            made.form_map(image, whole, None)


@pytest.mark.parametrize('name', NAMES)
def test_entries_are_those_of_the_protocol(name):
    """The same arguments with the same defaults, the same methods and properties."""
    made = backend(name)

    def arguments(function):
        given = list(inspect.signature(function).parameters.values())
        return [(p.name, p.kind, p.default) for p in given if p.name != 'self']

    for protocol in (Backprojection, SubapertureImager, SpectrumFusion):
        entry = getattr(made, protocol.__name__)
        assert arguments(entry) == arguments(getattr(Backend, protocol.__name__))
        for method in (m for m in vars(protocol) if not m.startswith('_')):
            wanted, found = getattr(protocol, method), getattr(entry, method)
            assert isinstance(found, property) == isinstance(wanted, property)
            if not isinstance(found, property):
                assert arguments(found) == arguments(wanted)
    assert arguments(made.form_map) == arguments(Backend.form_map)


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
