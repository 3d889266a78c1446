"""What the launch files share: their arguments, the check of the configuration, the nodes.

`launch` and `launch_ros` come with a ROS installation alone and are imported where they are used.
"""

from __future__ import annotations

import importlib.resources
import os
from collections.abc import Mapping
from pathlib import Path

import yaml

from .node_processes import MODES, PROFILE, node_names

CONFIG = Path(str(importlib.resources.files('sar_imaging') / 'config'))
RECORDED_TOPICS = ('/pulses', '/odometry')
# Name, default, description.
ARGUMENTS = (
    ('config', 'sar_imaging', 'Parameter file, or name of a shipped one such as airborne_x_band'),
    ('namespace', '', 'Namespace of the nodes and their topics, such as radar1'),
    ('mode', '', 'image or subapertures; as configured when left out'),
    ('autostart', '', 'false waits for a life cycle manager; as configured when left out'),
    ('use_sim_time', 'false', 'Take the time from /clock'),
)
REPLAY_ARGUMENTS = (
    ('bag', None, 'Folder of the recording'),
    ('rate', '1.0', 'Times as fast as recorded'),
    ('delay', '5.0', 'Seconds that the nodes have to get ready before the first pulse'),
    ('pipeline', 'false', 'All stages in one process'),
)


def find_config(name: str) -> Path:
    """Parameter file by path, or by the name of a shipped one.

    Raises
    ------
    FileNotFoundError
        There is none; the text lists those that are shipped.
    """
    for path in (Path(name).expanduser(), CONFIG / f'{name}.yaml'):
        if path.is_file():
            return path
    shipped = ', '.join(sorted(p.stem for p in CONFIG.glob('*.yaml')))
    raise FileNotFoundError(f'config:={name} is no file; shipped are {shipped}')


def mode_of(config: Path, mode: str) -> str:
    """Mode of backprojection: as asked for, else as the parameter file says, else ``image``.

    Raises
    ------
    ValueError
        The mode asked for is unknown.
    """
    if mode not in ('', *MODES):
        raise ValueError(f'mode:={mode} is unknown; use {" or ".join(MODES)}')
    return mode or _configured_mode(yaml.safe_load(config.read_text())) or MODES[0]


def _configured_mode(tree) -> str:
    """Value of the last parameter `mode` in a parameter file, empty without one."""
    mode = ''
    for key, value in tree.items() if isinstance(tree, dict) else ():
        if key == 'ros__parameters' and isinstance(value, dict):
            mode = value.get('mode', mode)
        else:
            mode = _configured_mode(value) or mode
    return mode


def overrides(arguments: Mapping[str, str]) -> dict:
    """Parameters that the arguments of a launch file set, beside those of the file.

    Raises
    ------
    ValueError
        An argument is neither true nor false.
    """
    parameters: dict = {'use_sim_time': as_bool('use_sim_time', arguments['use_sim_time'])}
    if arguments['autostart']:
        parameters['autostart'] = as_bool('autostart', arguments['autostart'])
    if arguments['mode']:
        parameters['mode'] = arguments['mode']
    return parameters


def as_bool(name: str, text: str) -> bool:
    """Value of an argument; ValueError when it is neither true nor false."""
    if text.lower() not in ('true', 'false'):
        raise ValueError(f'{name}:={text}; expected true or false')
    return text.lower() == 'true'


def profile_variable(environment: Mapping[str, str]) -> dict[str, str]:
    """Fast DDS profile of this package; nothing where one was chosen already."""
    if environment.get(PROFILE):
        return {}
    return {PROFILE: str(CONFIG / 'fastdds_large_segment.xml')}


def replay_command(arguments: Mapping[str, str]) -> list[str]:
    """Command that replays a recording into the nodes."""
    command = ['ros2', 'bag', 'play', arguments['bag'], '--rate', arguments['rate'],
               '--delay', arguments['delay']]
    if as_bool('use_sim_time', arguments['use_sim_time']):
        command.append('--clock')
    namespace = arguments['namespace'].strip('/')
    if namespace:
        command += ['--remap', *(f'{topic}:=/{namespace}{topic}' for topic in RECORDED_TOPICS)]
    return command


def describe(*, pipeline: bool, replay: bool = False):
    """Launch description: check the configuration, then start the nodes.

    Parameters
    ----------
    pipeline : bool
        All stages in one process, unless `replay` asks.
    replay : bool
        Replay a recording, too.

    Returns
    -------
    launch.LaunchDescription
    """
    from launch import LaunchDescription
    from launch.actions import DeclareLaunchArgument, OpaqueFunction

    table = (*ARGUMENTS, *(REPLAY_ARGUMENTS if replay else ()))
    return LaunchDescription([
        *(DeclareLaunchArgument(name, default_value=default, description=text)
          for name, default, text in table),
        OpaqueFunction(function=_start, args=[[name for name, *_ in table], pipeline, replay])])


def _start(context, names, pipeline, replay):
    """Actions for the arguments of a running launch."""
    from launch.actions import (
        ExecuteProcess,
        RegisterEventHandler,
        SetEnvironmentVariable,
        Shutdown,
    )
    from launch.event_handlers import OnProcessExit
    from launch_ros.actions import Node
    from launch_ros.substitutions import ExecutableInPackage

    arguments = {name: context.launch_configurations[name] for name in names}
    config = find_config(arguments['config'])
    if replay:
        pipeline = as_bool('pipeline', arguments['pipeline'])
    parameters = [str(config), overrides(arguments)]
    actions = [Node(package='sar_imaging', executable=name, name=name, output='screen',
                    namespace=arguments['namespace'], parameters=parameters)
               for name in node_names(mode_of(config, arguments['mode']), pipeline=pipeline)]
    if replay:
        actions.append(ExecuteProcess(cmd=replay_command(arguments), output='screen'))
    check = ExecuteProcess(
        cmd=[ExecutableInPackage('check_config', 'sar_imaging'), str(config)], output='screen')

    def checked(event, context):
        if event.returncode:
            return [Shutdown(reason=f'{config} cannot work, see the errors above')]
        return actions

    return [*(SetEnvironmentVariable(name, value)
              for name, value in profile_variable(os.environ).items()),
            RegisterEventHandler(OnProcessExit(target_action=check, on_exit=checked)), check]
