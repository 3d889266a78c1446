# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Time-domain correlation: compiled loops against their formulas, and backends without it."""

import types

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from sar_imaging import backends
from sar_imaging.backends import cpu, reference
from sar_imaging.imaging.imager import plan_image
from sar_imaging.signal.pulses import PulseBlock
from sar_imaging.signal.radar import RadarParameters

SEEDS = st.integers(0, 2 ** 32 - 1)


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


def test_the_reference_correlates_whole_images(make_scene):
    scene = make_scene(range_m=1000.0, height_m=300.0)
    images = [plan_image(scene.grid, scene.block.radar, scene.block.n_samples,
                         method='correlation', backend=name)(scene.block).samples
              for name in ('cpu', 'reference')]
    np.testing.assert_allclose(*images, atol=1e-6 * np.abs(images[0]).max())


def test_a_backend_that_lacks_it_says_so(make_scene):
    scene = make_scene(range_m=1000.0, height_m=300.0)
    four = types.SimpleNamespace(**{entry: getattr(cpu, entry) for entry in backends._ENTRIES})
    imager = plan_image(scene.grid, scene.block.radar, scene.block.n_samples, backend=four,
                        method='correlation')
    with pytest.raises(ValueError, match="offers no correlate_profiles; use backend='cpu'"):
        imager(scene.block)
