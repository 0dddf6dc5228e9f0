# SPDX-License-Identifier: Apache-2.0
"""Bytes that are no message of their type are refused, in either version of XCDR."""

from __future__ import annotations

import pytest
from imu_recording.bags.decoding.message_types import DecodeError, standard_types
from imu_recording.bags.decoding.slow_decode import decode_message
from imu_recording.logging_contract import IMU


def test_bytes_that_are_no_message_are_refused() -> None:
    with pytest.raises(DecodeError):
        decode_message(b'\x00\x01\x00\x00\x01', IMU, standard_types())
    with pytest.raises(DecodeError, match='no std_msgs/msg/Float64 in XCDR version 2'):
        decode_message(b'\x00\x07\x00\x00' + bytes(12), 'std_msgs/msg/Float64', standard_types())
