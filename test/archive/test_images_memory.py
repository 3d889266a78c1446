# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Pulses stream from the disk: the memory of an image does not grow with its recording."""

from __future__ import annotations

import dataclasses
import pathlib

import numpy as np
import pytest

from sar_imaging.archive.pieces import ImagePiece
from sar_imaging.archive.scans import Division, write_job
from sar_imaging.archive.windows import Window
from sar_imaging.archive.workflow import compute
from sar_imaging.geometry import MapGrid
from sar_imaging.recordings.bag_io import write_bag
from sar_imaging.recordings.truth import make_truth
from sar_imaging.signal import PulseBlock

from .small_archive import SPACING_M, START_NS, fly, make_archive

N_PULSES, N_SAMPLES = 4000, 2048  # 66 MB


def noise(radar):
    """Messages of a straight flight that received noise alone."""
    rng = np.random.default_rng(0)
    for first in range(0, N_PULSES, 100):
        counter = np.arange(first, first + 100)
        track = np.column_stack([counter * 0.03 - 60, np.full(100, -800.0),
                                 np.full(100, 500.0)])[:, None]
        samples = rng.standard_normal((100, 1, 2 * N_SAMPLES), np.float32).view(np.complex64)
        yield PulseBlock(radar, True, START_NS + counter * 10**6, counter, samples, track, track)


@pytest.fixture
def long_recording(tmp_path):
    """Archive of one recording that is larger than what an image of it may take."""
    archive = make_archive(tmp_path, {'short': [(fly(0.0), 0.0)]})
    [scan] = archive.scans
    path = tmp_path / 'long'
    write_bag(path, noise(scan.radar), make_truth(
        scenario='long', description='', scatterers=[], grid=MapGrid((0, 0, 0), 64, 64, SPACING_M),
        pulses_per_aperture=N_PULSES, n_pulses=N_PULSES, n_channels=1, cut_half_width_m=(5, 5),
        radar=scan.radar, compressed=True))
    blocks = list(noise(scan.radar))
    np.savez(archive.output / 'scans' / 'long.npz', message_ns=np.zeros(0, np.int64), **{
        name: np.concatenate([getattr(block, name) for block in blocks])
        for name in ('counter', 'stamp_ns', 'tx_m', 'rx_m')})
    window = Window(-16, 16, -16, 16)
    return archive, dataclasses.replace(
        scan, name='long', path=path, n_pulses=N_PULSES, n_samples=N_SAMPLES,
        centres='scans/long.npz', window=window,
        division=Division((window,), ((0, N_PULSES),), 1.0, 1.0, 10**8, 'exact'))


def resident_mb(field):
    lines = pathlib.Path('/proc/self/status').read_text().splitlines()
    return next(int(line.split()[1]) / 1000 for line in lines if line.startswith(field))


def test_an_image_takes_less_memory_than_its_pulses(long_recording):
    if not pathlib.Path('/proc/self/clear_refs').exists():
        pytest.skip('peaks of memory are measured on Linux')
    archive, scan = long_recording
    write_job(dataclasses.replace(archive.job, memory_bytes=4.2e8))  # blocks of 2 MB
    compute(ImagePiece(key='warm', scan=scan, window=scan.window, pulses=(0, 100), partial='w'),
            archive.output)
    pathlib.Path('/proc/self/clear_refs').write_text('5')
    before = resident_mb('VmRSS')
    result = compute(ImagePiece(key='long', scan=scan, window=scan.window,
                                pulses=(0, N_PULSES)), archive.output)
    assert result.found['method'] == 'exact'
    # blocks, their copies and resampled profiles; all pulses at once would be 66 MB and more
    assert resident_mb('VmHWM') - before < 35
