# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Running clusters: what is refused, in one line each; two network namespaces."""

import contextlib
import os
import socket
import subprocess
import sys
import threading
from pathlib import Path

import pytest

pytest.importorskip('distributed', reason='the extra archive is not installed')

from sar_imaging.archive.cluster import ClusterError, open_cluster
from sar_imaging.archive.runner import run_pieces

NEXT_TO_THIS = Path(__file__).parent


def refused(output, address, memory_bytes=None):
    """The line that says why this cluster does not do."""
    with pytest.raises(ClusterError) as error, \
            open_cluster(output, scheduler=address, memory_bytes=memory_bytes):
        pass
    assert '\n' not in str(error.value)
    return str(error.value)


def test_a_job_on_a_running_cluster(dask, toys, tmp_path):
    address = dask.scheduler()
    dask.worker(address)
    with open_cluster(tmp_path, scheduler=address, memory_bytes=2_000_000_000) as client:
        summary = run_pieces(toys.tree(4), toys.compute, client, tmp_path, retries=1)
    assert summary.exit_status == 0


def test_nothing_listens(tmp_path):
    with socket.socket() as closed:  # bound, and nobody listens
        closed.bind(('127.0.0.1', 0))
        address = f'tcp://127.0.0.1:{closed.getsockname()[1]}'
        assert refused(tmp_path, address).startswith(f'no Dask scheduler answers at {address}')


@pytest.mark.parametrize('address', ['no address', 'tcp://no-such-host.invalid:8786', 'tcp://a:b'])
def test_addresses_that_are_none(tmp_path, address, monkeypatch):
    distributed = pytest.importorskip('distributed')
    # a client that failed could stop the next one for ever when it is collected
    monkeypatch.setattr(distributed, 'Client', lambda *_, **__: pytest.fail('a client was made'))
    assert 'start one with `dask scheduler`' in refused(tmp_path, address)


def test_something_else_listens(tmp_path):
    with socket.create_server(('127.0.0.1', 0)) as server:
        def answer():
            with contextlib.suppress(OSError):
                while True:
                    connection, _ = server.accept()
                    connection.sendall(b'HTTP/1.1 400 Bad Request\r\n\r\n')
                    connection.close()
        threading.Thread(target=answer, daemon=True).start()
        address = f'tcp://127.0.0.1:{server.getsockname()[1]}'
        assert refused(tmp_path, address).startswith('no Dask scheduler answers')
        server.shutdown(socket.SHUT_RDWR)


def test_a_scheduler_without_workers(dask, tmp_path, monkeypatch):
    monkeypatch.setattr('sar_imaging.archive.cluster._WORKER_SECONDS', 0.5)
    address = dask.scheduler()
    assert f'has no workers; start some: dask worker {address}' in refused(tmp_path, address)


@pytest.mark.parametrize(('custom', 'expected'), [
    ('import sar_imaging; sar_imaging.__version__ = "9.9"', 'has sar_imaging 9.9, this job'),
    ('import sys; sys.modules["sar_imaging"] = None', 'cannot load sar_imaging')])
def test_workers_of_another_version_and_without_the_package(dask, tmp_path, custom, expected):
    (tmp_path / 'sitecustomize.py').write_text(custom)
    path = os.pathsep.join([str(tmp_path), os.environ['PYTHONPATH']])
    address = dask.scheduler()
    dask.worker(address, environment={'PYTHONPATH': path})
    assert expected in refused(tmp_path, address)


def test_workers_that_may_not_take_enough_memory(dask, tmp_path):
    address = dask.scheduler()
    dask.worker(address, memory='3GB', threads=2)
    assert ('may take 3 GB, but its 2 threads need 4 GB; start it with --nthreads 1'
            in refused(tmp_path, address, memory_bytes=2_000_000_000))


def test_a_worker_that_does_not_see_the_output(dask, tmp_path):
    from dask_processes import can
    if not can('unshare', '-m', 'true'):
        pytest.skip('no namespaces for mounts here: needs root and `unshare`')
    address = dask.scheduler()
    hidden = ['unshare', '-m', 'sh', '-c', f'mount -t tmpfs none {tmp_path} && exec "$@"', 'sh']
    dask.worker(address, before=hidden)
    assert (f'does not see {tmp_path}; the output folder must be shared by all workers'
            in refused(tmp_path, address))
    assert list(tmp_path.iterdir()) == []  # the probe is gone


def test_a_scheduler_that_dies_stops_the_job_which_goes_on_elsewhere(dask, toys, tmp_path):
    from dask_processes import Processes
    with Processes() as other, contextlib.suppress(Exception):
        address = other.scheduler()
        other.worker(address)
        with open_cluster(tmp_path, scheduler=address) as client:
            summary = run_pieces(toys.tree(4, rounds=500), toys.compute, client, tmp_path,
                                 on_result=lambda piece, result: other.__exit__())
    assert summary.exit_status == 1 and 'the scheduler' in summary.stopped
    assert '\n' not in summary.stopped
    address = dask.scheduler()
    dask.worker(address)
    with open_cluster(tmp_path, scheduler=address) as client:
        later = run_pieces(toys.tree(4, rounds=500), toys.compute, client, tmp_path)
    assert later.exit_status == 0 and later.n_found >= 1


def test_the_same_bits_in_two_network_namespaces_with_a_scheduler_between(
        dask, toys, namespaces, client, tmp_path):
    """The scheduler of either side is the middle; no address is shared by all three."""
    (tmp_path / 'local').mkdir()
    run_pieces(toys.tree(12), toys.compute, client, tmp_path / 'local')
    (tmp_path / 'apart').mkdir()
    address = dask.scheduler(host='10.77.1.1', before=namespaces['m'])
    for place in 'ab':
        dask.worker(address, before=namespaces[place])
    job = subprocess.run(
        [*namespaces['m'], sys.executable, str(NEXT_TO_THIS / 'toy_job.py'),
         str(tmp_path / 'apart'), '12', '2', '200', address], text=True, capture_output=True)
    assert job.returncode == 0, job.stderr
    assert toys.bits(tmp_path / 'apart') == toys.bits(tmp_path / 'local')
    hosts = {line.split('"worker": "tcp://')[1].split(':')[0]
             for path in (tmp_path / 'apart').glob('records/*/*.json')
             for line in path.read_text().splitlines()}
    assert hosts == {'10.77.1.2', '10.77.2.2'}
