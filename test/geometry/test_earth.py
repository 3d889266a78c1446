# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""The datum and WGS 84 coordinates, against PROJ and against what is known of the ellipsoid."""

import numpy as np
import pytest
from hypothesis import given, strategies as st

from sar_imaging.geometry.earth import Datum, ecef_to_geographic, geographic_to_ecef

# measured 2e-9 m over 100,000 places; positions of float64 at the Earth's radius resolve 1e-9 m
_TOLERANCE_M = 1e-8
_LATITUDES = st.floats(-90, 90)
_LONGITUDES = st.floats(-180, 180)
_HEIGHTS = st.floats(-10_000, 1e6)


def test_axes_of_the_ellipsoid():
    np.testing.assert_allclose(geographic_to_ecef(0, 0, 10), [6378147, 0, 0], atol=1e-9)
    np.testing.assert_allclose(geographic_to_ecef(90, 0, 0), [0, 0, 6356752.314245], atol=1e-6)
    np.testing.assert_allclose(geographic_to_ecef(0, 90, 0), [0, 6378137, 0], atol=1e-9)


@given(_LATITUDES, _LONGITUDES, _HEIGHTS)
def test_geographic_round_trip(latitude, longitude, height):
    point = geographic_to_ecef(latitude, longitude, height)
    again = geographic_to_ecef(*ecef_to_geographic(point))
    np.testing.assert_allclose(again, point, rtol=0, atol=_TOLERANCE_M)
    np.testing.assert_allclose(ecef_to_geographic(point)[2], height, rtol=0, atol=_TOLERANCE_M)


def test_agrees_with_proj():
    pyproj = pytest.importorskip('pyproj', reason='the extra "formats" is not installed')
    rng = np.random.default_rng(1)
    latitude, longitude = rng.uniform(-90, 90, 5000), rng.uniform(-180, 180, 5000)
    height = rng.uniform(-1e4, 1e6, 5000)
    to_ecef = pyproj.Transformer.from_crs('EPSG:4979', 'EPSG:4978', always_xy=True)
    expected = np.stack(to_ecef.transform(longitude, latitude, height), axis=-1)
    np.testing.assert_allclose(geographic_to_ecef(latitude, longitude, height), expected,
                               rtol=0, atol=_TOLERANCE_M)


@pytest.mark.parametrize('latitude', [0.0, 47.3, 70.0, -89.9999, 90.0])
@pytest.mark.parametrize('longitude', [0.0, 179.9999, -180.0, 200.0])
def test_local_frame(latitude, longitude):
    datum = Datum(latitude, longitude, 431.0, heading_deg=30.0)
    np.testing.assert_allclose(datum.axes_ecef @ datum.axes_ecef.T, np.eye(3), atol=1e-15)
    points = np.random.default_rng(2).uniform(-1e5, 1e5, (50, 3))
    np.testing.assert_allclose(datum.from_ecef(datum.to_ecef(points)), points, rtol=0,
                               atol=_TOLERANCE_M)
    np.testing.assert_allclose(datum.from_geographic(*datum.to_geographic(points)), points,
                               rtol=0, atol=2 * _TOLERANCE_M)
    # straight up from the origin nothing but the height changes
    lat, _, height = datum.to_geographic([0.0, 0.0, 100.0])
    assert lat == pytest.approx(latitude, abs=1e-12) and height == pytest.approx(531.0, abs=1e-8)


def test_heading_turns_the_axes_clockwise():
    north = Datum(45.0, 10.0, heading_deg=0.0)
    turned = Datum(45.0, 10.0, heading_deg=90.0)
    np.testing.assert_allclose(turned.axes_ecef[1], north.axes_ecef[0], atol=1e-15)  # y is east
    np.testing.assert_allclose(turned.axes_ecef[0], -north.axes_ecef[1], atol=1e-15)
    assert Datum(0, 190.0).longitude_deg == -170.0


@pytest.mark.parametrize('wrong, told', [
    (dict(latitude_deg=91.0, longitude_deg=0.0), 'exchanged'),
    (dict(latitude_deg=0.0, longitude_deg=-181.0), '-180 to 360'),
    (dict(latitude_deg=0.0, longitude_deg=float('nan')), 'finite'),
    (dict(latitude_deg=0.0, longitude_deg=0.0, height_m=1e9), 'ellipsoid'),
    (dict(latitude_deg=0.0, longitude_deg=0.0, heading_deg=400.0), 'heading_deg=400'),
])
def test_impossible_places(wrong, told):
    with pytest.raises(ValueError, match=told):
        Datum(**wrong)
