# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""What evaluation says of folders, recordings and options that it cannot use."""

from pathlib import Path

import pytest

pytest.importorskip('rclpy', reason='rclpy comes as wheels for Linux on x86-64 only')

from sar_imaging.tools.evaluate import main

ROOT = Path(__file__).resolve().parents[3]
PSF = ROOT / 'bags' / 'psf'


@pytest.mark.parametrize('arguments, reason', [
    (['nowhere'], 'nowhere is not a rosbag2 recording'),
    ([PSF, '--output', ROOT / 'README.md'], 'README.md is not a folder'),
])
def test_unusable_folders(tmp_path, capsys, arguments, reason):
    arguments = [str(a) for a in arguments]
    if '--output' not in arguments:
        arguments += ['--output', str(tmp_path)]
    assert main(arguments) == 1
    assert reason in capsys.readouterr().err


def test_truncated_recording(tmp_path, capsys):
    bag = tmp_path / 'psf'
    bag.mkdir()
    (bag / 'metadata.yaml').write_bytes((PSF / 'metadata.yaml').read_bytes())
    (bag / 'psf.mcap').write_bytes((PSF / 'psf.mcap').read_bytes()[:1000])
    assert main([str(bag), '--output', str(tmp_path / 'out')]) == 1
    assert 'it is truncated' in capsys.readouterr().err


@pytest.mark.parametrize('option, reason', [
    (['--rate', '0'], 'is not a positive number'), (['--timeout', '-1'], 'is not a positive num'),
    (['--rate', 'inf'], 'is not a positive number'),
    (['--namespace', 'radar 1'], 'radar 1 is not a namespace such as radar1')])
def test_senseless_options(capsys, option, reason):
    with pytest.raises(SystemExit) as stop:
        main([str(PSF), '--output', 'unused', *option])
    assert stop.value.code == 2
    assert reason in capsys.readouterr().err
