# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Job files, a small archive, pieces that misbehave, and workers of this machine."""

import dataclasses
import os
import shutil
import subprocess
import uuid
from pathlib import Path

import pytest

from .small_archive import N_PULSES, fly, make_archive


@pytest.fixture
def job_file(tmp_path):
    """Function that writes a job file, and returns its path."""
    def write(text):
        path = tmp_path / 'job.yaml'
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return path

    return write


def _two_strips(folder):
    return make_archive(folder, {
        'flight-1': [(fly(0.0), 0.0), (fly(80.0, first_counter=N_PULSES), 80.0)],
        'flight-2': [(fly(40.0, 520.0), 40.0),
                     (fly(120.0, 520.0, first_counter=N_PULSES), 120.0)]})


@pytest.fixture
def two_strips(tmp_path):
    """Two recordings of two apertures each; neighbours overlap."""
    return _two_strips(tmp_path)


@pytest.fixture(scope='session')
def _imaged_once(tmp_path_factory):
    archive = _two_strips(tmp_path_factory.mktemp('imaged'))
    for scan in archive.scans:
        archive.image(scan)
    return archive


@pytest.fixture
def imaged(_imaged_once, tmp_path):
    """Those of `two_strips` with the images of all apertures, in a folder of the test's own."""
    output = tmp_path / 'out'
    shutil.copytree(_imaged_once.output, output)
    return dataclasses.replace(_imaged_once,
                               job=dataclasses.replace(_imaged_once.job, output=output))


@pytest.fixture(scope='module')
def toys_are_importable():
    """By this process and by the workers that it starts."""
    from .forked_workers import forked_workers
    with pytest.MonkeyPatch.context() as patch, forked_workers():
        folder = str(Path(__file__).parent)
        patch.syspath_prepend(folder)
        root = str(Path(__file__).resolve().parents[2])
        patch.setenv('PYTHONPATH', os.pathsep.join([folder, root]))
        yield


@pytest.fixture(scope='module')
def toys(toys_are_importable):
    """Pieces that compute little and misbehave on demand."""
    import archive_toys
    return archive_toys


@pytest.fixture(scope='module')
def client(toys_are_importable, tmp_path_factory):
    from sar_imaging.archive.cluster import open_cluster
    with open_cluster(tmp_path_factory.mktemp('cluster'), workers=2) as client:
        yield client


@pytest.fixture
def dask(toys_are_importable):
    from dask_processes import Processes
    with Processes() as processes:
        yield processes


@pytest.fixture
def namespaces():
    """Three namespaces: a scheduler's in the middle, one with workers on either side."""
    from dask_processes import can
    tag = uuid.uuid4().hex[:6]
    names = {place: f'sar{tag}{place}' for place in ('m', 'a', 'b')}
    if not can('ip', 'netns', 'add', names['m']):
        pytest.skip('no network namespaces here: needs root and `ip`')
    try:
        middle = ['ip', '-n', names['m']]
        commands = [['ip', 'netns', 'add', names['a']], ['ip', 'netns', 'add', names['b']],
                    [*middle, 'link', 'set', 'lo', 'up']]
        for number, place in enumerate('ab', 1):
            far = ['ip', '-n', names[place]]
            commands += [
                [*middle, 'link', 'add', f'v{place}', 'type', 'veth', 'peer', 'name', 'v0',
                 'netns', names[place]],
                [*middle, 'addr', 'add', f'10.77.{number}.1/24', 'dev', f'v{place}'],
                [*middle, 'link', 'set', f'v{place}', 'up'],
                [*far, 'addr', 'add', f'10.77.{number}.2/24', 'dev', 'v0'],
                [*far, 'link', 'set', 'v0', 'up'], [*far, 'link', 'set', 'lo', 'up'],
                [*far, 'route', 'add', 'default', 'via', f'10.77.{number}.1']]
        commands.append(['ip', 'netns', 'exec', names['m'], 'sysctl', '-qw',
                         'net.ipv4.ip_forward=1'])
        for command in commands:
            done = subprocess.run(command, capture_output=True, text=True)
            if done.returncode:
                pytest.skip(f'{" ".join(command)}: {done.stderr.strip()}')
        yield {place: ['ip', 'netns', 'exec', name] for place, name in names.items()}
    finally:
        for name in names.values():
            subprocess.run(['ip', 'netns', 'del', name], capture_output=True)
