# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""The page of job files tells the truth."""

import pathlib
import re

import pytest

from sar_imaging.archive.job import KEYS, Job, read_job

PAGE = pathlib.Path(__file__).parents[2] / 'docs/archive_jobs.md'


def _examples():
    return re.findall(r'```yaml\n(.*?)```', PAGE.read_text(), re.DOTALL)


@pytest.mark.parametrize('text', _examples())
def test_examples_are_jobs(text, job_file, tmp_path):
    (tmp_path / 'radar.yaml').write_text('gain_m: 6.27e+6\n')
    job = read_job(job_file(text))
    assert job.output.name == 'survey'


def test_every_key_and_its_default_is_told(job_file):
    rows = dict(re.findall(r'^\| `(\w+)` \| .* \| (.*) \|$', PAGE.read_text(), re.MULTILINE))
    assert list(rows) == list(KEYS)
    default = Job(('a',), pathlib.Path('b'), 1.0)
    told = {'memory_gb': default.memory_bytes / 1e9} | {
        name: getattr(default, name) for name in rows if hasattr(default, name)}
    for name in ('height_m', 'target_db', 'tile', 'memory_gb', 'longest_piece_s',
                 'checked_pixels', 'retries'):
        assert float(rows[name]) == told[name], name
    assert rows['surface'] == f'`{default.surface}`' and rows['method'] == f'`{default.method}`'
    assert default.products.mosaic and not default.products.strips
