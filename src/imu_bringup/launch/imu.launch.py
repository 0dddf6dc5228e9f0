# SPDX-License-Identifier: Apache-2.0
"""Start the chain in one process for one board, or for each board of a file in its namespace.

ros2 launch imu_bringup imu.launch.py transport:=simulated://dut1 model:=dut1.yaml filter:=ahrs
ros2 launch imu_bringup imu.launch.py boards:=boards.yaml
"""

from pathlib import Path

from ament_index_python.packages import (
    PackageNotFoundError,
    get_package_prefix,
    get_package_share_directory,
)
from imu_bringup.boards import BOARD_ARGUMENTS, boards_of, value
from imu_recording.user_error import UserError
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

SHARE = Path(get_package_share_directory('imu_bringup'))
SHARED = {
    'boards': ('', 'YAML: namespace → arguments of that board; the others are defaults for all'),
    'use_sim_time': ('false', 'Whether time comes from /clock'),
    'config': (str(SHARE / 'config' / 'imu_chain.yaml'), 'Parameter file of chain and stages'),
    'rviz': ('false', 'Whether to start RViz'),
}


def chain(board, given):
    """Return the process of one board; it holds several nodes, so that it gets no name."""
    parameters = {name: value(board[name]) for name in BOARD_ARGUMENTS if str(board[name])}
    namespace = parameters.pop('namespace', '')
    parameters['use_sim_time'] = value(given['use_sim_time'])
    if namespace and board['record']:
        parameters['topics'] = [f'/{namespace.strip("/")}/*', '/chamber/*', '/diagnostics']
    return Node(
        package='imu_bringup',
        executable='imu_chain_node',
        namespace=namespace,
        parameters=[given['config'], parameters],
        output='screen',
    )


def rviz():
    """Return RViz; refuse where there is none, as a failed launch leaves what runs already."""
    try:
        get_package_prefix('rviz2')
    except PackageNotFoundError:
        raise UserError('rviz:=true needs rviz2: install ros-jazzy-rviz2') from None
    arguments = ['-d', str(SHARE / 'rviz' / 'imu.rviz')]
    return [Node(package='rviz2', executable='rviz2', arguments=arguments)]


def processes(context):
    """Return what the arguments ask for."""
    given = {
        name: LaunchConfiguration(name).perform(context) for name in (*BOARD_ARGUMENTS, *SHARED)
    }
    view = rviz() if value(given['rviz']) is True else []
    return [*(chain(board, given) for board in boards_of(given)), *view]


def generate_launch_description():
    arguments = [
        DeclareLaunchArgument(name, default_value=default, description=meaning)
        for name, (default, meaning) in (BOARD_ARGUMENTS | SHARED).items()
    ]
    return LaunchDescription([*arguments, OpaqueFunction(function=processes)])
