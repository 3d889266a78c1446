# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""The simulate command, and that the recordings of bags/ are what it writes."""

from __future__ import annotations

import dataclasses
import importlib.metadata
import itertools
import os
import pathlib
import re
import shlex
import signal

import numpy as np
import pytest

from sar_imaging.configuration.parameters import default_file, read_configuration
from sar_imaging.recordings.bag_io import raw_messages, read_blocks, read_truth
from sar_imaging.signal.pulses import concatenate
from sar_imaging.signal.radar import SPEED_OF_LIGHT
from sar_imaging.simulation.scenarios import SCENARIOS
from sar_imaging.simulation.scenarios.scenario import Scenario
from sar_imaging.tools import simulate

BAGS = pathlib.Path(__file__).parents[2] / 'bags'
COMMANDS = re.findall(r'^python -m sar_imaging\.tools\.simulate (.+)$',
                      (BAGS / 'README.md').read_text(), re.MULTILINE)


@pytest.mark.parametrize('command', COMMANDS, ids=lambda command: command.split()[0])
def test_recording_is_regenerated_bit_for_bit(command, tmp_path, monkeypatch):
    """The countryside's clutter takes ten seconds: two of its messages, and its truth."""
    words = shlex.split(command)
    place = words.index('--output') + 1
    recorded = BAGS.parent / words[place]
    new, few = tmp_path / recorded.name, recorded.name == 'countryside'
    words[place] = str(new)
    if few:
        monkeypatch.setattr(Scenario, 'blocks', lambda *options, every=Scenario.blocks:
                            itertools.islice(every(*options), 2))
    assert simulate.main(words) == 0
    told, expected = list(raw_messages(new)), list(raw_messages(recorded))
    assert told == (expected[:2] if few else expected) and len(expected) > 2
    assert read_truth(new) == read_truth(recorded)
    if few:
        return
    assert (new / 'metadata.yaml').read_text() == (recorded / 'metadata.yaml').read_text()
    file = f'{recorded.name}.mcap'
    writer = f'rosbags-{importlib.metadata.version("rosbags")}'.encode()
    if writer not in (recorded / file).read_bytes()[:100]:
        pytest.skip('recorded with another version of rosbags: messages are the same, but the '
                    'file names its writer')
    assert (new / file).read_bytes() == (recorded / file).read_bytes()


def test_recordings_are_small_and_all_are_listed():
    folders = {path.name for path in BAGS.iterdir() if path.is_dir()}
    assert folders == {shlex.split(command)[0] for command in COMMANDS}
    assert sum(f.stat().st_size for f in BAGS.rglob('*.mcap')) < 8e6
    for name in folders:
        sizes = {b.n_pulses for b in read_blocks(BAGS / name)}
        assert min(sizes) >= 10 and max(sizes) <= 32


@pytest.mark.parametrize('name', SCENARIOS)
def test_truth_describes_the_recording(tmp_path, name):
    path = BAGS / name  # what lies there is what the command writes, see above
    if not path.is_dir():
        path = tmp_path / name
        assert simulate.main([name, '--output', str(path)]) == 0
    truth = read_truth(path)
    block = concatenate(list(read_blocks(path)))
    scenario = SCENARIOS[name]()
    assert truth['scenario'] == name and truth['frame'] == 'map'
    assert truth['compressed'] == block.compressed
    assert (truth['n_pulses'], truth['n_channels']) == block.samples.shape[:2]
    radar = {**dataclasses.asdict(scenario.radar), 'waveform': 'LFM'}
    assert radar.pop('propagation_speed_m_per_s') == SPEED_OF_LIGHT  # which is not written
    assert truth['radar'] == radar
    assert truth['grid'] == {'centre_m': list(scenario.grid.centre_m), 'n_x': scenario.grid.n_x,
                             'n_y': scenario.grid.n_y, 'spacing_m': scenario.grid.spacing_m}
    for got, scatterer in zip(truth['scatterers'], scenario.scatterers, strict=True):
        assert got['position_m'] == list(scatterer.position_m)
        assert got['amplitude_db'] == pytest.approx(scatterer.amplitude_db, abs=1e-8)


def test_noise_and_seed_change_the_samples(tmp_path):
    samples = []
    for i, options in enumerate([[], ['--noise-std', '0.1'],
                                 ['--noise-std', '0.1', '--seed', '9']]):
        path = tmp_path / str(i)
        assert simulate.main(['psf', '--output', str(path), *options]) == 0
        samples.append(concatenate(list(read_blocks(path))).samples)
    assert np.std(samples[1] - samples[0]) == pytest.approx(0.1, rel=0.02)
    assert np.std(samples[2] - samples[1]) == pytest.approx(0.1414, rel=0.02)


def test_pulses_per_message(tmp_path):
    path = tmp_path / 'psf'
    assert simulate.main(['psf', '--output', str(path), '--pulses-per-message', '64']) == 0
    assert [b.n_pulses for b in read_blocks(path)] == [64, 64, 64, 8]


def test_existing_bag_needs_force(tmp_path, capsys):
    command = ['psf', '--output', str(tmp_path / 'psf')]
    assert simulate.main(command) == 0
    assert simulate.main(command) == 1
    assert '--force' in capsys.readouterr().err
    assert simulate.main([*command, '--force']) == 0


def test_unwritable_place_is_explained(tmp_path, capsys):
    (tmp_path / 'file').write_text('in the way')
    assert simulate.main(['psf', '--output', str(tmp_path / 'file' / 'psf')]) == 1
    assert 'error:' in capsys.readouterr().err


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_signal_leaves_no_half_bag(tmp_path, monkeypatch, capsys, number):
    class Interrupted(Scenario):
        def blocks(self, pulses_per_block=25):
            for i, block in enumerate(super().blocks(pulses_per_block)):
                if i == 3:
                    os.kill(os.getpid(), number)
                yield block

    psf = SCENARIOS['psf']()
    fields = {f.name: getattr(psf, f.name) for f in dataclasses.fields(psf)}
    monkeypatch.setitem(SCENARIOS, 'psf', lambda: Interrupted(**fields))
    before = signal.getsignal(signal.SIGTERM)
    assert simulate.main(['psf', '--output', str(tmp_path / 'psf')]) == 130
    assert 'nothing was written' in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
    assert signal.getsignal(signal.SIGTERM) == before


def test_list_describes_every_scenario(capsys):
    assert simulate.main(['--list']) == 0
    text = capsys.readouterr().out
    for name, make in SCENARIOS.items():
        assert f'{name}\n    {make().description}' in text


@pytest.mark.parametrize(('arguments', 'message'), [
    ([], 'name a scenario'), (['moon'], "'moon' is unknown; use one of psf"),
    (['psf', '--pulses-per-message', '0'], 'not a positive number'),
    (['psf', '--noise-std', '-1'], 'at least 0'), (['psf', '--noise-std', 'nan'], 'at least 0')])
def test_wrong_use_is_explained(arguments, message, capsys):
    with pytest.raises(SystemExit) as stop:
        simulate.main(arguments)
    assert stop.value.code == 2
    assert message in capsys.readouterr().err


def test_a_configured_radar_is_recorded(tmp_path, capsys):
    config = default_file().with_name('automotive_77ghz.yaml')
    folder = tmp_path / 'bag'
    assert simulate.main(['--config', str(config), '--output', str(folder)]) == 0
    acquisition = read_configuration(config).acquisition()
    blocks = list(read_blocks(folder))
    assert sum(b.n_pulses for b in blocks) == 256
    assert {b.radar for b in blocks} == {acquisition.radar}
    assert {b.frame for b in blocks} == {'odom'}  # as the file says
    assert blocks[0].samples.shape[1:] == (acquisition.n_channels, acquisition.n_samples)
    truth = read_truth(folder)
    assert (truth['scenario'], truth['window']) == ('automotive_77ghz', 'taylor:4:35')
    assert truth['frame'] == 'odom'
    assert len(truth['scatterers']) == 5
    assert '256 pulses of 4 channels' in capsys.readouterr().out


@pytest.mark.parametrize(('arguments', 'expected'), [
    (['--config', 'nowhere.yaml'], 'error: nowhere.yaml cannot be read'),
    (['--config', str(default_file())], 'lacks the numbers of radar and platform; check_config'),
])
def test_a_configuration_that_cannot_be_recorded(arguments, expected, tmp_path, capsys):
    assert simulate.main([*arguments, '--output', str(tmp_path / 'bag')]) == 1
    assert expected in capsys.readouterr().err
    assert not (tmp_path / 'bag').exists()


def test_a_scenario_and_a_configuration_contradict(capsys):
    with pytest.raises(SystemExit):
        simulate.main(['psf', '--config', str(default_file())])
    assert 'name a scenario, psf, or --config, not both' in capsys.readouterr().err
