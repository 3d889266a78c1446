# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Workers: a cluster of this machine's processes, or a running one found by its address."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import os
import socket
import uuid
import warnings
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import sar_imaging

from ..formats.extras import require

CONNECT_SECONDS = 5.0
_WORKER_SECONDS = 10.0  # until the first worker of a running cluster is there
_SETTINGS = {
    # A paused worker would wait for memory that only its next piece could free.
    'distributed.worker.memory.pause': False,
    # Predictions make use of all that a worker may take.
    'distributed.worker.memory.terminate': 0.98,
    # After it another worker is started: one that died is back on a busy machine in less.
    'distributed.deploy.lost-worker-timeout': '60s',
    # Ctrl-C in the terminal is for the job's own process alone.
    'distributed.worker.preload': ['import signal; signal.signal(signal.SIGINT, signal.SIG_IGN)'],
}
#: One thread for each worker, also in libraries; GDAL would keep a twentieth of the machine.
ENVIRONMENT = {'NUMBA_NUM_THREADS': '1', 'OMP_NUM_THREADS': '1', 'OPENBLAS_NUM_THREADS': '1',
               'MKL_NUM_THREADS': '1', 'GDAL_CACHEMAX': '64'}


class ClusterError(RuntimeError):
    """There are no workers that can do the job; the text says what to change."""


@contextlib.contextmanager
def open_cluster(output: Path, *, scheduler: str | None = None, workers: int | None = None,
                 memory_bytes: int | None = None) -> Iterator[Any]:
    """A Dask client whose workers can write into the output folder.

    Parameters
    ----------
    output : path
        Output folder of the job; it exists.
    scheduler : str, optional
        Address of a running cluster, such as ``tcp://10.0.0.1:8786``; without it, workers of this
        machine are started, and stopped in the end.
    workers : int, optional
        Workers of this machine; one for each core unless told.
    memory_bytes : int, optional
        Bound of a worker. Workers of a running cluster must be allowed as much.

    Yields
    ------
    distributed.Client
        Its `dashboard_link` is for a browser.

    Raises
    ------
    ClusterError
        The scheduler is not there, or its workers cannot do the job.
    MissingExtraError
        Dask is not installed.
    """
    dask()
    for name in ('distributed', 'tornado.application', 'asyncio', 'bokeh'):
        logging.getLogger(name).setLevel(logging.CRITICAL)
    opened = _running(scheduler) if scheduler else _local(workers or os.cpu_count() or 1,
                                                          memory_bytes)
    with opened as client:
        _check_workers(client, output, memory_bytes)
        yield client


def dask(module: str = 'distributed') -> ModuleType:
    """A module of Dask, or one line that says how to install it."""
    return require(module, 'an archive', extra='archive')


@contextlib.contextmanager
def _local(workers: int, memory_bytes: int | None) -> Iterator[Any]:
    config, distributed = dask('dask').config, dask()
    with config.set(_SETTINGS), warnings.catch_warnings():
        warnings.simplefilter('ignore')  # of a port that another dashboard has taken
        with distributed.LocalCluster(n_workers=workers, threads_per_worker=1, processes=True,
                                      memory_limit=memory_bytes or 0, env=ENVIRONMENT,
                                      dashboard_address='localhost:8787',
                                      silence_logs=logging.CRITICAL) as cluster, \
                distributed.Client(cluster, set_as_default=False) as client:
            # Dask takes a worker that was lost for long from the cluster, and puts another one
            # in its place when it is asked for the number of workers.
            keeper = dask('tornado.ioloop').PeriodicCallback(lambda: cluster.scale(workers), 1000)
            cluster.loop.add_callback(keeper.start)
            try:
                yield client
            finally:
                cluster.loop.add_callback(keeper.stop)


@contextlib.contextmanager
def _running(address: str) -> Iterator[Any]:
    distributed = dask()
    try:
        asyncio.run(_reach(address))
        client = distributed.Client(address, timeout=CONNECT_SECONDS, set_as_default=False)
    except Exception as error:  # of sockets, of addresses, of what else answers there
        raise ClusterError(
            f'no Dask scheduler answers at {address} ({" ".join(str(error).split())}); start one '
            'with `dask scheduler`, and give the address that it prints, such as '
            'tcp://10.0.0.1:8786') from error
    with client:
        try:
            client.wait_for_workers(1, timeout=_WORKER_SECONDS)
        except (TimeoutError, asyncio.TimeoutError) as error:  # one only since Python 3.11
            raise ClusterError(
                f'the scheduler at {address} has no workers; start some: dask worker {address} '
                '--nthreads 1 --memory-limit 2GB') from error
        yield client


async def _reach(address: str) -> None:
    """Connect to a scheduler and hang up.

    A client that failed to connect stays until Python collects it, and may then wait for ever for
    a lock of the client that is being made at that moment.
    """
    security = dask().Security().get_connection_args('client')
    communication = await dask('distributed.comm').connect(address, timeout=CONNECT_SECONDS,
                                                           **security)
    await communication.close()


def _check_workers(client: Any, output: Path, memory_bytes: int | None) -> None:
    """Ask every worker whether it can do the job, and raise ClusterError where one cannot."""
    witness = output / f'.probe-{uuid.uuid4().hex}'
    witness.write_text(socket.gethostname())
    try:
        answers = client.run(trouble_of_worker, witness, sar_imaging.__version__, memory_bytes,
                             on_error='return')
    except Exception as error:
        raise ClusterError(f'the workers cannot be asked: {one_line(error)}') from error
    finally:
        witness.unlink(missing_ok=True)
    troubles = {address: trouble for address, answer in sorted(answers.items())
                if (trouble := _told(answer))}
    if troubles:
        address, trouble = next(iter(troubles.items()))
        others = f' (and {len(troubles) - 1} more workers)' if len(troubles) > 1 else ''
        raise ClusterError(f'worker {address}{others} {trouble}')


def trouble_of_worker(witness: Path, version: str, memory_bytes: int | None,
                      dask_worker: Any = None) -> str:
    """Why the worker that runs this cannot do a job, or ''.

    Parameters
    ----------
    witness : path
        A file or folder in the output folder, which the job's own process made.
    version : str
        Version of this package, at the job's own process.
    memory_bytes : int or None
        What a piece may take.
    dask_worker : distributed.Worker
        Dask fills it in where `Client.run` calls this.
    """
    if version != sar_imaging.__version__:
        return (f'has sar_imaging {sar_imaging.__version__}, this job {version}; install the same '
                'version on both')
    if not witness.exists() or not os.access(witness.parent, os.W_OK):
        what = 'may not write into' if witness.exists() else 'does not see'
        return (f'{what} {witness.parent}; the output folder must be shared by all workers under '
                'the same name')
    worker = dask_worker or dask().get_worker()
    threads, limit = worker.state.nthreads, worker.memory_manager.memory_limit
    wanted = (memory_bytes or 0) * threads
    if limit and limit < wanted:
        return (f'may take {limit / 1e9:.3g} GB, but its {threads} threads need '
                f'{wanted / 1e9:.3g} GB; start it with --nthreads 1 and a larger --memory-limit, '
                'or lower the memory of a worker in the job')
    return ''


def _told(answer: str | Exception) -> str:
    """What a worker answered, or why it could not."""
    if isinstance(answer, str):
        return answer
    if cannot_import(answer):
        return (f'cannot load sar_imaging {sar_imaging.__version__} ({one_line(answer)}); install '
                'it with the extra `archive` where the worker runs')
    return f'does not answer as it should: {one_line(answer)}'


def cannot_import(error: BaseException) -> bool:
    """Whether a worker could not import what it was sent; Dask tells some errors as texts."""
    return isinstance(error, ImportError) or 'ModuleNotFoundError' in str(error)


def one_line(error: BaseException) -> str:
    """Text of an error in one line; its type where it is no error about data or files."""
    text = ' '.join(str(error).split())
    plain = isinstance(error, (OSError, MemoryError)) or type(error).__module__.startswith('sar_')
    return text if plain and text else f'{type(error).__name__}: {text}'
