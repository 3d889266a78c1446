# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Damaged recordings: whatever the bytes, they are imaged, or lost with a line."""

import re
import shutil

import pytest
from hypothesis import HealthCheck, given, settings, strategies as st

from sar_imaging.archive.job import Job
from sar_imaging.archive.recordings import find_recordings, scan_recording, with_datum
from sar_imaging.simulation.survey import Survey
from sar_imaging.tools.simulate_archive import write_archive


@pytest.fixture(scope='module', params=['bag', 'cphd'])
def archive(request, tmp_path_factory):
    if request.param == 'cphd':
        pytest.importorskip('sarkit', reason='the extra formats is not installed')
    folder = tmp_path_factory.mktemp('damaged') / 'flights'
    write_archive(Survey(n_recordings=1, pixels=32, clutter=0), folder,
                  file_format=request.param)
    return folder


@settings(max_examples=40, deadline=None,
          suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_damaged_recordings_are_scanned_or_lost(archive, tmp_path, data):
    job = Job((str(archive),), tmp_path / 'out', 0.25)
    [(name, path)] = find_recordings(job).items()
    job = with_datum(job, {name: path})
    copy = tmp_path / 'copy' / path.name
    shutil.rmtree(copy.parent, ignore_errors=True)
    copy.parent.mkdir()
    shutil.copytree(path, copy) if path.is_dir() else shutil.copy(path, copy)
    file = data.draw(st.sampled_from(sorted(copy.iterdir()) if copy.is_dir() else [copy]))
    content = bytearray(file.read_bytes())
    at = data.draw(st.integers(0, len(content) - 1))
    damage = data.draw(st.sampled_from(['cut', 'bytes', 'zeros', 'gone', 'twice']))
    if damage == 'gone':
        file.unlink()
    else:
        new = {'cut': content[:at], 'twice': content + content,
               'bytes': content[:at] + data.draw(st.binary(min_size=1, max_size=8)) + content[
                   at + 8:],
               'zeros': content[:at] + bytes(64) + content[at + 64:]}[damage]
        file.write_bytes(new)
    scan = scan_recording(copy, name, job, job.output)
    assert scan.apertures or scan.losses
    for loss in scan.losses:
        assert '\n' not in loss.reason
        # what is wrong; what to do
        assert re.search('.{15}; .*(recover|correct|add|check|leave it out)', loss.reason)
    for aperture in scan.apertures:
        assert aperture.window.n_pixels < 10**6
