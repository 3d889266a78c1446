# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Parameter files are read as ROS reads them, and what no node would read is an error."""

import dataclasses
import pathlib

import pytest
import yaml
from hypothesis import given, strategies as st

from sar_imaging import nodes
from sar_imaging.configuration.parameters import (
    CHECKER_PARAMETERS,
    ConfigurationFileError,
    default_file,
    interpret,
    read_configuration,
)
from sar_imaging.geometry.grids import MapGrid
from sar_imaging.signal.radar import SPEED_OF_LIGHT, Waveform
from sar_imaging.yaml_text import load_yaml

DEFAULTS = yaml.safe_load(default_file().read_text())
RADAR = """
/**/check_config:
  ros__parameters:
    radar: {carrier_hz: 9.6e+9, bandwidth_hz: 400.0e+6, sample_rate_hz: 480.0e+6,
            pulse_length_s: 5.0e-6, range_start_m: 4850.0, samples_per_pulse: 3456,
            channels: 2, channel_spacing_m: 0.4, prf_hz: 400, beamwidth_deg: 180.0}
    platform: {centre_x: -4600.0, centre_y: 1.0, centre_z: 2000.0, velocity_x: 3.0,
               velocity_y: 80.0}
"""


def read(text):
    return interpret(load_yaml(text), DEFAULTS)


def errors(text):
    return [f.text for f in read(text).findings]


def test_defaults_are_those_of_the_default_file():
    configuration = read_configuration(default_file())
    assert configuration.findings == ()
    assert not configuration.describes_radar
    assert configuration.nodes['backprojection']['grid.spacing'] == 0.25
    imaging = configuration.imaging()
    assert imaging.grid == MapGrid.from_size((0.0, 0.0, 0.0), 100.0, 100.0, 0.25)
    assert imaging.pulses_per_aperture == 1024
    assert imaging.window == 'none'


def test_every_node_has_a_section():
    """Without one the checker would refuse its parameters."""
    folder = pathlib.Path(nodes.__file__).parent
    executable = {p.stem for p in folder.glob('*.py') if '\ndef main(' in p.read_text()}
    assert set(read_configuration(default_file()).nodes) == executable - {'sar_pipeline'}


def test_radar_and_platform():
    acquisition = read(RADAR).acquisition()
    radar = acquisition.radar
    assert radar.first_sample_delay_s == pytest.approx(2 * 4850.0 / SPEED_OF_LIGHT)
    assert radar.chirp_rate_hz_per_s == pytest.approx(400e6 / 5e-6)
    assert radar.waveform == Waveform.LFM
    assert (acquisition.n_samples, acquisition.n_channels, acquisition.prf_hz) == (3456, 2, 400.0)
    assert acquisition.centre_m == (-4600.0, 1.0, 2000.0)
    assert acquisition.velocity_m_per_s == (3.0, 80.0, 0.0)
    assert acquisition.beamwidth_rad == pytest.approx(3.14159265)


def test_speed_of_the_waves():
    sonar = RADAR.replace('radar: {', 'radar: {propagation_speed_m_per_s: 1480.0, ').replace(
        '9.6e+9', '300e3').replace('400.0e+6', '60e3').replace('480.0e+6', '100e3').replace(
        '5.0e-6', '1e-3').replace('4850.0', '30.0')
    radar = read(sonar).acquisition().radar
    assert radar.propagation_speed_m_per_s == 1480.0
    assert radar.first_sample_delay_s == pytest.approx(2 * 30.0 / 1480.0)
    assert read(RADAR).acquisition().radar.propagation_speed_m_per_s == SPEED_OF_LIGHT
    with pytest.raises(ValueError, match='propagation_speed_m_per_s=0.0 must be positive'):
        read(sonar.replace('1480.0', '0.0')).acquisition()


@pytest.mark.parametrize('number', ['9.6e9', '96e8', '9.6E+9', '+9600.e6', '.96e10'])
def test_numbers_as_ros_takes_them(number):
    acquisition = read(RADAR.replace('9.6e+9', number)).acquisition()
    assert acquisition.radar.carrier_hz == 9.6e9


@pytest.mark.parametrize('text', ['e9', '1e', '9.6e9x', "'9.6e9'", '1e9.5'])
def test_texts_stay_texts(text):
    assert isinstance(load_yaml(text), str)


def test_an_fmcw_ramp_sweeps_its_bandwidth_with_its_samples():
    text = RADAR.replace('radar: {', 'radar: {waveform: fmcw, ')
    radar = read(text).acquisition().radar
    assert radar.waveform == Waveform.FMCW
    assert radar.chirp_rate_hz_per_s * 3456 / radar.sample_rate_hz == pytest.approx(400e6)


@pytest.mark.parametrize('key', ['/**/backprojection', '/radar1/backprojection',
                                 'backprojection', '/backprojection'])
def test_names_of_sections(key):
    configuration = read(f'{key}:\n  ros__parameters:\n    grid:\n      spacing: 1\n')
    assert configuration.findings == ()
    # A whole number for a double is taken as the nodes take it.
    assert configuration.nodes['backprojection']['grid.spacing'] == 1.0


def test_nested_namespaces_and_the_common_section():
    configuration = read("""
/**:
  ros__parameters: {pulses_per_aperture: 64, use_sim_time: true,
                    start_type_description_service: true}
/radar1:
  backprojection:
    ros__parameters: {"grid.spacing": 0.5, qos_overrides: {/image: {publisher: {depth: 2}}}}
""")
    assert configuration.findings == ()
    assert configuration.imaging().pulses_per_aperture == 64
    assert configuration.imaging().grid.spacing_m == 0.5
    assert configuration.nodes['pulse_buffer']['pulses_per_aperture'] == 64


def test_the_pipeline_has_the_parameters_of_all_nodes():
    configuration = read('sar_pipeline:\n  ros__parameters: {target_db: -60.0, window: hann}')
    assert configuration.findings == ()
    assert configuration.imaging().target_db == -60.0
    assert configuration.imaging().window == 'hann'
    [error] = errors('sar_pipeline:\n  ros__parameters: {windo: hann}')
    assert 'did you mean window?' in error


def test_lists_of_numbers():
    defaults = {'/**/pulse_buffer': {'ros__parameters': {'antenna.tx': [0.0, 0.0, 0.0]}}}

    def found(value):
        tree = {'/**': {'ros__parameters': {'antenna.tx': value}}}
        return [f.text for f in interpret(tree, defaults).findings]

    assert found([1, 2, 3, 4, 5, 6]) == []
    assert found([1, 2.5, 3]) == ["section '**': antenna.tx=[1, 2.5, 3] mixes whole numbers and "
                                  'others, which ROS refuses; write all of them with a point']
    for value in ([1.0, '2'], [float('inf')], 3.0, '[1.0]'):
        said = f"section '**': antenna.tx: expected a list of numbers, got {value!r}"
        assert found(value) == [said]


@pytest.mark.parametrize(('text', 'expected'), [
    ('/**/backprojektion:\n  ros__parameters: {target_db: -60.0}',
     "line 1: section 'backprojektion' names no node; did you mean backprojection?"),
    ('/**/backprojection:\n  ros__parameters: {grid: {spaceing: 0.1}}',
     "line 2: section 'backprojection' has grid.spaceing, which no node reads; did you mean "
     'grid.spacing?'),
    ('/**:\n  ros__parameters: {puls_per_aperture: 64}',
     "line 2: section '**' has puls_per_aperture, which no node reads; did you mean "
     'pulses_per_aperture?'),
    ('/**/backprojection:\n  ros__parameters: {target_db: eighty}',
     "line 2: section 'backprojection': target_db: expected a number such as 1.0e+9, got "
     "'eighty'"),
    (RADAR.replace('9.6e+9', '9.6 GHz'),
     "line 4: section 'check_config': radar.carrier_hz: expected a number such as 1.0e+9, got "
     "'9.6 GHz'"),
    ('/**:\n  ros__parameters: {pulses_per_aperture: 64.0}',
     "line 2: section '**': pulses_per_aperture: expected a whole number, got 64.0"),
    ('/**:\n  ros__parameters: {autostart: 1}', "line 2: section '**': autostart: "
     'expected true or false, got 1'),
    ('/**/range_compression:\n  ros__parameters: {oversampling: .nan}',
     "line 2: section 'range_compression': oversampling: expected a number such as 1.0e+9, got "
     'nan'),
])
def test_what_no_node_would_take(text, expected):
    assert errors(text)[:1] == [expected]


@pytest.mark.parametrize(('text', 'expected'), [
    ('', 'a parameter file has sections such as /\\*\\*/backprojection'),
    ('[1, 2]', 'a parameter file has sections'),
    ('/**/backprojection: 3', "section '/\\*\\*/backprojection' has no ros__parameters"),
    ('/**/backprojection:\n  grid: {spacing: 1.0}', 'has no ros__parameters'),
    ('/**:\n  ros__parameters: 3', "ros__parameters of '/\\*\\*' has no parameters"),
])
def test_what_is_no_parameter_file(text, expected):
    with pytest.raises(ConfigurationFileError, match=expected):
        read(text)


def test_files_that_cannot_be_read(tmp_path):
    with pytest.raises(ConfigurationFileError, match='missing.yaml cannot be read'):
        read_configuration(tmp_path / 'missing.yaml')
    path = tmp_path / 'broken.yaml'
    path.write_text('a: [1, 2')
    with pytest.raises(ConfigurationFileError, match='broken.yaml, line .*: it is no YAML'):
        read_configuration(path)
    path.write_bytes(b'\xff\xfe\xff')
    with pytest.raises(ConfigurationFileError, match='broken.yaml cannot be read'):
        read_configuration(path)


@pytest.mark.parametrize('name', [n for n, v in CHECKER_PARAMETERS.items() if isinstance(v, type)])
def test_what_is_missing_is_named(name):
    tree = yaml.safe_load(RADAR)
    group, key = name.split('.')
    del tree['/**/check_config']['ros__parameters'][group][key]
    with pytest.raises(ValueError, match=f'section check_config lacks {name}'):
        interpret(tree, DEFAULTS).acquisition()


def test_an_unknown_waveform():
    text = RADAR.replace('radar: {', 'radar: {waveform: chirp, ')
    with pytest.raises(ValueError, match="radar.waveform='chirp' is unknown; use one of lfm, "):
        read(text).acquisition()


SCALARS = (st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=8)
           | st.sampled_from(['image', 'hamming', 'lfm']))
NAMES = st.sampled_from(['/**', '/**/backprojection', 'check_config', 'ros__parameters', 'radar',
                         'grid', 'spacing', 'carrier_hz', 'pulses_per_aperture', '']) | st.text(
                             max_size=4)
TREES = st.recursive(SCALARS | st.lists(SCALARS, max_size=2),
                     lambda t: st.dictionaries(NAMES, t, max_size=4), max_leaves=12)


@given(tree=TREES)
def test_any_yaml_is_read_or_refused(tree):
    try:
        configuration = interpret(tree, DEFAULTS)
    except ConfigurationFileError:
        return
    # Whatever was accepted has the type of its default.
    expected = interpret({'/**': {'ros__parameters': {}}}, DEFAULTS).nodes
    assert {node: {k: type(v) for k, v in values.items()}
            for node, values in configuration.nodes.items()} == {
        node: {k: type(v) for k, v in values.items()} for node, values in expected.items()}


def test_reading_changes_no_default():
    before = read('/**:\n  ros__parameters: {}')
    read('/**:\n  ros__parameters: {pulses_per_aperture: 7}\n' + RADAR)
    assert dataclasses.asdict(read('/**:\n  ros__parameters: {}')) == dataclasses.asdict(before)
    assert not read('/**:\n  ros__parameters: {}').describes_radar
