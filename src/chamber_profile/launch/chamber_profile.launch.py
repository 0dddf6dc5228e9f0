# SPDX-License-Identifier: Apache-2.0
"""Run a profile on a chamber; the chamber node is given time to make it safe at Ctrl-C."""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

ARGUMENTS = {
    'profile': ('paper_betta2022', 'Profile: a file or a name, see imu_workbench plan'),
    'chamber': ('simulated', 'simulated, espec+tcp://HOST:PORT, watlow_f4+serial:///dev/…'),
    'start': ('false', 'Begin at once and exit at the end; else ~/start begins'),
    'require_imu': ('true', 'An IMU silent for 10 s ends the run in the safe state'),
    'run_directory': ('', 'Where journal and profile go; an interrupted run resumes'),
    'time_scale': ('1.0', 'Chamber seconds per second; only for an emulated chamber'),
}
SAFE_RAMP_S = '7200'  # a run on its way to the safe temperature is not killed


def generate_launch_description():
    share = Path(get_package_share_directory('chamber_profile'))
    config = str(share / 'config' / 'chamber_profile.yaml')
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
        [
            DeclareLaunchArgument(name, default_value=value, description=meaning)
            for name, (value, meaning) in ARGUMENTS.items()
        ]
        + [chamber]
    )
