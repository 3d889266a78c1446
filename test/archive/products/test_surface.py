"""Surfaces at one height above the ellipsoid beside the curvature of the Earth."""

import pytest

from sar_imaging.archive.windows import surface_z
from sar_imaging.geometry import Datum


@pytest.mark.parametrize('height_m', [0.0, 300.0, -40.0])
def test_a_surface_is_at_its_height_and_falls_with_distance(height_m):
    datum = Datum(45.0, 7.0, 250.0)
    assert surface_z(0.0, 0.0, datum, height_m) == pytest.approx(height_m, abs=1e-6)
    distance = 10e3
    drop = height_m - surface_z(distance, 0.0, datum, height_m)
    # d^2 / 2R with radii of curvature of 6,335 to 6,400 km, and 4 m of 7.8 m more or less
    assert drop == pytest.approx(distance**2 / (2 * 6378e3), rel=0.01)
