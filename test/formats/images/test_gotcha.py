# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""The measured Gotcha pass as standard products."""

import pathlib

import numpy as np
import pytest

from sar_imaging.formats import Acquisition, read_sicd, sicd_grid, write_sicd
from sar_imaging.geometry import Datum
from sar_imaging.imaging.imager import plan_image
from sar_imaging.recordings import load

from .checker import failures

ROOT = pathlib.Path(__file__).resolve().parents[3]
MEASURED = ROOT.parent / 'shared' / 'data' / 'gotcha_pass1_hh'
pytestmark = [pytest.mark.data, pytest.mark.skipif(
    not MEASURED.is_dir(), reason='needs the Gotcha files in ../shared/data/gotcha_pass1_hh '
    'beside the repository')]


@pytest.mark.parametrize('plane', ['ground', 'slant'])
def test_measured_pulses_as_sicd(tmp_path, plane):
    pytest.importorskip('sarkit', reason='sarkit is not installed: it needs Python 3.11')
    block = load('gotcha', MEASURED).block
    acquisition = Acquisition.of(block, polarisation='H:H', collector='Gotcha')
    grid = sicd_grid(acquisition, (-15.6, 21.6, 0.0), 30.0, 30.0, plane=plane)
    image = plan_image(grid, block.radar, block.n_samples, compressed=block.compressed)(block)
    path, datum = tmp_path / 'gotcha.nitf', Datum(39.78, -84.09, 250.0)
    write_sicd(path, image, datum, acquisition)
    assert failures(path) == {}
    back = read_sicd(path)
    np.testing.assert_array_equal(back.image.samples, image.samples)
    # the brighter reflector, which is not quite on the plane
    brightest = np.unravel_index(np.abs(image.samples).argmax(), image.shape)
    assert np.linalg.norm(grid.positions(*brightest)[:2] - (-15.6, 21.6)) < 1.0
