# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Reference maps come back as they were written, or are refused by name."""

import dataclasses
import json

import numpy as np
import pytest
import yaml

from sar_imaging import Image, MapGrid
from sar_imaging.exploitation.registration import LookDirection, Speckle
from sar_imaging.formats.reference_map import (
    Pass,
    ReferenceMap,
    read_reference_map,
    write_reference_map,
)
from sar_imaging.geometry import Datum, PlaneGrid
from sar_imaging.imaging.image import Report

GRID = MapGrid((10.0, -4.0, 1.5), 7, 4, 0.25)


@pytest.fixture
def reference():
    amplitude = np.arange(28, dtype=np.float32).reshape(4, 7)
    occupancy = np.full((4, 7), -1, np.int8)
    occupancy[0, 1], occupancy[3, 6] = 100, 0
    return ReferenceMap(Image(amplitude, GRID, 9.6e9, Report('exact', '', -60.0)),
                        (Pass('monday', LookDirection(30.0, 20.0), 5),
                         Pass('tuesday', LookDirection(-30.0, 25.0), 7)),
                        np.full((4, 7), 2, np.uint16), 0.6, -31.5, None, occupancy)


def test_a_map_comes_back(reference, tmp_path):
    names = write_reference_map(tmp_path / 'map', reference)
    assert sorted(names) == sorted(path.name for path in (tmp_path / 'map').iterdir())
    back = read_reference_map(tmp_path / 'map')
    np.testing.assert_array_equal(back.image.samples, reference.image.samples)
    np.testing.assert_array_equal(back.seen, reference.seen)
    assert (back.image.grid, back.image.carrier_hz) == (GRID, 9.6e9)
    assert (back.passes, back.resolution_m, back.noise_floor_db, back.datum) == (
        reference.passes, 0.6, -31.5, None)


@pytest.fixture
def kept(reference):
    """The map with the complex image of its second pass."""
    samples = np.exp(1j * np.arange(28)).astype(np.complex64).reshape(4, 7)
    samples[0, 0] = 0
    speckle = Speckle(dataclasses.replace(reference.image, samples=samples), (-20.0, 3.0, 7.0))
    first, second = reference.passes
    return dataclasses.replace(reference, passes=(
        first, dataclasses.replace(second, speckle=speckle)))


def test_complex_images_of_passes_come_back_and_change_nothing_else(reference, kept, tmp_path):
    write_reference_map(tmp_path / 'before', reference)
    names = write_reference_map(tmp_path / 'map', kept)
    assert sorted(names) == sorted(path.name for path in (tmp_path / 'map').iterdir())
    assert set(names) - {path.name for path in (tmp_path / 'before').iterdir()} == {
        'complex_1.npy'}
    back, before = (read_reference_map(tmp_path / name) for name in ('map', 'before'))
    [speckle] = back.speckle
    assert speckle is back.passes[1].speckle and back.passes[0] == reference.passes[0]
    assert speckle.phase_centre_m == (-20.0, 3.0, 7.0) and speckle.turned_rad == 0.0
    assert (speckle.image.grid, speckle.image.carrier_hz) == (GRID, 9.6e9)
    np.testing.assert_array_equal(speckle.image.samples, kept.speckle[0].image.samples)
    # what looks at amplitudes finds what it found
    assert before.speckle == []
    assert before.passes == tuple(dataclasses.replace(p, speckle=None) for p in back.passes)
    np.testing.assert_array_equal(back.image.samples, before.image.samples)
    told, same = (json.loads((tmp_path / name / 'map.json').read_text())
                  for name in ('map', 'before'))
    assert set(same['passes'][1]) == {'name', 'look', 'stamp_ns'}
    del told['passes'][1]['complex']
    assert told == same


def test_complex_images_that_do_not_belong_to_the_map_are_refused_by_name(kept, tmp_path):
    def refused(message):
        with pytest.raises(ValueError, match=message):
            read_reference_map(tmp_path)

    write_reference_map(tmp_path, kept)
    path, whole = tmp_path / 'complex_1.npy', (tmp_path / 'complex_1.npy').read_bytes()
    path.write_bytes(whole[:-8])
    refused(r'complex_1\.npy')
    path.write_bytes(whole[:-1] + bytes([whole[-1] ^ 1]))
    refused(r'complex_1\.npy is damaged, or that of another map: .* make the map again')
    np.save(path, 2 * kept.speckle[0].image.samples)  # of the same place on another day
    refused(r'complex_1\.npy is damaged, or that of another map')
    np.save(path, np.ones((4, 7), np.complex128))
    refused(r'complex_1\.npy.*holds complex128 \(4, 7\); map\.json tells of complex64')
    path.unlink()
    refused(r'complex_1\.npy cannot be read: No such file')
    path.write_bytes(whole)
    told = json.loads((tmp_path / 'map.json').read_text())
    for wrong in ({}, {'phase_centre_m': [1.0, 2.0], 'crc32': 5},
                  {'phase_centre_m': [1.0, 2.0, float('nan')], 'crc32': 5},
                  {'phase_centre_m': [1.0, 2.0, 3.0], 'crc32': 'five'}, None):
        told['passes'][1]['complex'] = wrong
        (tmp_path / 'map.json').write_text(json.dumps(told))
        refused(r'map\.json cannot be read as a reference map: it cannot be understood')


def test_complex_images_that_are_no_part_of_the_map_are_not_written(kept, tmp_path):
    [speckle] = kept.speckle
    nan = np.full(GRID.shape, np.nan, np.complex64)
    for change in ({'samples': nan}, {'grid': MapGrid((0.0, 0.0, 1.5), 7, 4, 0.25)}):
        wrong = dataclasses.replace(speckle, image=dataclasses.replace(speckle.image, **change))
        passes = kept.passes[0], dataclasses.replace(kept.passes[1], speckle=wrong)
        with pytest.raises(ValueError, match='the complex image of tuesday'):
            write_reference_map(tmp_path / 'map', dataclasses.replace(kept, passes=passes))


def test_a_map_on_another_grid_is_refused(reference, tmp_path):
    reference.image.grid = PlaneGrid.wall((0, 0, 3), (1, 0), 1.5, 0.75, 0.25)
    with pytest.raises(ValueError, match='the map lies on a PlaneGrid; expected a MapGrid'):
        write_reference_map(tmp_path / 'map', reference)
    assert not list(tmp_path.iterdir())


def test_map_server_finds_cells_where_they_are(reference, tmp_path):
    write_reference_map(tmp_path, reference)
    told = yaml.safe_load((tmp_path / 'obstacles.yaml').read_text())
    # map_server: origin is the lower left corner of the lower left cell
    assert told['origin'] == pytest.approx([10.0 - 7 * 0.125, -4.0 - 4 * 0.125, 0.0])
    assert (told['resolution'], told['negate'], told['mode']) == (0.25, 0, 'trinary')
    header, size, most, cells = (tmp_path / told['image']).read_bytes().split(b'\n', 3)
    assert (header, size, most) == (b'P5', b'7 4', b'255')
    grey = np.frombuffer(cells, np.uint8).reshape(4, 7)
    share = (255 - grey) / 255.0  # how map_server reads occupancy
    assert share[0, 1] > told['occupied_thresh'] and share[3, 6] < told['free_thresh']
    rest = np.delete(share.ravel(), [1, 27])
    assert (rest > told['free_thresh']).all() and (rest < told['occupied_thresh']).all()


def test_a_map_whose_place_is_known_has_a_geotiff(reference, tmp_path):
    rasterio = pytest.importorskip('rasterio')
    known = dataclasses.replace(reference, datum=Datum(47.0, 8.0, 450.0))
    assert 'map.tif' in write_reference_map(tmp_path, known)
    assert read_reference_map(tmp_path).datum == known.datum
    with rasterio.open(tmp_path / 'map.tif') as file:
        assert file.descriptions == ('amplitude', 'passes')
        np.testing.assert_array_equal(file.read(1), reference.image.samples)


def test_damaged_maps_are_refused_by_name(reference, tmp_path):
    with pytest.raises(FileNotFoundError, match=r'map\.json does not exist'):
        read_reference_map(tmp_path / 'none')
    write_reference_map(tmp_path, reference)
    told = json.loads((tmp_path / 'map.json').read_text())
    for change, message in (({'version': 9}, 'version 9; expected 1'),
                            ({'grid': {}}, 'cannot be understood'),
                            ({'passes': [{}]}, 'cannot be understood')):
        (tmp_path / 'map.json').write_text(json.dumps(told | change))
        with pytest.raises(ValueError, match=message):
            read_reference_map(tmp_path)
    (tmp_path / 'map.json').write_text(json.dumps(told))
    np.save(tmp_path / 'amplitude.npy', np.ones((3, 3), np.float32))
    with pytest.raises(ValueError, match=r'amplitude\.npy.*holds float32 \(3, 3\)'):
        read_reference_map(tmp_path)
    (tmp_path / 'amplitude.npy').write_bytes(b'no array')
    with pytest.raises(ValueError, match=r'amplitude\.npy'):
        read_reference_map(tmp_path)
