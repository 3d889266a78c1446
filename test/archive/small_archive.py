# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""A small archive: recordings of a strip, their scans, and the job that images them."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from sar_imaging.archive.job import Job
from sar_imaging.archive.pieces import ImagePiece, SumPiece, TilePiece
from sar_imaging.archive.scans import ApertureScan, Division, RecordingScan, write_job, write_scan
from sar_imaging.archive.windows import Window, union
from sar_imaging.archive.workflow import compute
from sar_imaging.geometry import Datum, MapGrid
from sar_imaging.recordings.bag_io import read_blocks, write_bag
from sar_imaging.recordings.truth import make_truth
from sar_imaging.signal import SPEED_OF_LIGHT, PulseBlock, RadarParameters
from sar_imaging.simulation import EchoSimulator

DATUM = Datum(47.0, 8.0, 400.0, 30.0)
SPACING_M, TILE = 1.0, 64
N_PULSES, N_SAMPLES = 48, 256
START_NS = 1_700_000_000_000_000_000
CARRIER_HZ, BANDWIDTH_HZ = 1.3e9, 90e6


def scene(seed=1, n=300):
    """Points and amplitudes of speckle with some bright reflectors."""
    rng = np.random.default_rng(seed)
    points = np.column_stack([rng.uniform(-90, 330, n), rng.uniform(-90, 90, n), np.zeros(n)])
    amplitudes = rng.normal(size=n) + 1j * rng.normal(size=n)
    amplitudes[:4] *= 30
    return points, amplitudes


def fly(along_m, height_m=500.0, scattered=None, first_counter=0):
    """Range profiles of a straight pass at y = -800 m, opposite to some x."""
    x = np.linspace(-60, 60, N_PULSES) + along_m
    track = np.column_stack([x, np.full(N_PULSES, -800.0), np.full(N_PULSES, height_m)])[:, None]
    near = math.hypot(700.0, height_m)
    radar = RadarParameters(CARRIER_HZ, BANDWIDTH_HZ, 1.4 * BANDWIDTH_HZ,
                            2 * (near - 40) / SPEED_OF_LIGHT)
    points, amplitudes = scattered or scene()
    echoes = EchoSimulator(radar, N_SAMPLES, compressed=True, points_m=points,
                           amplitudes=amplitudes)
    counter = np.arange(N_PULSES) + first_counter
    return PulseBlock(radar, True, START_NS + counter * 10_000_000, counter,
                      echoes(track, track), track, track)


@dataclasses.dataclass(frozen=True)
class Archive:
    """Recordings, their scans, and the output folder."""

    job: Job
    scans: tuple[ApertureScan, ...]
    blocks: dict[str, PulseBlock]

    @property
    def output(self):
        return self.job.output

    @property
    def mosaic(self):
        return union(s.window for s in self.scans).on_tiles(self.job.tile)

    def divided(self, scan, windows=None, pulses=None):
        """A scan with another division."""
        division = dataclasses.replace(scan.division, windows=windows or scan.division.windows,
                                       pulses=pulses or scan.division.pulses)
        return dataclasses.replace(scan, division=division)

    def image(self, scan, job=None):
        """Compute all pieces of an aperture's image."""
        job, out, parts = job or self.job, [], scan.division.pulses
        for window in scan.division.windows:
            if len(parts) == 1:
                out.append(self.compute(ImagePiece(key='i', scan=scan, window=window,
                                                   pulses=parts[0]), job))
                continue
            names = [f'part{n}' for n in range(len(parts))]
            for name, pulses in zip(names, parts, strict=True):
                self.compute(ImagePiece(key='i', scan=scan, window=window, pulses=pulses,
                                        partial=name), job)
            while len(names) > 1:
                target = '' if len(names) == 2 else f'{names[0]}+'
                out.append(self.compute(SumPiece(key='s', scan=scan, window=window,
                                                 parts=tuple(names[:2]), partial=target), job))
                names = [target, *names[2:]]
        return out

    def compute(self, piece, job=None):
        write_job(job or self.job)
        return compute(piece, self.output)

    def mosaic_tiles(self):
        return [TilePiece(KIND='mosaic', subject='', key=f'm{n}', tile=tile, extent=self.mosaic,
                          images=_images(self.scans, tile))
            for n, tile in enumerate(self.mosaic.tiles(self.job.tile))]

    def strip_tiles(self, recording):
        scans = [s for s in self.scans if s.recording == recording]
        strip = union(s.window for s in scans).on_tiles(self.job.tile)
        return [TilePiece(KIND='strip', subject=recording, key=f's{n}', tile=tile, extent=strip,
                          images=_images(scans, tile))
                for n, tile in enumerate(strip.tiles(self.job.tile))]


def _images(scans, tile):
    return tuple((s.name, s.window) for s in scans if s.window.intersection(tile) is not None)


def make_archive(folder, flights, *, datum=DATUM, **job):
    """Archive of recordings by name: of each the blocks of its apertures, and their middles."""
    pytest.importorskip('zarr', reason='the extra archive is not installed')
    output = folder / 'out'
    (output / 'scans').mkdir(parents=True)
    scans, blocks = [], {}
    for name, apertures in flights.items():
        path = folder / name
        grid = MapGrid((apertures[0][1], 0, 0), 128, 128, SPACING_M)
        block = apertures[0][0]
        write_bag(path, [part.select(slice(a, a + 16)) for part, _ in apertures
                         for a in range(0, N_PULSES, 16)],
                  make_truth(scenario=name, description='', scatterers=[], grid=grid,
                             pulses_per_aperture=N_PULSES, n_pulses=N_PULSES * len(apertures),
                             n_channels=1, cut_half_width_m=(5, 5), radar=block.radar,
                             compressed=True, datum=datum))
        radar = next(read_blocks(path)).radar  # rounded by the wire format
        for number, (block, middle) in enumerate(apertures):
            block = dataclasses.replace(block, radar=radar)
            scan = _scan(name, path, number, block, middle, datum)
            np.savez(output / scan.centres, counter=block.counter.astype(np.int64),
                     stamp_ns=block.stamp_ns, tx_m=block.tx_m, rx_m=block.rx_m,
                     message_ns=np.zeros(0, np.int64))
            scans.append(scan)
            blocks[scan.name] = block
    for name in flights:
        write_scan(output, RecordingScan(
            name, tuple(scan for scan in scans if scan.recording == name)))
    options = dict(datum=datum, tile=TILE, target_db=-50.0, checked_pixels=20) | job
    return Archive(Job(tuple(str(folder / name) for name in flights), output, SPACING_M,
                       **options), tuple(scans), blocks)


def _scan(recording, path, number, block, middle, datum):
    corners = tuple((middle + dx, dy) for dx, dy in ((-70, -60), (70, -60), (55, 65), (-55, 65)))
    window = Window.around(corners, SPACING_M)
    return ApertureScan(
        f'{recording}_aperture-{number:03d}', path, recording, number, 'print', 'recording',
        block.radar, block.n_pulses, 1, block.n_samples, True, int(block.stamp_ns[0]),
        int(block.stamp_ns[-1]), datum, corners, window,
        tuple(block.tx_m.mean(axis=(0, 1))), block.samples.nbytes,
        Division((window,), ((0, block.n_pulses),), 1.0, 1.0, 10**8, 'exact'),
        f'scans/{recording}_aperture-{number:03d}.npz')
