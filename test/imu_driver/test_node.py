# SPDX-License-Identifier: Apache-2.0
"""The node in-process: what it publishes, refuses and answers."""

import json
import math
import os
import threading
import time
import tty
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from imu_driver.driver_status import DriverStatus
from imu_driver.node import ImuDriverNode
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import Imu, MagneticField, Temperature
from std_srvs.srv import Trigger

from imu_recording import ImuRecording, write_bag

TYPES = {'imu/data_raw': Imu, 'imu/mag': MagneticField, 'imu/temperature': Temperature}
DEADLINE = 120.0


class Captured:
    """What a node published, in order, and a way to wait for it."""

    def __init__(self) -> None:
        self.changed = threading.Condition()
        self.messages: list[tuple[str, Any]] = []
        self.counts: Counter[str] = Counter()

    def __call__(self, topic: str, message: Any) -> None:
        with self.changed:
            self.counts[topic] += 1
            if topic in TYPES:
                self.messages.append((topic, deserialize_message(message, TYPES[topic])))
            else:
                self.messages.append((topic, message))
            self.changed.notify_all()

    def count(self, topic: str) -> int:
        return self.counts[topic]

    def on(self, topic: str) -> list[Any]:
        return [message for name, message in self.messages if name == topic]

    def wait(self, condition: Callable[[], bool]) -> None:
        with self.changed:
            assert self.changed.wait_for(condition, DEADLINE)


def stamp_of(message: Any) -> int:
    return message.header.stamp.sec * 1_000_000_000 + message.header.stamp.nanosec


@pytest.fixture
def captured() -> Captured:
    return Captured()


def test_a_simulated_device(ros: Any, captured: Captured) -> None:
    parameters = {
        'transport': 'simulated://dut1?temperature=30&orientation=+y',
        'output_data_rate': 476,
        'frame_id': 'dut1_link',
        'linear_acceleration_stddev': 0.05,
    }
    node = ImuDriverNode(capture=captured, parameters=parameters)
    assert node.autostart()
    captured.wait(lambda: captured.count('imu/data_raw') > 1200)
    response = node.on_measure_rest(Trigger.Request(), Trigger.Response())
    position = node.on_check_position(Trigger.Request(), Trigger.Response())
    level, line, values = node.diagnostics()
    node.publish_diagnostics()
    node.trigger_deactivate()
    refused = node.on_measure_rest(Trigger.Request(), Trigger.Response())
    assert refused.success is False
    node.destroy_node()

    order = [(stamp_of(m), topic) for topic, m in captured.messages if topic in TYPES]
    assert order == sorted(order, key=lambda item: item[0]), 'stamps never go back'
    first = [topic for stamp, topic in order if stamp == order[0][0]]
    assert first == ['imu/temperature', 'imu/mag', 'imu/data_raw'], 'temperature first'
    imu = captured.on('imu/data_raw')
    assert {m.header.frame_id for m in imu} == {'dut1_link'}
    assert imu[0].orientation_covariance[0] == -1.0
    assert imu[0].linear_acceleration_covariance[8] == pytest.approx(0.0025)
    up = np.mean([m.linear_acceleration.y for m in imu])
    assert up == pytest.approx(9.8, abs=0.5)
    stamps = {stamp_of(m) for m in imu}
    assert {stamp_of(m) for m in captured.on('imu/mag')} <= stamps
    span = (stamp_of(imu[-1]) - stamp_of(imu[0])) * 1e-9
    assert len(imu) / span == pytest.approx(476.0, rel=0.05), "the sensor's own clock is off a bit"
    assert len(captured.on('imu/mag')) / span == pytest.approx(80.0, rel=0.02)
    assert len(captured.on('imu/temperature')) / span == pytest.approx(59.5, rel=0.03)
    assert captured.on('imu/temperature')[0].temperature == pytest.approx(30.0, abs=3.0)

    assert response.success, response.message
    bias = json.loads(response.message)['gyroscope_bias']
    assert np.abs(bias).max() < 0.05
    assert position.message.startswith('+y is up')
    (supply,) = captured.on('imu/supply_voltage')
    assert supply.data == pytest.approx(3.3)
    assert level == 0
    assert line.endswith('Hz')
    assert values['device'] == 'DUT1'
    assert values['nominal_rate_hz'] == 476.0
    assert 'CTRL_REG1_G=a0' in values['registers']


def test_a_simulated_device_follows_the_chamber(ros: Any, captured: Captured) -> None:
    transport = 'simulated://dut1?temperature=chamber&time_scale=600'
    node = ImuDriverNode(capture=captured, parameters={'transport': transport})
    assert node.autostart()
    captured.wait(lambda: captured.count('imu/temperature') > 10)
    assert captured.on('imu/temperature')[-1].temperature == pytest.approx(20.0, abs=3.0)
    for air in (60.0, math.nan):  # a sensor that has failed
        node.inputs['chamber/temperature'](Temperature(temperature=air))
    captured.wait(lambda: captured.on('imu/temperature')[-1].temperature > 50.0)
    node.destroy_node()


def test_a_board_in_a_room_listens_to_no_chamber(ros: Any) -> None:
    node = ImuDriverNode(
        capture=lambda *_: None, parameters={'transport': 'simulated://dut1?temperature=21'}
    )
    assert node.autostart()
    assert 'chamber/temperature' not in node.inputs
    node.destroy_node()


@pytest.mark.parametrize(
    ('parameters', 'told'),
    [
        ({'transport': 'usb://imu'}, "transport 'usb://imu'"),
        ({'accelerometer_full_scale': 3}, 'accelerometer full scale 3 g'),
        ({'magnetometer_axis_map': '-x +y +z'}, 'mirrors'),
        ({'transport': 'simulated://dut7'}, 'dut7'),
        ({'transport': 'simulated://dut1?colour=red'}, 'unknown option colour'),
        ({'transport': 'bag:///nowhere'}, '/nowhere'),
        ({'protocol': 'nmea'}, 'protocol'),
    ],
)
def test_what_cannot_be_is_refused(ros: Any, parameters: dict[str, Any], told: str) -> None:
    node = ImuDriverNode(capture=lambda *_: None, parameters=parameters)
    assert not node.autostart()
    node.destroy_node()
    assert told in node.refused


def test_a_missing_device_is_an_error_not_the_end(ros: Any, tmp_path: Path) -> None:
    parameters = {'transport': f'serial://{tmp_path}/imu0'}
    node = ImuDriverNode(capture=lambda *_: None, parameters=parameters)
    assert node.autostart()
    level, line, _ = node.diagnostics()
    node.trigger_deactivate()
    node.destroy_node()
    assert level == 2
    assert line.startswith('not connected')


def test_it_can_be_deactivated_and_activated_again(ros: Any, captured: Captured) -> None:
    node = ImuDriverNode(capture=captured, parameters={'transport': 'simulated://dut3'})
    assert node.autostart()
    for _ in range(2):
        before = captured.count('imu/data_raw')
        captured.wait(lambda n=before: captured.count('imu/data_raw') > n + 20)
        node.trigger_deactivate()
        assert node.diagnostics() == (0, 'inactive', {})
        node.trigger_activate()
    node.trigger_deactivate()
    node.trigger_cleanup()
    node.destroy_node()


def test_noise_on_the_line_is_told(ros: Any, tmp_path: Path) -> None:
    board, host = os.openpty()
    tty.setraw(host)
    parameters = {'transport': f'serial://{os.ttyname(host)}'}
    node = ImuDriverNode(capture=lambda *_: None, parameters=parameters)
    assert node.autostart()
    end = time.monotonic() + DEADLINE
    line = ''
    while 'no frame among them' not in line:
        assert time.monotonic() < end, line
        os.write(board, bytes([0x55, 0xAA, 0x10, 0x00]) * 50)
        time.sleep(0.01)
        line = node.diagnostics()[1]
    node.trigger_deactivate()
    node.destroy_node()
    os.close(board)
    os.close(host)


def test_a_bag_keeps_its_stamps(ros: Any, captured: Captured, tmp_path: Path) -> None:
    n = 50
    stamp = 1_700_000_000_000_000_000 + np.arange(n) * 10_000_000 + np.arange(n) % 7
    field = np.full((n, 3), np.nan)
    field[::3] = [2e-5, 0.0, -4e-5]
    recording = ImuRecording(
        stamp=stamp,
        angular_velocity=np.arange(3.0 * n).reshape(n, 3) * 1e-3,
        linear_acceleration=np.tile([0.0, 0.0, 9.81], (n, 1)),
        magnetic_field=field,
        temperature=20.0 + np.arange(n) // 10,
        device='DUT1',
    )
    write_bag(recording, tmp_path / 'bag')
    node = ImuDriverNode(
        capture=captured, parameters={'transport': f'bag://{tmp_path}/bag?rate=0'}
    )
    assert node.autostart()
    captured.wait(lambda: captured.count('imu/data_raw') == n)
    driver = node.driver
    node.trigger_deactivate()
    node.destroy_node()
    assert DriverStatus(driver).report(0)[:2] == (0, 'the bag has ended')
    assert [stamp_of(m) for m in captured.on('imu/data_raw')] == stamp.tolist()
    assert [stamp_of(m) for m in captured.on('imu/mag')] == stamp[::3].tolist()
    assert [m.temperature for m in captured.on('imu/temperature')] == [20, 21, 22, 23, 24]
    rates = [m.angular_velocity.z for m in captured.on('imu/data_raw')]
    np.testing.assert_array_equal(rates, recording.angular_velocity[:, 2])
