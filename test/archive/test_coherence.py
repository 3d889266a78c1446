# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Coherence of two passes, tile by tile: that of the whole images, and complete or refused."""

from __future__ import annotations

import json

import numpy as np
import pytest

from sar_imaging.archive.job import Products
from sar_imaging.archive.pieces import ArchiveDataError, TilePiece
from sar_imaging.archive.storage import image_array
from sar_imaging.archive.tiles import stored_coherence
from sar_imaging.exploitation.passes import compare_passes
from sar_imaging.exploitation.passes.coherence import mean_sample, unbiased
from sar_imaging.imaging.image import Image, Report

from .small_archive import fly, make_archive

LEVELS = np.tanh(np.linspace(0.0, 5.0, 121))  # of the table that removes the bias


@pytest.fixture
def stack(tmp_path):
    """Two passes over the same pixels; of the second, some ground has changed."""
    rng = np.random.default_rng(3)  # two scatterers in a resolution cell
    # all within what is unambiguous along the track, 42 m
    points = np.column_stack([rng.uniform(-20, 20, 5000), rng.uniform(-60, 60, 5000),
                              np.zeros(5000)])
    amplitudes = rng.standard_normal((5000, 2)) @ [1.0, 1.0j]
    changed = amplitudes.copy()
    moved = np.abs(points[:, 1]) < 20
    changed[moved] = np.roll(changed[moved], 7)
    return make_archive(tmp_path, {
        'first': [(fly(0.0, scattered=(points, amplitudes)), 0.0)],
        'second': [(fly(0.0, 501.0, scattered=(points, changed)), 0.0)]},
        products=Products(coherence_window=5))


def pieces(archive):
    first, second = archive.scans
    extent = first.window.on_tiles(archive.job.tile)
    return [TilePiece(KIND='coherence', subject='first~second', key=f'c{n}', tile=tile,
                      extent=extent, marks=(first.fingerprint, second.fingerprint),
                      images=((first.name, first.window), (second.name, second.window)))
            for n, tile in enumerate(extent.tiles(archive.job.tile))]


def test_tiles_join_to_the_coherence_of_the_whole(stack):
    for scan in stack.scans:
        stack.image(scan)
    work = pieces(stack)
    assert len(work) >= 6
    results = [stack.compute(piece) for piece in work]
    window = stack.scans[0].window
    found, phase = (array.read(window) for array in stored_coherence(
        stack.output, 'first~second', work[0].extent, stack.job.tile))
    grid = window.grid(stack.job.spacing_m)
    images = [Image(image_array(stack.output, s.name, s.window, stack.job.tile).read(window),
                    grid, s.radar.carrier_hz, Report('exact', '', -50.0)) for s in stack.scans]
    whole = compare_passes(*images, window=5)
    # Looks of all tiles are 10 % fewer than those of the window: around the scatterers lie their
    # sidelobes. The coherence differs by the bias of so many looks and by nothing else.
    looks = json.loads((stack.output / 'coherence.zarr' / 'first~second' / 'pair.json').read_text()
                       )['pair']['looks']
    assert looks == pytest.approx(whole.looks, rel=0.15)
    sample = np.interp(whole.coherence, LEVELS, [mean_sample(g, whole.looks) for g in LEVELS])
    told = whole.coherence > 0  # others are below what unrelated images give
    assert np.abs(found - unbiased(sample, looks))[told].max() < 1e-3  # float32
    assert found[~told].max() < 0.11  # low coherences are roots of what looks differ: 0.15 / 13
    both = np.isfinite(phase) & np.isfinite(whole.phase_rad)
    assert both.sum() > 0.99 * np.isfinite(whole.phase_rad).sum()
    turn = np.angle(np.exp(1j * (phase - whole.phase_rad)))[both]
    assert np.abs(turn).max() < 1e-3
    assert sum(result.found['pixels'] for result in results) == window.n_pixels
    points = grid.points()
    changed, calm = (along & (np.abs(points[..., 0]) < 15) for along in (
        np.abs(points[..., 1]) < 15, np.abs(np.abs(points[..., 1]) - 40) < 12))
    assert np.median(found[changed]) < 0.6 < 0.8 < np.median(found[calm])


def test_tiles_are_the_same_bits_in_any_order(stack):
    for scan in stack.scans:
        stack.image(scan)
    work, found = pieces(stack), []
    for order in (work, work[::-1]):
        for piece in order:
            stack.compute(piece)
        found.append([a.read(work[0].extent).tobytes() for a in stored_coherence(
            stack.output, 'first~second', work[0].extent, stack.job.tile)])
        (stack.output / 'coherence.zarr' / 'first~second' / 'pair.json').unlink()
    assert found[0] == found[1]


def test_an_image_that_is_not_there_is_told(stack):
    stack.image(stack.scans[0])
    with pytest.raises(ArchiveDataError, match='the image of second_aperture-000 is not complete'):
        stack.compute(pieces(stack)[0])
