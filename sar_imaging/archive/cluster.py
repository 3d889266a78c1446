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

import sar_imaging

from ..formats.extras import require

CONNECT_SECONDS = 5.0
_WORKER_SECONDS = 10.0  # until the first worker of a running cluster is there
_PROBE_SECONDS = 20.0
_SETTINGS = {
    # A death is told at once; `run_pieces` knows which piece ran and counts its tries.
    'distributed.scheduler.allowed-failures': 0,
    # Results are small: a worker's memory is what its piece takes. Spilling and pausing would
    # free nothing, and a paused worker may wait for ever.
    'distributed.worker.memory.target': False,
    'distributed.worker.memory.spill': False,
    'distributed.worker.memory.pause': False,
    'distributed.worker.memory.terminate': 0.98,
    # A worker that dies starts again, on a busy machine in more than the usual 15 s.
    'distributed.deploy.lost-worker-timeout': '1h',
    'distributed.worker.preload': ['import signal; signal.signal(signal.SIGINT, signal.SIG_IGN)'],
    # A kernel that compiles for a minute or holds the interpreter is no reason for warnings.
    'distributed.admin.tick.limit': '1h',
}
#: One thread for each worker, also in libraries; GDAL would keep a twentieth of the machine.
ENVIRONMENT = {'NUMBA_NUM_THREADS': '1', 'OMP_NUM_THREADS': '1', 'OPENBLAS_NUM_THREADS': '1',
               'MKL_NUM_THREADS': '1', 'GDAL_CACHEMAX': '64'}


class ClusterError(RuntimeError):
    """There are no workers that can do the job; the text says what to change."""


@contextlib.contextmanager
def open_cluster(output: Path, *, scheduler: str | None = None, workers: int | None = None,
                 memory_bytes: int | None = None) -> Iterator:
    """A Dask client whose workers can write into the output folder.

    Parameters
    ----------
    output : path
        Output folder of the job; it exists.
    scheduler : str, optional
        Address of a running cluster, such as ``tcp://10.0.0.1:8786``; without it, workers of this
        machine are started, and stopped in the end.
    workers : int, optional
        Of this machine; one for each core unless told.
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
        check_workers(client, output, memory_bytes)
        yield client


def dask(module: str = 'distributed') -> ModuleType:
    """A module of Dask, or one line that says how to install it."""
    return require(module, 'an archive', extra='archive')


@contextlib.contextmanager
def _local(workers: int, memory_bytes: int | None) -> Iterator:
    config, distributed = dask('dask').config, dask()
    with config.set(_SETTINGS), warnings.catch_warnings():
        warnings.simplefilter('ignore')  # of a port that another dashboard has taken
        with distributed.LocalCluster(n_workers=workers, threads_per_worker=1, processes=True,
                                      memory_limit=memory_bytes or 0, env=ENVIRONMENT,
                                      dashboard_address='localhost:8787',
                                      silence_logs=logging.CRITICAL) as cluster, \
                distributed.Client(cluster, set_as_default=False) as client:
            yield client


@contextlib.contextmanager
def _running(address: str) -> Iterator:
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


def check_workers(client, output: Path, memory_bytes: int | None) -> None:
    """Ask every worker whether it can do the job.

    Parameters
    ----------
    client : distributed.Client
        Of the cluster.
    output : path
        Output folder, where a file is put for them to find.
    memory_bytes : int or None
        What a piece may take.

    Raises
    ------
    ClusterError
        One cannot: it lacks the package, has another version, does not see the folder, or may
        not take that much memory.
    """
    path = output / f'.probe-{uuid.uuid4().hex}'
    path.write_text(socket.gethostname())
    try:
        answers = client.run(probe, path, on_error='return')
    except Exception as error:
        raise ClusterError(f'the workers cannot be asked: {_line(error)}') from error
    finally:
        path.unlink(missing_ok=True)
    troubles = {address: trouble for address, answer in sorted(answers.items())
                if (trouble := _trouble(answer, output, memory_bytes))}
    if troubles:
        address, trouble = next(iter(troubles.items()))
        others = f' (and {len(troubles) - 1} more workers)' if len(troubles) > 1 else ''
        raise ClusterError(f'worker {address}{others} {trouble}')


def probe(path: Path, dask_worker=None) -> dict:
    """What a worker is; runs there, Dask fills in `dask_worker`."""
    return {'version': sar_imaging.__version__, 'sees': path.exists(),
            'writes': os.access(path.parent, os.W_OK), 'threads': dask_worker.state.nthreads,
            'memory_bytes': dask_worker.memory_manager.memory_limit}


def _trouble(answer, output: Path, memory_bytes: int | None) -> str:
    """Why a worker cannot do the job, or ''."""
    if isinstance(answer, Exception) and cannot_import(answer):
        return (f'cannot load sar_imaging {sar_imaging.__version__} ({_line(answer)}); install it '
                'with the extra `archive` where the worker runs')
    if isinstance(answer, Exception):
        return f'does not answer as it should: {_line(answer)}'
    if answer['version'] != sar_imaging.__version__:
        return (f'has sar_imaging {answer["version"]}, this job {sar_imaging.__version__}; '
                'install the same version on both')
    if not answer['sees'] or not answer['writes']:
        return (f'{"may not write into" if answer["sees"] else "does not see"} {output}; the '
                'output folder must be shared by all workers under the same name')
    limit, wanted = answer['memory_bytes'], (memory_bytes or 0) * answer['threads']
    if limit and limit < wanted:
        return (f'may take {limit / 1e9:.3g} GB, but its {answer["threads"]} threads need '
                f'{wanted / 1e9:.3g} GB; start it with --nthreads 1 and a larger --memory-limit, '
                'or lower the memory of a worker in the job')
    return ''


def cannot_import(error: Exception) -> bool:
    """Whether a worker could not import what it was sent; Dask tells some errors as texts."""
    return isinstance(error, ImportError) or 'ModuleNotFoundError' in str(error)


def _line(error: Exception) -> str:
    return f'{type(error).__name__}: {" ".join(str(error).split())}'
