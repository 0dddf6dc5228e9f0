# SPDX-License-Identifier: Apache-2.0
"""Run a profile on a chamber; the chamber node is given time to make it safe at Ctrl-C."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

ARGUMENTS = {
    'profile': 'paper_betta2022',
    'chamber': 'simulated',
    'start': 'false',
    'require_imu': 'true',
    'run_directory': '',
    'time_scale': '1.0',
}
SAFE_RAMP_S = '7200'  # a run on its way to the safe temperature is not killed


def generate_launch_description():
    share = FindPackageShare('chamber_profile')
    config = PathJoinSubstitution([share, 'config', 'chamber_profile.yaml'])
    chamber = Node(
        package='chamber_profile',
        executable='chamber_profile_node',
        name='chamber_profile',
        parameters=[config, {name: LaunchConfiguration(name) for name in ARGUMENTS}],
        sigterm_timeout=SAFE_RAMP_S,
        sigkill_timeout=SAFE_RAMP_S,
        output='screen',
        emulate_tty=True,
    )
    return LaunchDescription(
        [DeclareLaunchArgument(name, default_value=value) for name, value in ARGUMENTS.items()]
        + [chamber]
    )
