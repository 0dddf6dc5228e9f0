# SPDX-License-Identifier: Apache-2.0
"""Start the drivers of three boards, each in a namespace of its own."""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import LifecycleNode

BOARDS = ('dut1', 'dut2', 'dut3')


def generate_launch_description():
    share = Path(get_package_share_directory('imu_driver'))
    actions = [
        DeclareLaunchArgument(
            'config',
            default_value=str(share / 'config' / 'three_boards.yaml'),
            description='Parameter file of all boards',
        )
    ]
    for board in BOARDS:
        actions += [
            DeclareLaunchArgument(
                f'{board}_transport',
                default_value=f'simulated://{board}',
                description=f'Transport of {board}, e.g. serial:///dev/serial/by-id/NAME',
            ),
            DeclareLaunchArgument(
                f'{board}_device', default_value='', description=f'Serial number of {board}'
            ),
            LifecycleNode(
                package='imu_driver',
                executable='imu_driver_node',
                name='imu_driver',
                namespace=board,
                parameters=[
                    LaunchConfiguration('config'),
                    {
                        'transport': LaunchConfiguration(f'{board}_transport'),
                        'device': LaunchConfiguration(f'{board}_device'),
                        'frame_id': f'{board}_imu_link',
                    },
                ],
                output='screen',
            ),
        ]
    return LaunchDescription(actions)
