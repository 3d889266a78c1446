# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Scans: footprints and phase centres on the map, and why recordings are lost."""

import dataclasses
import json
import re

import numpy as np
import pytest

from sar_imaging.archive.job import Job
from sar_imaging.archive.pieces import ArchiveDataError, ScanPiece
from sar_imaging.archive.recordings import find_recordings, scan_piece, scan_recording, with_datum
from sar_imaging.archive.scans import load_scan, load_scans
from sar_imaging.archive.windows import Window
from sar_imaging.geometry.earth import Datum
from sar_imaging.recordings import open_pulses
from sar_imaging.recordings.bag_io import read_blocks, read_truth, write_bag
from sar_imaging.simulation.survey import Survey
from sar_imaging.tools.simulate_archive import write_archive

SURVEY = Survey(n_recordings=8, apertures=2, lines=2, pixels=64, overlap=0.25, clutter=0,
                n_channels=2, datum=Datum(60.0, -20.0, 100.0))


@pytest.fixture(scope='module')
def archive(tmp_path_factory):
    folder = tmp_path_factory.mktemp('scanning') / 'flights'
    return folder, write_archive(SURVEY, folder)


@pytest.fixture
def job(archive, tmp_path):
    job = Job((str(archive[0]),), tmp_path / 'out', SURVEY.spacing_m)
    return with_datum(job, find_recordings(job))


def _scan(job, name):
    return scan_recording(find_recordings(job)[name], name, job, job.output)


def test_windows_are_the_squares_of_the_survey(archive, job):
    """Squares stand at multiples of the advance in the frame of the survey, the map's own is that
    of the first recording, half an advance further."""
    side, step = SURVEY.size_m, SURVEY.advance_m
    first = np.array([0.0, step / 2])  # middle of the first recording, frame of the survey
    for recording, entry in zip(SURVEY.recordings(), archive[1]['recordings'], strict=True):
        scan = _scan(job, entry['name'])
        assert not scan.losses and [a.aperture for a in scan.apertures] == [0, 1]
        for number, aperture in enumerate(scan.apertures):
            middle = np.array([recording.line, 2 * recording.along + number]) * step - first
            row, column = -middle[1] / job.spacing_m, middle[0] / job.spacing_m
            own = aperture.window
            # the raster that coverage is asked on is 0.4 pixels fine, the unambiguous reach a side
            assert abs((own.row0 + own.row1 - 1) / 2 - row) <= 3, (aperture.name, own)
            assert abs((own.column0 + own.column1 - 1) / 2 - column) <= 3
            assert all(abs(n - side / job.spacing_m) <= 5 for n in own.shape)


def test_phase_centres_are_moved_into_the_frame_of_the_map(archive, job):
    """Through ECEF, to a micrometre; distances to a place on the Earth stay."""
    place = np.array([SURVEY.datum.latitude_deg, SURVEY.datum.longitude_deg, 50.0])
    for name in ('flight-0000', 'flight-0007'):
        scan = _scan(job, name)
        for aperture in scan.apertures:
            source = open_pulses(aperture.path, aperture=aperture.aperture)
            counter, stamp_ns, tx_m, rx_m = aperture.phase_centres(job.output)
            np.testing.assert_array_equal(counter, source.counter)
            np.testing.assert_array_equal(stamp_ns, source.stamp_ns)
            assert tx_m.shape == (SURVEY.pulses_per_aperture, 2, 3)
            for found, own in ((tx_m, source.tx_m), (rx_m, source.rx_m)):
                told = [np.linalg.norm(points - datum.from_geographic(*place), axis=-1)
                        for points, datum in ((found, job.datum), (own, source.datum))]
                np.testing.assert_allclose(*told, rtol=0, atol=1e-6)
            assert aperture.datum == source.datum
            assert len(aperture.message_times(job.output)) == source.n_pulses
    assert _scan(job, 'flight-0000').apertures[0].datum == job.datum
    assert aperture.datum != job.datum


def test_scans_are_kept_and_the_same_again(archive, job):
    path = find_recordings(job)['flight-0001']
    piece = ScanPiece(key='scan flight-0001', path=path, recording='flight-0001')
    result = scan_piece(piece, job, job.output)
    assert result.found == {'apertures': 2, 'losses': 0}
    assert all((job.output / file).is_file() for file in result.files) and len(result.files) == 3
    scan = load_scan(job.output, 'flight-0001')
    assert scan == scan_recording(path, 'flight-0001', job, job.output)
    assert load_scans(job.output) == [scan]
    assert len({a.fingerprint for a in scan.apertures}) == 1
    assert not list(job.output.rglob('*.part'))


def test_a_changed_recording_has_another_fingerprint(archive, job, tmp_path):
    before = _scan(job, 'flight-0001').apertures[0].fingerprint
    assert before != _scan(job, 'flight-0002').apertures[0].fingerprint
    blocks = list(read_blocks(archive[0] / 'flight-0001'))
    write_bag(tmp_path / 'new/flight-0001', blocks[:-1], read_truth(archive[0] / 'flight-0001'))
    changed = scan_recording(tmp_path / 'new/flight-0001', 'x', job, job.output)
    assert changed.apertures[0].fingerprint != before


def test_cphd_gives_the_same_windows(job, tmp_path):
    pytest.importorskip('sarkit', reason='the extra formats is not installed')
    survey = dataclasses.replace(SURVEY, apertures=1, n_recordings=2)
    windows = []
    for kind in ('bag', 'cphd'):
        write_archive(survey, tmp_path / kind, file_format=kind)
        own = Job((str(tmp_path / kind),), job.output, job.spacing_m, datum=SURVEY.datum)
        scans = [scan_recording(path, name, own, own.output)
                 for name, path in find_recordings(own).items()]
        windows.append([a.window for s in scans for a in s.apertures])
        assert [a.kind for s in scans for a in s.apertures][0] == (
            'recording' if kind == 'bag' else 'CPHD')
    for one, other in zip(*windows, strict=True):
        # a CPHD file names its area to the pixel
        assert np.abs(np.subtract(one.as_tuple, other.as_tuple)).max() <= 1


BROKEN = {'truncated': 'recover the file', 'no-poses': 'have no phase centres',
          'empty': 'without metadata.yaml', 'foreign': 'neither CPHD'}


def test_broken_recordings_are_lost_with_their_reason(tmp_path):
    survey = Survey(n_recordings=6, pixels=64, clutter=0)
    truth = write_archive(survey, tmp_path / 'a', broken=4)
    job = Job((str(tmp_path / 'a/flight-*'),), tmp_path / 'out', 0.25)
    found = find_recordings(job)
    job = with_datum(job, found)
    for entry in truth['recordings']:
        name, state = entry['name'], entry['broken']
        piece = ScanPiece(key=f'scan {name}', path=found[name], recording=name)
        if not state:
            assert scan_piece(piece, job, job.output).found['apertures'] == 1
            continue
        with pytest.raises(ArchiveDataError, match=BROKEN[state]) as caught:
            scan_piece(piece, job, job.output)
        assert 'leave it out' in str(caught.value) and '\n' not in str(caught.value)
        assert [loss.name for loss in load_scan(job.output, name).losses] == [name]


def _rewritten(archive, path, change=lambda blocks: blocks, **truth):
    """Copy of a recording with other truth and pulses; None removes what the truth told."""
    told = read_truth(archive[0] / 'flight-0001') | truth
    told = {key: value for key, value in told.items() if value is not None}
    write_bag(path, change(list(read_blocks(archive[0] / 'flight-0001'))), told)
    return path


def _at(grid, x, y, size):
    return {**grid, 'centre_m': [x, y, 0.0], 'n_x': size, 'n_y': size}


WRONG = {
    'no datum': (dict(datum=None), {}, 'has no datum, and the map has that of flight-0000'),
    'impossible datum': (dict(datum={'latitude_deg': 99.0, 'longitude_deg': 0.0}), {},
                         'latitude_deg=99'),
    'datum elsewhere': (dict(datum={'latitude_deg': -10.0, 'longitude_deg': 0.0}), {},
                        'no profile reaches its area|out of sight|lies beyond'),
    'high ground': ({}, dict(height_m=3000.0), 'no profile reaches its area.*check height_m'),
    'outside the job': ({}, dict(area_m=(5000.0, 0.0, 6000.0, 100.0)), 'lies beyond the area_m'),
}


@pytest.mark.parametrize(('truth', 'options', 'message'), WRONG.values(), ids=WRONG)
def test_what_cannot_be_placed_is_lost_with_its_reason(archive, job, tmp_path, truth, options,
                                                       message):
    path = _rewritten(archive, tmp_path / 'changed', **truth)
    scan = scan_recording(path, 'changed', dataclasses.replace(job, **options), job.output)
    assert not scan.apertures and scan.losses
    for loss in scan.losses:
        assert loss.path == path
        assert re.search(message, loss.reason), loss.reason
        assert re.search('; .*(correct|add|check|enlarge|leave it out)', loss.reason)


def test_short_apertures_are_lost_and_gaps_are_told(archive, job, tmp_path):
    n = SURVEY.pulses_per_aperture

    def without(blocks):
        """The second aperture with a third of its pulses, the first with a gap of two."""
        return [b.select((b.counter < n + n // 3) & (b.counter != 5) & (b.counter != 6))
                for b in blocks]

    path = _rewritten(archive, tmp_path / 'short',
                      lambda blocks: [b for b in without(blocks) if b.n_pulses])
    scan = scan_recording(path, 'short', job, job.output)
    assert [a.aperture for a in scan.apertures] == [0]
    assert scan.apertures[0].warnings == (f'2 of its {n} pulses are missing',)
    [loss] = scan.losses
    assert loss.name == 'short_aperture-001' and f'it has {n // 3} pulses' in loss.reason


def test_without_any_datum_the_frame_is_local(archive, job, tmp_path):
    path = _rewritten(archive, tmp_path / 'local', datum=None)
    local = Job((str(path),), job.output, job.spacing_m)
    assert with_datum(local, find_recordings(local)) == local
    scan = scan_recording(path, 'local', local, job.output)
    source = open_pulses(path, aperture=1)
    np.testing.assert_array_equal(scan.apertures[1].phase_centres(job.output)[2], source.tx_m)


def test_a_datum_of_the_job_is_that_of_recordings_without_one(archive, job, tmp_path):
    path = _rewritten(archive, tmp_path / 'placed', datum=None)
    told = dataclasses.replace(job, datum_from='')
    scan = scan_recording(path, 'placed', told, job.output)
    assert 'its frame is taken for that of the job' in scan.apertures[0].warnings[0]
    assert scan.apertures[0].datum == job.datum


def test_an_area_of_the_job_serves_recordings_that_name_none(archive, job, tmp_path):
    blocks = list(read_blocks(archive[0] / 'flight-0001'))
    path = tmp_path / 'bare'
    truth = read_truth(archive[0] / 'flight-0001')
    write_bag(path, blocks, truth)
    metadata = (path / 'metadata.yaml').read_text()
    (path / 'metadata.yaml').write_text(metadata.replace('sar_imaging.truth', 'someone.else'))
    local = Job((str(path),), job.output, 0.25)
    scan = scan_recording(path, 'bare', local, job.output)
    assert 'does not state where its scene is; add area_m to the job' in scan.losses[0].reason
    local = dataclasses.replace(local, area_m=(-4.0, -10.0, 4.0, 9.0))
    [aperture] = scan_recording(path, 'bare', local, job.output).apertures
    assert aperture.window == Window(-36, 41, -16, 17)


def test_the_roundness_of_the_earth_is_told_where_it_matters(archive, job, tmp_path):
    far = Datum(60.05, -20.0, 100.0)  # 5.6 km away: 2.4 m of drop
    told = dataclasses.replace(job, datum=far, datum_from='')
    scan = _scan(told, 'flight-0000')
    assert 'surface: ellipsoid follows it' in scan.apertures[0].warnings[0]
    assert '2.4' in scan.apertures[0].warnings[0]
    rounded = dataclasses.replace(told, surface='ellipsoid')
    assert _scan(rounded, 'flight-0000').apertures[0].warnings == ()


def test_scans_are_json_that_people_can_read(archive, job):
    piece = ScanPiece(key='s', path=find_recordings(job)['flight-0000'], recording='flight-0000')
    scan_piece(piece, job, job.output)
    told = json.loads((job.output / 'scans/flight-0000.json').read_text())
    assert told['apertures'][0]['radar']['carrier_hz'] == 10e9
