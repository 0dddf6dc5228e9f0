# SPDX-License-Identifier: Apache-2.0
"""The nodes in-process: same numbers as the batch, nothing poisons them, everything is counted."""

from __future__ import annotations

from dataclasses import replace
from math import inf, nan
from typing import Any

import numpy as np
import pytest
from imu_recording.recording import ImuRecording
from imu_recording.ros.messages import (
    ImuSample,
    MagneticSample,
    imu_from_sample,
    magnetic_field_from_sample,
)
from orientation_filters.filters import run_filter
from orientation_filters.result import SIX_AXIS
from orientation_filters.rotation.arrays import conjugate, euler_zyx, multiply, rotation_angle

from .recordings import random_attitude, rest


@pytest.fixture(params=['complementary', 'ahrs'])
def name(request: pytest.FixtureRequest) -> str:
    return request.param


def make(ros: Any, name: str, **parameters: Any) -> Any:
    from orientation_filters.node import AhrsFilterNode, ComplementaryFilterNode

    published: list[tuple[str, Any]] = []
    node_class = {'complementary': ComplementaryFilterNode, 'ahrs': AhrsFilterNode}[name]
    node = node_class(
        capture=lambda topic, message: published.append((topic, message)),
        now=lambda: 0,
        parameters=parameters,
    )
    node.published = published
    assert node.autostart()
    return node


def feed(node: Any, recording: ImuRecording) -> None:
    for i in range(len(recording)):
        field = recording.magnetic_field[i]
        w, f = recording.angular_velocity[i], recording.linear_acceleration[i]
        sample = ImuSample(int(recording.stamp[i]), tuple(w), tuple(f))
        if not np.isnan(field).any():
            message = MagneticSample(int(recording.stamp[i]), tuple(field))
            node.inputs['imu/mag'](magnetic_field_from_sample(message))
        node.inputs['imu/data_raw'](imu_from_sample(sample))
    node.finish()


def orientations(node: Any) -> np.ndarray:
    data = [m for topic, m in node.published if topic == 'imu/data']
    return np.array([[q.x, q.y, q.z, q.w] for q in (m.orientation for m in data)])


def test_node_equals_batch_bit_for_bit(ros: Any, name: str) -> None:
    for preset in ('paper', 'robust'):
        recording = rest(random_attitude(1), seed=1, seconds=3)
        node = make(ros, name, preset=preset)
        feed(node, recording)
        result = run_filter(name, recording, preset=preset)
        np.testing.assert_array_equal(orientations(node), result.orientation)
        data = [m for topic, m in node.published if topic == 'imu/data']
        got = np.array([m.orientation_covariance for m in data]).reshape(-1, 3, 3)
        np.testing.assert_array_equal(got, result.covariance)
        euler = [m.vector for topic, m in node.published if topic == '~/euler']
        np.testing.assert_allclose(
            [[v.x, v.y, v.z] for v in euler], euler_zyx(result.orientation), atol=1e-12
        )
        node.destroy_node()


def test_bad_numbers_are_counted_and_never_poison(ros: Any, name: str) -> None:
    recording = rest(random_attitude(2), seed=2, seconds=10)
    w, f, m = (
        np.array(column)
        for column in (
            recording.angular_velocity,
            recording.linear_acceleration,
            recording.magnetic_field,
        )
    )
    w[100], w[101], w[102] = nan, inf, 1e300
    f[200], f[201], f[202] = nan, inf, 0.0
    f[203], m[302] = 1e308, 0.0
    bad = replace(recording, angular_velocity=w, linear_acceleration=f, magnetic_field=m)
    node = make(ros, name)
    feed(node, bad)
    got = orientations(node)
    assert len(got) == len(recording) - 3
    assert np.isfinite(got).all()
    clean = run_filter(name, recording).orientation[-1]
    assert np.degrees(rotation_angle(multiply(conjugate(clean), got[-1]))) < 0.3
    values = node.diagnostics()[2]
    assert values['invalid_gyroscope'] == 3
    assert values['dropped'] == 3
    assert values['invalid_accelerometer'] == 4
    assert values['invalid_magnetometer'] == 1
    node.inputs['imu/mag'](magnetic_field_from_sample(MagneticSample(0, (nan, nan, inf))))
    assert node.diagnostics()[2]['invalid_magnetometer'] == 2
    node.destroy_node()


def test_time_going_wrong_is_dropped_or_reset(ros: Any, name: str) -> None:
    recording = rest(random_attitude(3), seed=3, seconds=4)
    node = make(ros, name)
    feed(node, recording.rows(slice(0, 100)))
    feed(node, recording.rows(slice(95, 100)))
    values = node.diagnostics()[2]
    assert values['dropped'] == 5
    assert values['resets'] == 0
    feed(node, replace(recording, stamp=recording.stamp + 10_000_000_000).rows(slice(100, 200)))
    assert node.diagnostics()[2]['resets'] == 1
    feed(node, recording)
    values = node.diagnostics()[2]
    assert values['jumped_back'] == 1
    assert values['resets'] == 2
    assert len(orientations(node)) == 100 + 100 + len(recording)
    node.destroy_node()


def test_lost_magnetometer_falls_back_to_six_axes(ros: Any, name: str) -> None:
    recording = rest(random_attitude(4), seed=4, seconds=4, noise=0.01)
    field = recording.magnetic_field.copy()
    field[200:300] = nan
    gap = replace(recording, magnetic_field=field)
    node = make(ros, name)
    feed(node, gap)
    fallen = node.diagnostics()[2]['six_axis']
    assert 45 <= fallen <= 50
    flags = run_filter(name, gap).flags
    assert np.count_nonzero(flags & SIX_AXIS) == fallen
    node.destroy_node()


def test_presets_are_parameters_that_can_be_read_and_set(ros: Any, name: str) -> None:
    from rclpy.parameter import Parameter

    node = make(ros, name, preset='robust', bias_limit=1)
    assert node.get_parameter('adaptive').value is True
    assert node.get_parameter('bias_limit').value == 1
    described = node.describe_parameter('bias_limit')
    assert 'rad/s' in described.description
    assert described.floating_point_range
    refused = node.set_parameters([Parameter('rest_duration', value=-1.0)])[0]
    assert not refused.successful
    assert 'rest_duration' in refused.reason
    assert not node.set_parameters([Parameter('world_frame', value='ned')])[0].successful
    assert node.set_parameters([Parameter('rest_duration', value=3.0)])[0].successful
    assert node.config.rest_duration == 3.0
    node.destroy_node()


def test_cutoff_above_half_the_rate_is_refused_naming_both(ros: Any) -> None:
    slow = rest(random_attitude(5), seed=5, seconds=60, rate_hz=1.25)
    node = make(ros, 'complementary')
    feed(node, slow)
    level, line, _ = node.diagnostics()
    assert level == 2
    assert '3 Hz' in line
    assert '1.25 Hz' in line
    with pytest.raises(ValueError, match=r'cutoff_hz 3 Hz .* 1\.25 Hz'):
        run_filter('complementary', slow)
    node.destroy_node()


def test_tf_without_tf2_msgs_is_refused_in_one_line(ros: Any) -> None:
    from orientation_filters.node import AhrsFilterNode

    node = AhrsFilterNode(capture=lambda *_: None, now=lambda: 0, parameters={'publish_tf': True})
    try:
        import tf2_msgs  # noqa: F401
    except ImportError:
        assert not node.autostart()
    else:
        assert node.autostart()
    node.destroy_node()


def test_a_stream_in_another_unit_is_an_error_until_it_is_right(ros: Any, name: str) -> None:
    still = rest(random_attitude(1), seed=1, seconds=30.0)
    node = make(ros, name)
    feed(node, replace(still, linear_acceleration=still.linear_acceleration / 9.80665))
    level, line, _ = node.diagnostics()
    assert level == 2
    assert 'as if in g' in line
    assert 'the orientation is wrong' in line
    feed(node, replace(still, stamp=still.stamp + 40_000_000_000))
    assert node.diagnostics()[0] < 2
    node.destroy_node()
