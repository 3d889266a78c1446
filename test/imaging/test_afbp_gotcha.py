"""AFBP of the measured Gotcha pass, a curved track, against exact backprojection."""

import pathlib

import numpy as np
import pytest

from sar_imaging.geometry import MapGrid
from sar_imaging.imaging.afbp import AfbpImager
from sar_imaging.imaging.backprojection import Backprojector
from sar_imaging.signal.range_compression import RangeCompressor
from sar_imaging.tools.load_gotcha import read_folder

MEASURED = pathlib.Path(__file__).parents[3] / 'shared' / 'data' / 'gotcha_pass1_hh'


@pytest.mark.skipif(not MEASURED.is_dir(), reason='the measured Gotcha files are not there')
def test_gotcha_over_100_metres():
    block = read_folder(MEASURED)
    profiles = RangeCompressor.for_block(block)(block)
    grid = MapGrid.from_size((0.0, 0.0, 0.0), 100.0, 100.0, 0.1)
    plan = AfbpImager(grid, profiles.radar, profiles.n_samples, profiles.tx_m, profiles.rx_m)
    image = plan(profiles)
    exact = Backprojector(grid, profiles.radar, profiles.n_samples)(profiles)
    error = 10 * np.log10(np.sum(np.abs(image - exact) ** 2) / np.sum(np.abs(exact) ** 2))
    assert error <= -50.0 and plan.predicted_error_db <= -50.0  # measured: -58.8
    row, column = np.unravel_index(np.abs(image).argmax(), image.shape)
    assert grid.x_m[column] == pytest.approx(-15.6, abs=0.11)  # the brighter reflector
    assert grid.y_m[row] == pytest.approx(21.6, abs=0.11)
