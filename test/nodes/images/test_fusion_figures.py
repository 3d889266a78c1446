# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Figures that the fusion tells about an image: how long it took, how old its pulses are."""

import time
import types

import pytest

pytest.importorskip('rclpy', reason='the package of the nodes needs ROS')

from sar_imaging.geometry.grids import MapGrid
from sar_imaging.nodes.afbp_fusion import FusionStep
from sar_imaging.nodes.runtime.stage import COMMON_PARAMETERS
from sar_imaging.signal.range_compression import RangeCompressor
from sar_imaging.streaming.subapertures import LiveSubapertures


class Figures(dict):
    """What a step tells, without a node."""

    def __init__(self):
        super().__init__()
        self.set = self.__setitem__
        self.info = self.warning = lambda text: None

    def count(self, key, increment=1):
        self[key] = self.get(key, 0) + increment


def test_an_image_tells_its_work_once_and_the_age_of_its_pulses(psf):
    g = psf.truth['grid']
    grid = MapGrid(tuple(g['centre_m']), g['n_x'], g['n_y'], g['spacing_m'])
    profiles = RangeCompressor.for_block(psf.pulses)(psf.pulses).select(slice(0, 100))
    stage = LiveSubapertures(grid, pulses_per_aperture=100, pulses_per_subaperture=25)
    figures = Figures()
    defaults = {p.name: p.default for p in (*FusionStep.PARAMETERS, *COMMON_PARAMETERS)}
    step = FusionStep.create(defaults | {'pulses_per_aperture': 100}, figures)
    step._products = types.SimpleNamespace(publish=lambda *image: None)
    step._obstacles = types.SimpleNamespace(publish=lambda *image: None)
    began = time.perf_counter()
    [image] = [image for sub in stage.add(profiles) for image in step.process(sub)]
    step.received_s = time.monotonic() - 3.0
    step.publish(image)
    took = time.perf_counter() - began
    assert 0 < figures['last_image_seconds'] <= took
    assert 3.0 <= figures['image_latency_seconds'] <= 3.0 + took
    step.publish(image)
    assert figures['last_image_seconds'] == 0.0
    assert figures['images_published'] == figures['images_final'] == 2
