# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Reference maps come back as they were written, or are refused by name."""

import dataclasses
import json

import numpy as np
import pytest
import yaml

from sar_imaging import Image, MapGrid
from sar_imaging.exploitation.registration import LookDirection
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
