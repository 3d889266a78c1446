# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""One job for each output folder, one process at a time."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from sar_imaging.archive.job import Job
from sar_imaging.archive.records import OtherJobError, OutputInUseError, claim, held
from sar_imaging.archive.scans import load_job
from sar_imaging.geometry.earth import Datum

ROOT = Path(__file__).resolve().parents[2]
HOLDER = """
import sys
from pathlib import Path
from sar_imaging.archive.records import held
with held(Path(sys.argv[1])):
    print('held', flush=True)
    sys.stdin.read()
"""


def make_job(output, **fields):
    return Job(**{'recordings': ('flights',), 'output': output, 'spacing_m': 0.5, **fields})


@pytest.fixture
def holder(tmp_path):
    """Another process that holds the folder until its standard input ends."""
    process = subprocess.Popen([sys.executable, '-c', HOLDER, str(tmp_path)], cwd=ROOT, text=True,
                               stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    assert process.stdout.readline() == 'held\n'
    yield process
    process.kill()
    process.communicate()


def test_the_same_job_may_go_on(tmp_path):
    claim(make_job(tmp_path))
    claim(make_job(tmp_path, retries=9))  # changes no bits
    assert load_job(tmp_path).retries == 9


def test_another_job_is_told_which_key_changed(tmp_path):
    claim(make_job(tmp_path, datum=Datum(47.0, 8.0, 400.0)))
    with pytest.raises(OtherJobError) as refused:
        claim(make_job(tmp_path, datum=Datum(47.0, 8.0, 400.0), spacing_m=0.25))
    assert str(refused.value) == (
        f'{tmp_path} was made by another job: spacing_m was 0.5, now 0.25; choose another output, '
        'remove that folder, or give the job as it was')
    assert load_job(tmp_path).spacing_m == 0.5


def test_a_folder_whose_job_cannot_be_read_is_refused(tmp_path):
    (tmp_path / 'job.json').write_text('{"digest"')
    with pytest.raises(OtherJobError, match=r'job.json cannot be read'):
        claim(make_job(tmp_path))


def test_two_jobs_on_one_output(tmp_path, holder):
    with pytest.raises(OutputInUseError) as refused, held(tmp_path):
        pass
    told = json.loads((tmp_path / 'job.lock').read_text())
    assert f'process {holder.pid} on {told["host"]}, since 20' in str(refused.value)
    assert 'wait until that job ends, stop it, or choose another output' in str(refused.value)


def test_the_lock_of_a_killed_job_holds_nobody_up(tmp_path, holder):
    holder.kill()
    holder.wait()
    assert (tmp_path / 'job.lock').exists()
    with held(tmp_path):
        pass
    with held(tmp_path):
        pass


@pytest.mark.parametrize('put', ['symlink_to', 'hardlink_to'])
def test_the_lock_is_not_written_through_links(tmp_path, put):
    precious = tmp_path / 'precious'
    precious.write_text('kept')
    getattr(tmp_path / 'job.lock', put)(precious)
    with pytest.raises(FileExistsError, match='job.lock is no file of an archive'), \
            held(tmp_path):
        pass
    assert precious.read_text() == 'kept'
