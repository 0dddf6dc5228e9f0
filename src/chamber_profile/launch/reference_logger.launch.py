# SPDX-License-Identifier: Apache-2.0
"""A reference logger with a chamber node that uses its temperatures instead of the chamber's."""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

CHAMBER = {
    'profile': ('paper_betta2022', 'Profile: a file or a name, see imu_workbench plan'),
    'chamber': ('simulated', 'simulated, espec+tcp://HOST:PORT, watlow_f4+serial:///dev/…'),
    'start': ('false', 'Begin at once and exit at the end; else ~/start begins'),
    'require_imu': ('true', 'An IMU silent for 10 s ends the run in the safe state'),
    'run_directory': ('', 'Where journal and profile go; an interrupted run resumes'),
}
SAFE_RAMP_S = '7200'  # a run on its way to the safe temperature is not killed


def generate_launch_description():
    config = Path(get_package_share_directory('chamber_profile')) / 'config'
    logger = Node(
        package='chamber_profile',
        executable='reference_logger_node',
        name='reference_logger',
        parameters=[
            str(config / 'reference_logger.yaml'),
            {'port': LaunchConfiguration('port')},
        ],
        output='screen',
    )
    chamber = Node(
        package='chamber_profile',
        executable='chamber_profile_node',
        name='chamber_profile',
        parameters=[
            str(config / 'chamber_profile.yaml'),
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
        'port': ('serial:///dev/reference_logger', 'serial:///dev/… or tcp://HOST:PORT'),
        'device_temperature': (
            'dut1/chamber/device_temperature',
            'Topic of the thermocouple the profile settles and dwells by',
        ),
        **CHAMBER,
    }
    return LaunchDescription(
        [
            DeclareLaunchArgument(name, default_value=value, description=meaning)
            for name, (value, meaning) in arguments.items()
        ]
        + [logger, chamber]
    )
