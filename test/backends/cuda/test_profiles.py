# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Profiles on the device against their Fourier series, and samples of the host's integers."""

import numpy as np
import pytest

from sar_imaging.backends.cuda.arrays import complex_samples
from sar_imaging.backends.cuda.profiles import Profiles
from sar_imaging.backends.cuda.transfers import to_host
from sar_imaging.backends.reference.resample_profiles import profile_spectra, resample_profiles
from sar_imaging.planning.interpolators import design_interpolator
from sar_imaging.planning.profiles import PhaseHistory, RangeGate, RangeResampling


@pytest.mark.parametrize(('history', 'first', 'n_phases', 'degree', 'fold'), [
    (False, 3, 1, 3, 0), (False, 3, 2, 4, 5), (False, -9, 1, 3, 0), (True, 0, 2, 4, 5)])
def test_polynomials_are_the_profiles(make_scene, error_db, history, first, n_phases, degree,
                                      fold):
    scene = make_scene(500.0, n=16, pulses=2, history=history)
    block, samples = scene.block, scene.echoes[0]
    if history:
        source = PhaseHistory(block.radar, block.n_samples)
    else:
        source = RangeGate(block.radar, first, block.n_samples - 10, block.radar.range_start_m
                           + first * block.radar.sample_spacing_m, 6 if first > 0 else 0, 8)
    n_padded = source.n_samples if history else source.n_samples + 20
    radar, n_cells = source.radar, n_padded * 2 // n_phases
    step_m = n_padded * radar.sample_spacing_m / (n_cells * n_phases)
    resampling = RangeResampling(
        n_padded, n_cells, n_phases, 8, step_m, step_m, design_interpolator(
            radar.range_resolution_m / step_m, 0.03, degree=degree), -60.0)
    middle = source.range_start_m + n_padded * radar.sample_spacing_m / 2
    profiles = Profiles(source, resampling, (middle - 5.0, middle + 5.0), fold)
    planes = to_host(profiles.planes(samples))
    assert planes.shape == (2, n_phases, profiles.n_cells >> fold, degree + 1, 1 << fold)
    planes = planes.swapaxes(2, 3).reshape(2, n_phases, degree + 1, profiles.n_cells)
    assert not planes[..., :8].any() and not planes[..., -8:].any()
    t, inside = 0.3, slice(16, -16)
    powers = t ** np.arange(degree + 1)
    value = np.einsum('q,ruqc->rcu', powers, planes)[:, inside]
    cells = profiles.range_at(0) + np.arange(profiles.n_cells)[inside, None] * resampling.cell_m
    range_m = np.broadcast_to(cells + (np.arange(n_phases) + t) * step_m, value.shape)
    wanted = resample_profiles(source, profile_spectra(source, samples, n_padded), range_m)
    # the interpolator's own error, and float32's
    assert error_db(value, wanted) < resampling.interpolator.error_db + 3.0


def test_integers_are_converted_there():
    rng = np.random.default_rng(0)
    pairs = rng.integers(-2 ** 15, 2 ** 15, (3, 7, 2), dtype=np.int16)
    samples = to_host(complex_samples(pairs))
    assert samples.dtype == np.complex64
    np.testing.assert_array_equal(samples, pairs[..., 0] + 1j * pairs[..., 1])


def test_passes_are_whole(make_scene):
    """Echoes that share a reference for the phase are never divided."""
    scene = make_scene(500.0, n=16, pulses=2)
    block = scene.block
    resampling = RangeResampling(64, 128, 1, 8, 0.1, 0.1, design_interpolator(2.0, degree=4),
                                 -60.0)
    source = RangeGate.whole(block.radar, block.n_samples)
    profiles = Profiles(source, resampling, (block.radar.range_start_m,) * 2)
    n_rows = 1_000_000  # 17 GB of polynomials
    slices = list(profiles.chunks(n_rows, 32))
    assert len(slices) > 1 and slices[0].start == 0 and slices[-1].stop == n_rows
    assert all(one.stop == other.start and one.stop % 32 == 0
               for one, other in zip(slices, slices[1:], strict=False))
