# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""The three doors of the documentation lead to pictures: what their pages show runs in order."""

from __future__ import annotations

import json
import pathlib
import re
import shlex
import sys

import numpy as np
import pytest

from sar_imaging.recordings.bag_io import read_poses, read_truth
from sar_imaging.tools import command

ROOT = pathlib.Path(__file__).parent.parent
SET_UP = ('source',)  # lines that prepare a terminal


def walk(name: str, folder: pathlib.Path) -> dict:
    """Run a door's files, Python and commands in an empty folder; returns what names are left.

    Blocks called `console` install or need ROS tools; the page of a door has them run by hand.
    """
    (folder / 'bags').symlink_to(ROOT / 'bags')
    page = (ROOT / 'docs' / 'start' / f'{name}.md').read_text()
    names = {}
    for language, code in re.findall(r'^```(bash|python|yaml)\n(.*?)^```', page,
                                     re.DOTALL | re.MULTILINE):
        if language == 'yaml':
            (folder / re.match(r'# (\S+)', code)[1]).write_text(code)
        elif language == 'python':
            exec(code, names)
        else:
            for line in code.splitlines():
                run(shlex.split(line), line)
    return names


def run(words: list[str], line: str) -> None:
    if words[0] in SET_UP:
        return
    if words[:3] == ['python', '-m', 'benchmarks.weekend']:
        weekend = pytest.importorskip('benchmarks.weekend', reason='the door simulates with it')
        weekend.main(words[3:])
        return
    assert (words[0], command.main(words[1:])) == ('sar-imaging', 0), line


def brightest(image, grid: dict, n: int, apart_m: float) -> list[tuple[float, float]]:
    """The n brightest places of an image that stand apart, x and y in metres."""
    y, x = np.indices(image.shape, dtype=float)
    x = grid['centre_m'][0] + (x - (image.shape[1] - 1) / 2) * grid['spacing_m']
    y = grid['centre_m'][1] - (y - (image.shape[0] - 1) / 2) * grid['spacing_m']
    left, places = np.abs(image), []
    for _ in range(n):
        row, column = np.unravel_index(left.argmax(), left.shape)
        places.append((x[row, column], y[row, column]))
        left = np.where(np.hypot(x - x[row, column], y - y[row, column]) < apart_m, 0, left)
    return places


def test_arrays_lead_to_their_reflectors(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    names = walk('arrays', tmp_path)
    assert 'nothing wrong was found' in capsys.readouterr().out
    grid = json.loads(pathlib.Path('out/image/quality.json').read_text())['grid']
    for image in (np.load('out/image/image.npy'), names['image'].samples):  # commands and Python
        for x, y in brightest(image, grid, 6, 0.25):
            away = np.linalg.norm(np.array(names['reflectors_m'])[:, :2] - [x, y], axis=1)
            # pixels of 0.04 m, cells of 0.15 m in range: half a pixel, and what neighbours pull
            assert away.min() < 0.05
    assert pathlib.Path('python.png').stat().st_size > 10_000


def test_recordings_lead_to_a_picture_and_a_map(tmp_path, monkeypatch, capsys):
    for library in ('sarkit', 'rasterio', 'pyproj'):
        pytest.importorskip(library, reason='the extra formats is not installed')
    monkeypatch.chdir(tmp_path)
    walk('recordings', tmp_path)
    assert 'nothing wrong was found' in capsys.readouterr().out
    assert {path.name for path in pathlib.Path('out/map').iterdir()} >= {
        'image.tif', 'image.nitf', 'overlay.kml', 'image.png', 'report.html'}
    quality = json.loads(pathlib.Path('out/first/quality.json').read_text())
    # a prediction is that of even scenes; 3 dB above it an image would break its promise
    assert quality['measured_error']['error_db'] < quality['predicted_error_db'] + 3


def test_a_robots_bag_leads_to_a_picture(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    walk('robot', tmp_path)
    assert 'nothing wrong was found' in capsys.readouterr().out
    weekend = pytest.importorskip('benchmarks.weekend')
    grid = json.loads(pathlib.Path('out/my_drive/quality.json').read_text())['grid']
    for x, y in brightest(np.load('out/my_drive/image.npy'), grid, 10, 0.1):
        away = np.linalg.norm(weekend.REFLECTORS_M[:, :2] - [x, y], axis=1)
        # cells of 0.05 m in range; the rough floor, 20 dB weaker, pulls at peaks
        assert away.min() < 0.025
    # nodes refuse poses of another frame than the images'
    assert read_truth('out/bags/my_drive')['frame'] == 'odom'
    assert read_poses('out/bags/my_drive').frame_id == 'odom'


def test_a_command_without_ros_says_what_it_needs(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, 'rclpy', None)
    monkeypatch.delitem(sys.modules, 'sar_imaging.tools.evaluate', raising=False)
    assert command.main(['evaluate', 'bags/psf', '--output', 'never']) == 1
    assert 'needs rclpy, which is not installed' in capsys.readouterr().err


def test_the_newcomers_pictures_are_those_that_the_program_draws(tmp_path, monkeypatch):
    newcomer = pytest.importorskip('benchmarks.newcomer', reason='benchmarks draw the pictures')
    page = (ROOT / 'docs' / 'newcomer.md').read_text()
    shown = re.findall(r'!\[.*?\]\(images/newcomer/(\w+)\.png\)', page, re.DOTALL)
    assert shown == list(newcomer.PICTURES) and len(shown) == 10
    monkeypatch.setattr(newcomer, 'FOLDER', tmp_path)
    newcomer.main(['aperture', 'back_projection'])
    for name in ('aperture', 'back_projection'):
        assert (tmp_path / f'{name}.png').stat().st_size > 10_000
    for name in shown:  # a page of ten pictures that loads at once
        assert (ROOT / 'docs' / 'images' / 'newcomer' / f'{name}.png').stat().st_size < 80_000


def test_a_shipped_radar_goes_by_its_name(tmp_path, capsys):
    assert command.main(['check-config', 'automotive_77ghz']) == 0
    assert 'automotive_77ghz.yaml can work' in capsys.readouterr().out
    recording = tmp_path / 'car'
    assert command.main(['simulate', '--config', 'drone_uwb', '--output', str(recording)]) == 0
    assert read_truth(recording)['scenario'] == 'drone_uwb'
    assert command.main(['check-config', 'no_such_radar']) == 1
    assert 'no_such_radar cannot be read' in capsys.readouterr().err


def test_a_bag_without_pulses_says_what_makes_some(tmp_path, monkeypatch, capsys):
    weekend = pytest.importorskip('benchmarks.weekend')
    weekend.drive(tmp_path / 'drive')
    assert command.main(['image', str(tmp_path / 'drive'), '--output', str(tmp_path / 'out')]) == 1
    assert 'sar-imaging load makes a recording of the raw messages' in capsys.readouterr().err
