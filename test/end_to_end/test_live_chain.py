# SPDX-License-Identifier: Apache-2.0
"""Driver → compensation → both filters → a subscriber that imports nothing of ours, over DDS."""

import math
from pathlib import Path
from typing import Any

import pytest

pytestmark = pytest.mark.end_to_end

TOPICS = {
    'imu/data_raw': 'Imu',
    'imu/mag': 'MagneticField',
    'imu/temperature': 'Temperature',
    'imu_compensated/data_raw': 'Imu',
    'imu_compensated/mag': 'MagneticField',
    'imu/data_complementary': 'Imu',
    'imu/data_ahrs': 'Imu',
}


def numbers(value: Any) -> list[float]:
    """All numbers of a message, at any depth."""
    if isinstance(value, dict):
        return [n for item in value.values() for n in numbers(item)]
    if isinstance(value, list):
        return [n for item in value for n in numbers(item)]
    return [float(value)] if isinstance(value, int | float) else []


def start_chain(processes: Any, model: Path, *namespace: str) -> None:
    compensated = (
        '-r', 'imu/data_raw:=imu_compensated/data_raw', '-r', 'imu/mag:=imu_compensated/mag',
    )  # fmt: skip
    processes.start(
        'imu_driver', 'imu_driver_node', '--ros-args', *namespace,
        '-p', 'transport:=simulated://dut1', '-p', 'output_data_rate:=119',
    )  # fmt: skip
    processes.start(
        'thermal_comp', 'thermal_comp_node', '--ros-args', *namespace, '-p', f'model:={model}'
    )
    for name in ('complementary', 'ahrs'):
        processes.start(
            'orientation_filters', f'{name}_filter_node', '--ros-args', *namespace, *compensated,
            '-r', f'imu/data:=imu/data_{name}',
        )  # fmt: skip


def test_every_output_reaches_a_foreign_subscriber(processes: Any, dut1_model: Path) -> None:
    namespace = '/robot1'  # without one: the test below
    start_chain(processes, dut1_model, '-r', f'__ns:={namespace}')
    topics = [f'{namespace}/{topic}={kind}' for topic, kind in TOPICS.items()]
    heard = processes.listen(20, 240, *topics, '/diagnostics=DiagnosticArray')
    assert all(math.isfinite(n) for n in numbers(heard['last']))
    for topic, kind in TOPICS.items():
        for quality in ('default', 'sensor_data'):
            message = heard['last'][f'{namespace}/{topic} {quality}']
            assert message['header']['frame_id'] == 'imu_link'
            assert message['header']['stamp']['sec'] > 0
            if kind == 'Imu':
                assert message['angular_velocity_covariance'][0] > 0
                assert message['linear_acceleration_covariance'][0] > 0
                raw = topic.endswith('data_raw')
                unknown = message['orientation_covariance'][0]
                assert unknown == -1 if raw else unknown > 0
                if not raw:
                    assert math.isclose(
                        sum(n * n for n in numbers(message['orientation'])), 1, abs_tol=1e-9
                    )
            if kind == 'MagneticField':
                assert message['magnetic_field_covariance'][0] > 0
    processes.interrupt(signals=2)


def test_one_ctrl_c_ends_every_node_cleanly(
    processes: Any, dut1_model: Path, tmp_path: Path
) -> None:
    start_chain(processes, dut1_model)
    processes.start(
        'imu_recording', 'recorder_node', '--ros-args', '-p', f'output:={tmp_path}/bag'
    )
    processes.start(
        'chamber_profile', 'chamber_profile_node', '--ros-args',
        '-p', 'profile:=short_20min', '-p', 'chamber:=simulated',
        '-p', f'run_directory:={tmp_path}/run',
    )  # fmt: skip
    processes.listen(
        5, 240,
        '/imu/data_ahrs=Imu', '/imu/data_complementary=Imu', '/chamber/temperature=Temperature',
        'node:recorder', 'node:chamber_profile',
    )  # fmt: skip
    processes.interrupt()
