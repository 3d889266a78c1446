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
    assert '0.0594 m  width at -3 dB on the ground, window taylor:4:35' in out
    assert 'assumed for' in out


def test_measuring_replaces_the_assumption(run):
    # A small image, which is quick.
    code, out, _ = run(('size_x: 6.0', 'size_x: 1.0'), ('size_y: 6.0', 'size_y: 1.0'),
                       options=['--measure'])
    assert code == 0
    assert 'G/s (measured)' in out


def test_an_impossible_configuration_ends_with_one(run):
    code, out, err = run(('spacing: 0.02\n', 'spacing: 0.2\n'))
    assert code == 1
    assert 'range resolution' in out  # the table shows why
    assert 'sub-apertures' not in out
    assert 'error: grid.spacing=0.2 m: scatterers between pixels vanish' in err
    assert err.rstrip().endswith('my_radar.yaml cannot work: 2 errors')


def test_a_warning_is_no_failure(run):
    code, _, err = run(('samples_per_pulse: 512', 'samples_per_pulse: 150'))
    assert code == 0
    assert 'warning: the scene lies' in err


@pytest.mark.parametrize(('replacement', 'expected'), [
    (('spacing: 0.02\n', 'spaceing: 0.02\n'), 'did you mean grid.spacing?'),
    (('prf_hz: 1600.0', 'prf_hz: -1.0'), 'prf_hz=-1.0 must be positive'),
    (('velocity_y: 2.0', 'velocity_y: 0.0'), 'the platform stands still'),
    (('window: taylor:4:35', 'window: box'), "window='box' is unknown"),
    (('waveform: fmcw', 'waveform: sine'), "radar.waveform='sine' is unknown"),
    (('      prf_hz: 1600.0\n', ''), 'section check_config lacks radar.prf_hz'),
    (('/**/check_config:', '/**/check_config'), 'my_radar.yaml is no YAML'),
])
def test_errors_say_what_to_change(run, replacement, expected):
    code, _, err = run(replacement)
    assert code == 1
    assert expected in err
    assert 'Traceback' not in err


def test_sub_apertures_where_they_cannot_be(run):
    # The car above the edge of its scene.
    code, out, err = run(('centre_x: -7.0', 'centre_x: -2.9'))
    assert code == 0
    assert 'mode image only: ' in out
    assert 'the grid reaches across the track' in err


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
