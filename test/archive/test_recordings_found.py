# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Recordings of a job: folders, globs, lists and catalogues; names; whose datum is taken."""

import datetime
import json
import os
import sys

import pytest

from sar_imaging.archive.job import Job, JobError
from sar_imaging.archive.recordings import find_recordings, with_datum
from sar_imaging.geometry.earth import Datum
from sar_imaging.simulation.survey import Survey
from sar_imaging.tools.simulate_archive import write_archive

SURVEY = Survey(n_recordings=6, pixels=32, clutter=0, reflectors=1)


@pytest.fixture(scope='module')
def archive(tmp_path_factory):
    folder = tmp_path_factory.mktemp('finding') / 'flights'
    write_archive(SURVEY, folder, broken=4)
    return folder


def _job(*patterns, **options):
    return Job(tuple(map(str, patterns)), patterns[0] / 'out' if hasattr(patterns[0], 'joinpath')
               else options.pop('output'), 0.25, **options)


def test_a_folder_has_its_recordings_and_what_should_be_one(archive):
    found = find_recordings(_job(archive))
    # the text file and archive.json are left alone, the empty folder is not
    assert list(found) == [f'flight-{n:04d}' for n in range(5)]
    assert all(path.is_dir() for path in found.values())


def test_a_glob_takes_what_it_names_sorted(archive):
    found = find_recordings(_job(archive / 'flight-*'))
    assert list(found) == [f'flight-{n:04d}' for n in range(6)]


def test_a_list_takes_each_once(archive, tmp_path):
    (tmp_path / 'link').symlink_to(archive / 'flight-0001')
    found = find_recordings(_job(archive / 'flight-0002', archive, archive / 'flight-000[0-3]',
                                 tmp_path / 'link'))
    assert sorted(map(os.path.realpath, found.values())) == [
        str(archive / f'flight-{n:04d}') for n in range(5)]


def test_names_are_unique_and_fit_for_files(tmp_path):
    paths = ['a/flight.1', 'b/flight.1', 'b/FLIGHT.1', 'c/über flug', 'd/x.cphd', 'd/y.CPHD']
    for path in paths:
        folder = tmp_path / path
        folder.parent.mkdir(exist_ok=True)
        folder.touch() if path.lower().endswith('cphd') else folder.mkdir()
    found = find_recordings(Job((str(tmp_path / '*/*'),), tmp_path / 'out', 1.0))
    names = {path.relative_to(tmp_path).as_posix(): name for name, path in found.items()}
    assert names['a/flight.1'] == 'a_flight.1'
    assert names['b/flight.1'].endswith('_b_flight.1_1')  # files may not tell letters' cases
    assert names['b/FLIGHT.1'].endswith('_b_FLIGHT.1_0')
    assert (names['c/über flug'], names['d/x.cphd'], names['d/y.CPHD']) == ('über_flug', 'x', 'y')
    assert list(found) == [names[path] for path in sorted(paths)]


def test_the_output_is_no_recording(archive, tmp_path):
    os.symlink(archive / 'flight-0000', tmp_path / 'one')
    (tmp_path / 'survey').mkdir()
    found = find_recordings(Job((str(tmp_path),), tmp_path / 'survey', 1.0))
    assert list(found) == ['one']


def _catalogue(folder, hrefs, *, role='data', media=None):
    pystac = pytest.importorskip('pystac', reason='the extra formats is not installed')
    catalog = pystac.Catalog('flights', 'Some flights')
    for number, href in enumerate(hrefs):
        item = pystac.Item(f'item-{number}', None, None, datetime.datetime(2025, 1, 1), {})
        item.add_asset('pulses', pystac.Asset(str(href), roles=[role], media_type=media))
        item.add_asset('picture', pystac.Asset('picture.png'))
        catalog.add_item(item)
    catalog.normalize_and_save(str(folder), pystac.CatalogType.SELF_CONTAINED)
    return folder / 'catalog.json'


def test_a_catalogue_names_recordings_by_relative_links(archive, tmp_path):
    # items lie in folders of their own, and links start there
    links = [os.path.relpath(archive / f'flight-000{n}', tmp_path / 'stac' / f'item-{i}')
             for i, n in enumerate((3, 0))]
    path = _catalogue(tmp_path / 'stac', links)
    found = find_recordings(Job((str(path),), tmp_path / 'out', 1.0))
    assert {name: os.path.realpath(p) for name, p in found.items()} == {
        f'flight-000{n}': str(archive / f'flight-000{n}') for n in (0, 3)}
    item = tmp_path / 'stac' / 'item-0' / 'item-0.json'
    assert len(find_recordings(Job((str(item),), tmp_path / 'out', 1.0))) == 1


def test_a_catalogue_of_cphd_and_of_recordings_that_are_gone(tmp_path):
    path = _catalogue(tmp_path / 'stac', ['gone.cphd', 'also_gone'], role='recording')
    assert sorted(find_recordings(Job((str(path),), tmp_path / 'out', 1.0))) == [
        'also_gone', 'gone']  # their scans tell


def test_catalogues_that_lead_elsewhere_are_explained(tmp_path):
    path = _catalogue(tmp_path / 'stac', ['s3://bucket/flight.cphd'])
    with pytest.raises(JobError, match='item-0 .* lies at s3://bucket.*download them'):
        find_recordings(Job((str(path),), tmp_path / 'out', 1.0))
    path = _catalogue(tmp_path / 'none', ['image.nitf'])
    with pytest.raises(JobError, match='holds no recording'):
        find_recordings(Job((str(path),), tmp_path / 'out', 1.0))


@pytest.mark.parametrize('damage', [
    lambda p: p.write_text('{'), lambda p: p.write_text('[]'), lambda p: p.write_text('{"a": 1}'),
    lambda p: p.write_bytes(b'\xff\xfe'),
    lambda p: p.write_text(p.read_text().replace('item-0.json', 'gone.json'))])
def test_damaged_catalogues_are_explained(tmp_path, damage):
    path = _catalogue(tmp_path / 'stac', ['flight.cphd'])
    damage(path)
    with pytest.raises(JobError, match='no STAC catalogue that can be read') as caught:
        find_recordings(Job((str(path),), tmp_path / 'out', 1.0))
    assert '\n' not in str(caught.value)


def test_a_catalogue_without_the_library_is_one_line(tmp_path, monkeypatch):
    path = _catalogue(tmp_path / 'stac', ['flight.cphd'])
    monkeypatch.setitem(sys.modules, 'pystac', None)
    with pytest.raises(JobError, match=r'pip install sar_imaging\[archive\]') as caught:
        find_recordings(Job((str(path),), tmp_path / 'out', 1.0))
    assert '\n' not in str(caught.value)


@pytest.mark.parametrize(('pattern', 'message'), [
    ('nowhere', 'nowhere does not exist; expected a folder'),
    ('flight-9*', r'flight-9\* holds no recording'), ('empty/below', 'holds no recording')])
def test_what_is_not_found_is_explained(archive, tmp_path, pattern, message):
    (tmp_path / 'empty/below').mkdir(parents=True)
    base = tmp_path if 'empty' in pattern else archive
    with pytest.raises(JobError, match=message):
        find_recordings(Job((str(base / pattern),), tmp_path / 'out', 1.0))


def test_the_first_recording_that_can_be_read_tells_the_datum(archive):
    job = _job(archive / 'flight-*')
    found = find_recordings(job)
    told = with_datum(job, found)
    assert told.datum_from == 'flight-0000'
    truth = json.loads((archive / 'archive.json').read_text())
    assert told.datum == Datum(**truth['recordings'][0]['datum'])
    broken = {entry['name'] for entry in truth['recordings']
              if entry['broken'] in ('truncated', 'empty', 'foreign')}
    assert with_datum(job, {name: found[name] for name in broken}) == job
    without_first = {name: found[name] for name in [*sorted(broken), 'flight-0003']}
    assert with_datum(job, without_first).datum_from == 'flight-0003'
    own = _job(archive, datum=Datum(1.0, 2.0))
    assert with_datum(own, found) is own
