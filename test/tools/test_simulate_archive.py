# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Simulated archives: reflectors where they are said to be, damage, the same bytes again."""

import json

import numpy as np
import pytest

from sar_imaging.geometry.earth import Datum
from sar_imaging.imaging.imager import plan_image
from sar_imaging.recordings import open_pulses
from sar_imaging.simulation.survey import Survey
from sar_imaging.tools.command import main
from sar_imaging.tools.simulate_archive import BROKEN, TRUTH_FILE, write_archive

# 8 recordings, 2 passes of 2 lines, 2 apertures each
SMALL = Survey(n_recordings=8, apertures=2, lines=2, passes=2, pixels=64, overlap=0.25,
               reflectors=2, clutter=20)


@pytest.fixture(scope='module')
def archive(tmp_path_factory):
    folder = tmp_path_factory.mktemp('archive') / 'a'
    return folder, write_archive(SMALL, folder)


@pytest.mark.parametrize('surface', ['plane', 'ellipsoid'])
def test_reflectors_shine_where_the_truth_puts_them_on_the_earth(surface, tmp_path):
    """Through latitude and longitude of each, and the datum that the recording tells."""
    survey = Survey(n_recordings=6, lines=3, n_channels=2, pixels=64, reflectors=3, clutter=10,
                    datum=Datum(-33.0, 151.0, 20.0), surface=surface)
    truth = write_archive(survey, tmp_path / 'a')
    places = np.array(truth['reflectors_geographic'])
    found = 0
    for entry in truth['recordings']:
        source = open_pulses(tmp_path / 'a' / entry['name'])
        grid = source.grid
        points = source.datum.from_geographic(*places.T)
        row, column = (np.rint(v).astype(int) for v in grid.to_pixels(*points.T[:2]))
        inside = (row > 3) & (row < grid.n_y - 4) & (column > 3) & (column < grid.n_x - 4)
        imager = plan_image(grid, source.radar, source.n_samples, target_db=-40.0)
        image = imager.new_image()
        for block in source.blocks(1e7):
            imager.accumulate(block, image)
        power = np.abs(image.samples)
        # a reflector returns 1 from each pulse and channel, noise and clutter far less
        least = 0.5 * source.n_pulses * source.n_channels
        for r, c in zip(row[inside], column[inside], strict=True):
            assert power[r - 1:r + 2, c - 1:c + 2].max() > least
            found += 1
    assert found > 15


def test_frames_differ_and_passes_see_the_same_ground(archive):
    folder, truth = archive
    sources = [open_pulses(folder / entry['name'], aperture=1) for entry in truth['recordings']]
    assert len({source.datum for source in sources}) == 4  # of each place, in both passes
    assert all(source.n_pulses == SMALL.pulses_per_aperture for source in sources)
    assert [entry['pass'] for entry in truth['recordings']] == [0] * 4 + [1] * 4
    one, other = sources[1], sources[5]
    assert one.scatterers == other.scatterers
    baseline = np.linalg.norm(other.track_m.mean(axis=0) - one.track_m.mean(axis=0))
    assert 0 < baseline < 0.01 * SMALL.range_m
    assert one.stamp_ns[-1] < other.stamp_ns[0]


def test_times_and_counters_ascend(archive):
    folder, truth = archive
    entry = truth['recordings'][2]['name']
    first, second = (open_pulses(folder / entry, aperture=n) for n in (0, 1))
    assert first.stamp_ns[-1] < second.stamp_ns[0] and first.counter[-1] < second.counter[0]


def test_the_same_command_gives_the_same_bytes(tmp_path, capsys):
    options = ['--recordings', '3', '--pixels', '32', '--clutter', '5', '--broken', '0']
    for name in ('a', 'b'):
        assert main(['simulate', 'archive', '--output', str(tmp_path / name), *options]) == 0
    assert '3 recordings, 0 of them broken' in capsys.readouterr().out
    files = [sorted(p for p in (tmp_path / n).rglob('*') if p.is_file()) for n in ('a', 'b')]
    assert len(files[0]) == 7
    for one, other in zip(*files, strict=True):
        assert one.read_bytes() == other.read_bytes(), one
    main(['simulate', 'archive', '--output', str(tmp_path / 'c'), *options, '--seed', '2'])
    assert json.loads((tmp_path / 'c' / TRUTH_FILE).read_text())['reflectors_m'] != json.loads(
        (tmp_path / 'a' / TRUTH_FILE).read_text())['reflectors_m']


@pytest.mark.parametrize('file_format', ['bag', 'cphd'])
def test_broken_recordings_are_refused_each_for_its_reason(tmp_path, file_format):
    if file_format == 'cphd':
        pytest.importorskip('sarkit', reason='the extra formats is not installed')
    survey = Survey(n_recordings=6, pixels=64, clutter=0)
    truth = write_archive(survey, tmp_path / 'a', file_format=file_format, broken=4)
    states = {entry['name']: entry['broken'] for entry in truth['recordings']}
    assert sorted(states.values()) == ['', '', *sorted(BROKEN)]
    assert list(states.values())[0] == ''
    for name, state in states.items():
        if state:
            with pytest.raises((RuntimeError, ValueError, OSError)):
                source = open_pulses(tmp_path / 'a' / name)
                list(source.blocks(1e7))
        else:
            assert open_pulses(tmp_path / 'a' / name).n_pulses == survey.pulses_per_aperture


@pytest.mark.parametrize(('options', 'message'), [
    (['--recordings', '5', '--lines', '2'], 'n_recordings=5 is no multiple of 1 passes of 2'),
    (['--overlap', '1'], 'overlap=1.0; expected at least 0 and less than 1'),
    (['--pixels', '3'], 'pixels=3; expected at least 16'),
    (['--apertures', '2', '--overlap', '0.95'], 'choose a smaller overlap'),
    (['--broken', '100'], 'broken=100; expected less than the 100 recordings'),
    (['--datum', '100', '0', '0'], 'latitude_deg=100')])
def test_wrong_options_are_explained(tmp_path, capsys, options, message):
    assert main(['simulate', 'archive', '--output', str(tmp_path / 'a'), *options]) == 1
    assert message in capsys.readouterr().err
    assert not (tmp_path / 'a').exists()


def test_an_archive_is_not_overwritten_by_accident(tmp_path, capsys):
    command = ['simulate', 'archive', '--output', str(tmp_path), '--recordings', '1', '--pixels',
               '16', '--broken', '0']
    (tmp_path / 'precious').touch()
    assert main(command) == main([*command, '--force']) == 1
    assert 'is not empty' in capsys.readouterr().err
    (tmp_path / 'precious').unlink()
    assert main(command) == 0 and main(command) == 1 and main([*command, '--force']) == 0


def test_long_recordings_are_streamed():
    """Blocks of some pulses, each simulated when it is asked for."""
    survey = Survey(n_recordings=1, pixels=2048, clutter=0)
    assert survey.n_bytes > 1e7
    [recording] = survey.recordings()
    block = next(recording.blocks(3))
    assert block.n_pulses == 3 and block.n_samples == survey.n_samples
