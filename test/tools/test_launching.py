# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Launch files: what they ask for exists, and where launch is installed they are executed."""

import ast
import importlib.util
import pathlib
import py_compile
import re
import shlex

import pytest
import yaml

from sar_imaging.recordings.bag_io import ODOMETRY_TOPIC, TOPIC
from sar_imaging.tools import launching, node_processes

ROOT = pathlib.Path(launching.__file__).parents[2]
FILES = sorted((ROOT / 'sar_imaging' / 'launch').glob('*.launch.py'))
REPLAY = dict(use_sim_time='', bag='my bag', rate='2.0', delay='5.0')


def executables():
    """Of `ros2 run`; pip has one program instead."""
    setup = ast.parse((ROOT / 'setup.py').read_text())
    scripts = [ast.literal_eval(v) for node in ast.walk(setup) if isinstance(node, ast.Dict)
               for k, v in zip(node.keys, node.values, strict=True)
               if k is not None and getattr(k, 'value', '') == 'console_scripts']
    return {script.split(' = ')[0] for script in max(scripts, key=len)}


def strings(path):
    """Texts of a module, docstrings left out."""
    tree = ast.parse(path.read_text())
    documentation = {ast.get_docstring(node, clean=False) for node in ast.walk(tree)
                     if isinstance(node, (ast.Module, ast.FunctionDef))}
    return {node.value for node in ast.walk(tree)
            if isinstance(node, ast.Constant) and isinstance(node.value, str)} - documentation


def test_there_is_a_launch_file_for_each_way():
    assert [p.name for p in FILES] == ['replay.launch.py', 'sar_imaging.launch.py',
                                       'sar_pipeline.launch.py']


@pytest.mark.parametrize('path', FILES, ids=lambda p: p.name)
def test_launch_files_compile_and_call_what_exists(path, tmp_path):
    py_compile.compile(str(path), cfile=str(tmp_path / 'compiled'), doraise=True)
    spec = importlib.util.spec_from_file_location(path.stem.replace('.', '_'), path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    assert module.describe is launching.describe
    [call] = [node for node in ast.walk(ast.parse(path.read_text()))
              if isinstance(node, ast.Call)]
    accepted = launching.describe.__kwdefaults__ or {}
    assert {k.arg for k in call.keywords} <= {'pipeline', *accepted}


def test_executables_are_those_of_setup():
    mentioned = {*launching.node_names('image', pipeline=False),
                 *launching.node_names('subapertures', pipeline=False),
                 *launching.node_names('image', pipeline=True), 'check_config'}
    assert {'check_config', 'wait_until_active'} <= strings(pathlib.Path(launching.__file__))
    assert {*mentioned, 'wait_until_active'} <= executables()
    for name in mentioned - {'check_config'}:
        assert (ROOT / 'sar_imaging' / 'nodes' / f'{name}.py').is_file()


def test_parameters_are_those_of_the_nodes():
    tree = yaml.safe_load((launching.CONFIG / 'sar_imaging.yaml').read_text())
    known = {name for section in tree.values() for name in section['ros__parameters']}
    words = launching.overrides({'use_sim_time': 'True', 'autostart': 'false', 'mode': 'image'})
    assert words == ['-p', 'mode:=image', '-p', 'autostart:=false', '-p', 'use_sim_time:=true']
    assert {'autostart', 'mode'} <= known


def test_a_map_starts_the_node_that_reads_it(tmp_path, monkeypatch):
    assert launching._localization('', 'image') == {}
    monkeypatch.chdir(tmp_path)
    place = ['-p', f'map.folder:={tmp_path}/out/place']
    assert launching._localization('out/place', 'image') == {'localization': place}
    assert launching._localization('out/place', 'image_complex') == {
        'localization': [*place, '-r', 'image:=image_complex']}
    assert 'localization' in executables()


def test_files_exist():
    for value in launching.profile_variable({}).values():
        assert pathlib.Path(value).is_file()
    assert launching.profile_variable({node_processes.PROFILE: 'mine.xml'}) == {}
    defaults = {name: default for name, default, _ in launching.ARGUMENTS}
    assert launching.find_config(defaults['config']).name == 'sar_imaging.yaml'
    assert launching.find_config('drone_uwb').parent == launching.CONFIG
    with pytest.raises(FileNotFoundError, match='config:=nothing is no file; shipped are'):
        launching.find_config('nothing')


def test_a_path_comes_before_a_name(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'drone_uwb').write_text('/**:\n  ros__parameters: {}\n')
    assert launching.find_config('drone_uwb') == pathlib.Path('drone_uwb')


@pytest.mark.parametrize(('text', 'argument', 'expected'), [
    ('/**:\n  ros__parameters: {pulses_per_block: 3}', '', 'image'),
    ('/**:\n  ros__parameters: {mode: subapertures}', '', 'subapertures'),
    ('/**:\n  ros__parameters: {mode: subapertures}', 'image', 'image'),
    ('/**/backprojection:\n  ros__parameters: {mode: subapertures}', '', 'subapertures'),
    ('/r:\n  backprojection:\n    ros__parameters: {mode: subapertures}', '', 'subapertures'),
    ('', 'subapertures', 'subapertures'),
    ('', '', 'image'),
])
def test_the_mode_decides_about_the_fusion_node(tmp_path, text, argument, expected):
    path = tmp_path / 'config.yaml'
    path.write_text(text)
    mode = launching.mode_of(path, argument)
    assert mode == expected
    fusion = 'afbp_fusion' in launching.node_names(mode, pipeline=False)
    assert fusion == (expected == 'subapertures')
    assert launching.node_names(mode, pipeline=True) == ('sar_pipeline',)


def test_arguments_that_make_no_sense():
    good = {'use_sim_time': '', 'autostart': '', 'mode': ''}
    for name in ('autostart', 'use_sim_time'):
        with pytest.raises(ValueError, match=f'{name}:=yes; expected true or false'):
            launching.overrides(good | {name: 'yes'})
    with pytest.raises(ValueError, match='mode:=fast is unknown; use image, subap.* or volume'):
        launching.overrides(good | {'mode': 'fast'})


def test_what_is_left_out_stays_as_configured():
    arguments = {name: default for name, default, _ in launching.ARGUMENTS}
    assert launching.overrides(arguments) == []


@pytest.fixture(name='bag')
def bag_fixture(tmp_path):
    """A folder that looks like a recording."""
    folder = tmp_path / 'my bag'
    folder.mkdir()
    (folder / 'metadata.yaml').write_text('')
    return str(folder)


@pytest.fixture(autouse=True)
def rosbag2(tmp_path, monkeypatch):
    """A machine with rosbag2, as far as can be seen without starting it."""
    (tmp_path / 'ros2bag').mkdir()
    (tmp_path / 'ros2bag' / '__init__.py').touch()
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(launching.shutil, 'which', lambda name: f'/usr/bin/{name}')


def test_replay_reaches_the_topics_of_the_nodes(bag):
    arguments = REPLAY | {'bag': bag}
    plain = ['ros2', 'bag', 'play', bag, '--rate', '2.0', '--delay', '5.0']
    assert launching.replay_command(arguments) == plain
    assert launching.replay_command(arguments | {'use_sim_time': 'true'}) == [*plain, '--clock']
    moved = launching.replay_command(arguments, '/radar1')
    topics = TOPIC, ODOMETRY_TOPIC, '/pose', '/fix', '/imu'
    assert moved == [*plain, '--remap', *(f'{topic}:=/radar1{topic}' for topic in topics)]
    remapped = launching.replay_command(arguments, remappings=[
        ('pulses', 'radar/raw'), ('/pose', '/platform/pose'), ('/other', '/more')])
    assert remapped == [*plain, '--remap', '/pulses:=/radar/raw', '/pose:=/platform/pose']


def test_a_replay_without_rosbag2_says_what_to_install(bag, monkeypatch):
    monkeypatch.setattr(launching.shutil, 'which', lambda name: None)
    with pytest.raises(ValueError, match=r'needs rosbag2: .*rosbag2;.*sar-imaging evaluate'):
        launching.replay_command(REPLAY | {'bag': bag})


@pytest.mark.parametrize(('change', 'message'), [
    ({'bag': 'nowhere'}, 'bag:=nowhere is no recording: expected a folder with a metadata.yaml'),
    ({'rate': '0'}, 'rate:=0; expected a number of 0.001 or more'),
    ({'rate': 'fast'}, 'rate:=fast; expected a number'),
    ({'delay': '-0.1'}, 'delay:=-0.1; expected a number of 0 or more'),
    ({'delay': 'inf'}, 'delay:=inf; expected a number'),
    ({'use_sim_time': 'maybe'}, 'use_sim_time:=maybe; expected true or false'),
])
def test_a_replay_that_makes_no_sense_is_refused(bag, change, message):
    with pytest.raises(ValueError, match=message):
        launching.replay_command(REPLAY | {'bag': bag} | change)


@pytest.mark.parametrize('path', FILES, ids=lambda p: p.name)
def test_launch_files_declare_their_arguments(path):
    pytest.importorskip('launch_ros', reason='launch files need a ROS installation')
    from launch.actions import DeclareLaunchArgument

    spec = importlib.util.spec_from_file_location(path.stem.replace('.', '_'), path)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    entities = module.generate_launch_description().entities
    arguments = {e.name for e in entities if isinstance(e, DeclareLaunchArgument)}
    table = launching.ARGUMENTS
    if path.name.startswith('replay'):
        table += launching.REPLAY_ARGUMENTS
    assert arguments == {name for name, *_ in table}


def test_the_installation_page_launches_what_exists():
    for page in [ROOT / 'README.md', *sorted((ROOT / 'docs').rglob('*.md'))]:
        for line in re.findall(r'^ros2 launch sar_imaging (.+)$', page.read_text(), re.MULTILINE):
            name, *given = shlex.split(line, comments=True)
            assert name in {p.name for p in FILES}, page
            known = {n for n, *_ in (*launching.ARGUMENTS, *launching.REPLAY_ARGUMENTS)}
            assert {word.split(':=')[0] for word in given} <= known, page
