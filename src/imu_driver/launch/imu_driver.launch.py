# SPDX-License-Identifier: Apache-2.0
"""Start the driver of one board with its parameter file."""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import LifecycleNode


def generate_launch_description():
    share = Path(get_package_share_directory('imu_driver'))
    return LaunchDescription(
        [
            DeclareLaunchArgument(
                'namespace', default_value='', description='Namespace of the board'
            ),
            DeclareLaunchArgument(
                'transport',
                default_value='serial:///dev/imu',
                description='serial:///dev/…, tcp://host:port, simulated://dut1 or bag://path',
            ),
            DeclareLaunchArgument(
                'config',
                default_value=str(share / 'config' / 'imu_driver.yaml'),
                description='Parameter file',
            ),
            LifecycleNode(
                package='imu_driver',
                executable='imu_driver_node',
                name='imu_driver',
                namespace=LaunchConfiguration('namespace'),
                parameters=[
                    LaunchConfiguration('config'),
                    {'transport': LaunchConfiguration('transport')},
                ],
                output='screen',
            ),
        ]
    )
