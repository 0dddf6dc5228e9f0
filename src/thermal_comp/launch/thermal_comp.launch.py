# SPDX-License-Identifier: Apache-2.0
"""Start thermal_comp_node with its parameter file."""

from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import LifecycleNode


def generate_launch_description():
    share = Path(get_package_share_directory('thermal_comp'))
    defaults = str(share / 'config' / 'thermal_comp.yaml')
    return LaunchDescription(
        [
            DeclareLaunchArgument('namespace', default_value='', description='ROS namespace'),
            DeclareLaunchArgument('config', default_value=defaults, description='Parameter file'),
            DeclareLaunchArgument(
                'model', default_value='', description='Model file; empty: pass data through'
            ),
            LifecycleNode(
                package='thermal_comp',
                executable='thermal_comp_node',
                name='thermal_comp',
                namespace=LaunchConfiguration('namespace'),
                parameters=[
                    LaunchConfiguration('config'),
                    {'model': LaunchConfiguration('model')},
                ],
                output='screen',
            ),
        ]
    )
