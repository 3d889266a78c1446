# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""The benchmark of the device runs from end to end, at sizes for the simulator."""

import json

import pytest

from benchmarks import gpu


@pytest.mark.campaign
def test_benchmark_runs(tmp_path, monkeypatch):
    monkeypatch.setattr(gpu, 'COMPARED', 5)
    output = tmp_path / 'gpu.json'
    assert gpu.main(['--small', '--output', str(output)]) == 0
    found = json.loads(output.read_text())
    assert set(found['cases']) == {*gpu.SMALL, gpu.LIVE_SMALL, gpu.RAW_SMALL}
    assert not found['left_out']
    for row in found['cases'].values():
        # far from either target there would be a mistake; so few pulses are predicted poorly
        assert row['error_db'] < gpu.CORRECT_DB
    assert found['cases'][gpu.RAW_SMALL]['compression_error_db'] < -120.0


def test_no_case_begins_after_the_limit(tmp_path):
    output = tmp_path / 'gpu.json'
    assert gpu.main(['--limit', '-1', '--output', str(output)]) == 0
    assert not output.exists()


def test_every_case_has_a_size():
    sized = {**gpu.EXACT, **gpu.AFBP, **gpu.SMALL, **gpu.GROWING, **gpu.RAW, gpu.LETTER: None}
    assert set(gpu.NAMES) <= set(sized)
