# SPDX-License-Identifier: Apache-2.0
"""The live model: bytes in, numbers and lines out; the truth is what the bytes were made of."""

import re
from collections.abc import Sequence

import numpy as np
import pytest
from imu_recording.bags.decoding.cdr import encode_messages
from imu_recording.logging_contract import IMU, MAGNETIC_FIELD, TEMPERATURE
from imu_recording.ros.message_cdr import serialise
from imu_workbench.web.live import readings as view
from imu_workbench.web.live.state import LiveState, NodeStatus
from imu_workbench.web.live.tables import verdict
from imu_workbench.web.live.topic_history import SECOND_NS, decoded
from orientation_filters.rotation.arrays import from_rotation_vector
from sensor_msgs.msg import Imu
from std_msgs.msg import String

START = 1_800_000_000 * SECOND_NS
GRAVITY = np.array([0.1, -0.2, 9.8])
TRUE_RATE = np.array([0.01, -0.02, 0.005])


class Clock:
    """A clock that is set by hand."""

    def __init__(self) -> None:
        self.time = 100.0

    def __call__(self) -> float:
        return self.time


def stamps(seconds: float, rate_hz: float, begin_s: float = 0.0) -> np.ndarray:
    count = round(seconds * rate_hz)
    return (
        START
        + round(begin_s * SECOND_NS)
        + (np.arange(count) * SECOND_NS / rate_hz).astype(np.int64)
    )


def imu(stamp: np.ndarray, rate: np.ndarray, force: np.ndarray, frame: str = 'imu') -> list[bytes]:
    shape = (len(stamp), 3)
    columns = (np.broadcast_to(rate, shape), np.broadcast_to(force, shape))
    return [row.tobytes() for row in encode_messages(IMU, stamp, frame, columns, {4: -1.0})]


def oriented(stamp: np.ndarray, quaternion: Sequence[np.ndarray]) -> list[bytes]:
    messages = []
    for one, xyzw in zip(stamp, quaternion, strict=True):
        message = Imu()
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(int(one), SECOND_NS)
        o = message.orientation
        o.x, o.y, o.z, o.w = (float(part) for part in xyzw)
        messages.append(serialise(message))
    return messages


def put(state: LiveState, role: str, messages: Sequence[bytes]) -> None:
    for message in messages:
        state.put(role, message)


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def state(clock: Clock) -> LiveState:
    """Twenty seconds at 100 Hz; the compensated stream lacks a bias and every tenth sample."""
    state = LiveState(clock)
    stamp = stamps(20, 100)
    put(state, 'raw', imu(stamp, TRUE_RATE, GRAVITY))
    kept = stamp[np.arange(len(stamp)) % 10 != 3]
    put(state, 'compensated', imu(kept, TRUE_RATE - 0.004, GRAVITY - 0.03))
    state.absorb()
    return state


def test_bytes_become_the_numbers_that_ros_serialised() -> None:
    stamp = stamps(1, 4)
    messages = imu(stamp[:2], TRUE_RATE, GRAVITY, 'a') + imu(
        stamp[2:], -TRUE_RATE, GRAVITY, 'bcdefghi'
    )
    rows, unreadable = decoded(IMU, [*messages, b'\x00\x01\x00\x00', b''])
    assert unreadable == 2
    np.testing.assert_array_equal(rows.stamp, stamp)
    np.testing.assert_allclose(rows.values[:, 13:16], TRUE_RATE * [[1], [1], [-1], [-1]])
    np.testing.assert_allclose(rows.values[:, 25:28], np.broadcast_to(GRAVITY, (4, 3)))


def test_what_a_message_does_not_report_is_not_a_number() -> None:
    message = encode_messages(
        IMU, stamps(1, 1), 'imu', (np.zeros((1, 3)), np.ones((1, 3))), {16: -1.0}
    )
    rows, _ = decoded(IMU, [message[0].tobytes()])
    assert np.isnan(rows.values[0, 13:16]).all()
    np.testing.assert_array_equal(rows.values[0, 25:28], 1.0)


def test_raw_and_compensated_are_subtracted_stamp_by_stamp(state: LiveState) -> None:
    difference = state.tracks['difference'].recent.since(0)
    assert len(difference.stamp) == 1800
    np.testing.assert_allclose(difference.values[:, :3], 0.004)
    np.testing.assert_allclose(difference.values[:, 3:], 0.03)


@pytest.mark.parametrize('lead', [-40, -1, 0, 40])
def test_partners_meet_whichever_comes_first(clock: Clock, lead: int) -> None:
    """The compensated stream is `lead` samples of 50 Hz ahead of the raw one."""
    state = LiveState(clock)
    stamp = stamps(4, 50)
    raw, compensated = imu(stamp, TRUE_RATE, GRAVITY), imu(stamp, TRUE_RATE - 1.0, GRAVITY)
    for now in range(-40, 250, 5):
        put(state, 'raw', raw[max(now, 0) : max(now + 5, 0)])
        put(state, 'compensated', compensated[max(now + lead, 0) : max(now + lead + 5, 0)])
        state.absorb()
    difference = state.tracks['difference'].recent.since(0)
    np.testing.assert_array_equal(difference.stamp, stamp)
    np.testing.assert_allclose(difference.values[:, :3], 1.0)


def test_the_last_second_is_read(state: LiveState) -> None:
    now = view.reading(state, 'gyroscope', 0)
    np.testing.assert_allclose(now.raw, TRUE_RATE)
    np.testing.assert_allclose(now.compensated, TRUE_RATE - 0.004)
    np.testing.assert_allclose(now.difference, 0.004)
    np.testing.assert_allclose(now.static, 0.0, atol=1e-12)
    assert view.rate_hz(state, 'raw') == pytest.approx(100.0)


def test_the_verdict_is_on_the_noise_and_names_the_axis_that_drifts(clock: Clock) -> None:
    """Three minutes at 20 Hz; accelerometer y drifts by ten times the noise of a second."""
    rng = np.random.default_rng(5)
    stamp = stamps(180, 20)
    time = (stamp - stamp[0])[:, None] / SECOND_NS
    rate = TRUE_RATE + rng.normal(0.0, 1e-3, (len(stamp), 3))
    force = GRAVITY + rng.normal(0.0, 0.01, (len(stamp), 3))
    drift = 10.0 * 0.01 / np.sqrt(20.0) * np.array([0.0, 1.0, 0.0])
    for drifts, said in (
        (0.0, r'^What is left is noise: at most 1\.\d+ ×'),
        (drift, r'beyond the noise of means of a second: accelerometer y \d'),
    ):
        state = LiveState(clock)
        put(state, 'raw', imu(stamp, rate, force + drifts * time / 180.0))
        state.absorb()
        assert re.search(said, verdict(state, 0))
    ratios = view.over_noise(state, 'accelerometer', 0)
    assert 0.8 < ratios[0] < 1.3
    assert ratios[1] == pytest.approx(10.0 / np.sqrt(3.0), rel=0.2)  # rms of a ramp
    assert np.isnan(view.over_noise(state, 'magnetometer', 0)).all()


def test_there_is_no_verdict_before_a_minute(state: LiveState) -> None:
    assert verdict(state, 0) == 'A verdict needs 60 s at rest since the zero.'
    why = '/imu/data_raw has 2 publishers (/one, /other)'
    assert verdict(state, 0, {'raw': why}) == f'No verdict: {why}.'
    assert verdict(state, 0, {'ahrs': why}).startswith('A verdict needs')


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


def test_a_bag_that_starts_again_clears_the_history(state: LiveState) -> None:
    put(state, 'raw', imu(stamps(2, 100), TRUE_RATE, GRAVITY))
    state.absorb()
    assert state.restarts == 1
    assert view.newest(state) == stamps(2, 100)[-1]
    assert len(view.line(state, 'raw', 3600.0).time) == 1


def test_late_samples_within_a_second_do_not_clear_it(state: LiveState) -> None:
    put(state, 'raw', imu(stamps(0.1, 100, begin_s=19.5), TRUE_RATE, GRAVITY))
    state.absorb()
    assert state.restarts == 0


def test_another_topic_in_a_role_starts_it_afresh(state: LiveState) -> None:
    state.forget('raw')
    assert state.tracks['raw'].newest == -1
    assert state.tracks['difference'].newest == -1
    assert state.tracks['compensated'].newest > 0


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
