# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Campaign: two simulated archives, every kind of piece, the same bits however they are computed.

By 1, 2 and 4 workers, by workers in two network namespaces, with workers killed at random
moments, and after ``kill -9`` of all processes. ARCHIVE_RESULTS names a file for what happened,
ARCHIVE_KILLS the number of runs of each that are killed, each way.
"""

import contextlib
import json
import os
import random
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

pytest.importorskip('zarr', reason='Zarr comes with the extra `archive`')
pytest.importorskip('psutil', reason='psutil comes with Dask')

import psutil

from sar_imaging.tools import simulate_archive

pytestmark = pytest.mark.campaign

ROOT = Path(__file__).resolve().parents[2]
KILLS = int(os.environ.get('ARCHIVE_KILLS', '10'))
SURVEYS = {
    # aperture images that fit a piece each, GeoTIFF and SICD
    'whole': ['--recordings', '4', '--passes', '2', '--pixels', '384', '--channels', '2',
              '--broken', '1', '--clutter', '0'],
    # images of several tiles, and one of two sub-apertures and their sum
    'parts': ['--recordings', '4', '--passes', '2', '--pixels', '900', '--channels', '4',
              '--broken', '1', '--clutter', '0', '--surface', 'ellipsoid']}
JOBS = {
    'whole': 'tile: 256\nproducts: {images: [geotiff, sicd], strips: true, mosaic: true, '
             'coherence_window: 5}\n',
    'parts': 'tile: 512\nsurface: ellipsoid\narea_m: [0, -512, 256, 512]\nproducts: {images: '
             '[geotiff], strips: true, mosaic: true, coherence_window: 5}\n'}
_COMMON = {'scan', 'image', 'strip', 'mosaic', 'coherence', 'geotiff', 'catalogue'}
KINDS = {'whole': _COMMON | {'sicd'}, 'parts': _COMMON | {'sum'}}
# what a run tells of itself: places, times, processes
_OF_THE_RUN = {'records', 'job.json', 'job.lock', 'plan.txt', 'summary.json'}
# dates of writing: of a catalogue; of NITF, its header and the metadata in it
_CREATED = re.compile(rb'"created": "[^"]*"')
_NITF_DATES = re.compile(rb'\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d(\.\d+)?Z')
_NITF_HEADER_DATE = slice(25, 39)


@pytest.fixture(scope='module')
def archives(tmp_path_factory):
    """Job files, each beside its recordings."""
    folder = tmp_path_factory.mktemp('archives')
    for name, options in SURVEYS.items():
        simulate_archive.main(['--output', str(folder / name), *options])
        (folder / f'{name}.yaml').write_text(
            f'recordings: {name}\noutput: none\nspacing_m: 0.25\nmemory_gb: 0.8\n'
            f'checked_pixels: 5\nlongest_piece_s: 1\n{JOBS[name]}')
    return folder


@pytest.fixture(scope='module')
def told():
    """What happened, for the documents."""
    found = {}
    yield found
    if os.environ.get('ARCHIVE_RESULTS'):
        from benchmarks.support.machine import machine
        Path(os.environ['ARCHIVE_RESULTS']).write_text(
            json.dumps({'machine': machine(), **found}, indent=1) + '\n')


def command(archives, name, folder, *options):
    """The program that users call; outputs have the same name, which catalogues tell."""
    return [sys.executable, '-m', 'sar_imaging.tools.command', 'archive',
            str(archives / f'{name}.yaml'), '--output', str(folder / 'survey'), *options]


def start(archives, name, folder, *options, before=()):
    with open(folder / 'log', 'w') as log:  # a pipe would fill
        return subprocess.Popen([*before, *command(archives, name, folder, *options)], cwd=ROOT,
                                stdout=log, stderr=subprocess.STDOUT, start_new_session=True)


def finish(process, folder):
    """Summary of a run that ends by itself: broken recordings are lost, nothing else."""
    status, text = process.wait(), (folder / 'log').read_text()
    assert status == 3, text
    summary = json.loads((folder / 'survey' / 'summary.json').read_text())
    assert all(loss['key'].startswith('scan ') for loss in summary['losses']), text
    return summary


def records(folder):
    """Texts of all records, by key; each names the run and process that computed it."""
    texts = [path.read_text() for path in (folder / 'survey').glob('records/*/*.json')]
    return {json.loads(text)['key']: text for text in texts}


def bits(folder):
    """All files of results, by name, without dates of writing."""
    output = folder / 'survey'
    found = {}
    for path in output.rglob('*'):
        name = path.relative_to(output)
        if path.is_file() and name.parts[0] not in _OF_THE_RUN:
            data = path.read_bytes()
            if path.suffix == '.nitf':
                data = _NITF_DATES.sub(b'', data.replace(data[_NITF_HEADER_DATE], b''))
            found[str(name)] = _CREATED.sub(b'', data)
    return found


def equal(folder, expected):
    """Fails with the names of the files that differ."""
    found = bits(folder)
    differing = sorted(name for name in found.keys() | expected.keys()
                       if found.get(name) != expected.get(name))
    assert differing == []
    return len(found)


@pytest.fixture(scope='module', params=list(SURVEYS))
def undisturbed(request, archives, tmp_path_factory, told):
    """One worker that nothing disturbs: name of the archive, its bits, number of records."""
    name = request.param
    first, two = (tmp_path_factory.mktemp(f'{name}-{n}') for n in (1, 2))
    begin = time.perf_counter()
    summary = finish(start(archives, name, first, '--workers', '1'), first)
    one_s, begin = time.perf_counter() - begin, time.perf_counter()
    finish(start(archives, name, two, '--workers', '2'), two)
    two_s, expected = time.perf_counter() - begin, bits(first)
    assert {key.split()[0] for key in records(first)} == KINDS[name]
    told[name] = {
        'pieces': summary['n_pieces'], 'lost': [loss['key'] for loss in summary['losses']],
        'seconds_of_one_worker': round(one_s, 1),
        'runs': [{'workers': 1, 'files': len(expected),
                  'bytes': sum(map(len, expected.values()))},
                 {'workers': 2, 'seconds': round(two_s, 1), 'equal_files': equal(two, expected)}]}
    return name, expected, len(records(first))


def test_four_workers(archives, undisturbed, told, tmp_path):
    name, expected, _ = undisturbed
    finish(start(archives, name, tmp_path, '--workers', '4'), tmp_path)
    told[name]['runs'].append({'workers': 4, 'equal_files': equal(tmp_path, expected)})


def test_two_network_namespaces(archives, undisturbed, told, tmp_path, dask, namespaces):
    """Two workers on either side of a scheduler, which no address is shared by."""
    name, expected, _ = undisturbed
    address = dask.scheduler(host='10.77.1.1', before=namespaces['m'])
    for place in 'aabb':
        dask.worker(address, before=namespaces[place])
    finish(start(archives, name, tmp_path, '--scheduler', address, before=namespaces['m']),
           tmp_path)
    hosts = [re.search(r'"worker": "tcp://([^:]+):', text)[1]
             for text in records(tmp_path).values()]
    assert set(hosts) == {'10.77.1.2', '10.77.2.2'}
    told[name]['runs'].append({
        'namespaces': {host: hosts.count(host) for host in sorted(set(hosts))},
        'equal_files': equal(tmp_path, expected)})


@pytest.mark.parametrize('seed', range(KILLS))
def test_workers_killed_at_random_moments(archives, undisturbed, told, tmp_path, seed):
    name, expected, n_records = undisturbed
    rng, killed = random.Random(seed), []
    moments = sorted((rng.randrange(n_records), rng.random()) for _ in range(3))
    process = start(archives, name, tmp_path, '--workers', '2')
    for finished, more in moments:
        wait_for(process, tmp_path, finished, more)
        workers = [] if process.poll() is not None else worker_processes(process.pid)
        if workers:
            rng.choice(workers).kill()
            killed.append(len(records(tmp_path)))
    summary = finish(process, tmp_path)
    told[name].setdefault('workers_killed', []).append({
        'seed': seed, 'finished_at_kills': killed, 'seconds': round(summary['seconds'], 1),
        'equal_files': equal(tmp_path, expected)})


@pytest.mark.parametrize('seed', range(KILLS))
def test_kill_9_of_everything(archives, undisturbed, told, tmp_path, seed):
    name, expected, n_records = undisturbed
    rng, before, killed = random.Random(1000 + seed), {}, []
    moments = sorted((rng.randrange(n_records), rng.random()) for _ in range(2))
    for finished, more in moments:
        process = start(archives, name, tmp_path, '--workers', '2')
        wait_for(process, tmp_path, finished, more)
        if process.poll() is not None:
            break
        os.killpg(process.pid, signal.SIGKILL)
        process.wait()
        found = records(tmp_path)
        assert before.items() <= found.items()  # none computed twice
        before = found
        killed.append(len(found))
    summary = finish(start(archives, name, tmp_path, '--workers', '2'), tmp_path)
    again = [key for key, text in records(tmp_path).items() if before.get(key, text) != text]
    assert again == []
    told[name].setdefault('everything_killed', []).append({
        'seed': seed, 'finished_at_kills': killed, 'found': summary['n_found'],
        'computed': summary['n_computed'], 'computed_twice': len(again),
        'equal_files': equal(tmp_path, expected)})


def wait_for(process, folder, finished, more):
    """Wait until some pieces are finished and up to a second more, or for the end."""
    while process.poll() is None and len(records(folder)) < finished:
        ends_within(process, 0.01)
    ends_within(process, more)


def ends_within(process, seconds):
    """Wait for the end of a process, but not for long."""
    with contextlib.suppress(subprocess.TimeoutExpired):
        process.wait(seconds)


def worker_processes(pid):
    """Workers of a job, which Dask starts as processes of multiprocessing."""
    return [child for child in psutil.Process(pid).children(recursive=True)
            if any('multiprocessing' in part and 'spawn_main' in part
                   for part in child.cmdline())]
