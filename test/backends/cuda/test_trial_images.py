# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Trial images of a search on the device against the formula, and what a search makes of them."""

import numpy as np
import pytest

from sar_imaging.backends import backend
from sar_imaging.backends.cuda.arrays import given, xp


@pytest.mark.parametrize(('there', 'bias_m'), [(False, 0.0), (True, 0.5)])
def test_kernels_of_trial_images(make_scene, error_db, there, bias_m):
    """Some pixels see the ends of profiles, and beyond."""
    scene = make_scene(300.0, n=16, pulses=9, apart_m=5.0)
    block = scene.block
    end_m = block.radar.range_start_m + block.n_samples * block.radar.sample_spacing_m
    starts = np.array([[299.0, 1.0, 0.0], [block.radar.range_start_m - 2.0, 0.0, 1.0],
                       [end_m - 5.0, 0.5, 0.0]])
    step = np.array([0.3, 0.02, 0.0])
    samples = given(xp.asarray(block.samples)) if there else block.samples
    trials = (backend('cuda').TrialImages(block.radar, samples),
              backend('reference').TrialImages(block.radar, block.samples))
    image, wanted = (t.image(block.tx_m, block.rx_m, starts, step, bias_m) for t in trials)
    assert trials[0].length == trials[1].length == image.shape[2]
    assert isinstance(image, np.ndarray) and np.abs(image).sum(axis=(0, 2)).min() > 0
    assert error_db(image, wanted) < -105.0  # measured -111 dB: float32 weights and phases
