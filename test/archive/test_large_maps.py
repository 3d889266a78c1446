# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Maps larger than the plane and the memory: reflectors stay where they are on the Earth."""

from __future__ import annotations

import dataclasses
import json

import numpy as np
import pytest

pytest.importorskip('zarr', reason='the extra archive is not installed')

from sar_imaging.archive.division import divide
from sar_imaging.archive.job import Job
from sar_imaging.archive.provenance import check_mosaic
from sar_imaging.archive.recordings import find_recordings, scan_recording
from sar_imaging.archive.scans import write_job, write_scan
from sar_imaging.archive.tiles import stored_looks
from sar_imaging.archive.workflow import compute
from sar_imaging.geometry import Datum
from sar_imaging.simulation.survey import Survey
from sar_imaging.tools.simulate_archive import write_archive

HERE = Datum(47.0, 8.0, 430.0)
THERE = Datum(47.3, 8.5, 430.0)  # 50 km from there


def imaged(folder, recordings, surface):
    """Job with all its pieces computed, and its plan."""
    job = Job((str(recordings),), folder, 0.5, datum=HERE, surface=surface, tile=128,
              target_db=-50.0)
    folder.mkdir()
    write_job(job)
    scans = []
    for name, path in find_recordings(job).items():
        scan = scan_recording(path, name, job, folder)
        write_scan(folder, scan)
        assert not scan.losses
        scans += scan.apertures
    plan = divide(job, scans)
    for piece in plan.pieces:
        if piece.KIND in ('image', 'sum', 'mosaic'):
            compute(piece, folder)
    return job, plan


def peaks(job, plan, places_m):
    """How far from some places, x and y in metres, the mosaic is brightest, within 3 m."""
    array = stored_looks(job.output, '', plan.window.on_tiles(job.tile), job.tile)[0]
    power = np.nan_to_num(array.read(plan.window))
    grid = plan.window.grid(job.spacing_m)
    x, y = grid.x_m, grid.y_m
    out = []
    for place in places_m:
        near = np.hypot(x - place[0], y[:, None] - place[1]) < 3
        row, column = np.unravel_index((power * near).argmax(), power.shape)
        out.append(np.hypot(x[column] - place[0], y[row] - place[1]))
    return np.array(out)


def test_reflectors_50_km_from_the_datum(tmp_path):
    survey = Survey(n_recordings=1, pixels=96, spacing_m=0.5, reflectors=2, clutter=0,
                    datum=THERE, surface='ellipsoid', seed=4)
    truth = write_archive(survey, tmp_path / 'in')
    latitude, longitude, height = np.array(truth['reflectors_geographic']).T
    places = HERE.from_geographic(latitude, longitude, height)
    inside = np.abs(survey.reflectors_m()[:, :2]).max(axis=1) < 20
    assert inside.any() and np.hypot(*places[0, :2]) > 49e3
    # the ground is that far below the plane of the map: distance^2 / 2 R
    drop = np.hypot(*places[0, :2]) ** 2 / 2 / 6.371e6
    np.testing.assert_allclose(-places[:, 2], drop, rtol=0.01)
    job, plan = imaged(tmp_path / 'out', tmp_path / 'in', 'ellipsoid')
    # a pixel's half diagonal, and the shift of a peak by its neighbours' sidelobes
    assert peaks(job, plan, places[inside]).max() < 0.5
    assert check_mosaic(job.output, 40).error_db < job.target_db


MEMORY = """
import json, pathlib, sys
import numpy as np
from sar_imaging.formats.georeference import georeference
from sar_imaging.formats.geotiff import write_cog
from sar_imaging.geometry import Datum, MapGrid

def status(field):
    lines = pathlib.Path('/proc/self/status').read_text().splitlines()
    return next(int(line.split()[1]) / 1024 for line in lines if line.startswith(field))

side, tile = 8192, np.full((1024, 1024), 3.5, np.float32)
place = georeference(MapGrid((0, 0, 0), side, side, 0.5), Datum(47, 8))
windows = (((slice(r, r + 1024), slice(c, c + 1024)), tile)
           for r in range(0, side, 1024) for c in range(0, side, 1024))
before = status('VmRSS')
write_cog(sys.argv[1], windows, place, shape=(side, side), dtype=np.float32,
          nodata=float('nan'))
print(json.dumps(status('VmHWM') - before))
"""


def test_a_geotiff_of_270_mb_takes_less_memory(tmp_path):
    import subprocess
    import sys

    rasterio = pytest.importorskip('rasterio', reason='the extra formats is not installed')
    path = tmp_path / 'large.tif'
    run = subprocess.run([sys.executable, '-c', MEMORY, str(path)], check=True,
                         capture_output=True, text=True)
    # GDAL's cache has 128 MB, its buffers for overviews some tens
    assert json.loads(run.stdout) < 230
    with rasterio.open(path) as file:
        assert file.shape == (8192, 8192) and file.overviews(1)
        assert file.read(1, out_shape=(20, 20)).min() == 3.5


def test_a_job_of_the_plane_says_what_the_earth_does(tmp_path):
    survey = Survey(n_recordings=1, pixels=64, spacing_m=0.5, reflectors=1, clutter=0,
                    datum=THERE, surface='ellipsoid')
    write_archive(survey, tmp_path / 'in')
    job = Job((str(tmp_path / 'in'),), tmp_path / 'out', 0.5, datum=HERE)
    [path] = find_recordings(job).values()
    job.output.mkdir()
    scan = scan_recording(path, 'one', dataclasses.replace(job), job.output)
    told = ' '.join([*(w for a in scan.apertures for w in a.warnings),
                     *(loss.reason for loss in scan.losses)])
    assert 'surface: ellipsoid' in told
