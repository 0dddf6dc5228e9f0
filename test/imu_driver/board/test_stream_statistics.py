# SPDX-License-Identifier: Apache-2.0
"""Rate and jitter, rest and its refusals, and the six-position check."""

import json

import numpy as np
import pytest
from imu_driver.board.sample import Sample
from imu_driver.board.stream_statistics import (
    RestError,
    SixPositionCheck,
    StreamStatistics,
    check_six_positions,
    rest_report,
    up_axis,
)
from imu_recording.recording import STANDARD_GRAVITY

POSITIONS = {
    f'{sign}{axis}': STANDARD_GRAVITY * (1 if sign == '+' else -1) * np.eye(3)[i]
    for sign in '+-'
    for i, axis in enumerate('xyz')
}


def resting(rate_hz: float = 100.0, duration: float = 4.0, **changes: object) -> StreamStatistics:
    """Statistics of a device with z up, 10 mrad/s gyroscope bias about x."""
    statistics = StreamStatistics()
    for k in range(round(duration * rate_hz)):
        stamp = 1_700_000_000_000_000_000 + round(k * 1e9 / rate_hz)
        force = (0.0, 0.0, STANDARD_GRAVITY)
        sample = Sample(stamp, (0.01, 0.0, 0.0), force, None, 20.0)
        statistics.add(sample._replace(**changes))
    return statistics


def test_rate_is_of_the_time_since_last_asked() -> None:
    statistics = resting()
    rate, jitter = statistics.take_rate()
    assert rate == pytest.approx(100.0)
    assert jitter < 1e-6
    assert statistics.take_rate() == (0.0, 0.0)


def test_a_device_at_rest() -> None:
    statistics = resting()
    report = json.loads(rest_report(statistics))
    assert report['gyroscope_bias'] == [0.01, 0.0, 0.0]
    assert SixPositionCheck().take(statistics) == (
        '+z is up, reads [0.00, 0.00, 9.81] m/s²; missing: +x, -x, +y, -y, -z'
    )


@pytest.mark.parametrize(
    ('statistics', 'told'),
    [
        (resting(duration=1.0), 'only 1.0 s were received, 2 s are needed'),
        (resting(angular_velocity=(1.0, 0.0, 0.0)), 'the device moves'),
        (resting(linear_acceleration=(0.0, 0.0, 4.0)), 'must read 9.8 m/s², it reads 4.00'),
    ],
)
def test_what_is_not_rest(statistics: StreamStatistics, told: str) -> None:
    with pytest.raises(RestError, match=told):
        statistics.up_axis()


def test_six_positions() -> None:
    assert check_six_positions(POSITIONS) == []
    assert [up_axis([*reading]) for reading in POSITIONS.values()] == list(POSITIONS)
    mirrored = {axis: reading * (-1, 1, 1) for axis, reading in POSITIONS.items()}
    assert any('mirrored' in fault for fault in check_six_positions(mirrored))
    turned = {axis: reading[[1, 2, 0]] for axis, reading in POSITIONS.items()}
    faults = check_six_positions(turned)
    assert len(faults) == 6
    assert 'with +x up the sensor reads [0.00, 0.00, 9.81] m/s²: its +z is up' in faults
    assert check_six_positions({'+x': POSITIONS['+x']})[0] == 'position -x is missing'
