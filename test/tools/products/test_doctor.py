# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""`sar-imaging doctor` on recordings: what it prints, writes and returns."""

from __future__ import annotations

import dataclasses
import json
import pathlib

import numpy as np

from benchmarks.support.doctor_cases import right_case
from benchmarks.support.doctor_faults import FAULTS
from sar_imaging.recordings.bag_io import write_bag
from sar_imaging.recordings.truth import make_truth
from sar_imaging.tools.products import doctor

ROOT = pathlib.Path(__file__).parents[3]


def _recorded(path, case, **changes):
    block = dataclasses.replace(case.block, **changes)
    truth = make_truth(scenario='doctor', description='for the doctor', scatterers=[],
                       grid=case.grid, radar=block.radar, n_pulses=block.n_pulses,
                       n_channels=block.n_channels, pulses_per_aperture=100_000,
                       compressed=False, cut_half_width_m=(1, 1))
    write_bag(path, [block], truth)
    return path


def test_right_recording(capsys, tmp_path):
    assert doctor.main([str(ROOT / 'bags' / 'countryside'), '--output', str(tmp_path)]) == 0
    assert 'nothing wrong was found' in capsys.readouterr().out
    assert json.loads((tmp_path / 'doctor.json').read_text())['findings'] == []
    assert (tmp_path / 'signals.png').stat().st_size > 10_000


def test_faulty_recording(capsys, tmp_path):
    case = FAULTS['clipping'][0](right_case(1), np.random.default_rng(1))
    path = _recorded(tmp_path / 'clipped', case)
    assert doctor.main([str(path), '--output', str(tmp_path / 'out')]) == 3
    assert '- clipping: ' in capsys.readouterr().out
    [finding] = json.loads((tmp_path / 'out' / 'doctor.json').read_text())['findings']
    assert finding['fault'] == 'clipping'


def test_recording_without_positions(capsys, tmp_path):
    path = _recorded(tmp_path / 'nowhere', right_case(1), tx_m=None, rx_m=None)
    assert doctor.main([str(path)]) == 3
    out = capsys.readouterr().out
    assert '- no positions: ' in out and 'looked at samples' in out


def test_what_is_no_recording(capsys, tmp_path):
    assert doctor.main([str(tmp_path / 'absent')]) == 1
    assert 'does not exist' in capsys.readouterr().err


def test_recording_that_cannot_tell(capsys, tmp_path):
    """Noise alone: no sample is wrong, and no image shows anything."""
    case = right_case(1)
    rng = np.random.default_rng(2)
    noise = rng.standard_normal(case.block.samples.shape) + 1j * rng.standard_normal(
        case.block.samples.shape)
    path = _recorded(tmp_path / 'noise', case, samples=noise.astype(np.complex64))
    assert doctor.main([str(path), '--output', str(tmp_path / 'out')]) == 4
    out = capsys.readouterr().out
    assert 'this recording cannot tell: nothing stands out' in out
    assert 'nothing wrong was found' not in out
    assert json.loads((tmp_path / 'out' / 'doctor.json').read_text())['untold']
