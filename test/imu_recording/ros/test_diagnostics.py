# SPDX-License-Identifier: Apache-2.0
"""A status as a message, as news for the log, and as a warning when its input has stopped."""

from __future__ import annotations

from imu_recording.ros.diagnostics import (
    INPUT_TIMEOUT_S,
    LOG_REPEAT_S,
    InputTimeout,
    StatusLog,
    diagnostic_array,
)


def test_an_error_is_not_hidden_by_a_timeout() -> None:
    now = [0.0]
    timeout = InputTimeout(lambda: now[0])
    ok, error = (0, 'ok', {'rate_hz': 100.0}), (2, 'no model', {})
    now[0] = 1000.0
    assert timeout.applied('imu/mag', ok) == ok  # no message yet: still waiting for the first
    timeout.heard()
    now[0] += 1.1 * INPUT_TIMEOUT_S
    assert timeout.applied('imu/mag', ok) == (1, 'no message on imu/mag for 11 s', ok[2])
    assert timeout.applied('imu/mag', error) == error
    timeout.restart()
    assert timeout.applied('imu/mag', ok) == ok


def test_a_status_that_comes_and_goes_is_logged_once_a_minute() -> None:
    log = StatusLog()
    told = [log.is_new(float(t), t % 2, 'warm' if t % 2 else 'cold') for t in range(10)]
    assert told == [True, True] + [False] * 8
    assert log.is_new(LOG_REPEAT_S + 10, 0, 'cold')


def test_the_message_holds_level_line_and_values() -> None:
    message = diagnostic_array(
        'imu', 1_500_000_000, {'rate': (1, 'slow', {'device': 7, 'rate_hz': 99.5})}
    )
    (status,) = message.status
    assert (status.level, status.name, status.message) == (b'\x01', 'imu: rate', 'slow')
    assert status.hardware_id == '7'
    assert {item.key: item.value for item in status.values} == {'device': '7', 'rate_hz': '99.5'}
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (1, 500_000_000)
