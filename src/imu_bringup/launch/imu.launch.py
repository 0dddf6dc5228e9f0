# SPDX-License-Identifier: Apache-2.0
"""Start the chain in one process for one board, or for each board of a file in its namespace.

ros2 launch imu_bringup imu.launch.py transport:=simulated://dut1 model:=dut1.yaml filter:=ahrs
ros2 launch imu_bringup imu.launch.py boards:=boards.yaml
"""

from pathlib import Path

import yaml
from ament_index_python.packages import get_package_share_directory
from imu_recording.user_error import UserError
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

SHARE = Path(get_package_share_directory('imu_bringup'))
BOARD = {
    'namespace': ('', 'Namespace of the board'),
    'transport': (
        '',
        'serial:///dev/…, tcp://host:port, simulated://dut1, bag://path; topic: another driver',
    ),
    'device': ('', 'Serial number that is accepted; empty: any'),
    'model': ('', 'Thermal model; empty: nothing is compensated'),
    'filter': ('ahrs', 'none, complementary, ahrs or both'),
    'record': ('', 'Folder of the bag; empty: nothing is recorded'),
    'frame_id': ('', 'Frame of the sensor; empty: imu_link, or <namespace>_imu_link'),
    'body_frame_id': ('', 'Frame of the orientation; empty: frame_id'),
    'world_frame_id': ('', 'Parent frame on /tf; empty: world'),
    'publish_tf': ('false', 'Whether the filter publishes world → body on /tf'),
}
"""Arguments of one board: default and meaning; a file of boards gives any of them for each."""
SHARED = {
    'boards': ('', 'YAML: namespace → arguments of that board; the others are defaults for all'),
    'use_sim_time': ('false', 'Whether time comes from /clock'),
    'config': (str(SHARE / 'config' / 'imu_chain.yaml'), 'Parameter file of chain and stages'),
    'rviz': ('false', 'Whether to start RViz'),
}


def value(text):
    """Return a launch argument as the parameter it stands for."""
    return {'true': True, 'false': False}.get(str(text).lower(), str(text))


def boards_of(given):
    """Return the arguments of each board."""
    common = {name: given[name] for name in BOARD}
    if not given['boards']:
        return [common]
    content = yaml.safe_load(Path(given['boards']).read_text()) or {}
    boards = []
    for namespace, own in content.items():
        unknown = sorted(set(own or {}) - set(BOARD))
        if unknown:
            raise UserError(
                f'{given["boards"]}: {namespace} has {unknown[0]}; known: {", ".join(BOARD)}'
            )
        board = {**common, 'namespace': namespace, **(own or {})}
        board['frame_id'] = board['frame_id'] or f'{namespace}_imu_link'
        if common['record'] and not (own or {}).get('record'):
            board['record'] = f'{common["record"]}_{namespace}'
        boards.append(board)
    return boards


def chain(board, given):
    """Return the process of one board; it holds several nodes, so that it gets no name."""
    parameters = {name: value(board[name]) for name in BOARD if str(board[name])}
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


def processes(context):
    """Return what the arguments ask for."""
    given = {name: LaunchConfiguration(name).perform(context) for name in (*BOARD, *SHARED)}
    started = [chain(board, given) for board in boards_of(given)]
    if value(given['rviz']) is True:
        view = ['-d', str(SHARE / 'rviz' / 'imu.rviz')]
        started.append(Node(package='rviz2', executable='rviz2', arguments=view))
    return started


def generate_launch_description():
    arguments = [
        DeclareLaunchArgument(name, default_value=default, description=meaning)
        for name, (default, meaning) in (BOARD | SHARED).items()
    ]
    return LaunchDescription([*arguments, OpaqueFunction(function=processes)])
