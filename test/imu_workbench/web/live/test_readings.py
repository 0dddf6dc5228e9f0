# SPDX-License-Identifier: Apache-2.0
"""Readings of a running device: what its messages were made of."""

import numpy as np
import pytest
from imu_recording.bags.decoding.cdr import encode_messages
from imu_recording.logging_contract import MAGNETIC_FIELD, TEMPERATURE
from imu_recording.recording import SECOND_NS
from imu_recording.ros.message_cdr import serialise
from imu_workbench.web.live import readings as view
from imu_workbench.web.live.state import LiveState, NodeStatus
from orientation_filters.rotation.arrays import from_rotation_vector
from std_msgs.msg import String

from .heard import GRAVITY, START, TRUE_RATE, Clock, imu, oriented, put, stamps


def test_the_last_second_is_read(state: LiveState) -> None:
    now = view.reading(state, 'gyroscope', 0)
    np.testing.assert_allclose(now.raw, TRUE_RATE)
    np.testing.assert_allclose(now.compensated, TRUE_RATE - 0.004)
    np.testing.assert_allclose(now.difference, 0.004)
    np.testing.assert_allclose(now.static, 0.0, atol=1e-12)
    assert view.rate_hz(state, 'raw') == pytest.approx(100.0)


def test_raw_and_compensated_are_shown_of_the_same_second(clock: Clock) -> None:
    """The compensated stream lags: a rising rate must not look like an error."""
    state = LiveState(clock)
    stamp = stamps(10, 50)
    rising = TRUE_RATE + np.arange(500)[:, None] * 1e-3
    put(state, 'raw', imu(stamp, rising + 0.002, GRAVITY))
    put(state, 'compensated', imu(stamp[:450], rising[:450], GRAVITY))
    state.absorb()
    now = view.reading(state, 'gyroscope', 0)
    np.testing.assert_allclose(now.raw - now.compensated, now.difference)
    np.testing.assert_allclose(now.difference, 0.002)


def test_the_static_residual_is_the_drift_since_the_zero(clock: Clock) -> None:
    state = LiveState(clock)
    stamp = stamps(100, 20)
    drift = np.arange(2000)[:, None] / 20 * 1e-3
    put(state, 'raw', imu(stamp, TRUE_RATE, GRAVITY))
    put(state, 'compensated', imu(stamp, TRUE_RATE + drift, GRAVITY))
    state.absorb()
    end = view.reading(state, 'gyroscope', 0).static
    np.testing.assert_allclose(end, (99.475 - 4.975) * 1e-3, rtol=1e-6)
    later = view.reading(state, 'gyroscope', START // SECOND_NS + 80).static
    np.testing.assert_allclose(later, (99.475 - 84.975) * 1e-3, rtol=1e-6)
    lines = view.static_line(state, 'gyroscope', 3600.0, 0)
    np.testing.assert_allclose(np.diff(lines.values[:, 0]), 1e-3, rtol=1e-6)
    assert view.tilt_since_zero_deg(state, 0) == pytest.approx(0.0, abs=1e-6)


def test_a_turned_device_is_noticed(clock: Clock) -> None:
    state = LiveState(clock)
    stamp = stamps(30, 20)
    force = np.where(np.arange(600)[:, None] < 400, [[0.0, 0.0, 9.8]], [[0.0, 9.8, 0.0]])
    put(state, 'raw', imu(stamp, TRUE_RATE, force))
    state.absorb()
    assert view.tilt_since_zero_deg(state, 0) == pytest.approx(90.0)


def test_an_attitude_comes_back_with_the_angle_between_two(clock: Clock) -> None:
    state = LiveState(clock)
    stamp = stamps(3, 20)
    level = from_rotation_vector(np.array([0.0, 0.0, 0.5]))
    tilted = from_rotation_vector(np.array([np.radians(30.0), 0.0, 0.0]))
    signs = np.where(np.arange(60) % 2, 1.0, -1.0)
    put(state, 'ahrs', oriented(stamp, [sign * tilted for sign in signs]))
    put(state, 'complementary', oriented(stamp, [level] * 60))
    for _ in range(2):
        state.absorb()
    ahrs, complementary = view.attitude(state, 'ahrs'), view.attitude(state, 'complementary')
    assert ahrs is not None
    assert complementary is not None
    np.testing.assert_allclose(np.degrees(ahrs.euler), [30.0, 0.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(complementary.euler, [0.0, 0.0, 0.5], atol=1e-12)
    expected = 2 * np.degrees(np.arccos(np.cos(0.25) * np.cos(np.radians(15.0))))
    assert view.angle_between_deg(ahrs, complementary) == pytest.approx(expected)


def test_means_of_an_attitude_do_not_mind_the_sign_of_a_quaternion(clock: Clock) -> None:
    state = LiveState(clock)
    stamp = stamps(40, 10)
    tilted = from_rotation_vector(np.array([0.3, -0.2, 3.1]))
    signs = np.where(np.arange(400) % 3, 1.0, -1.0)
    messages = oriented(stamp, [sign * tilted for sign in signs])
    for first in range(0, 400, 7):
        put(state, 'ahrs', messages[first : first + 7])
        state.absorb()
    lines = view.euler_line(state, 'ahrs', 3600.0)
    ahrs = view.attitude(state, 'ahrs')
    assert ahrs is not None
    np.testing.assert_allclose(lines.values, np.broadcast_to(ahrs.euler, lines.values.shape))


def test_a_filter_that_knows_no_orientation_shows_none(clock: Clock) -> None:
    state = LiveState(clock)
    put(state, 'ahrs', imu(stamps(1, 10), TRUE_RATE, GRAVITY))
    state.absorb()
    assert view.attitude(state, 'ahrs') is None


def test_temperature_and_its_slope(clock: Clock) -> None:
    state = LiveState(clock)
    stamp = stamps(120, 1)
    celsius = 20.0 + np.arange(120)[:, None] / 60.0 * 1.5
    put(
        state,
        'temperature',
        [row.tobytes() for row in encode_messages(TEMPERATURE, stamp, 'imu', (celsius,))],
    )
    state.absorb()
    assert view.value_of(state, 'temperature') == pytest.approx(celsius[-1, 0])
    assert view.warming_c_per_min(state) == pytest.approx(1.5)
    clock.time += 5.0
    assert view.silence_s(state, 'temperature') == pytest.approx(5.0)


def test_missing_fields_leave_the_rest_alone(clock: Clock) -> None:
    state = LiveState(clock)
    stamp = stamps(3, 20)
    field = np.full((60, 3), 5e-5)
    field[::2, 0] = np.nan
    put(
        state,
        'raw_field',
        [row.tobytes() for row in encode_messages(MAGNETIC_FIELD, stamp, 'imu', (field,))],
    )
    state.absorb()
    np.testing.assert_allclose(view.reading(state, 'magnetometer', 0).raw, 5e-5)
    assert np.isnan(view.reading(state, 'gyroscope', 0).raw).all()
    assert np.isnan(view.tilt_since_zero_deg(state, 0))


def test_phase_and_time_left(clock: Clock) -> None:
    state = LiveState(clock)
    state.put('phase', serialise(String(data='ramp_up 2')))
    state.absorb()
    assert state.phase == 'ramp_up 2'
    assert np.isnan(view.chamber_times(state.statuses)).all()
    values = {'mode': 'RUN', 'phase_left [s]': '90', 'run_left [s]': '5400'}
    state.put_status(NodeStatus('chamber_profile', 0, 'RUN', values, clock()))
    assert view.chamber_times(state.statuses) == (90.0, 5400.0)
