# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Images of apertures: right, in parts, from disk, and with an error that is told."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest

from sar_imaging.archive import images
from sar_imaging.archive.images import StoredImage, _energy, aperture_pulses
from sar_imaging.archive.pieces import ArchiveDataError, ImagePiece, SumPiece
from sar_imaging.archive.storage import IMAGES, PARTIALS, image_array
from sar_imaging.archive.windows import Window, window_grid
from sar_imaging.imaging.correlation import correlate_profiles
from sar_imaging.recordings.bag_io import serialise


def stored(archive, scan):
    return image_array(archive.output, scan.name, scan.window, archive.job.tile).read(scan.window)


def correlated(archive, scan):
    """Correlation of every pixel of an aperture."""
    points = scan.window.grid(archive.job.spacing_m).points()
    return correlate_profiles(archive.blocks[scan.name], points.reshape(-1, 3))[0].reshape(
        points.shape[:2])


def error_db(image, reference):
    return 10 * np.log10(np.sum(np.abs(image - reference) ** 2) / np.sum(np.abs(reference) ** 2))


def quartered(window, tile):
    """Its parts on both sides of a line between tiles, along both axes."""
    row = (window.row0 // tile + 1) * tile
    column = (window.column0 // tile + 1) * tile
    return tuple(Window(*rows, *columns) for rows in ((window.row0, row), (row, window.row1))
                 for columns in ((window.column0, column), (column, window.column1)))


@pytest.mark.parametrize('way', ['whole', 'tiles', 'sub-apertures', 'both'])
def test_every_division_gives_the_image(two_strips, way):
    scan = two_strips.scans[1]
    windows = quartered(scan.window, two_strips.job.tile) if way in ('tiles', 'both') else None
    pulses = ((0, 13), (13, 30), (30, 48)) if way in ('sub-apertures', 'both') else None
    scan = two_strips.divided(scan, windows, pulses)
    results = two_strips.image(scan)
    reference = correlated(two_strips, scan)
    error = error_db(stored(two_strips, scan), reference)
    assert error < two_strips.job.target_db
    # a figure of 20 pixels of each part; that of few random ones has 1 dB, of few parts 2 dB
    figures = StoredImage.open(two_strips.output, scan.name).figures(two_strips.output)
    assert len(figures) == len(scan.division.windows)
    assert results[-1].predicted_error_db < two_strips.job.target_db
    measured = [r.measured_error_db for r in results if r.measured_error_db is not None]
    assert max(measured) < two_strips.job.target_db + 10
    assert max(measured) > error - 10
    assert not list((two_strips.output / PARTIALS).glob('*/part*'))


def test_energy_is_that_of_pixels_with_a_value():
    assert _energy(np.array([[3.0 + 4.0j, 0.0], [1.0j, 0.0]], np.complex64)) == (26.0, 2)


def test_messages_of_no_use_leave_the_others(two_strips, monkeypatch):
    """Damaged bytes and pulses of another length between those of the aperture."""
    scan = two_strips.scans[0]
    block = next(aperture_pulses(scan, two_strips.output).profiles(1e9))
    other = dataclasses.replace(block, samples=block.samples[..., :-1])
    useless = [(0, b'damaged'), (0, serialise(other))]
    plain = images.raw_messages
    monkeypatch.setattr(images, 'raw_messages', lambda *given: [*useless, *plain(*given)])
    found = aperture_pulses(scan, two_strips.output).profiles(1e9)
    assert sum(block.n_pulses for block in found) == scan.n_pulses


def test_the_error_told_is_that_of_the_pixels_compared(two_strips):
    """With all pixels compared it is the error by its definition."""
    scan = two_strips.scans[0]
    job = dataclasses.replace(two_strips.job, checked_pixels=10**6)
    [result] = two_strips.image(scan, job)
    error = error_db(stored(two_strips, scan), correlated(two_strips, scan))
    # pixels near the ends of profiles are left out, 1 % here
    assert result.measured_error_db == pytest.approx(error, abs=0.5)


@pytest.mark.parametrize('way', ['whole', 'sub-apertures'])
def test_the_same_bits_again(two_strips, way):
    scan = two_strips.scans[0]
    if way == 'sub-apertures':
        scan = two_strips.divided(scan, None, ((0, 20), (20, 48)))
    two_strips.image(scan)
    first = stored(two_strips, scan)
    two_strips.image(scan)
    np.testing.assert_array_equal(stored(two_strips, scan).view(np.float32),
                                  first.view(np.float32))


def test_zarr_reads_the_image(two_strips):
    import zarr

    scan = two_strips.scans[0]
    two_strips.image(scan)
    group = zarr.open_group(str(two_strips.output / IMAGES), mode='r')
    array = group[scan.name]
    row0, row1, column0, column1 = array.attrs['window']
    first_row, _, first_column, _ = array.attrs['extent']
    cut = array[row0 - first_row:row1 - first_row, column0 - first_column:column1 - first_column]
    np.testing.assert_array_equal(cut, stored(two_strips, scan))
    assert array.attrs['pulses'] == 48 and array.chunks == (64, 64)


def test_pulses_that_are_gone_are_told(two_strips):
    """The scan has seen more pulses than the recording has: it was replaced."""
    scan = two_strips.scans[0]
    counter, stamp, tx, rx = scan.phase_centres(two_strips.output)
    counter[-1] += 5000
    np.savez(two_strips.output / scan.centres, counter=counter, stamp_ns=stamp, tx_m=tx, rx_m=rx,
             message_ns=np.zeros(0, np.int64))
    with pytest.raises(ArchiveDataError, match='has 47 of the 48 pulses.*it has changed'):
        two_strips.image(scan)
    assert not (two_strips.output / IMAGES).exists()


def test_windows_that_share_tiles_are_refused(two_strips):
    scan, window = two_strips.scans[0], two_strips.scans[0].window
    half = dataclasses.replace(window, row1=window.row0 + 3)
    with pytest.raises(ValueError, match='expected edges between tiles'):
        two_strips.compute(ImagePiece(key='i', scan=scan, window=half, pulses=(0, 48)))


def test_figures_are_json(two_strips):
    scan = two_strips.scans[0]
    two_strips.image(scan)
    [path] = (two_strips.output / 'figures' / scan.name).glob('*-*.json')
    told = json.loads(path.read_text())
    assert told['method'] == 'exact' and len(told['index']) == 20


def test_a_sum_whose_worker_died_late_goes_on(two_strips):
    """The sum was written and its parts are gone, but nobody heard of it."""
    scan = two_strips.divided(two_strips.scans[0], None, ((0, 20), (20, 48)))
    [first] = two_strips.image(scan)
    before = stored(two_strips, scan)
    again = two_strips.compute(SumPiece(key='s', scan=scan, window=scan.window,
                                        parts=('part0', 'part1')))
    assert again.measured_error_db == first.measured_error_db
    np.testing.assert_array_equal(stored(two_strips, scan), before)


def test_pixels_on_the_ellipsoid(two_strips):
    """A reflector on the Earth 50 km from the datum, 197 m below the map's plane, stays there."""
    job = dataclasses.replace(two_strips.job, surface='ellipsoid')
    window = Window(-30_000, -29_990, 40_000, 40_012)
    grid = window_grid(window, job)
    points = grid.points()
    np.testing.assert_array_equal(points[..., :2],
                                  window.grid(job.spacing_m).points()[..., :2])
    _, _, height = job.datum.to_geographic(points)
    np.testing.assert_allclose(height, job.datum.height_m, atol=1e-6)
    # of a sphere: distance^2 / 2 R, within the flattening of the Earth
    drop = np.hypot(40_000, 30_000) ** 2 / 2 / 6.371e6
    np.testing.assert_allclose(points[..., 2], -drop, rtol=0.005)
