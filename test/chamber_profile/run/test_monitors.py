# SPDX-License-Identifier: Apache-2.0
"""Monitors of IMU, reference logger and recorder, on a clock set by hand."""

import pytest
from chamber_profile.run.config import ChamberConfig
from chamber_profile.run.monitors import RunMonitors
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from sensor_msgs.msg import Temperature

SECOND = 1_000_000_000


class Clock:
    """A clock that stands until it is set."""

    def __init__(self) -> None:
        self.stamp = 0

    def __call__(self) -> int:
        return self.stamp


def monitors(**parameters) -> tuple[RunMonitors, Clock]:
    clock = Clock()
    return RunMonitors(ChamberConfig(**parameters), clock), clock


def test_an_imu_has_failed_after_ten_seconds_of_silence() -> None:
    watch, clock = monitors()
    clock.stamp = 10 * SECOND
    assert watch.readings().imu_alive
    clock.stamp += 1
    assert not watch.readings().imu_alive
    watch.on_imu(Temperature())
    assert watch.readings().imu_alive
    clock.stamp += 11 * SECOND
    watch.restart_imu_timeout()
    assert watch.readings().imu_alive


def test_only_what_the_parameters_ask_for_is_subscribed() -> None:
    topics = [topic for _, topic, _ in monitors()[0].inputs()]
    assert topics == ['imu/temperature', '/diagnostics']
    watch, clock = monitors(require_imu=False, publish_temperature=False)
    topics = [topic for _, topic, _ in watch.inputs()]
    assert topics == ['chamber/temperature', 'chamber/device_temperature', '/diagnostics']
    clock.stamp = 100 * SECOND
    assert watch.readings().imu_alive


def test_a_reference_logger_replaces_the_chambers_sensor_while_it_is_heard() -> None:
    watch, clock = monitors(publish_temperature=False)
    assert 'reference logger' in watch.readings().fault
    watch.on_air(Temperature(temperature=21.5))
    watch.on_device(Temperature(temperature=22.5))
    readings = watch.readings()
    assert (readings.air, readings.device, readings.referenced) == (21.5, 22.5, True)
    assert readings.fault == ''
    clock.stamp = 11 * SECOND
    assert watch.readings().air is None


@pytest.mark.parametrize(
    ('name', 'level', 'fault'),
    [
        ('recorder', 2, 'recorder: disk full'),
        ('lab/recorder', 2, 'recorder: disk full'),
        ('recorder', 1, ''),
        ('other', 2, ''),
    ],
)
def test_errors_of_the_recorder_are_faults_until_they_are_over(name, level, fault) -> None:
    watch, _ = monitors()
    status = DiagnosticStatus(name=name, level=bytes([level]), message='disk full')
    watch.on_diagnostics(DiagnosticArray(status=[status]))
    assert watch.readings().fault == fault
    status.level = bytes([0])
    watch.on_diagnostics(DiagnosticArray(status=[status]))
    assert watch.readings().fault == ''
