# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Imaging of the arc SAR: on a made-up file of the same form, and the measured one."""

from __future__ import annotations

import json
import pathlib

import numpy as np
import pytest

from benchmarks.measured import image_arcsar
from sar_imaging.geometry.antenna import Antenna
from sar_imaging.geometry.grids import MapGrid
from sar_imaging.recordings import load
from sar_imaging.signal.range_compression import RangeCompressor
from sar_imaging.simulation.echoes import EchoSimulator
from sar_imaging.tools.evaluate import main as evaluate
from sar_imaging.tools.load import main as load_recording

MEASURED = (pathlib.Path(__file__).parents[4] / 'shared' / 'data' / 'arcsar_77ghz'
            / 'Prova_Esterna_7.bin')
ANTENNA = Antenna('uniform', 70.0, cutoff_widths=0.55)
POINTS_M = ((1.32, 2.96), (-0.94, 3.58))
needs_data = pytest.mark.skipif(not MEASURED.is_file(), reason='needs the arc SAR recording in '
                                '../shared/data/arcsar_77ghz beside the repository')


def _write(path, radius_m=image_arcsar.RADIUS_M, n_pulses=160):
    """A file like the real ones with two unit scatterers, amplitude 1000 steps."""
    path.write_bytes(np.zeros((2, 4 * 128), '<i2').tobytes())
    radar = load('arcsar', path).block.radar
    simulate = EchoSimulator(radar, 256, compressed=False, amplitudes=[1e3, 1e3], points_m=[
        (x, y, 0.0) for x, y in POINTS_M])
    centre_m = image_arcsar.arc(n_pulses, radius_m)
    beat = simulate(centre_m, centre_m).conj().reshape(-1, 2)  # the board's sideband
    np.concatenate([beat.real, beat.imag], axis=1).round().astype('<i2').tofile(path)
    return path


def test_simulated_recording_focuses_and_tells_its_radius(tmp_path):
    block = load('arcsar', _write(tmp_path / 'arc.bin', radius_m=0.2063)).block
    profiles = RangeCompressor.for_block(block, window='hamming')(block)
    radii = np.array([0.2, 0.203, 0.2063, 0.21])
    for point in POINTS_M:
        # From 0.2 m: measured 9 and 10 um off.
        assert image_arcsar.autofocus_radius(profiles, point) == pytest.approx(0.2063, abs=3e-5)
        assert image_arcsar.radius_sharpness(profiles, point, ANTENNA, radii).argmax() == 2
    grid = MapGrid.from_size((0.2, 3.25, 0.0), 3.0, 1.0, 0.02)
    angle, radius_m = image_arcsar.radius_by_direction(
        profiles, image_arcsar.image_within_beam(profiles, grid, ANTENNA), grid, n_places=2)
    # The two points stand at 66 and 105 degrees.
    np.testing.assert_allclose(np.sort(np.degrees(angle)), [65.97, 104.71], atol=0.5)
    np.testing.assert_allclose(radius_m, 0.2063, atol=3e-5)


def test_pulses_go_only_where_the_antenna_looks(tmp_path):
    block = load('arcsar', _write(tmp_path / 'arc.bin')).block
    profiles = RangeCompressor.for_block(block)(block)
    x, y = POINTS_M[0]
    image = image_arcsar.image_within_beam(profiles, np.array([[x, y, 0.0], [x, -y, 0.0]]),
                                           ANTENNA)
    # 70 of 180 degrees are 62 pulses, to the nearest step of 10: measured 60
    assert abs(image[0]) / 1e3 == pytest.approx(62, abs=10.5)
    assert image[1] == 0  # behind the arm


def test_other_recordings_do_not_get_the_points_of_recording_7(tmp_path):
    file = _write(tmp_path / 'Prova_Esterna_7.bin')
    assert image_arcsar.read_recording(file).scene.scatterers == []  # the name says nothing
    # Imaged and measured all the same, at its brightest places: here the two simulated points.
    assert image_arcsar.main([str(file), '--output', str(tmp_path / 'image')]) == 0
    results = json.loads((tmp_path / 'image' / 'results.json').read_text())
    found = [(p['peak_x_m'], p['peak_y_m']) for p in results['points'][:2]]
    assert [p['name'] for p in results['points'][:2]] == ['bright_1', 'bright_2']
    # pixels of 2 cm
    np.testing.assert_allclose(sorted(found), sorted(POINTS_M), atol=0.03)
    assert 'far reflector' not in results['radius_m']


def test_what_cannot_be_measured_is_told_not_formatted():
    measured = dict.fromkeys(('peak_x_m', 'peak_y_m', 'irw_range_m', 'irw_azimuth_m'), 0.05)
    points = [measured | {'name': 'a', 'reason': ''},
              measured | {'name': 'b', 'irw_azimuth_m': None, 'reason': 'no null'},
              measured | {'name': 'c', 'irw_range_m': None, 'irw_azimuth_m': None, 'reason': 'x'},
              dict.fromkeys(measured) | {'name': 'd', 'reason': 'no peak near the truth'}]
    lines = image_arcsar.summary({'points': points, 'radius_m': {}}).splitlines()
    assert lines == [
        'a: (0.050, 0.050) m, width 5.0 cm in range, 5.0 cm in azimuth',
        'b: (0.050, 0.050) m, width 5.0 cm in range; no null',
        'c: (0.050, 0.050) m, its widths cannot be measured; x', 'd: no peak near the truth']


@pytest.mark.data
@needs_data
def test_known_and_other_measured_recordings(tmp_path, capsys):
    known = image_arcsar.read_recording(MEASURED).scene.scatterers
    assert [s['name'] for s in known] == ['point_1', 'point_2']
    other = MEASURED.with_name('Prova_Esterna_10.bin')
    assert image_arcsar.read_recording(other).scene.scatterers == []
    assert image_arcsar.main([str(other), '--output', str(tmp_path)]) == 0
    assert 'bright_3: (' in capsys.readouterr().out


@pytest.mark.data
@needs_data
def test_measured_points_focus_where_they_stand():
    block = load('arcsar', MEASURED).block
    profiles = RangeCompressor.for_block(block, window='taylor:4:35')(block)
    for x, y in POINTS_M:
        grid = MapGrid.from_size((x, y, 0.0), 0.4, 0.4, 0.01)
        image = np.abs(image_arcsar.image_within_beam(profiles, grid, ANTENNA))
        row, column = np.unravel_index(image.argmax(), image.shape)
        # measured 0 on pixels of 10 mm
        assert np.hypot(grid.x_m[column] - x, grid.y_m[row] - y) < 0.015
        assert image.max() > 100 * np.median(image)  # measured 345 and 274


@pytest.mark.data
@needs_data
@pytest.mark.usefixtures('forked_nodes')
def test_the_nodes_form_the_same_image(tmp_path):
    """Loaded by its description, through the pipeline over DDS: no beam is cut out by hand."""
    scene = ['--set', 'scene.centre_m=[1.32, 2.96, 0]', '--set', 'scene.size_m=[0.6, 0.6]',
             '--set', 'scene.scatterers={}']
    assert load_recording(['arcsar_7', str(MEASURED), '--output', str(tmp_path / 'bag'),
                           *scene]) == 0
    evaluate(['--launch-nodes', '--pipeline', '--timeout', '300',
              '--output', str(tmp_path / 'out'), str(tmp_path / 'bag')])
    nodes = np.load(tmp_path / 'out' / 'image.npy')
    recording = load('arcsar_7', MEASURED)
    profiles = RangeCompressor.for_block(recording.block, window='taylor:4:35')(recording.block)
    expected = image_arcsar.image_within_beam(
        profiles, MapGrid.from_size((1.32, 2.96, 0.0), 0.6, 0.6, 0.01), recording.antenna)
    # planned for errors of -80 and -60 dB
    assert np.linalg.norm(nodes - expected) < 1e-3 * np.linalg.norm(expected)


@pytest.mark.data
@needs_data
def test_measured_radius_comes_out_of_autofocus():
    block = load('arcsar', MEASURED).block
    profiles = RangeCompressor.for_block(block, window='taylor:4:35')(block)
    point = POINTS_M[0]
    # From 200 mm; the data's description says 210.5 mm. Measured 210.41 mm.
    radius_m = image_arcsar.autofocus_radius(profiles, point)
    assert radius_m == pytest.approx(0.2105, abs=5e-4)
    start, end = image_arcsar.radius_sharpness(profiles, point, ANTENNA, [0.2, radius_m])
    assert end > 1.8 * start  # measured 2.06


def test_missing_file_is_told(tmp_path, capsys):
    assert image_arcsar.main([str(tmp_path / 'no.bin'), '--output', str(tmp_path / 'out')]) == 1
    assert 'cannot be read' in capsys.readouterr().err
