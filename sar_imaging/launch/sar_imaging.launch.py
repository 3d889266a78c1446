"""Start pulse_buffer, range_compression and backprojection."""

import os
from pathlib import Path

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, SetEnvironmentVariable
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

CONFIG = Path(__file__).resolve().parents[1] / 'config'
NODES = ('pulse_buffer', 'range_compression', 'backprojection')
PROFILE = 'FASTRTPS_DEFAULT_PROFILES_FILE'


def generate_launch_description() -> LaunchDescription:
    """Three nodes that share a parameter file and a namespace."""
    # Who has chosen a profile keeps it.
    environment = [] if os.environ.get(PROFILE) else [
        SetEnvironmentVariable(PROFILE, str(CONFIG / 'fastdds_large_segment.xml'))]
    nodes = [
        Node(package='sar_imaging', executable=name, name=name, output='screen',
             namespace=LaunchConfiguration('namespace'),
             parameters=[LaunchConfiguration('params_file'),
                         {'use_sim_time': ParameterValue(LaunchConfiguration('use_sim_time'),
                                                         value_type=bool)}])
        for name in NODES]
    return LaunchDescription([
        DeclareLaunchArgument('params_file', default_value=str(CONFIG / 'sar_imaging.yaml'),
                              description='Parameter file of the nodes'),
        DeclareLaunchArgument('namespace', default_value='',
                              description='Namespace of the nodes and their topics'),
        DeclareLaunchArgument('use_sim_time', default_value='false',
                              description='Take the time from /clock'),
        *environment,
        *nodes,
    ])
