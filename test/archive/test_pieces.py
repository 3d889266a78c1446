# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Pieces travel, and tell whether they are still the same."""

import dataclasses
import pickle
from pathlib import Path

from sar_imaging.archive.job import Job
from sar_imaging.archive.pieces import ScanPiece, TilePiece
from sar_imaging.archive.windows import Window
from sar_imaging.geometry.earth import Datum


def test_fingerprints_tell_what_is_computed_and_not_what_was_predicted():
    tile, mosaic = Window(0, 64, 0, 64), Window(0, 128, 0, 128)
    piece = TilePiece(KIND='mosaic', subject='', key='mosaic tile 0-0', tile=tile, extent=mosaic,
                      images=(('a', tile),), seconds=1.0)
    again = pickle.loads(pickle.dumps(piece))
    assert again == piece and again.fingerprint() == piece.fingerprint()
    assert dataclasses.replace(piece, seconds=2.0).fingerprint() == piece.fingerprint()
    other = dataclasses.replace(piece, images=(('a', tile), ('b', tile)))
    assert other.fingerprint() != piece.fingerprint()
    assert (ScanPiece(key='k', path=Path('a'), recording='a').fingerprint()
            != ScanPiece(key='k', path=Path('b'), recording='a').fingerprint())


def test_digests_tell_what_decides_bits():
    job = Job(('flights/*',), Path('/out'), 0.5)
    for name, value in {'recordings': ('others',), 'output': Path('/elsewhere'),
                        'retries': 9}.items():
        assert dataclasses.replace(job, **{name: value}).digest() == job.digest(), name
    digests = {job.digest()}
    for name, value in {'spacing_m': 0.25, 'datum': Datum(47.0, 8.0), 'height_m': 1.0,
                        'area_m': (0.0, 0.0, 1.0, 1.0), 'surface': 'ellipsoid',
                        'method': 'exact', 'target_db': -40.0, 'tile': 64,
                        'memory_bytes': 1e9, 'longest_piece_s': 5.0}.items():
        digests.add(dataclasses.replace(job, **{name: value}).digest())
    assert len(digests) == 11
