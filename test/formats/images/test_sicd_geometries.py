# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Every radar, flight and place that can be: the checker finds nothing in what is written."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from sar_imaging.formats import Acquisition, sicd_grid, write_sicd
from sar_imaging.geometry import Datum
from sar_imaging.imaging.image import Image, Report
from sar_imaging.signal import RadarParameters

from .checker import failures
from .damage import PROPERTY

# Carrier and band of the radars, hertz, and their ranges, metres: UWB drone, L to Ka band
# aircraft, satellite, car
RADARS = st.sampled_from([(600e6, 600e6, 60.0), (1.3e9, 80e6, 9e3), (9.6e9, 600e6, 20e3),
                          (35e9, 1e9, 3e3), (9.65e9, 300e6, 600e3), (77e9, 1e9, 20.0)])


@st.composite
def flights(draw):
    """Acquisition, datum and grid."""
    def number(low, high):
        return draw(st.floats(low, high))

    carrier, band, distance = draw(RADARS)
    heading, grazing, squint = number(0, 2 * np.pi), number(0.1, 1.2), number(-0.6, 0.6)
    ahead = np.array([np.sin(heading), np.cos(heading), number(-0.1, 0.1)])
    side = draw(st.sampled_from([-1, 1]))
    beside = side * np.array([ahead[1], -ahead[0], 0.0])
    middle = distance * (np.cos(grazing) * (np.cos(squint) * beside - np.sin(squint) * ahead)
                         + np.sin(grazing) * np.array([0, 0, 1.0]))
    n, speed = draw(st.integers(16, 400)), number(0.5, 300.0)
    length = distance * number(0.01, 0.3)
    along = length * np.linspace(-0.5, 0.5, n)[:, None]
    bend = number(-0.05, 0.05) * length * np.linspace(-1, 1, n)[:, None]**2 * beside
    track = middle + along * ahead + bend
    apart = draw(st.sampled_from([0.0, 0.0, 0.001, 0.2])) * distance * ahead
    stamps = draw(st.integers(0, 2 * 10**18)) + np.round(
        np.linspace(0, 1e9 * length / speed, n)).astype(np.int64)
    acquisition = Acquisition(RadarParameters(carrier, band, 1.25 * band, 0.0), stamps, track,
                              track + apart)
    datum = Datum(number(-89.9, 89.9), number(-180, 180), number(-100, 5000), number(0, 360))
    centre = 0.01 * distance * np.array([number(-1, 1), number(-1, 1), number(-1, 1)])
    plane = draw(st.sampled_from(['ground', 'slant']))
    grid = sicd_grid(acquisition, centre, 0.05 * distance, 0.05 * distance, plane=plane)
    return acquisition, datum, grid


@settings(max_examples=40, derandomize=True, **PROPERTY)
@given(flights())
def test_checker_finds_nothing_anywhere(tmp_path, flown):
    pytest.importorskip('sarkit', reason='sarkit is not installed: it needs Python 3.11')
    acquisition, datum, grid = flown
    # many pixels are a matter of the disk: the geometry is the same with fewer
    few = type(grid)(grid.origin_m, grid.step_u_m, grid.step_v_m, min(grid.n_u, 400),
                     min(grid.n_v, 400))
    image = Image(np.zeros(few.shape, np.complex64), few, acquisition.radar.carrier_hz,
                  Report('none', 'test', -60.0))
    path = tmp_path / 'image.nitf'
    write_sicd(path, image, datum, acquisition)
    assert failures(path) == {}


def test_the_local_spectrum_far_from_the_scene_centre_is_that_of_its_direction(tmp_path):
    """Straight over a short aperture the middle of the support is that of the middle pulse."""
    sicd = pytest.importorskip('sarkit.sicd', reason='sarkit is not installed')
    n, distance = 64, 100.0
    track = np.c_[np.full(n, -distance), np.linspace(-0.2, 0.2, n), np.zeros(n)]
    acquisition = Acquisition(RadarParameters(9.6e9, 100e6, 125e6, 0.0),
                              np.arange(n, dtype=np.int64) * 10**7, track, track)
    grid = sicd_grid(acquisition, np.zeros(3), 30.0, 30.0, plane='slant')
    path = tmp_path / 'image.nitf'
    write_sicd(path, Image(np.zeros(grid.shape, np.complex64), grid, 9.6e9,
                           Report('none', 'test', -60.0)), Datum(50.0, 8.0, 100.0), acquisition)
    with path.open('rb') as file, sicd.NitfReader(file) as reader:
        tree = sicd.ElementWrapper(reader.metadata.xmltree.getroot())
    away = np.array([10.0, -12.0])  # metres along rows, in range, and columns, across it
    look = np.array([distance + away[0], away[1]])
    cosine = abs(look[1]) / np.hypot(*look)
    expected = 2 * 9.6e9 / 299792458.0 * cosine  # cycles per metre, 6.9
    polynomial = np.asarray(tree['Grid']['Col']['DeltaKCOAPoly'])
    found = np.polynomial.polynomial.polyval2d(*away, polynomial)
    assert abs(found) == pytest.approx(expected, rel=0.01)  # 1 % of the band, 0.2 % of the pass
