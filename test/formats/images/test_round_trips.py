"""Images come back from files as they went, to the bit where the type of the pixels allows it."""

import numpy as np
import pytest

from sar_imaging.formats import read_geotiff, read_sicd, sicd_grid, write_geotiff, write_sicd
from sar_imaging.geometry import MapGrid

pytest.importorskip('rasterio', reason='rasterio is not installed')
MAP = MapGrid((2.0, -3.0, 0.0), 130, 120, 0.3)


def test_complex_geotiff_is_equal_to_the_bit(flight, tmp_path):
    flown = flight()
    image = flown.image(MAP)
    path = tmp_path / 'image.tif'
    write_geotiff(path, image, flown.datum, content='complex')
    back = read_geotiff(path)
    np.testing.assert_array_equal(back.image.samples, image.samples)
    assert (back.image.grid, back.datum, back.image.carrier_hz) == (
        MAP, flown.datum, image.carrier_hz)
    assert (back.image.report, back.image.stamp_ns) == (image.report, image.stamp_ns)
    np.testing.assert_array_equal(back.image.counters, image.counters)


@pytest.mark.parametrize('plane', ['ground', 'slant'])
def test_sicd_is_equal_to_the_bit(flight, tmp_path, plane):
    pytest.importorskip('sarkit', reason='sarkit is not installed: it needs Python 3.11')
    flown = flight(left=False, heading_deg=123.0, squint_m=400.0)
    grid = sicd_grid(flown.acquisition, (1.0, 2.0, 0.5), 30.0, 24.0, plane=plane)
    image = flown.image(grid)
    path = tmp_path / 'image.nitf'
    write_sicd(path, image, flown.datum, flown.acquisition)
    back = read_sicd(path)
    np.testing.assert_array_equal(back.image.samples, image.samples)
    # ECEF coordinates of 6 million metres hold 1e-9
    np.testing.assert_allclose(back.image.grid.points(), grid.points(), rtol=0, atol=1e-8)
    assert back.datum == flown.datum
    assert back.image.carrier_hz == pytest.approx(image.carrier_hz, rel=1e-15)
    acquisition = back.acquisition
    assert (acquisition.polarisation, acquisition.collector) == ('V:H', 'test radar')
    np.testing.assert_allclose(acquisition.stamp_ns, flown.block.stamp_ns, rtol=0, atol=2)
    np.testing.assert_allclose(acquisition.tx_m, flown.block.tx_m[:, 0], rtol=0, atol=1e-4)
