# SPDX-License-Identifier: Apache-2.0
"""Record topics, a bag for each run."""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import LifecycleNode


def generate_launch_description():
    share = Path(get_package_share_directory('imu_recording'))
    config = str(share / 'config' / 'recorder.yaml')
    return LaunchDescription(
        [
            DeclareLaunchArgument('namespace', default_value='', description='ROS namespace'),
            DeclareLaunchArgument(
                'output',
                default_value='',
                description='Folder of the bag; empty: recordings/<UTC>',
            ),
            DeclareLaunchArgument('config', default_value=config, description='Parameter file'),
            LifecycleNode(
                package='imu_recording',
                executable='recorder_node',
                name='recorder',
                namespace=LaunchConfiguration('namespace'),
                parameters=[
                    LaunchConfiguration('config'),
                    {'output': LaunchConfiguration('output')},
                ],
                output='screen',
            ),
        ]
    )
