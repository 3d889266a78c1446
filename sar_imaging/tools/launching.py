# Copyright 2026 SAR Imaging contributors
# SPDX-License-Identifier: Apache-2.0
"""Common parts of the launch files: arguments, check of the configuration, start of the nodes.

`launch` and `launch_ros` come with a ROS installation alone and are imported where they are used.
"""

from __future__ import annotations

import importlib.resources
import importlib.util
import math
import shutil
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from sar_imaging.configuration.parameters import load_tree
from sar_imaging.configuration.settings import MODES

from .node_processes import node_names, profile_variable

if TYPE_CHECKING:
    from launch import LaunchContext, LaunchDescription, LaunchDescriptionEntity
    from launch.events.process import ProcessExited

CONFIG = Path(str(importlib.resources.files('sar_imaging') / 'config'))
RECORDED_TOPICS = ('/pulses', '/odometry', '/pose', '/fix', '/imu')
# Name, default, description.
ARGUMENTS = (
    ('config', 'sar_imaging', 'Parameter file, or name of a shipped one such as airborne_x_band'),
    ('namespace', '', 'Namespace of the nodes and their topics, such as radar1'),
    ('mode', '', 'image, subapertures or volume; as configured when left out'),
    ('autostart', '', 'false waits for a life cycle manager; as configured when left out'),
    ('use_sim_time', '', 'true takes the time from /clock; as configured when left out'),
    ('respawn', 'false', 'true starts a node again when it has died'),
    ('map', '', 'Folder of a reference map: starts the node localization, too'),
    ('map_images', 'image', 'Topic of the images that localization finds in it: image_complex for '
                            'a map with complex images'),
)
REPLAY_ARGUMENTS = (
    ('bag', None, 'Folder of the recording'),
    ('rate', '1.0', 'Times as fast as recorded'),
    ('delay', '1.0', 'Seconds from when all nodes are active to the first pulse'),
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


def named_config(text: str) -> Path:
    """Parameter file of an argument, which may name a shipped one; else the path as it stands."""
    try:
        return find_config(text)
    except FileNotFoundError:
        return Path(text)


def mode_of(config: Path, mode: str) -> str:
    """Mode of backprojection: as asked for, else as the parameter file says, else ``image``."""
    return mode or configured_mode(config) or MODES[0]


def configured_mode(config: Path) -> str:
    """Mode of backprojection that a parameter file says, empty when it does not."""
    return _configured_mode(load_tree(config))


def _configured_mode(tree: object) -> str:
    """Value of the last parameter `mode` in a parameter file, empty without one."""
    mode = ''
    for key, value in tree.items() if isinstance(tree, dict) else ():
        if key == 'ros__parameters' and isinstance(value, dict):
            mode = value.get('mode', mode)
        else:
            mode = _configured_mode(value) or mode
    return mode


def overrides(arguments: Mapping[str, str]) -> list[str]:
    """ROS arguments that the arguments of a launch file become.

    They count whatever the parameter file says, see
    `sar_imaging.nodes.runtime.parameters.command_line_parameters`.

    Raises
    ------
    ValueError
        An argument is neither true nor false, or the mode is unknown.
    """
    mode = arguments['mode']
    if mode not in ('', *MODES):
        raise ValueError(f'mode:={mode} is unknown; use {", ".join(MODES[:-1])} or {MODES[-1]}')
    given = {'mode': mode} | {
        name: str(as_bool(name, arguments[name])).lower()
        for name in ('autostart', 'use_sim_time') if arguments[name]}
    return [word for name, value in given.items() if value
            for word in ('-p', f'{name}:={value}')]


def as_bool(name: str, text: str) -> bool:
    """Value of an argument; ValueError when it is neither true nor false."""
    if text.lower() not in ('true', 'false'):
        raise ValueError(f'{name}:={text}; expected true or false')
    return text.lower() == 'true'


def replay_command(arguments: Mapping[str, str], namespace: str = '',
                   remappings: Sequence[tuple[str, str]] = ()) -> list[str]:
    """Command that replays a recording into the nodes.

    Parameters
    ----------
    arguments : mapping
        Arguments of the launch file by name.
    namespace : str
        Namespace of the nodes, absolute, such as ``/radar1``; empty for none.
    remappings : sequence of (str, str)
        Names that the nodes replace, and those they take instead.

    Raises
    ------
    ValueError
        There is no such recording, a number makes no sense, or rosbag2 is missing.
    """
    if shutil.which('ros2') is None or importlib.util.find_spec('ros2bag') is None:
        raise ValueError('a replay needs rosbag2: sudo apt install ros-$ROS_DISTRO-rosbag2; '
                         'without it `sar-imaging evaluate` plays a recording by itself')
    bag = Path(arguments['bag']).expanduser()
    if not (bag / 'metadata.yaml').is_file():
        raise ValueError(f'bag:={arguments["bag"]} is no recording: expected a folder with a '
                         'metadata.yaml')
    command = ['ros2', 'bag', 'play', str(bag)]
    for name, least in (('rate', 1e-3), ('delay', 0.0)):
        command += [f'--{name}', _number(name, arguments[name], least)]
    if arguments['use_sim_time'] and as_bool('use_sim_time', arguments['use_sim_time']):
        command.append('--clock')
    moved = {_absolute(given, namespace): _absolute(taken, namespace)
             for given, taken in remappings}
    heard = {topic: moved.get(f'{namespace}{topic}', f'{namespace}{topic}')
             for topic in RECORDED_TOPICS}
    rules = [f'{topic}:={name}' for topic, name in heard.items() if name != topic]
    return command + (['--remap', *rules] if rules else [])


def _absolute(name: str, namespace: str) -> str:
    """Name of a topic in a namespace."""
    return name if name.startswith('/') else f'{namespace}/{name}'


def _number(name: str, text: str, least: float) -> str:
    """Text of a finite number that is large enough."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not least <= value < math.inf:
        raise ValueError(f'{name}:={text}; expected a number of {least:g} or more')
    return text


def describe(*, pipeline: bool, replay: bool = False) -> LaunchDescription:
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


def _start(context: LaunchContext, names: list[str], pipeline: bool, replay: bool
           ) -> list[LaunchDescriptionEntity]:
    """Actions for the arguments of a running launch: a mistake in them ends it before a start.

    All of them are returned at once: nodes are made in the scope of the group that includes the
    launch file, with its namespace, remappings and parameters.
    """
    from launch.actions import SetEnvironmentVariable
    from launch_ros.actions import Node

    arguments = {name: context.launch_configurations[name] for name in names}
    config = find_config(arguments['config'])
    if replay:
        pipeline = as_bool('pipeline', arguments['pipeline'])
    ros_arguments = overrides(arguments)
    nodes = node_names(mode_of(config, arguments['mode']), pipeline=pipeline)
    own = _localization(arguments['map'], arguments['map_images'])
    nodes = (*nodes, *own)
    respawn = as_bool('respawn', arguments['respawn'])
    replayed = _replayed(context, arguments, nodes) if replay else []
    _check(context, config, ros_arguments)
    return [*(SetEnvironmentVariable(name, value)
              for name, value in profile_variable(context.environment).items()),
            *(Node(package='sar_imaging', executable=name, name=name, output='screen',
                   namespace=arguments['namespace'], parameters=[str(config)],
                   ros_arguments=[*ros_arguments, *own.get(name, ())], respawn=respawn,
                   respawn_delay=2.0)
              for name in nodes), *replayed]


def _localization(folder: str, images: str) -> dict[str, list[str]]:
    """Node that a reference map asks for, and its ROS arguments."""
    if not folder:
        return {}
    remapped = [] if images == 'image' else ['-r', f'image:={images}']
    return {'localization': ['-p', f'map.folder:={Path(folder).expanduser().absolute()}',
                             *remapped]}


def _check(context: LaunchContext, config: Path, ros_arguments: list[str]) -> None:
    """Run check_config by its own Python, which may be that of a virtual environment."""
    from launch.logging import get_logger
    from launch_ros.substitutions import ExecutableInPackage

    checked = subprocess.run(
        [ExecutableInPackage('check_config', 'sar_imaging').perform(context), str(config),
         *ros_arguments], env=dict(context.environment), text=True, stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT)
    for line in checked.stdout.splitlines():
        get_logger('check_config').info(line)
    _require(checked.returncode == 0, f'{config} cannot work, see the errors above')


def _replayed(context: LaunchContext, arguments: Mapping[str, str], nodes: Sequence[str]
              ) -> list[LaunchDescriptionEntity]:
    """Actions that play a recording to where the nodes listen, once all of them are active."""
    from launch.actions import ExecuteProcess, RegisterEventHandler
    from launch.event_handlers import OnProcessExit
    from launch_ros.substitutions import ExecutableInPackage
    from launch_ros.utilities import make_namespace_absolute, prefix_namespace

    scope = context.launch_configurations
    namespace = make_namespace_absolute(prefix_namespace(
        scope.get('ros_namespace'), arguments['namespace']) or '/').rstrip('/')
    simulated: dict[str, object] = dict(
        p for p in scope.get('global_params', []) if isinstance(p, tuple))
    command = replay_command(
        {'use_sim_time': str(simulated.get('use_sim_time', '')), **{
            name: value for name, value in arguments.items() if value}},
        namespace, scope.get('ros_remaps', ()))
    wait = ExecuteProcess(cmd=[ExecutableInPackage('wait_until_active', 'sar_imaging'),
                               *(f'{namespace}/{name}' for name in nodes)], output='screen')
    player = ExecuteProcess(cmd=command, output='screen',
                            additional_env=profile_variable(context.environment))

    def ready(event: ProcessExited, context: LaunchContext) -> list[LaunchDescriptionEntity]:
        _require(event.returncode == 0, 'the nodes did not become active')
        return [player]

    def played(event: ProcessExited, context: LaunchContext) -> None:
        _require(event.returncode == 0, f'{" ".join(command)} failed')

    return [wait, RegisterEventHandler(OnProcessExit(target_action=wait, on_exit=ready)),
            RegisterEventHandler(OnProcessExit(target_action=player, on_exit=played))]


def _require(holds: bool, message: str) -> None:
    """End the launch with an error unless something holds; it ends all of its processes."""
    if not holds:
        raise RuntimeError(message)
