# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""GeoTIFF as rasterio and pyproj see it: reflectors at their latitude and longitude."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from scipy import ndimage

from sar_imaging.formats import read_geotiff, write_geotiff
from sar_imaging.formats.quicklook import decibels, grey_levels, limits_db
from sar_imaging.geometry import Datum, MapGrid, PlaneGrid, TerrainGrid, VolumeGrid
from sar_imaging.imaging.image import Image, Report
from sar_imaging.quality import error_db

from .damage import PROPERTY, Content, damaged, mutations

rasterio = pytest.importorskip('rasterio', reason='rasterio is not installed')
pyproj = pytest.importorskip('pyproj', reason='pyproj is not installed')

MAP = MapGrid((1.0, -2.0, 0.0), 240, 230, 0.15)
GEOD = pyproj.Geod(ellps='WGS84')
CLOSE_M = 0.005  # half a centimetre


def open_map(path):
    """Samples of a file and a function from (S, 2) pixels to latitude and longitude."""
    with rasterio.open(path) as file:
        band, crs, transform = file.read(1), file.crs, file.transform
    to_earth = pyproj.Transformer.from_crs(pyproj.CRS.from_user_input(crs), 4326, always_xy=True)

    def place(pixels):
        x, y = transform * (pixels[:, 1] + 0.5, pixels[:, 0] + 0.5)
        return to_earth.transform(x, y)[::-1]

    def pixel(latitude, longitude):
        x, y = to_earth.transform(longitude, latitude, direction='INVERSE')
        column, row = ~transform * (np.asarray(x), np.asarray(y))
        return np.column_stack([row, column]) - 0.5

    return band, place, pixel


def missed_m(path, flown, peaks):
    """(S,) metres on the Earth from maxima of a file to the reflectors' true places."""
    band, place, pixel = open_map(path)
    power = np.abs(band)**2 if band.dtype == np.complex64 else np.nan_to_num(10**(band / 10))
    latitude, longitude, _ = flown.datum.to_geographic(flown.points_m)
    found = place(peaks(power.astype(complex), pixel(latitude, longitude)))
    return GEOD.inv(longitude, latitude, found[1], found[0])[2]


@pytest.mark.parametrize('content', ['decibels', 'complex'])
@pytest.mark.parametrize('datum', [
    (47.0, 8.0, 400.0, 30.0), (0.0, 11.95, 2000.0, 0.0), (70.0, 25.0, 0.0, -100.0),
    (-33.0, -180.0, 50.0, 211.0), (-85.0, 40.0, 3000.0, 10.0)])
def test_reflectors_are_at_their_places(flight, peaks, tmp_path, content, datum):
    flown = flight(datum=datum)
    path = tmp_path / 'image.tif'
    write_geotiff(path, flown.image(MAP), flown.datum, content=content)
    assert missed_m(path, flown, peaks).max() < CLOSE_M


@pytest.mark.parametrize('crs', ['local', 32632, 'EPSG:25832', 3857, 4326])
@pytest.mark.parametrize('north_up', [False, True])
def test_reflectors_in_projections_that_are_asked_for(flight, peaks, tmp_path, crs, north_up):
    flown = flight()
    path = tmp_path / 'image.tif'
    place = write_geotiff(path, flown.image(MAP), flown.datum, crs=crs, north_up=north_up,
                          acquisition=flown.acquisition)
    assert missed_m(path, flown, peaks).max() < CLOSE_M
    if north_up:
        assert (place.affine[0, 1], place.affine[1, 0]) == (0, 0)


def test_default_is_the_zone_of_the_image(flight, tmp_path):
    flown, path = flight(datum=(-33.0, -179.99, 50.0, 0.0)), tmp_path / 'image.tif'
    write_geotiff(path, flown.image(MAP), flown.datum)
    with rasterio.open(path) as file:
        assert file.crs.to_epsg() == 32701


def test_interpolated_pixels_are_those_that_imaging_gives(flight, tmp_path):
    flown = flight()
    path = tmp_path / 'image.tif'
    write_geotiff(path, flown.image(dataclasses.replace(MAP, spacing_m=0.25)), flown.datum,
                  content='complex', acquisition=flown.acquisition, north_up=True)
    image = read_geotiff(path).image
    inside = image.samples != 0
    assert np.count_nonzero(inside) > 50_000
    exact = flown.image(image.grid).samples
    # beside the edge, samples are missing on one side
    assert error_db(image.samples[inside], exact[inside]) < -50
    inside = ndimage.binary_erosion(inside, iterations=6)
    assert error_db(image.samples[inside], exact[inside]) < -70


def test_edge_of_a_map(flight, tmp_path):
    """Longitudes jump from 180 to -180 within the image."""
    flown = flight(datum=(10.0, 180.0, 0.0, 0.0))
    image, path = flown.image(MAP), tmp_path / 'image.tif'
    with pytest.raises(ValueError, match='in WGS 84 the image would need .* pixels, here it has '
                                         '230 by 240: it lies on the edge of this map'):
        write_geotiff(path, image, flown.datum, crs=4326, acquisition=flown.acquisition)
    write_geotiff(path, image, flown.datum, crs=32660)
    assert path.exists()


def test_cloud_optimised(flight, tmp_path):
    cogeo = pytest.importorskip('rio_cogeo.cogeo', reason='rio-cogeo is not installed')
    flown, path = flight(), tmp_path / 'image.tif'
    image = Image(np.ones((1300, 1100), np.complex64), MapGrid((0, 0, 0), 1100, 1300, 0.1),
                  9.6e9, Report('none', 'test', -60.0))
    for content in ('decibels', 'quicklook', 'complex'):
        write_geotiff(path, image, flown.datum, content=content)
        assert cogeo.cog_validate(path, strict=True) == (True, [], [])


def large(half_m):
    return MapGrid((0, 0, 0), 101, 101, half_m / 50)


def blank(grid):
    return Image(np.zeros(grid.shape, np.complex64), grid, 9.6e9, Report('none', 'test', -60.0))


@pytest.mark.parametrize(('half_m', 'name'), [
    (300, 'WGS 84 / UTM zone 32N'), (5500, 'Transverse Mercator about the image')])
def test_large_images_get_a_projection_of_their_own(tmp_path, half_m, name):
    """UTM's scale changes by 1e-7 a metre; about the image it is a millimetre over 4 km."""
    datum, grid, path = Datum(47.0, 6.1, 500.0, 12.0), large(half_m), tmp_path / 'image.tif'
    place = write_geotiff(path, blank(grid), datum)
    assert place.crs.name == name
    _, to_earth, _ = open_map(path)
    row, column = (part.ravel() for part in np.indices(grid.shape))
    latitude, longitude = to_earth(np.column_stack([row, column]))
    true = datum.to_geographic(grid.positions(row, column))
    missed = GEOD.inv(true[1], true[0], longitude, latitude)[2]
    # every pixel, against some that were looked at; 1e-5 m are pyproj's digits
    assert missed.max() < place.error_m * 1.05 + 1e-5 < 0.0026


def test_what_is_too_large_is_interpolated(flight, tmp_path):
    """To UTM, 20 km with a blob near a corner."""
    datum, grid, path = Datum(47.0, 8.0, 500.0, 12.0), large(10_000), tmp_path / 'image.tif'
    with pytest.raises(ValueError, match='pixels would lie up to 0.01.* m .*give the acquisit'):
        write_geotiff(path, blank(grid), datum)
    acquisition = flight().acquisition

    def blob(points):
        away = np.linalg.norm(points - acquisition.tx_m[acquisition.n_pulses // 2], axis=-1)
        cycles = 2 * away / acquisition.radar.wavelength_m
        return np.exp(2j * np.pi * (cycles % 1)
                      - 0.5 * ((points - (-7033.0, 6521.0, 0.0))**2).sum(axis=-1) / 400.0**2)

    samples = blob(grid.points()).astype(np.complex64)
    place = write_geotiff(path, dataclasses.replace(blank(grid), samples=samples), datum,
                          content='complex', acquisition=acquisition)
    assert place.crs.to_epsg() == 32632
    image = read_geotiff(path).image
    points = image.grid.points()
    np.testing.assert_allclose(points[..., 2], 0.0, atol=1e-6)  # on the plane that was imaged
    row, column = (part.ravel() for part in np.indices(image.shape))
    _, to_earth, _ = open_map(path)
    latitude, longitude = to_earth(np.column_stack([row, column]))
    true = datum.to_geographic(points.reshape(-1, 3))
    assert GEOD.inv(true[1], true[0], longitude, latitude)[2].max() < 1e-4  # pyproj's digits
    inside = image.samples != 0
    assert error_db(image.samples[inside], blob(points[inside])) < -70


def test_terrain(flight, tmp_path, peaks):
    """Reflectors on a slope: pixels lie at their heights, and so do latitude and longitude."""
    points = ((0.0, 0.0, 40.0), (9.0, 4.0, 40.0 + 0.2 * 9.0), (-8.0, 7.0, 40.0 - 0.2 * 8.0))
    flown = flight(reflectors=points)
    heights = 40.0 + 0.2 * np.broadcast_to(MAP.x_m, MAP.shape)
    path = tmp_path / 'image.tif'
    image = flown.image(TerrainGrid(MAP, heights))
    write_geotiff(path, image, flown.datum)
    assert missed_m(path, flown, peaks).max() < CLOSE_M
    write_geotiff(path, image, flown.datum, north_up=True, acquisition=flown.acquisition)
    assert missed_m(path, flown, peaks).max() < CLOSE_M


def test_decibels():
    samples = np.array([[1.0, 10j, 0.0], [-1e-3, 3 + 4j, np.nan]], np.complex64)
    np.testing.assert_allclose(decibels(samples), [[0, 20, np.nan], [-60, 13.9794, np.nan]],
                               rtol=1e-5)


def test_grey_levels():
    rng = np.random.default_rng(3)
    clutter = rng.normal(size=(300, 300)) + 1j * rng.normal(size=(300, 300))
    clutter[7, 8] = 1e6
    levels = decibels(clutter.astype(np.complex64))
    black, white = limits_db(levels)
    # the median of the power of clutter is 2 ln 2; its thousandth quantile from above -2 ln 0.001
    assert white == pytest.approx(10 * np.log10(-2 * np.log(1e-3)), abs=0.2)
    assert black == pytest.approx(white - 30.0)
    grey = grey_levels(levels, black, white)
    assert grey[7, 8] == 255 and grey.min() >= 1 and 100 < np.median(grey) < 200
    assert grey_levels(np.array([np.nan, black, white]), black, white).tolist() == [0, 1, 255]
    assert limits_db(np.array([np.nan])) == (-60.0, 0.0)


@pytest.mark.parametrize(('grid', 'more', 'told'), [
    (MAP, {'content': 'jpeg'}, 'content=.jpeg.; expected one of complex, decibels, quicklook'),
    (MAP, {'crs': 'EPSG:1'}, "crs='EPSG:1'; expected an EPSG number such as 32632"),
    (MAP, {'crs': 4978}, 'expected a projected or a geographic CRS'),
    (MAP, {'north_up': True}, 'north_up interpolates: give the acquisition'),
    (PlaneGrid.wall((0, 0, 3), (1, 0), 2.0, 2.0, 0.1), {}, 'rises by 100 %; a map is level'),
    (VolumeGrid.above(large(10), 10.0), {}, 'lies on a VolumeGrid; expected a MapGrid')])
def test_what_is_no_map(tmp_path, grid, more, told):
    image = blank(grid)
    if len(grid.shape) == 3:
        image = dataclasses.replace(image, samples=image.samples[0])
    with pytest.raises(ValueError, match=told):
        write_geotiff(tmp_path / 'image.tif', image, Datum(47.0, 8.0), **more)
    assert not list(tmp_path.iterdir())


def test_files_of_others(tmp_path):
    path = tmp_path / 'image.tif'
    with pytest.raises(FileNotFoundError, match='expected GeoTIFF'):
        read_geotiff(path)
    write_geotiff(path, blank(MAP), Datum(47.0, 8.0))
    with pytest.raises(ValueError, match='it holds 1 bands of float32; expected one of complex64'):
        read_geotiff(path)
    with rasterio.open(path, 'w', driver='GTiff', height=4, width=4, count=1,
                       dtype='complex64') as file:
        file.write(np.zeros((1, 4, 4), np.complex64))
    with pytest.raises(ValueError, match='it has no tag SAR_IMAGING; expected a file of wri'):
        read_geotiff(path)
    path.write_bytes(b'not at all')
    with pytest.raises(ValueError, match='cannot be read as GeoTIFF'):
        read_geotiff(path)


@pytest.fixture(scope='module')
def written(tmp_path_factory):
    """Bytes of a small file."""
    path = tmp_path_factory.mktemp('geotiff') / 'image.tif'
    grid = MapGrid((0, 0, 0), 40, 30, 0.5)
    rng = np.random.default_rng(5)
    samples = rng.normal(size=(30, 40)) + 1j * rng.normal(size=(30, 40))
    write_geotiff(path, dataclasses.replace(blank(grid), samples=samples.astype(np.complex64)),
                  Datum(47.0, 8.0), content='complex')
    return Content(path.read_bytes())


def survives(tmp_path, written, changes):
    """A damaged file is read, or refused, within the memory of its size."""
    tag = written.index(b'counters')
    path = tmp_path / 'damaged.tif'
    path.write_bytes(damaged(written, changes, [(0, 600), (tag, tag + 900)]))
    try:
        image = read_geotiff(path).image
    except ValueError as error:
        assert 'damaged.tif' in str(error)
    else:
        assert image.samples.nbytes < 1032 * len(written)


@settings(max_examples=300, derandomize=True, **PROPERTY)
@given(mutations())
def test_damaged_files(written, tmp_path, little_memory, changes):
    survives(tmp_path, written, changes)


@pytest.mark.campaign
@settings(max_examples=10_000, **PROPERTY)
@given(mutations())
def test_many_damaged_files(written, tmp_path, little_memory, changes):
    survives(tmp_path, written, changes)
