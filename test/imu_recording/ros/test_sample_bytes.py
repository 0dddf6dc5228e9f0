# SPDX-License-Identifier: Apache-2.0
"""Serialised samples: the numbers and lengths of what the middleware writes, both ways."""

from __future__ import annotations

from math import isnan
from typing import Any

import pytest
from imu_recording.ros.messages import ImuSample, MagneticSample, TemperatureSample, VectorSample
from imu_recording.ros.sample_bytes import form_of, imu_from_bytes
from rclpy.serialization import deserialize_message, serialize_message

STAMP = 1_234_567_890_123_456_789
NINE = tuple(0.5 * n for n in range(9))
SAMPLES = {
    'Imu': lambda frame: ImuSample(
        STAMP, (1.0, -2.0, 3.0), (4.0, 5.0, -6.0), NINE, NINE[::-1], frame, (0.0, 0.6, 0.0, 0.8),
        (-1.0, *NINE[1:]),
    ),
    'MagneticField': lambda frame: MagneticSample(STAMP, (7e-6, 8e-6, -9e-6), NINE, frame),
    'Temperature': lambda frame: TemperatureSample(STAMP, 21.0625, 0.1, frame),
    'Vector3Stamped': lambda frame: VectorSample(STAMP, (0.1, -0.2, 3.0), frame),
}  # fmt: skip


def message_class(name: str) -> Any:
    import geometry_msgs.msg
    import sensor_msgs.msg

    return getattr(sensor_msgs.msg, name, None) or getattr(geometry_msgs.msg, name)


@pytest.mark.parametrize('frame_id', ['', 'a', 'imu', 'imu_link', 'dut1/imu_link', 'größe'])
@pytest.mark.parametrize('name', SAMPLES)
def test_bytes_and_messages_hold_the_same(name: str, frame_id: str) -> None:
    kind, sample = message_class(name), SAMPLES[name](frame_id)
    form = form_of(kind)
    message = form.to_message(sample)
    written = form.to_bytes(sample)
    theirs = serialize_message(message)
    assert deserialize_message(written, kind) == message
    assert len(written) == len(theirs)
    assert form.from_bytes(theirs) == form.from_bytes(written) == sample
    assert form.from_message(message) == sample


def test_vectors_that_are_not_reported_are_nan() -> None:
    form = form_of(message_class('Imu'))
    sample = ImuSample(STAMP, (1.0, 2.0, 3.0), (0.0, 0.0, 9.8), (-1.0,) + (0.0,) * 8)
    read = imu_from_bytes(form.to_bytes(sample))
    assert all(isnan(value) for value in read.angular_velocity)
    assert read.linear_acceleration == (0.0, 0.0, 9.8)


def test_big_endian_is_refused_by_name() -> None:
    with pytest.raises(ValueError, match='little-endian'):
        imu_from_bytes(b'\0\0' + bytes(320))
