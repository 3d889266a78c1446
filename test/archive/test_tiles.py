# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Strips and mosaics: mean power of what covers a pixel, and how many images do."""

from __future__ import annotations

import numpy as np
from matplotlib.path import Path as Outline

from sar_imaging.archive.storage import image_array
from sar_imaging.archive.tiles import stored_looks
from sar_imaging.imaging.correlation import correlate_profiles


def mosaic(archive):
    power, looks = stored_looks(archive.output, '', archive.mosaic, archive.job.tile)
    return power.read(archive.mosaic), looks.read(archive.mosaic)


def expected(archive, scans):
    """Mean power and looks of correlation, all in float64."""
    grid = archive.mosaic.grid(archive.job.spacing_m)
    points = grid.points().reshape(-1, 3)
    total, looks = np.zeros(len(points)), np.zeros(len(points), int)
    for scan in scans:
        covered = Outline(scan.footprint_m).contains_points(points[:, :2], radius=1e-6)
        values, _ = correlate_profiles(archive.blocks[scan.name], points[covered])
        total[covered] += np.abs(values) ** 2
        looks[covered] += 1
    with np.errstate(invalid='ignore'):
        return (total / looks).reshape(grid.shape), looks.reshape(grid.shape)


def check(found, wanted, target_db):
    (power, looks), (true_power, true_looks) = found, wanted
    differ = looks != true_looks
    assert differ.mean() < 1e-3  # pixels on an edge of a footprint
    assert np.isnan(power[looks == 0]).all()
    both = (looks > 0) & ~differ
    error = np.abs(np.sqrt(power[both]) - np.sqrt(true_power[both])) ** 2
    assert 10 * np.log10(error.sum() / true_power[both].sum()) < target_db


def test_mosaic_is_the_mean_power_of_correlation(imaged):
    for piece in imaged.mosaic_tiles():
        assert imaged.compute(piece).found['missing'] == []
    found = mosaic(imaged)
    check(found, expected(imaged, imaged.scans), imaged.job.target_db)
    assert found[1].max() == 4


def test_strip_has_the_apertures_of_its_recording(imaged):
    pieces = imaged.strip_tiles('flight-2')
    for piece in pieces:
        imaged.compute(piece)
    power, looks = stored_looks(imaged.output, 'flight-2', pieces[0].extent, imaged.job.tile)
    rest = np.zeros(imaged.mosaic.shape, np.float32) * np.nan, np.zeros(imaged.mosaic.shape, int)
    cut = pieces[0].extent.within(imaged.mosaic)
    rest[0][cut], rest[1][cut] = power.read(pieces[0].extent), looks.read(pieces[0].extent)
    check(rest, expected(imaged, imaged.scans[2:]), imaged.job.target_db)


def test_mosaic_goes_on_without_lost_apertures(two_strips):
    lost, *imaged = two_strips.scans
    for scan in imaged:
        two_strips.image(scan)
    missing = [two_strips.compute(piece).found['missing'] for piece in two_strips.mosaic_tiles()]
    assert {name for names in missing for name in names} == {lost.name}
    check(mosaic(two_strips), expected(two_strips, imaged), two_strips.job.target_db)


def test_half_an_image_does_not_count(two_strips):
    """Pixels were written, but the worker died before it said so."""
    scan = two_strips.scans[0]
    two_strips.image(scan)
    [figures] = (two_strips.output / 'figures' / scan.name).glob('*-*.json')
    figures.unlink()
    for piece in two_strips.mosaic_tiles():
        two_strips.compute(piece)
    assert image_array(two_strips.output, scan.name, scan.window, 64).read(scan.window).any()
    assert not mosaic(two_strips)[1].any()


def test_the_same_bits_in_any_order(imaged):
    pieces = imaged.mosaic_tiles()
    for piece in pieces:
        imaged.compute(piece)
    first = mosaic(imaged)
    for piece in reversed(pieces):
        imaged.compute(piece)
    for one, other in zip(mosaic(imaged), first, strict=True):
        assert one.tobytes() == other.tobytes()
