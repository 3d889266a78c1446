# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""A second process that compiles kernels while the first one does, and what becomes of it."""

import functools
import os
import subprocess
import sys
from pathlib import Path

import pytest
from numba import _dispatcher
from numba.core.dispatcher import Dispatcher

from sar_imaging import MapGrid, RangeCompressor, compilation, plan_image
from sar_imaging.backends.cpu import backprojection, beforehand
from sar_imaging.compilation_helper import _kernels_of
from sar_imaging.simulation import SCENARIOS

_KERNELS = """
import os, sys, time
from pathlib import Path
from numpy import float32, int8
from sar_imaging import compilation_helper
from sar_imaging.compilation import counted, kernel_part, njit

@kernel_part
def part(x):
    return x + 1

@njit
def first(x):
    return part(x)

@njit
def last(x):
    return part(x) + 1

def job():
    first(1)
    last(1)

def job_with_values():
    job()
    first(1)[0]

def endless_job():
    while True:
        last(1)

def waiting_job():
    time.sleep(1000)

def dying_job():
    os._exit(1)

# whatever runs beside this test
compilation_helper._LOAD = Path('load')
compilation_helper._LOAD.write_text('0.5 0.4 0.3 2/200 1000')

def helper():
    return compilation_helper._Starter._latest._helper
"""


@pytest.fixture
def run(tmp_path):
    """Runs code beside the module `kernels` in a process with a cache of its own."""
    (tmp_path / 'kernels.py').write_text(_KERNELS)
    environment = os.environ | {
        'NUMBA_CACHE_DIR': str(tmp_path / 'cache'), 'NUMBA_NUM_THREADS': '2',
        'PYTHONPATH': str(Path(compilation.__file__).parents[1])}

    def run(code, **more):
        result = subprocess.run(
            [sys.executable, '-c', 'from kernels import *\n' + code], cwd=tmp_path,
            env=environment | more, capture_output=True, text=True)
        assert result.returncode == 0, result.stderr
        assert not result.stderr
        return result.stdout
    return run


def _compiled(tmp_path):
    return sorted(path.name.partition('-')[0] for path in tmp_path.rglob('*.nbc'))


@pytest.mark.parametrize('job', ['job', 'job_with_values', 'endless_job'])
def test_the_helper_compiles_the_last_kernel_and_the_block_loads_it(run, tmp_path, job):
    run('with compilation_helper.helped(' + job + '), counted() as compiled:\n'
        '    first(1)\n'
        '    assert compiled.n == 2\n'  # with its part
        '    assert helper().wait() == 0\n'
        '    assert last(1) == 3\n'
        '    assert compiled.n == 2\n')
    assert _compiled(tmp_path) == ['kernels.first', 'kernels.last']


def test_a_helper_that_fails_changes_nothing(run):
    """It dies, the job cannot be pickled, or is too long, or raises."""
    run('for value, job in {1: dying_job, 1.5: lambda: None, 1j: bytes(65 << 20),\n'
        '                   float32(2): time.sleep}.items():\n'
        '    with compilation_helper.helped(job), counted() as compiled:\n'
        '        first(value)\n'  # of a type of its own, to be compiled
        '        helper() and helper().wait()\n'
        '        assert last(value) == value + 2\n'
        '        assert compiled.n == 3\n')


def test_no_helper_is_started_without_processor_memory_or_python(run):
    run('from unittest.mock import patch\n'
        'Path("busy").write_text("0.5 0.4 0.3 3/200 1000")\n'
        'changes = [patch.object(compilation_helper.compilation.config, "NUMBA_NUM_THREADS", 1),\n'
        '           patch.object(compilation_helper, "_LOAD", Path("busy")),\n'
        '           patch.object(compilation_helper, "available_bytes", lambda: 1 << 20),\n'
        '           patch.object(sys, "frozen", True, create=True),\n'
        '           patch.object(sys, "executable", "/usr/bin/blender"),\n'
        '           patch.object(sys, "executable", "/nowhere/python3")]\n'
        'for value, change in zip((1, 1.5, 1j, True, float32(2), int8(1)), changes):\n'
        '    with change, compilation_helper.helped(job), counted() as compiled:\n'
        '        first(value)\n'
        '        assert helper() is None\n'
        '        assert last(value) == value + 2\n'
        '        assert compiled.n == 3\n')


def test_the_helper_ends_with_the_block(run):
    """Also after an error, and where nothing is compiled there is none."""
    run('try:\n'
        '    with compilation_helper.helped(waiting_job):\n'
        '        first(1)\n'
        '        found = helper()\n'
        '        assert found.poll() is None\n'
        '        1 / 0\n'
        'except ZeroDivisionError:\n'
        '    assert found.returncode == -15\n'
        'with compilation_helper.helped(job):\n'
        '    first(1)\n'
        '    assert compilation_helper._Starter._latest is None\n')


def test_a_helper_that_was_stopped_is_ended(run):
    run('import signal\n'
        'compilation_helper._END_S = 0.1\n'
        'with compilation_helper.helped(waiting_job):\n'
        '    first(1)\n'
        '    found = helper()\n'
        '    found.send_signal(signal.SIGSTOP)\n'
        '    os.waitid(os.P_PID, found.pid, os.WSTOPPED | os.WNOWAIT)\n'
        'assert found.returncode == -9\n')


def test_one_helper_at_a_time(run):
    run('with compilation_helper.helped(waiting_job):\n'
        '    first(1)\n'
        '    found = compilation_helper._Starter._latest\n'
        '    with compilation_helper.helped(job):\n'
        '        last(1)\n'
        '        assert compilation_helper._Starter._latest is found\n'
        '    assert found._helper.poll() is None\n'
        'assert found._helper.poll() == -15\n')


def test_a_helper_whose_parent_has_ended_compiles_nothing_more(run, tmp_path):
    for parent, kernels in ((-1, []), ('os.getppid()', ['kernels.first', 'kernels.last'])):
        run('import io, pickle, types\n'
            f'file = io.BytesIO(pickle.dumps({parent}) + pickle.dumps(job))\n'
            'sys.stdin = types.SimpleNamespace(buffer=file)\n'
            'compilation_helper.help_parent()\n')
        assert _compiled(tmp_path) == kernels


@pytest.fixture
def run_beside(run):
    """Runs code while another process is about to compile `first`."""
    run('first(1)')

    def run_beside(code):
        run('import fcntl, types\n'
            'from sar_imaging import compilation\n'
            'cache = Path("cache")\n'
            'made = {path: path.read_bytes() for path in cache.rglob("kernels.first*.nb?")}\n'
            'for path in made:\n'
            '    path.unlink()\n'
            'held = next(cache.rglob("kernels.first*.lock")).open("wb")\n'
            'fcntl.flock(held, fcntl.LOCK_EX)\n' + code)
    return run_beside


def test_who_needs_a_kernel_that_another_process_compiles_waits_and_loads_it(run_beside):
    run_beside('def sleep(_):\n'
               '    for path, content in made.items():\n'
               '        path.write_bytes(content)\n'
               '    fcntl.flock(held, fcntl.LOCK_UN)\n'
               'compilation.time = types.SimpleNamespace(sleep=sleep, monotonic=time.monotonic)\n'
               'with counted() as compiled:\n'
               '    assert first(1) == 2\n'
               'assert compiled.n == 0\n'
               'assert not compilation.compiled_elsewhere(first)\n')


def test_nobody_waits_without_end_for_another_process(run_beside):
    run_beside('compilation._MOST_WAIT_S = 0.0\n'
               'with counted() as compiled:\n'
               '    assert first(1) == 2\n'
               'assert compiled.n == 2\n'
               'assert all(path.exists() for path in made)\n'
               'assert compilation.compiled_elsewhere(first)\n')


def test_who_waits_for_another_process_can_give_up(run_beside):
    run_beside('try:\n'
               '    with compilation.interruptible(lambda: False):\n'
               '        first(1)\n'
               'except compilation.CompilationInterrupted:\n'
               '    sys.exit()\n'
               'raise AssertionError\n')


def test_where_there_can_be_no_lock_kernels_are_compiled_as_ever(run_beside):
    run_beside('[path] = cache.rglob("kernels.first*.lock")\n'
               'path.unlink()\n'
               'path.mkdir()\n'
               'assert first(1) == 2\n'
               'assert all(path.exists() for path in made)\n')


def test_nobody_waits_for_a_kernel_that_cannot_be_compiled(run):
    run('from numba import TypingError\n'
        'try:\n'
        '    first("a")\n'
        'except TypingError:\n'
        '    assert not compilation_helper.compilation.compiled_elsewhere(first)\n'
        '    sys.exit()\n'
        'raise AssertionError\n')


@pytest.mark.parametrize(('method', 'corner_m'), [
    ('exact', None), ('exact', (1.0, 0.0, 0.0)), ('afbp', None)])
def test_the_helper_makes_the_kernels_of_an_image_and_no_others(method, corner_m, monkeypatch):
    """By groups, around the antenna by points, and by AFBP."""
    scenario = SCENARIOS['spotlight']()
    raw = next(scenario.blocks())
    block = RangeCompressor.for_block(raw)(raw)
    grid = scenario.grid if corner_m is None else MapGrid(corner_m, 16, 16, 0.25)
    imager = plan_image(grid, block.radar, block.n_samples, method=method)
    called = {}

    def call(kernel, *arguments):
        if compilation.shared(kernel):
            called[kernel, tuple(map(kernel.typeof_pyval, arguments))] = None
        return _dispatcher.Dispatcher.__call__(kernel, *arguments)

    with monkeypatch.context() as patched:
        patched.setattr(Dispatcher, '__call__', call, raising=False)
        imager(block)
    module = beforehand if method == 'afbp' else backprojection
    job = functools.partial(module.form_silently, imager.report.plan, block.n_samples)
    assert _kernels_of(job) == list(called)
