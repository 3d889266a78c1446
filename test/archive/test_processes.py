# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Jobs as processes: killed with all their workers, interrupted, with other numbers of workers."""

import json
import os
import random
import signal
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest

from sar_imaging.files import NEW

pytest.importorskip('distributed', reason='the extra archive is not installed')

from sar_imaging.archive.scans import remove_parts

SCRIPT = Path(__file__).parent / 'toy_job.py'
LEAVES, ROUNDS = 12, 500


def start(output, workers=2):
    """The job in a session of its own, which is what a terminal gives it."""
    output.mkdir(exist_ok=True)
    return subprocess.Popen(
        [sys.executable, str(SCRIPT), str(output), str(LEAVES), str(workers), str(ROUNDS)],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, start_new_session=True)


def finish(process):
    """Summary of a job that runs to its end, and what it says on its standard error."""
    out, err = process.communicate()
    return json.loads(out.splitlines()[-1]), err


@pytest.fixture(scope='module')
def one_worker(toys, tmp_path_factory):
    """Bits of all pieces, computed one after the other by this process."""
    output = tmp_path_factory.mktemp('one')
    for piece in toys.tree(LEAVES, rounds=ROUNDS):
        toys.compute(piece, output)
    return toys.bits(output)


def test_the_same_bits_with_four_workers(toys, tmp_path, one_worker):
    """Those of two are compared where jobs are killed."""
    summary, err = finish(start(tmp_path, 4))
    assert summary['exit_status'] == 0 and err == '' and len(one_worker) == summary['n_pieces']
    assert toys.bits(tmp_path) == one_worker


def finished(output):
    """Keys of pieces with a record."""
    return {json.loads(path.read_text())['key'] for path in output.glob('records/*/*.json')}


def kill_and_go_on(toys, output, seed, kills=2):
    """Kill the job and its workers after some pieces, then let it end."""
    rng = random.Random(seed)
    before = set()
    for _ in range(kills):
        process = start(output)
        for _ in range(rng.randrange(1, 1 + LEAVES // 2)):
            process.stdout.readline()
        os.killpg(process.pid, signal.SIGKILL)
        process.communicate()
        assert before <= finished(output)
        before, n_calls = finished(output), len(toys.calls(output))
    summary, _ = finish(start(output))
    assert summary['exit_status'] == 0 and summary['n_found'] == len(before)
    assert not before & set(toys.calls(output)[n_calls:])  # computed twice


def test_kill_9_of_everything_and_a_restart(toys, tmp_path, one_worker):
    job = tmp_path / 'job'
    kill_and_go_on(toys, job, seed=0, kills=1)
    assert toys.bits(job) == one_worker
    record = next(job.glob('records/*/*.json'))
    # What a worker leaves that is killed before it moves a record to its place.
    half_done = Path(tempfile.mkdtemp(prefix=NEW, dir=record.parent))
    (half_done / record.name).write_text('{"key"')
    done = finished(job)
    remove_parts(job)
    assert not list(job.rglob(f'{NEW}*'))
    assert finished(job) == done and toys.bits(job) == one_worker


@pytest.mark.campaign
@pytest.mark.parametrize('seed', range(100, 120))
def test_campaign_of_kill_9(toys, tmp_path, one_worker, seed):
    kill_and_go_on(toys, tmp_path / 'job', seed)
    assert toys.bits(tmp_path / 'job') == one_worker


def test_ctrl_c_in_a_terminal_is_quiet_and_the_job_goes_on(toys, tmp_path, one_worker):
    """A terminal sends it to the workers, too."""
    (tmp_path / 'hold').touch()  # sums wait, so that the job cannot end before the signal
    process = start(tmp_path)
    for _ in range(3):
        process.stdout.readline()
    os.killpg(process.pid, signal.SIGINT)
    summary, err = finish(process)
    (tmp_path / 'hold').unlink()
    assert process.returncode == summary['exit_status'] == 130
    assert err == ''
    assert finish(start(tmp_path))[0]['exit_status'] == 0
    assert toys.bits(tmp_path) == one_worker
