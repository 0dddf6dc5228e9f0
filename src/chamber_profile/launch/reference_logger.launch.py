# SPDX-License-Identifier: Apache-2.0
"""A reference logger with a chamber node that uses its temperatures instead of the chamber's."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

CHAMBER = {
    'profile': 'paper_betta2022',
    'chamber': 'simulated',
    'start': 'false',
    'require_imu': 'true',
    'run_directory': '',
}
SAFE_RAMP_S = '7200'  # a run on its way to the safe temperature is not killed


def generate_launch_description():
    config = PathJoinSubstitution([FindPackageShare('chamber_profile'), 'config'])
    logger = Node(
        package='chamber_profile',
        executable='reference_logger_node',
        name='reference_logger',
        parameters=[
            PathJoinSubstitution([config, 'reference_logger.yaml']),
            {'port': LaunchConfiguration('port')},
        ],
        output='screen',
    )
    chamber = Node(
        package='chamber_profile',
        executable='chamber_profile_node',
        name='chamber_profile',
        parameters=[
            PathJoinSubstitution([config, 'chamber_profile.yaml']),
            {name: LaunchConfiguration(name) for name in CHAMBER},
            {'publish_temperature': False},
        ],
        remappings=[
            ('chamber/device_temperature', LaunchConfiguration('device_temperature')),
        ],
        sigterm_timeout=SAFE_RAMP_S,
        sigkill_timeout=SAFE_RAMP_S,
        output='screen',
        emulate_tty=True,
    )
    arguments = {
        'port': 'serial:///dev/reference_logger',
        'device_temperature': 'dut1/chamber/device_temperature',
        **CHAMBER,
    }
    return LaunchDescription(
        [DeclareLaunchArgument(name, default_value=value) for name, value in arguments.items()]
        + [logger, chamber]
    )
