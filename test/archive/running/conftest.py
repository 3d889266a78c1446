"""Workers of this machine, shared by the tests of a module that do not break them for good."""

import os
import subprocess
import uuid
from pathlib import Path

import pytest

pytest.importorskip('distributed', reason='Dask comes with the extra `archive`')

from sar_imaging.archive.cluster import open_cluster


@pytest.fixture(scope='session', autouse=True)
def toys_are_importable():
    """By this process and by the workers that it starts."""
    with pytest.MonkeyPatch.context() as patch:
        folder = str(Path(__file__).parent)
        patch.syspath_prepend(folder)
        root = str(Path(__file__).resolve().parents[3])
        patch.setenv('PYTHONPATH', os.pathsep.join([folder, root]))
        yield


@pytest.fixture(scope='module')
def client(toys_are_importable, tmp_path_factory):
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
