# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""The command on a simulated archive: exit status, losses, the same bits however it runs."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

pytest.importorskip('distributed', reason='Dask comes with the extra `archive`')
pytest.importorskip('zarr', reason='Zarr comes with the extra `archive`')

from sar_imaging.tools import simulate_archive
from sar_imaging.tools.archive import archive

ROOT = Path(__file__).resolve().parents[2]
RECORDINGS, BROKEN = 4, 2
JOB = """\
recordings: flights
output: survey
spacing_m: 0.25
memory_gb: 1.5
tile: 256
checked_pixels: 5
products: {strips: true, mosaic: true}
"""


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    """A job file beside a simulated archive, two of whose recordings are broken."""
    folder = tmp_path_factory.mktemp('archive')
    assert simulate_archive.main([
        '--output', str(folder / 'flights'), '--recordings', str(RECORDINGS), '--lines', '2',
        '--broken', str(BROKEN)]) == 0
    (folder / 'job.yaml').write_text(JOB)
    return folder


def bits(output):
    """All arrays and maps, by name: what the archive is made for."""
    kinds = ('images.zarr', 'mosaic.zarr', 'strips.zarr', 'strips', 'mosaic.tif')
    return {str(path.relative_to(output)): path.read_bytes() for path in output.rglob('*')
            if path.is_file() and path.relative_to(output).parts[0] in kinds}


@pytest.fixture(scope='module')
def one_worker(folder):
    """Bits that one worker makes, as a process: the program that users call."""
    output = folder / 'one'
    done = start(folder, output, 1)
    out, err = done.communicate()
    assert done.returncode == 3, out + err
    return out, bits(output), json.loads((output / 'summary.json').read_text())


def start(folder, output, workers):
    return subprocess.Popen(
        [sys.executable, '-m', 'sar_imaging.tools.command', 'archive', str(folder / 'job.yaml'),
         '--workers', str(workers), '--output', str(output)], cwd=ROOT, text=True,
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, start_new_session=True)


def test_the_summary_names_every_broken_recording(folder, one_worker):
    text, made, summary = one_worker
    truth = json.loads((folder / 'flights' / 'archive.json').read_text())
    broken = {f'scan {told["name"]}' for told in truth['recordings'] if told['broken']}
    assert len(broken) == BROKEN and {loss['key'] for loss in summary['losses']} == broken
    for loss in summary['losses']:
        assert loss['reason'] and f'lost: {loss["key"]}: {loss["reason"]}' in text
    assert summary['exit_status'] == 3 and 'dashboard: http://' in text
    assert 'apertures on a map of' in text  # the plan
    assert sum(name.startswith('images.zarr') for name in made) > RECORDINGS - BROKEN
    assert 0 < summary['peak_bytes'] < 1.5e9


def test_the_next_run_computes_nothing(folder, one_worker):
    output = folder / 'one'
    arguments = [str(folder / 'job.yaml'), '--output', str(output), '--workers', '1']
    assert archive.main(arguments) == 3
    summary = json.loads((output / 'summary.json').read_text())
    assert summary['n_computed'] == 0 and summary['n_found'] > RECORDINGS
    assert bits(output) == one_worker[1]


def test_kill_9_of_two_workers_and_a_restart_make_the_bits_of_one(folder, one_worker):
    output = folder / 'killed'
    process = start(folder, output, 2)
    while len(list(output.glob('records/*/*.json'))) < RECORDINGS and process.poll() is None:
        time.sleep(0.02)
    os.killpg(process.pid, signal.SIGKILL)
    process.communicate()
    assert process.returncode == -signal.SIGKILL
    half_done = [output / '.sar_imaging.abcd' / 'mosaic.tif',
                 output / 'mosaic.zarr' / '0.a.partial', output / 'partials.zarr' / '.p0' / '0.0']
    others = [output / '.git' / 'HEAD', output / 'notes.part']
    for path in (*half_done, *others):
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text('half')
    again = start(folder, output, 2)
    out, err = again.communicate()
    assert again.returncode == 3 and 'by an earlier run' in out, out + err
    assert bits(output) == one_worker[1]
    assert not any(path.exists() or path.parent.name.startswith('.') and path.parent.exists()
                   for path in half_done)
    assert all(path.exists() for path in others)


def test_the_plan_alone(folder, tmp_path, capsys):
    arguments = [str(folder / 'job.yaml'), '--output', str(tmp_path), '--workers', '1', '--plan']
    assert archive.main(arguments) == 3
    told = capsys.readouterr().out
    assert 'memory of a worker:' in told and 'lost: scan flight-' in told
    assert (tmp_path / 'plan.txt').read_text() in told
    assert not (tmp_path / 'images.zarr').exists()


@pytest.mark.parametrize(('text', 'expected'), [
    (JOB.replace('spacing_m', 'spacing'), 'spacing'),
    (JOB.replace('flights', 'nowhere'), 'does not exist'),
    (JOB.replace('1.5', '0.01'), 'memory_gb')])
def test_wrong_jobs_are_one_line(folder, capsys, text, expected):
    (folder / 'wrong.yaml').write_text(text)
    assert archive.main([str(folder / 'wrong.yaml')]) == 1
    error = capsys.readouterr().err
    assert error.startswith('error: ') and expected in error and error.count('\n') == 1


def test_a_folder_of_other_files_is_no_output(folder, capsys):
    before = sorted(path.name for path in folder.iterdir())
    assert archive.main([str(folder / 'job.yaml'), '--output', str(folder)]) == 1
    assert 'choose a new folder' in capsys.readouterr().err
    assert sorted(path.name for path in folder.iterdir() if path.name != 'job.lock') == before


def test_an_unreachable_scheduler_is_one_line(folder, tmp_path, capsys):
    assert archive.main([str(folder / 'job.yaml'), '--output', str(tmp_path), '--scheduler',
                         'tcp://127.0.0.1:1']) == 1
    error = capsys.readouterr().err
    assert error.startswith('error: no Dask scheduler answers') and error.count('\n') == 1


def test_another_job_on_the_same_output(folder, one_worker, capsys):
    (folder / 'other.yaml').write_text(JOB.replace('0.25', '0.5'))
    assert archive.main([str(folder / 'other.yaml'), '--output', str(folder / 'one')]) == 1
    assert 'spacing_m was 0.25, now 0.5' in capsys.readouterr().err
