# SPDX-License-Identifier: Apache-2.0
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import LifecycleNode
from launch_ros.substitutions import FindPackageShare

BOARDS = ('dut1', 'dut2', 'dut3')


def generate_launch_description():
    share = FindPackageShare('imu_driver')
    actions = [
        DeclareLaunchArgument(
            'config',
            default_value=PathJoinSubstitution([share, 'config', 'three_boards.yaml']),
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
