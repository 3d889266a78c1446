# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Job files: what three lines mean, and fifty that are wrong, each with a line that says how."""

import dataclasses
import re

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings, strategies as st

from sar_imaging.archive.job import Brightness, Job, JobError, Products, changed, read_job
from sar_imaging.archive.scans import load_job, write_job
from sar_imaging.geometry.earth import Datum

THREE = 'recordings: flights/*\noutput: survey\nspacing_m: 0.25\n'
ALL = """\
recordings: [flights/2025, /data/catalog.json]
output: survey
spacing_m: 0.25
datum: {latitude_deg: 47.3, longitude_deg: 8.5, height_m: 430.0, heading_deg: 10.0}
area_m: [-500.0, -200.0, 500.0, 3000.0]
height_m: 1.5
surface: plane
method: exact
target_db: -50
products:
  images: [geotiff, sicd]
  strips: true
  mosaic: false
  coherence_window: 7
tile: 512
memory_gb: 1.5
longest_piece_s: 60
checked_pixels: 10
retries: 1
"""

#: Name, what replaces what in ALL (or the file itself), line, and what the message tells.
WRONG = [
    ('no recordings', THREE.replace('recordings: flights/*\n', ''), None,
     'no recordings, which every job needs; add the line recordings: flights/*'),
    ('no output', THREE.replace('output: survey\n', ''), None, 'add the line output: survey'),
    ('no spacing', THREE.replace('spacing_m: 0.25\n', ''), None, 'add the line spacing_m: 0.25'),
    ('empty file', '', None, 'is empty; expected recordings, output and spacing_m'),
    ('comment alone', '# later\n', None, 'is empty'),
    ('a word', 'survey\n', None, 'write at least the lines recordings: flights/*, output'),
    ('a list', '- recordings\n- output\n', None, "is ['recordings', 'output']; expected lines"),
    ('no YAML', THREE + 'tile: [1, 2\n', 5, 'expected YAML'),
    ('tabs', 'recordings:\n\t- flights\n', 2, 'correct this line or the one before it'),
    ('no text', b'recordings: \xff\xfe\n', None, 'byte 12 is no UTF-8'),
    ('control bytes', b'recordings: \x00\n', None,
     'character 13 is 0x00, which no text has; remove it; expected YAML'),
    ('spacing without unit', THREE.replace('spacing_m', 'spacing'), 3,
     'unknown key spacing; did you mean spacing_m?'),
    ('misspelt', ('memory_gb', 'memory_gbit'), 16, 'did you mean memory_gb?'),
    ('unknown', ('retries', 'colour'), 19, 'unknown key colour; expected one of'),
    ('misspelt within', ('strips', 'strip'), 12,
     'unknown key products.strip; did you mean strips?'),
    ('unknown datum', ('heading_deg', 'bearing'), 4, 'unknown key datum.bearing'),
    ('twice', THREE + 'output: other\n', 4, 'key output is given twice, first in line 2; keep'),
    ('recordings nothing', ('[flights/2025, /data/catalog.json]', ''), 1,
     'recordings: expected a folder, a glob, a STAC catalogue or a list of those, got nothing'),
    ('recordings none', ('[flights/2025, /data/catalog.json]', '[]'), 1,
     'got []'),
    ('recordings mapping', ('[flights/2025, /data/catalog.json]', '{a: b}'), 1,
     "got {'a': 'b'}"),
    ('recordings nested', ('flights/2025', '[a]'), 1, 'recordings[0]: expected a folder, a glob'),
    ('output list', ('output: survey', 'output: [a]'), 2, "got ['a']"),
    ('output nothing', ('output: survey', 'output: ""'), 2, "got ''"),
    ('spacing zero', ('spacing_m: 0.25', 'spacing_m: 0'), 3,
     'spacing_m: expected a number of metres, 0.0001 to 10000, got 0'),
    ('spacing negative', ('spacing_m: 0.25', 'spacing_m: -1'), 3, 'got -1'),
    ('spacing text', ('spacing_m: 0.25', 'spacing_m: fine'), 3, "got 'fine'"),
    ('spacing quoted', ('spacing_m: 0.25', 'spacing_m: "0.25"'), 3, 'remove the quotes'),
    ('spacing with unit', ('spacing_m: 0.25', 'spacing_m: 0.25 m'), 3, "got '0.25 m'"),
    ('spacing NaN', ('spacing_m: 0.25', 'spacing_m: .nan'), 3, 'expected a number of metres'),
    ('spacing comma', ('spacing_m: 0.25', 'spacing_m: 0,25'), 3, "got '0,25'"),
    ('spacing list', ('spacing_m: 0.25', 'spacing_m: [1, 1]'), 3, 'got [1, 1]'),
    ('latitude missing', ('latitude_deg: 47.3, ', ''), 4, 'expected a place with latitude_deg'),
    ('latitude wrong', ('latitude_deg: 47.3', 'latitude_deg: 97.3'), 4,
     'datum.latitude_deg: expected a number of degrees, -90 to 90, got 97.3'),
    ('datum a list', ('{latitude_deg: 47.3, longitude_deg: 8.5, height_m: 430.0, '
                      'heading_deg: 10.0}', '[47.3, 8.5]'), 4, 'write datum: {latitude_deg'),
    ('area of three', ('[-500.0, -200.0, 500.0, 3000.0]', '[0, 1, 2]'), 5,
     'area_m: expected four numbers'),
    ('area turned', ('[-500.0, -200.0, 500.0, 3000.0]', '[500, -200, -500, 3000]'), 5,
     'expected the smallest x and y first; exchange'),
    ('area text', ('[-500.0, -200.0, 500.0, 3000.0]', 'all'), 5, "got 'all'"),
    ('area of a word', ('[-500.0,', '[west,'), 5, 'write for instance 100.0'),
    ('area too large', ('[-500.0, -200.0, 500.0, 3000.0]', '[-9e6, -9e6, 9e6, 9e6]'), 5,
     'expected at most 1e+12 pixels, and this has 5.2e+15'),
    ('height high', ('height_m: 1.5', 'height_m: 15000'), 6, '-12000 to 10000'),
    ('surface unknown', ('surface: plane', 'surface: planar'), 7,
     "surface: expected one of plane, ellipsoid, got 'planar'; did you mean plane?"),
    ('surface with SICD', ('surface: plane', 'surface: ellipsoid'), 7,
     "SICD images lie on planes, got 'ellipsoid'; write surface: plane, or"),
    ('method unknown', ('method: exact', 'method: abp'), 8, 'did you mean afbp?'),
    ('method strange', ('method: exact', 'method: magic'), 8, 'expected one of auto, exact, afbp'),
    ('target positive', ('target_db: -50', 'target_db: 50'), 9, 'of dB, -120 to -10'),
    ('images unknown', ('[geotiff, sicd]', '[tiff]'), 11,
     "products.images[0]: expected one of geotiff, sicd, got 'tiff'; did you mean geotiff?"),
    ('images a word', ('[geotiff, sicd]', 'geotiff'), 11, 'write for instance images: [geotiff]'),
    ('strips a number', ('strips: true', 'strips: 1'), 12, 'write true or false'),
    ('strips quoted', ('strips: true', 'strips: "true"'), 12, 'without quotes'),
    ('window even', ('coherence_window: 7', 'coherence_window: 8'), 14, 'write 9'),
    ('window broken', ('coherence_window: 7', 'coherence_window: 7.5'), 14, 'whole number'),
    ('products a list', ('products:\n  images: [geotiff, sicd]\n  strips: true\n  mosaic: false\n'
                         '  coherence_window: 7', 'products: [mosaic]'), 10,
     'products: expected a mapping with images'),
    ('tile odd', ('tile: 512', 'tile: 500'), 15, 'write 512'),
    ('tile small', ('tile: 512', 'tile: 8'), 15, '16 to 16384'),
    ('memory small', ('memory_gb: 1.5', 'memory_gb: 0.1'), 16, '0.6 to 100000'),
    ('memory in bytes', ('memory_gb: 1.5', 'memory_gb: 2000000000'), 16, 'gigabytes for one'),
    ('piece short', ('longest_piece_s: 60', 'longest_piece_s: 0'), 17, 'seconds, 1 to 1e+06'),
    ('pixels negative', ('checked_pixels: 10', 'checked_pixels: -1'), 18, '0 to 100000'),
    ('retries broken', ('retries: 1', 'retries: 1.5'), 19, 'a whole number of tries'),
]


def test_three_lines_are_a_job(job_file, tmp_path):
    job = read_job(job_file(THREE))
    assert job == Job((str(tmp_path / 'flights/*'),), tmp_path / 'survey', 0.25)
    assert (job.products.mosaic, job.memory_bytes, job.target_db) == (True, 2e9, -60.0)


def test_every_key_is_read(job_file, tmp_path):
    job = read_job(job_file(ALL))
    assert job == Job(
        (str(tmp_path / 'flights/2025'), '/data/catalog.json'), tmp_path / 'survey', 0.25,
        Datum(47.3, 8.5, 430.0, 10.0), (-500.0, -200.0, 500.0, 3000.0), 1.5, 'plane', None,
        'exact', -50.0, Products(('geotiff', 'sicd'), True, False, 7), 512, 1.5e9, 60.0, 10, 1)
    for field in dataclasses.fields(Job):  # each was given, but for some
        if field.name in ('crs', 'datum_from', 'radiometry'):
            continue
        if field.default is not dataclasses.MISSING:
            assert getattr(job, field.name) != field.default or field.name == 'surface', field.name
    job.output.mkdir()
    write_job(job)
    assert load_job(job.output) == job
    assert load_job(job.output).digest() == job.digest()


def test_a_radar_constant_is_read_with_the_job(job_file, tmp_path):
    """Workers elsewhere need no file, and another constant makes other bits."""
    constant = tmp_path / 'radar.yaml'
    constant.write_text('gain_m: 250.0\n')
    text = f'{THREE}radiometry: {{quantity: sigma0, constant_file: radar.yaml}}\n'
    job = read_job(job_file(text))
    assert job.radiometry == Brightness('sigma0', 250.0)
    assert np.isnan(job.radiometry.constant.noise_power)
    constant.write_text('gain_m: 260.0\nnoise_power: 0.5\n')
    other = read_job(job_file(text.replace('.yaml}', '.yaml, window: hamming}')))
    assert other.radiometry == Brightness('sigma0', 260.0, 0.5, 'hamming')
    assert len({job.digest(), other.digest(), read_job(job_file(THREE)).digest()}) == 3
    for one in (job, other):
        one.output.mkdir(exist_ok=True)
        write_job(one)
        assert load_job(one.output) == one


@pytest.mark.parametrize(('told', 'message'), [
    ('{quantity: sigma0}',
     "a mapping with constant_file, got {'quantity': 'sigma0'}; write radiometry: {q"),
    ('{quantity: sigma, constant_file: radar.yaml}',
     'expected one of rcs, beta0, .*did you mean sigma0'),
    ('{quantity: rcs, constant_file: none.yaml}', 'constant_file: .* is no file of a radar'),
    ('{quantity: rcs, constant_file: radar.yaml, window: hat}', 'radiometry.window: .*hat')])
def test_wrong_brightness_is_explained(job_file, tmp_path, told, message):
    (tmp_path / 'radar.yaml').write_text('gain_m: 250.0\n')
    with pytest.raises(JobError, match=f'line 4: .*{message}'):
        read_job(job_file(f'{THREE}radiometry: {told}\n'))


@pytest.mark.parametrize(('told', 'crs'), [('EPSG:32632', 'EPSG:32632'), ('25832', 'EPSG:25832'),
                                           ('local', 'local')])
def test_projections_are_named_as_proj_does(job_file, told, crs):
    pytest.importorskip('pyproj', reason='the extra formats is not installed')
    assert read_job(job_file(f'{THREE}crs: {told}\n')).crs == crs


@pytest.mark.parametrize(('told', 'message'), [
    ('EPSG:999999', 'expected a map projection that PROJ knows'),
    ('EPSG:4326', 'that is geographic, with degrees')])
def test_wrong_projections_are_explained(job_file, told, message):
    pytest.importorskip('pyproj', reason='the extra formats is not installed')
    with pytest.raises(JobError, match=message):
        read_job(job_file(f'{THREE}crs: {told}\n'))


@pytest.mark.parametrize(('text', 'line', 'message'), [w[1:] for w in WRONG],
                         ids=[w[0] for w in WRONG])
def test_a_wrong_job_says_what_to_change(job_file, text, line, message):
    if isinstance(text, tuple):
        assert ALL.count(text[0]) == 1 or text[0] in ('retries', 'strips', 'memory_gb')
        text = ALL.replace(*text)
    path = job_file(text)
    with pytest.raises(JobError) as caught:
        read_job(path)
    said = str(caught.value)
    assert message in said
    assert '\n' not in said and said.startswith(str(path))
    if line is not None:
        assert f', line {line}: ' in said


def test_fifty_jobs_are_wrong():
    assert len(WRONG) >= 50
    assert len({name for name, *_ in WRONG}) == len(WRONG)


@pytest.mark.parametrize(('make', 'message'), [
    (lambda p: p / 'none.yaml', 'cannot be read'), (lambda p: p, 'is no regular file'),
    (lambda p: p / 'large.yaml', r'expected at most 1 MB')])
def test_what_is_no_file_is_explained(tmp_path, make, message):
    (tmp_path / 'large.yaml').write_text('#' * 1_100_000)
    with pytest.raises(JobError, match=message) as caught:
        read_job(make(tmp_path))
    assert 'name another file' in str(caught.value)


@settings(max_examples=200, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_damaged_jobs_are_read_or_refused_in_one_line(job_file, data):
    """Any part of a right job replaced by any text."""
    start = data.draw(st.integers(0, len(ALL)))
    end = data.draw(st.integers(start, min(len(ALL), start + 30)))
    new = data.draw(st.one_of(
        st.text(max_size=12), st.sampled_from(['', '~', '[', '{', ': ', '!!int ', '*a', '1e999',
                                               '\t', '---\n', '&a [*a]', '"', "'", '- '])))
    path = job_file((ALL[:start] + new + ALL[end:]).encode('utf-8', 'surrogatepass'))
    try:
        job = read_job(path)
    except JobError as error:
        said = str(error)
        assert '\n' not in said and str(path.parent) in said
        assert re.search(r'expected|did you mean|remove|add|exchange|name', said)
    else:
        assert job.spacing_m > 0 and job.recordings
        hash(job.digest())


def test_options_of_the_command_line_replace_what_the_file_says(job_file):
    job = read_job(job_file(THREE))
    assert changed(job, memory_bytes=None, output=None) == job
    assert changed(job, memory_bytes=1e9).memory_bytes == 1e9
    with pytest.raises(JobError, match='0.2 GB; a worker needs at least 0.6 GB'):
        changed(job, memory_bytes=2e8)


def test_a_folder_without_a_job_is_explained(tmp_path):
    with pytest.raises(JobError, match='expected the output folder'):
        load_job(tmp_path)
