# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Bands of numbers on maps: values to the bit, places to half a centimetre."""

from __future__ import annotations

import numpy as np
import pytest

from sar_imaging.geometry import MapGrid
from sar_imaging.geometry.earth import Datum

rasterio = pytest.importorskip('rasterio', reason='the extra formats is not installed')
pyproj = pytest.importorskip('pyproj', reason='the extra formats is not installed')

from sar_imaging.formats.geotiff import write_raster  # noqa: E402

GRID = MapGrid((5.0, -3.0, 2.0), 37, 21, 0.5)
DATUM = Datum(47.0, 8.0, 400.0, 33.0)


def test_bands_come_back_with_names_and_places(tmp_path):
    values = np.arange(37 * 21, dtype=float).reshape(GRID.shape) / 7
    values[3, 4] = np.nan
    write_raster(tmp_path / 'a.tif', {'height': values, 'changed': values > 30}, GRID, DATUM)
    with rasterio.open(tmp_path / 'a.tif') as file:
        assert file.descriptions == ('height', 'changed')
        np.testing.assert_array_equal(file.read(1), values.astype(np.float32))
        np.testing.assert_array_equal(file.read(2), (values > 30).astype(np.float32))
        back = pyproj.Transformer.from_crs(file.crs, 4326, always_xy=True)
        for row, column in ((0, 0), (20, 36), (7, 11)):
            longitude, latitude = back.transform(*file.xy(row, column))
            true = DATUM.to_geographic(GRID.positions(row, column))
            place = DATUM.from_geographic(latitude, longitude, true[2])
            assert np.linalg.norm(place - GRID.positions(row, column)) < 0.005


def test_bands_of_another_shape_are_refused(tmp_path):
    with pytest.raises(ValueError, match="band 'height' has the shape"):
        write_raster(tmp_path / 'a.tif', {'height': np.zeros((2, 2))}, GRID, DATUM)
    assert not list(tmp_path.iterdir())
