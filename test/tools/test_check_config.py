# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""The command line: table, exit codes, and what it says about a wrong file."""

import pytest

from sar_imaging.configuration.parameters import default_file
from sar_imaging.tools import check_config

CAR = default_file().with_name('automotive_77ghz.yaml')


@pytest.fixture
def run(tmp_path, capsys):
    """Exit code, standard output and errors for the car's file with replacements."""
    def run(*replacements, options=()):
        text = CAR.read_text()
        for old, new in replacements:
            assert text.count(old) == 1
            text = text.replace(old, new)
        path = tmp_path / 'my_radar.yaml'
        path.write_text(text)
        code = check_config.main([*options, str(path)])
        return code, *capsys.readouterr()

    return run


def test_a_good_configuration_is_a_table(run):
    code, out, err = run()
    assert (code, err) == (0, '')
    names = [line.split('  ')[0] for line in out.splitlines()]
    for name in ('range resolution', 'azimuth resolution', 'unambiguous depth', 'aperture',
                 'unambiguous direction', 'PRF', 'unambiguous range', 'range window',
                 'pixel spacing', 'input', 'memory of pulse_buffer', 'memory of backprojection',
                 'exact imaging', 'sub-apertures'):
        assert names.count(name) == 1, name
    assert 'merge (width at -3 dB on the ground, window taylor:4:35)' in out
    assert '0.0209 m or less loses no point between pixels: half of the null spacing' in out
    assert out.endswith('my_radar.yaml can work: no errors, no warnings\n')
    assert 'assumed for' in out


def test_measuring_replaces_the_assumption(run):
    # A small image, which is quick.
    code, out, _ = run(('size_x: 6.0', 'size_x: 1.0'), ('size_y: 6.0', 'size_y: 1.0'),
                       options=['--measure'])
    assert code == 0
    assert 'per second, measured)' in out


def test_an_impossible_configuration_ends_with_one(run):
    code, out, err = run(('spacing: 0.02\n', 'spacing: 0.2\n'))
    assert code == 1
    assert 'range resolution' in out  # the table shows why
    assert 'sub-apertures' not in out
    assert 'error: grid.spacing=0.2 m: scatterers between pixels vanish' in err
    assert err.rstrip().endswith('my_radar.yaml cannot work: 2 errors')


@pytest.mark.parametrize(('given', 'expected'), [
    ('mode:=volume', 'volume.height=0 in mode volume'),
    ('modus:=volume', 'argument -p has modus, which no node reads; did you mean mode?'),
    ('target_db:=low', "argument -p: target_db: expected a number such as 1.0e+9, got 'low'")])
def test_values_besides_the_file_are_checked(run, given, expected):
    code, _, err = run(options=['-p', given])
    assert code == 1 and expected in err


def test_a_warning_is_no_failure(run):
    code, out, err = run(('samples_per_pulse: 512', 'samples_per_pulse: 150'))
    assert code == 0
    assert out.endswith('my_radar.yaml can work: no errors, 1 warning\n')
    assert 'warning: the scene lies' in err


@pytest.mark.parametrize(('replacement', 'expected'), [
    (('spacing: 0.02\n', 'spaceing: 0.02\n'), 'did you mean grid.spacing?'),
    (('prf_hz: 1600.0', 'prf_hz: -1.0'), 'prf_hz=-1.0 must be positive'),
    (('velocity_y: 2.0', 'velocity_y: 0.0'), 'the platform stands still'),
    (('window: taylor:4:35', 'window: box'), "window='box' is unknown"),
    (('waveform: fmcw', 'waveform: sine'), "radar.waveform='sine' is unknown"),
    (('      prf_hz: 1600.0\n', ''), 'section check_config lacks radar.prf_hz'),
    (('/**/check_config:', '/**/check_config'), 'it is no YAML'),
])
def test_errors_say_what_to_change(run, replacement, expected):
    code, _, err = run(replacement)
    assert code == 1
    assert expected in err
    assert 'Traceback' not in err


# Odometry in the car's file, and what is said of its four receivers.
POSES = 'frame_id: odom', 'frame_id: odom\n    pose: {source: odometry}\n    antenna: {%s}'
FOUR = '[-0.00285, 0.0, 0.0, -0.00095, 0.0, 0.0, 0.00095, 0.0, 0.0, 0.00285, 0.0, 0.0]'


@pytest.mark.parametrize(('arms', 'expected'), [
    ('rx: [0.0, 0.0, 0.0]', 'positions come from odometry and 4 channels have no lever arms of '
     'their own: all would be imaged as if they were at one place; give the place of each antenna '
     f'on the platform, such as antenna.rx: {FOUR} for receivers 0.0019 m apart along the flight'),
    ('rx: [0.0, 0.0, 0.0, 0.1, 0.0, 0.0]', 'antenna.rx has 2 phase centres for 4 channels: the '
     'nodes would reject every block of pulses; give one for all or one for each'),
    ("rx_frames: 'rx_1, rx_2'", 'antenna.rx has 2 phase centres for 4 channels'),
    ('offset_s: [0.0, 0.1]', 'antenna.offset_s has 2 times for 4 channels'),
    ('tx: [0.0, 0.0]', 'antenna.tx has 2 numbers; expected x, y, z of one phase centre'),
])
def test_lever_arms_that_cannot_work_are_refused(run, arms, expected):
    code, _, err = run((POSES[0], POSES[1] % arms))
    assert code == 1
    assert f'error: {expected}' in err
    assert err.endswith('my_radar.yaml cannot work: 1 error\n')


@pytest.mark.parametrize('arms', [f'rx: {FOUR}', "rx_frames: 'rx_1, rx_2, rx_3, rx_4'",
                                  "tx_frames: 'tx_1, tx_2, tx_1, tx_2'"])
def test_lever_arms_of_each_channel_can_work_and_the_clock_is_told_of(run, arms):
    code, out, err = run((POSES[0], POSES[1] % arms))
    assert (code, err) == (0, '')
    assert 'of the platform, in frame odom as grid and images' in out
    assert 'nothing checks it: 0.1 s would move images by 0.2 m' in out  # at 2 m/s
    _, out, _ = run((POSES[0], (POSES[1] % arms) + '\n    autofocus: {time_offset: 1.5}'))
    assert 'autofocus looks for up to 1.5 s' in out and 'nothing checks' not in out


def test_channels_at_one_place_must_be_said(run):
    together = ('channel_spacing_m: 0.0019', 'channel_spacing_m: 0.0')
    said = f'rx: [{", ".join(["0.1, 0.0, 0.0"] * 4)}]'
    assert run(together, (POSES[0], POSES[1] % said))[0] == 0  # such as polarisations
    code, _, err = run((POSES[0], POSES[1] % said))
    assert code == 1 and 'have no lever arms of their own' in err  # the radar says otherwise
    code, _, err = run(together, (POSES[0], POSES[1] % 'rx: [0.1, 0.0, 0.0]'))
    assert code == 1 and 'x, y, z of each channel in antenna.rx, also where they are' in err


def test_pulses_with_positions_need_no_lever_arms(run):
    code, out, err = run(('frame_id: odom', 'frame_id: odom\n    antenna: {rx: [0.0, 1.0]}'))
    assert (code, err) == (0, '')
    assert 'every pulse states those of its antennas, in odom' in out


@pytest.mark.parametrize(('change', 'expected'), [
    ('frame_id: odom\n/**/backprojection:\n  ros__parameters: {frame_id: map}',
     'frame_id is not the same in all nodes: odom in pulse_buffer, range_compression, '
     'afbp_fusion, moving_targets, localization; map in backprojection; set it once, in the '
     'section /**'),
    (f'frame_id: odom\n    pose: {{source: odometry, frame_id: map}}\n    antenna: {{rx: {FOUR}}}',
     'pose.frame_id=map, but grid and images are in frame_id=odom: poses are not transformed')])
def test_positions_and_grid_in_different_frames_are_refused(run, change, expected):
    code, _, err = run(('frame_id: odom', change))
    assert code == 1
    assert f'error: {expected}' in err


def test_without_a_radar_lever_arms_must_still_agree(tmp_path, capsys):
    path = tmp_path / 'arms.yaml'
    path.write_text('/**:\n  ros__parameters:\n    pose: {source: pose}\n    antenna:\n'
                    f'      rx: {FOUR}\n      tx: [0.0, 0.0, 0.0, 1.0, 0.0, 0.0]\n')
    assert check_config.main([str(path)]) == 1
    assert 'antenna.tx has 2 phase centres for 4 channels' in capsys.readouterr().err


def test_sub_apertures_where_they_cannot_be(run):
    # The car above the edge of its scene.
    code, out, err = run(('centre_x: -7.0', 'centre_x: -2.9'))
    assert code == 0
    assert 'mode image only: ' in out
    assert 'the grid extends across the track' in err


def test_without_a_radar_only_names_types_and_sizes_are_checked(tmp_path, capsys):
    assert check_config.main([str(default_file())]) == 0
    assert 'no section /**/check_config: nothing is known about radar' in capsys.readouterr().out
    path = tmp_path / 'large.yaml'
    path.write_text('/**/backprojection:\n  ros__parameters:\n    grid: {size_x: 9000}\n')
    assert check_config.main([str(path)]) == 0
    path.write_text('/**/backprojection:\n  ros__parameters:\n    grid: {size_x: 90000000}\n')
    assert check_config.main([str(path)]) == 1
    assert 'more than max_image_pixels=33554432; raise grid.spacing' in capsys.readouterr().err


def test_a_file_that_is_not_there(capsys):
    assert check_config.main(['nowhere.yaml']) == 1
    assert 'error: nowhere.yaml cannot be read' in capsys.readouterr().err


def test_help(capsys):
    with pytest.raises(SystemExit) as stopped:
        check_config.main(['--help'])
    assert stopped.value.code == 0
    assert 'Exit status: 0 when the configuration can work' in capsys.readouterr().out
