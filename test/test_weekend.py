# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""The weekend guide: its commands run, its numbers are derived, its failures are named."""

from __future__ import annotations

import contextlib
import io
import json
import pathlib
import re
import shlex

import numpy as np
import pytest
import yaml

from sar_imaging.configuration import Machine
from sar_imaging.configuration.derived import derive
from sar_imaging.configuration.parameters import default_file, read_configuration
from sar_imaging.configuration.report import rows
from sar_imaging.diagnosis.doctor import examine
from sar_imaging.tools import command

weekend = pytest.importorskip('benchmarks.weekend', reason='the guide simulates with benchmarks')

ROOT = pathlib.Path(__file__).parent.parent
PAGE = (ROOT / 'docs' / 'weekend.md').read_text()
BLOCKS = re.findall(r'^```(bash|yaml)\n(.*?)^```', PAGE, re.DOTALL | re.MULTILINE)


def write_files(folder):
    """The files of the page, named in their first lines."""
    for language, code in BLOCKS:
        if language == 'yaml':
            (folder / re.match(r'# (\S+)', code)[1]).write_text(code)


def test_every_command_runs_and_the_drive_is_in_focus(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_files(tmp_path)
    told = io.StringIO()
    with contextlib.redirect_stdout(told):
        for line in (line for language, code in BLOCKS if language == 'bash'
                     for line in code.splitlines()):
            program, *words = shlex.split(line)
            if program == 'python':
                assert words[:2] == ['-m', 'benchmarks.weekend'], line
                weekend.main(words[2:])
            elif program != 'ros2':  # see below
                assert (program, command.main(words)) == ('sar-imaging', 0), line
    assert 'slider.yaml can work: no errors, no warnings' in told.getvalue()
    assert 'nothing wrong was found' in told.getvalue()
    quality = json.loads(pathlib.Path('out/first_drive/quality.json').read_text())
    assert quality['measured_error']['error_db'] < quality['predicted_error_db'] < -60.0
    image, grid = np.abs(np.load('out/first_drive/image.npy')), weekend.GRID
    for place in weekend.REFLECTORS_M:
        row, column = (round(float(v)) for v in grid.to_pixels(*place[:2]))
        near = image[row - 7:row + 8, column - 7:column + 8]  # 5 cm, the resolution in range
        # a pixel and a half: neighbours and the floor, 20 dB below, pull at peaks
        assert np.hypot(*(np.array(np.unravel_index(near.argmax(), near.shape)) - 7)) < 2.2
        assert near.max() > 20 * np.median(image)


def test_the_nodes_know_what_they_are_told():
    pytest.importorskip('rclpy', reason='parameters of the nodes need ROS')
    from sar_imaging.nodes import radar_driver

    lines = [shlex.split(line) for language, code in BLOCKS if language == 'bash'
             for line in code.splitlines() if line.startswith('ros2 run')]
    assert [words[2:4] for words in lines] == [['sar_imaging', 'radar_driver'],
                                               ['sar_imaging', 'sar_pipeline']]
    told = {words[i + 1].split(':=')[0] for words in lines for i, w in enumerate(words)
            if w == '-p'}
    assert told and told <= {p.name for p in radar_driver.PARAMETERS}
    assert lines[1][-2:] == ['--params-file', 'slider.yaml']  # whose names check-config knows


def test_the_numbers_of_the_platforms_are_derived(tmp_path):
    write_files(tmp_path)
    table = [[cell.strip() for cell in line.strip('|').split('|')] for line in
             PAGE.split('as `check-config` derives them:')[1].split('\n\n')[1].splitlines()]
    names = {'wavelength': 'wavelength', 'PRF used': 'PRF', 'pulse spacing': 'pulse spacing',
             'aperture': 'aperture', 'range to the scene': 'range to the scene',
             'resolution, range': 'range resolution', 'resolution, azimuth': 'azimuth resolution'}
    files = [tmp_path / 'slider.yaml', *(default_file().with_name(f'{name}.yaml')
                                         for name in ('automotive_77ghz', 'drone_uwb'))]
    for column, file in enumerate(files, 1):
        told = {row[0]: row[column] for row in table[2:]}
        configuration = read_configuration(file)
        acquisition, imaging = configuration.acquisition(), configuration.imaging()
        derived = derive(acquisition, imaging, Machine(1e9, 'given', 8_000_000_000))
        printed = {name: (value, meaning) for name, value, meaning in rows(
            acquisition, imaging, Machine(1e9, 'given', 8_000_000_000), derived)}
        for name, row in names.items():
            assert told[name] == printed[row][0], (file.name, name)
        assert f'at least {told["PRF needed for the scene"]},' in printed['PRF'][1]
        assert float(told['speed'].split()[0]) == acquisition.speed_m_per_s
        assert float(told['beam along the track'][:-1]) == pytest.approx(
            np.degrees(acquisition.beamwidth_rad))


def failures():
    """Name of each picture, and the fault that the page says is named; None for nothing."""
    for line in PAGE.splitlines():
        if found := re.match(r'\| !\[.*\]\(images/weekend/(\w+)\.png\)', line):
            fault = re.match(r' `([^`]+)`', line.split('|')[4])
            yield found[1], fault and fault[1]


def test_every_failure_has_its_picture():
    shown = dict(failures())
    assert {'good', *shown} == set(weekend.FAILURES)
    sizes = [(weekend.FOLDER / f'{name}.png').stat().st_size for name in weekend.FAILURES]
    assert sum(sizes) < 1e6


@pytest.mark.parametrize('name', ['clipped', 'lost_frames', 'receipt_stamps'])
def test_what_the_page_says_is_named_is_named(name):
    """Those that need no image; test/diagnosis has the others."""
    found = examine(weekend.failed(name).block).findings
    assert [finding.fault for finding in found] == [dict(failures())[name]]


def test_the_description_is_the_slider_of_the_configuration():
    configured, described = [yaml.safe_load(code) for language, code in BLOCKS
                             if language == 'yaml']
    nodes = configured['/**']['ros__parameters']
    arm = described['alignment']['lever_arm_m']
    assert nodes['antenna']['tx'] == arm
    assert nodes['antenna']['rx'] == [*(np.add(arm, described['array']['rx_m'][0])),
                                      *(np.add(arm, described['array']['rx_m'][1]))]
