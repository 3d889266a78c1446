# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""SICD files as the reference implementation and sarpy check and project them."""

import dataclasses

import numpy as np
import pytest

from sar_imaging.formats import sicd_grid, write_sicd
from sar_imaging.geometry import (
    MapGrid,
    PlaneGrid,
    PointGrid,
    TerrainGrid,
)
from sar_imaging.imaging.image import Image, Report
from sar_imaging.signal import RadarParameters

from .checker import failures

sksicd = pytest.importorskip('sarkit.sicd', reason='sarkit is not installed: it needs Python 3.11')


@pytest.mark.parametrize('plane', ['ground', 'slant'])
@pytest.mark.parametrize('left', [True, False], ids=['left', 'right'])
@pytest.mark.parametrize(('heading_deg', 'datum'), [
    (10.0, (0.0, 8.0, 0.0, 0.0)), (190.0, (70.0, 25.0, 300.0, 100.0)),
    (80.0, (-12.0, 180.0, 50.0, 0.0))],
    ids=['ascending at the equator', 'descending at 70 degrees', 'across the date line'])
def test_checker_finds_nothing(flight, tmp_path, plane, left, heading_deg, datum):
    flown = flight(left=left, heading_deg=heading_deg, datum=datum)
    path = tmp_path / 'image.nitf'
    write_sicd(path, flown.sicd_image(plane), flown.datum, flown.acquisition)
    assert failures(path) == {}


def stored(path):
    """Metadata and pixels as the reference implementation reads them."""
    with open(path, 'rb') as file, sksicd.NitfReader(file) as reader:
        return reader.metadata.xmltree, reader.read_image()


def missed_by(tree, pixels, points_ecef, peaks):
    """(S,) metres on the image plane from maxima to where the reference projects points."""
    [expected, _, found] = sksicd.scene_to_image(tree, points_ecef)
    assert found
    scp = [int(tree.findtext(f'{{*}}ImageData/{{*}}SCPPixel/{{*}}{name}'))
           for name in ('Row', 'Col')]
    spacing = [float(tree.findtext(f'{{*}}Grid/{{*}}{name}/{{*}}SS')) for name in ('Row', 'Col')]
    maxima = peaks(pixels.astype(complex), expected / spacing + scp)
    return np.linalg.norm((maxima - scp) * spacing - expected, axis=1)


@pytest.mark.parametrize('plane', ['ground', 'slant'])
@pytest.mark.parametrize('left', [True, False], ids=['left', 'right'])
@pytest.mark.parametrize('squint_m', [0.0, 900.0])
def test_reflectors_are_where_the_reference_projects_them(flight, peaks, tmp_path, plane, left,
                                                          squint_m):
    flown = flight(left=left, heading_deg=37.0, squint_m=squint_m)
    path = tmp_path / 'image.nitf'
    write_sicd(path, flown.sicd_image(plane), flown.datum, flown.acquisition)
    tree, pixels = stored(path)
    on_ground = missed_by(tree, pixels, flown.datum.to_ecef(flown.points_m), peaks)
    assert on_ground.max() < 0.004


def test_reflectors_above_the_plane_lie_over(flight, peaks, tmp_path):
    """Where range and range rate of the middle of the aperture meet the plane."""
    raised = ((0.0, 0.0, 2.0), (6.0, 5.0, -3.0), (-7.0, 9.0, 5.0))
    flown = flight(left=False, heading_deg=200.0, reflectors=raised)
    path = tmp_path / 'image.nitf'
    write_sicd(path, flown.sicd_image(), flown.datum, flown.acquisition)
    assert missed_by(*stored(path), flown.datum.to_ecef(flown.points_m), peaks).max() < 0.004


@pytest.mark.parametrize('plane', ['ground', 'slant'])
def test_bistatic_images(flight, peaks, tmp_path, plane):
    flown = flight(heading_deg=37.0, apart_m=700.0)
    path = tmp_path / 'image.nitf'
    write_sicd(path, flown.sicd_image(plane), flown.datum, flown.acquisition)
    assert failures(path) == {}
    tree, pixels = stored(path)
    assert tree.getroot().tag == '{urn:SICD:1.4.0}SICD'
    assert tree.findtext('{*}CollectionInfo/{*}CollectType') == 'BISTATIC'
    assert missed_by(tree, pixels, flown.datum.to_ecef(flown.points_m), peaks).max() < 0.004


@pytest.mark.parametrize('plane', ['ground', 'slant'])
def test_reflectors_are_where_sarpy_projects_them(flight, peaks, tmp_path, plane):
    converter = pytest.importorskip('sarpy.io.complex.converter', reason='sarpy is not installed')
    flown = flight(heading_deg=260.0, squint_m=300.0)
    path = tmp_path / 'image.nitf'
    write_sicd(path, flown.sicd_image(plane), flown.datum, flown.acquisition)
    reader = converter.open_complex(str(path))
    projected, _, _ = reader.sicd_meta.project_ground_to_image(
        flown.datum.to_ecef(flown.points_m), tolerance=1e-5, max_iterations=50)
    spacing = [reader.sicd_meta.Grid.Row.SS, reader.sicd_meta.Grid.Col.SS]
    missed = (peaks(np.asarray(reader[:], complex), projected) - projected) * spacing
    assert np.linalg.norm(missed, axis=1).max() < 0.004


@pytest.mark.parametrize('heading_deg', [5.0, 95.0, 185.0, 275.0])
@pytest.mark.parametrize('left', [True, False], ids=['left', 'right'])
def test_maps_are_turned_until_rows_lead_away(flight, peaks, tmp_path, heading_deg, left):
    flown = flight(heading_deg=heading_deg, left=left)
    image = flown.image(MapGrid((1.0, 2.0, 0.0), 150, 141, 0.25))
    path = tmp_path / 'map.nitf'
    write_sicd(path, image, flown.datum, flown.acquisition)
    assert failures(path) == {}
    tree, pixels = stored(path)
    assert missed_by(tree, pixels, flown.datum.to_ecef(flown.points_m), peaks).max() < 0.004
    # turned and mirrored, not resampled
    np.testing.assert_array_equal(np.sort(np.abs(pixels), axis=None),
                                  np.sort(np.abs(image.samples), axis=None))


def test_width_and_band_are_those_of_the_image(flight, tmp_path):
    flown = flight(reflectors=((0.0, 0.0, 0.0),))
    path = tmp_path / 'image.nitf'
    write_sicd(path, flown.sicd_image(), flown.datum, flown.acquisition)
    tree, pixels = stored(path)
    spectrum = np.abs(np.fft.fft2(pixels))
    for axis, name in enumerate(('Row', 'Col')):
        told = {part: float(tree.findtext(f'{{*}}Grid/{{*}}{name}/{{*}}{part}'))
                for part in ('SS', 'ImpRespWid', 'ImpRespBW', 'DeltaK1', 'DeltaK2')}
        cut = np.fft.fft(pixels[:, pixels.shape[1] // 2] if axis == 0
                         else pixels[pixels.shape[0] // 2])
        fine = np.abs(np.fft.ifft(np.fft.ifftshift(np.pad(np.fft.fftshift(cut), 32 * len(cut)))))
        above = np.count_nonzero(fine > fine.max() / np.sqrt(2)) * told['SS'] / 65
        assert told['ImpRespWid'] == pytest.approx(above, rel=0.02)  # the cut's ends ripple
        frequencies = np.fft.fftfreq(pixels.shape[axis], told['SS'])
        power = (spectrum**2).sum(axis=1 - axis)
        inside = (frequencies >= told['DeltaK1']) & (frequencies <= told['DeltaK2'])
        assert power[inside].sum() > 0.97 * power.sum()
        # and no wider than it is: its ends hold what the annulus of the band leaves there
        assert np.ptp(frequencies[power > 0.01 * power.max()]) > 0.93 * told['ImpRespBW']


def planned(grid, acquisition, samples=None):
    samples = np.ones(grid.shape, np.complex64) if samples is None else samples
    return Image(samples, grid, acquisition.radar.carrier_hz, Report('none', 'test', -60.0))


@pytest.mark.parametrize(('grid', 'told'), [
    (TerrainGrid(MapGrid((0, 0, 0), 9, 9, 0.2), np.zeros((9, 9))),
     'lies on terrain.*Write a GeoTIFF, or form the image on .*sicd_grid'),
    (PointGrid(np.zeros((4, 4, 3))), 'lies on a PointGrid; expected a MapGrid or PlaneGrid'),
    (MapGrid((0, 0, 0), 9, 9, 2.0), 'are 2 m apart, but the image has detail of 0'),
    (PlaneGrid.wall((0, 0, 3), (1, 0), 2.0, 2.0, 0.1), 'is upright'),
    (PlaneGrid((0, 0, 0), (0.1, 0, 0), (0.05, 0.1, 0), 9, 9), 'meet at 63.4349 degrees')])
def test_what_sicd_does_not_describe(flight, tmp_path, grid, told):
    flown = flight()
    path = tmp_path / 'image.nitf'
    with pytest.raises(ValueError, match=told):
        write_sicd(path, planned(grid, flown.acquisition), flown.datum, flown.acquisition)
    assert not list(tmp_path.iterdir())


def test_what_does_not_belong_together(flight, tmp_path):
    flown = flight()
    acquisition, grid = flown.acquisition, MapGrid((0, 0, 0), 9, 9, 0.2)
    image, path = planned(grid, acquisition), tmp_path / 'image.nitf'

    def refused(told, image=image, acquisition=acquisition, **more):
        with pytest.raises(ValueError, match=told):
            write_sicd(path, image, flown.datum, acquisition, **more)

    def acquired(**fields):
        return dataclasses.replace(acquisition, **fields)

    refused('the image has the carrier 1e.10 Hz, the acquisition 9.6e.09',
            dataclasses.replace(image, carrier_hz=10e9))
    refused('of 3 pulses, the acquisition has 96', dataclasses.replace(
        image, counters=np.arange(3)))
    refused(r'samples.shape=\(2, 9, 9\).*the image of each channel', dataclasses.replace(
        image, samples=np.ones((2, 9, 9))))
    refused('does not move', acquisition=acquired(tx_m=acquisition.tx_m[:1].repeat(96, axis=0),
                                                  rx_m=acquisition.rx_m[:1].repeat(96, axis=0)))
    refused('96 pulses within 0 s', acquisition=acquired(stamp_ns=np.zeros(96, int)))
    refused('pixel_type=.RGB.; expected one of RE32F_IM32F, RE16I', pixel_type='RGB')
    refused('classification=.none.', classification='none')
    sonar = RadarParameters(100e3, 20e3, 25e3, 0.01, propagation_speed_m_per_s=1500.0)
    refused('the waves travel at 1500 m/s', planned(grid, acquired(radar=sonar)),
            acquired(radar=sonar))
    with_nan = np.full(grid.shape, np.nan, np.complex64)
    refused('81 samples are NaN', planned(grid, acquisition, with_nan), pixel_type='RE16I_IM16I')


def test_grids_that_cannot_be(flight):
    acquisition = flight().acquisition
    with pytest.raises(ValueError, match='plane=.wall.; expected "ground" or "slant"'):
        sicd_grid(acquisition, (0, 0, 0), 10, 10, plane='wall')
    with pytest.raises(ValueError, match='range_size_m=-1; expected a positive length'):
        sicd_grid(acquisition, (0, 0, 0), -1, 10)
    below = acquisition.centre_m.mean(axis=0) * [1, 1, 0]
    with pytest.raises(ValueError, match='looks straight down'):
        sicd_grid(acquisition, below, 10, 10)


@pytest.mark.parametrize(('spacing_m', 'wanted'), [(None, 1.5), ((0.3, 0.25), None)])
def test_carrier_turns_by_whole_quarters(flight, spacing_m, wanted):
    acquisition = flight().acquisition
    grid = sicd_grid(acquisition, (0, 0, 0), 30, 20, spacing_m=spacing_m)
    row = np.linalg.norm(grid.step_v_m)
    distance = [np.linalg.norm(acquisition.centre_m - grid.positions(i, grid.n_u // 2), axis=1)
                for i in (grid.n_v // 2, grid.n_v // 2 + 1)]
    # of the middle of the band and of the aperture, whose ends see the row at an angle
    per_row = 4 * 2 * np.diff(distance, axis=0) / acquisition.radar.wavelength_m
    assert abs(per_row.mean() - round(per_row.mean())) < 0.02
    if wanted:
        resolution = 299792458.0 / (2 * 400e6)
        assert resolution * np.hypot(3000, 1500) / 3000 / row == pytest.approx(wanted, rel=0.05)
    else:
        assert 0.98 * 0.3 < row <= 0.3 and np.linalg.norm(grid.step_u_m) == pytest.approx(0.25)
