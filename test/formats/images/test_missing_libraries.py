# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Libraries load when a file is written or read, and their absence is one clear line."""

import subprocess
import sys

import pytest

from sar_imaging.formats import (
    MissingExtraError,
    read_geotiff,
    read_sicd,
    write_geotiff,
    write_quicklook,
    write_sicd,
    write_stac_item,
)
from sar_imaging.geometry import MapGrid


def test_import_loads_no_library():
    code = ("import sys, sar_imaging.formats; print(sorted({'sarkit', 'rasterio', 'pyproj', "
            "'pystac', 'lxml', 'sarpy'} & set(sys.modules)))")
    told = subprocess.run([sys.executable, '-c', code], check=True, capture_output=True,
                          text=True).stdout
    assert told.strip() == '[]'


@pytest.mark.parametrize(('library', 'call', 'purpose'), [
    ('sarkit.sicd', lambda path, *image: write_sicd(path, *image), 'writing SICD'),
    ('sarkit.sicd', lambda path, *image: read_sicd(path), 'reading SICD'),
    ('rasterio', lambda path, *image: write_geotiff(path, *image[:2]), 'writing GeoTIFF'),
    ('rasterio', lambda path, *image: read_geotiff(path), 'reading GeoTIFF'),
    ('pyproj', lambda path, *image: write_geotiff(path, *image[:2], crs=32632),
     'a map projection'),
    ('rasterio', lambda path, *image: write_quicklook(path, *image[:2]), 'writing PNG'),
    ('pystac', lambda path, *image: write_stac_item(path, *image, {'data': __file__}),
     'writing a STAC item')])
def test_library_that_is_missing(flight, tmp_path, monkeypatch, library, call, purpose):
    if library == 'pyproj':
        pytest.importorskip('rasterio', reason='rasterio is not installed, and asked for first')
    flown = flight()
    image = flown.image(MapGrid((0, 0, 0), 9, 9, 0.2))
    monkeypatch.setitem(sys.modules, library, None)  # import raises ImportError
    with pytest.raises(MissingExtraError, match=f'{purpose} needs {library.split(".")[0]}, which '
                                                r'this Python does not have .*pip install'):
        call(tmp_path / 'image.png', image, flown.datum, flown.acquisition)
    assert not list(tmp_path.iterdir())
