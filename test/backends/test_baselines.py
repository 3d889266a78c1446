"""Methods for comparison: compiled loops against their formulas, and backends that lack them."""

import types

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from sar_imaging import backends
from sar_imaging.backends import cpu, reference
from sar_imaging.geometry.point_grids import PointGrid
from sar_imaging.imaging.imager import plan_image
from sar_imaging.planning.baselines.ffbp_choice import plan_ffbp
from sar_imaging.planning.baselines.zero_padding import DELAYS, INTERPOLATORS, plan_zero_padding
from sar_imaging.signal.pulses import PulseBlock
from sar_imaging.signal.radar import RadarParameters

SEEDS = st.integers(0, 2 ** 32 - 1)
OVERSAMPLING = {'knab8': 1.8, 'cubic': 2.5, 'linear': 4.0}


def pulses(rng, n_samples):
    """Profiles of noise around 100 m, sampled at 1.5 times their band."""
    radar = RadarParameters(10e9, 200e6, 300e6, 2 * 100.0 / 3e8)
    shape = rng.integers(1, 5), rng.integers(1, 4)
    samples = rng.standard_normal((*shape, n_samples, 2)).astype(np.float32).view(np.complex64)
    tx = rng.uniform(-3.0, 3.0, (*shape, 3))
    number = np.arange(shape[0])
    return PulseBlock(radar, True, number, number, samples[..., 0], tx,
                      tx + rng.normal(0, 0.1, tx.shape))


def places(rng, block, n):
    """Positions in, before and behind the profiles."""
    depth = block.n_samples * block.radar.sample_spacing_m
    way = rng.standard_normal((n, 3))
    r = block.radar.range_start_m + rng.uniform(-0.3, 1.3, n) * depth
    return r[:, None] * way / np.linalg.norm(way, axis=1)[:, None]


@settings(max_examples=30, deadline=None)
@given(seed=SEEDS, n=st.integers(1, 40), n_samples=st.integers(1, 90))
def test_correlation(seed, n, n_samples):
    rng = np.random.default_rng(seed)
    block = pulses(rng, n_samples)
    points, centres = places(rng, block, n), (block.tx_m, block.rx_m)
    spectra = block.samples.astype(np.complex128)
    arguments = rng.uniform(0.1, 100.0, 2), spectra, *centres, points
    found, wanted = (b.correlate_spectra(*arguments) for b in (cpu, reference))
    # float64; phases of some 1e4 turns are known to 1e-12
    scale = np.sqrt(np.sum(np.abs(spectra) ** 2))
    assert np.abs(found - wanted).max() <= 1e-9 * n_samples * scale
    half, sharpness = int(rng.integers(1, 40)), rng.uniform(1.0, 15.0)
    arguments = block.radar, block.samples, *centres, points, half, sharpness
    (found, covered), (wanted, expected) = (b.correlate_profiles(*arguments)
                                            for b in (cpu, reference))
    assert np.abs(found - wanted).max() <= 1e-7 * scale
    np.testing.assert_array_equal(covered, expected)


@settings(max_examples=30, deadline=None)
@given(seed=SEEDS, n=st.integers(1, 40), n_samples=st.integers(8, 60),
       interpolator=st.sampled_from(INTERPOLATORS), delay=st.sampled_from(DELAYS),
       ratio=st.integers(1, 9))
def test_zero_padding(seed, n, n_samples, interpolator, delay, ratio):
    rng = np.random.default_rng(seed)
    block = pulses(rng, n_samples)
    points = np.concatenate([places(rng, block, n), block.tx_m[0, :1] + [[101.0, 0.0, 0.0]]])
    plan = plan_zero_padding(PointGrid(points), block.radar, n_samples, block.tx_m, block.rx_m,
                             interpolator=interpolator, ratio=ratio, delay=delay)
    found, wanted = (b.image_zero_padded(plan, block) for b in (cpu, reference))
    # single-precision transforms, and weights from a table
    scale = np.sqrt(np.sum(np.abs(block.samples) ** 2))
    assert np.abs(found - wanted).max() <= 1e-5 * scale


@pytest.mark.parametrize('kernel', ['knab8', 'cubic', 'linear'])
@pytest.mark.parametrize('options', [
    {'range_m': 1000.0, 'height_m': 300.0}, {'range_m': 1000.0, 'bend_m': 3.0, 'channels': 2},
    {'range_m': 60.0, 'aperture_m': 10.0, 'height_m': 20.0}])
def test_factorised_images(make_scene, error_db, options, kernel):
    scene = make_scene(pulses=40, **options)
    block = scene.block
    plan = plan_ffbp(scene.grid, block.radar, block.n_samples, block.tx_m, block.rx_m,
                     pulses_per_subaperture=5, merge_factor=2, kernel=kernel,
                     range_oversampling=(sampling := OVERSAMPLING[kernel]),
                     angle_oversampling=sampling)
    found, wanted = (b.FactorisedImager(plan).image(block) for b in (cpu, reference))
    # Both interpolate at the same places, but for expansions, rounding, and the polynomials of
    # neighbouring intervals, which a segment reads a little beyond. Measured: -29.9 dB and less.
    assert error_db(found, wanted) <= plan.predicted_error_db - 25.0


def test_the_reference_correlates_whole_images(make_scene):
    scene = make_scene(range_m=1000.0, height_m=300.0)
    images = [plan_image(scene.grid, scene.block.radar, scene.block.n_samples,
                         method='correlation', backend=name)(scene.block).samples
              for name in ('cpu', 'reference')]
    np.testing.assert_allclose(*images, atol=1e-6 * np.abs(images[0]).max())


def test_a_backend_that_lacks_a_method_says_so(make_scene):
    scene = make_scene(range_m=1000.0, height_m=300.0)
    four = types.SimpleNamespace(**{entry: getattr(cpu, entry) for entry in backends._ENTRIES})
    for method, backend, entry in (('correlation', four, 'correlate_profiles'),
                                   ('zero-padding', four, 'image_zero_padded'),
                                   ('ffbp', four, 'FactorisedImager'),
                                   ('wavenumber', 'reference', 'image_wavenumber')):
        imager = plan_image(scene.grid, scene.block.radar, scene.block.n_samples, method=method,
                            backend=backend)
        with pytest.raises(ValueError, match=f"offers no {entry}; use backend='cpu'"):
            imager(scene.block)
