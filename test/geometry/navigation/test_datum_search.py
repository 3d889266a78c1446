# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""The datum of a frame from fixes: against the datum that the fixes were made with."""

import math

import numpy as np
import pytest
from hypothesis import given, strategies as st

from sar_imaging.geometry.earth import Datum
from sar_imaging.geometry.navigation import DatumSearch, Fix, datum_through

# ECEF coordinates resolve 1e-9 m; places 200 km away carry it over a few sums.
_TOLERANCE_M = 2e-8
DATUMS = st.builds(Datum, st.floats(-89.0, 89.0), st.floats(-180, 180), st.floats(-400, 9000),
                   st.floats(-360, 360))
PLACES = st.tuples(*[st.floats(-1e4, 1e4)] * 2, st.floats(-500, 12_000))


def assert_same(found, datum, tolerance_m=_TOLERANCE_M):
    """The same frame: its origin and points a kilometre along each axis."""
    points = np.vstack([np.zeros(3), 1000 * np.eye(3)])
    np.testing.assert_allclose(found.to_ecef(points), datum.to_ecef(points), rtol=0,
                               atol=tolerance_m)


@given(DATUMS, PLACES)
def test_a_place_and_the_heading_tell_the_datum(datum, place):
    found = datum_through(datum.to_ecef(place), place, datum.heading_deg)
    assert_same(found, datum)
    assert DatumSearch(datum.heading_deg).add(datum.to_ecef(place), place).datum == found


def test_a_place_at_the_origin_is_the_fix_itself():
    fix = Fix(0, -33.5, 179.99999, 1234.5)
    found = datum_through(fix.ecef_m, (0.0, 0.0, 0.0), 30.0)
    np.testing.assert_allclose([found.latitude_deg, found.longitude_deg, found.height_m,
                                found.heading_deg], [-33.5, 179.99999, 1234.5, 30.0],
                               rtol=0, atol=1e-8)


@given(DATUMS, st.floats(0, 360), PLACES)
def test_places_along_a_straight_way_tell_the_heading_too(datum, course_deg, start):
    search = DatumSearch(baseline_m=500.0)
    course = math.radians(course_deg)
    step = 101.0 * np.array([math.sin(course), math.cos(course), 0.01])
    found = None
    for n in range(6):
        place = np.array(start) + n * step
        found = search.add(datum.to_ecef(place), place, 0.1)
        if n < 5:
            assert found is None and f'{n + 1} good fixes' in search.reason
            assert 'the heading needs 3 and 500 m' in search.reason
    # 1e-9 m of rounding over 500 m, carried to places 1 km and 15 km away
    assert_same(found.datum, datum, 1e-6)
    assert found.residual_m < 1e-6
    assert found.heading_std_deg == pytest.approx(math.degrees(0.1 / 505), rel=1e-6)


def test_the_heading_of_noisy_fixes_is_as_good_as_it_says():
    datum, rng = Datum(60.0, 24.0, 20.0, heading_deg=-123.0), np.random.default_rng(4)
    errors, told = [], []
    for _ in range(100):
        search, found = DatumSearch(baseline_m=100.0), None
        for x in range(1000):
            place = np.array([x, 0.3 * x, 50.0])
            found = search.add(datum.to_ecef(place + rng.normal(0, 1.0, 3)), place, 1.0)
            if found:
                break
        errors.append(math.remainder(found.datum.heading_deg - datum.heading_deg, 360))
        told.append(found.heading_std_deg)
    # What is told does not count on errors that differ from fix to fix, so it is no smaller.
    assert np.std(errors) < np.mean(told) < 5 * np.std(errors)


def test_standing_still_tells_no_heading():
    datum, search = Datum(1.0, 2.0), DatumSearch(baseline_m=10.0)
    for n in range(100):
        assert search.add(datum.to_ecef((0.001 * n, 0, 0)), (0.001 * n, 0, 0)) is None
    assert search.reason.startswith('1 good fixes at places up to 0 m apart')


def test_poses_that_contradict_the_fixes_are_told_and_forgotten():
    datum, search = Datum(1.0, 2.0), DatumSearch(baseline_m=100.0)
    with pytest.raises(ValueError, match=r'differ by 17.1 m over \d+ m of way, whatever the head'):
        for x in range(0, 200, 10):
            search.add(datum.to_ecef((x, 0, 0)), (2.0 * x, 0, 0), 0.01)  # another scale
    assert search.reason == 'fixes and poses contradict each other'
    found = None
    for x in range(0, 200, 10):
        found = found or search.add(datum.to_ecef((x, 0, 0)), (x, 0, 0), 0.01)
    assert_same(found.datum, datum, 1e-6)


@pytest.mark.parametrize('baseline_m', [0.0, 100.0])
def test_frames_that_are_no_tangent_plane_are_refused(baseline_m):
    search = DatumSearch(baseline_m=baseline_m)
    with pytest.raises(ValueError, match='5000 km from the origin of its frame; expected a local'):
        search.add(Datum(45.0, 9.0).to_ecef((0, 0, 0)), (0.0, 5e6, 0.0))
