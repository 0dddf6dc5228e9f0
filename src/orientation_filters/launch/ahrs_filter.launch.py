# SPDX-License-Identifier: Apache-2.0
"""Start the Kalman AHRS with its parameter file."""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import LifecycleNode


def generate_launch_description():
    share = Path(get_package_share_directory('orientation_filters'))
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                'namespace', default_value='', description='Namespace of the board'
            ),
            DeclareLaunchArgument(
                'source',
                default_value='imu',
                description='Where data_raw and mag come from: imu, or imu_compensated',
            ),
            DeclareLaunchArgument(
                'output', default_value='imu/data_ahrs', description='Topic of the result'
            ),
            DeclareLaunchArgument('preset', default_value='paper', description='paper or robust'),
            DeclareLaunchArgument(
                'config',
                default_value=str(share / 'config' / 'ahrs_filter.yaml'),
                description='Parameter file',
            ),
            LifecycleNode(
                package='orientation_filters',
                executable='ahrs_filter_node',
                name='ahrs_filter',
                namespace=LaunchConfiguration('namespace'),
                parameters=[
                    LaunchConfiguration('config'),
                    {'preset': LaunchConfiguration('preset')},
                ],
                remappings=[
                    ('imu/data_raw', [LaunchConfiguration('source'), '/data_raw']),
                    ('imu/mag', [LaunchConfiguration('source'), '/mag']),
                    ('imu/data', LaunchConfiguration('output')),
                ],
                output='screen',
            ),
        ]
    )
