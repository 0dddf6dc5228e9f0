# SPDX-License-Identifier: Apache-2.0
"""Message bytes to columns: kernels, their plain Python and rosbags agree."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from imu_recording.bags.decoding import cdr_kernels
from imu_recording.bags.decoding.cdr import LAYOUTS, encode_messages
from imu_recording.bags.decoding.message_types import standard_types
from imu_recording.bags.decoding.slow_decode import decode_message
from imu_recording.bags.decoding.topic_columns import MessageBlock, TopicColumns
from imu_recording.logging_contract import IMU, TEMPERATURE, TRACKS
from recording_samples import START

TRACK_OF_TYPE = {track.message_type: track for track in TRACKS}


def block_of(message_type: str, n: int = 5, frame: str = 'imu_link') -> MessageBlock:
    rng = np.random.default_rng(3)
    layout = LAYOUTS[message_type]
    stamp = START + 10_000_000 * np.arange(n)
    groups = tuple(rng.normal(size=(n, group.count)) for group in layout.columns)
    records = encode_messages(message_type, stamp, frame, groups)
    size = records.shape[1]
    return MessageBlock(
        records.ravel(),
        size * np.arange(n),
        np.full(n, size),
        stamp + 7,
        np.zeros(n, np.int64),
        n,
    )


@pytest.mark.parametrize('message_type', LAYOUTS)
def test_kernels_give_what_rosbags_gives(message_type: str) -> None:
    block = block_of(message_type)
    columns = TopicColumns(TRACK_OF_TYPE[message_type], '/topic')
    columns.take(block, 0)
    assert (columns.count, columns.slow) == (block.count, 0)
    stamp, groups = columns.hand_over()
    for row in range(block.count):
        found = decode_message(block.bytes_of(row), message_type, standard_types())
        slow_stamp, values, _ = found
        assert stamp[row] == (block.received[row] if slow_stamp is None else slow_stamp)
        for group, numbers in zip(groups, values, strict=True):
            assert tuple(group[row]) == numbers


def test_compiled_and_plain_python_agree(monkeypatch: pytest.MonkeyPatch) -> None:
    def columns() -> Any:
        taken = TopicColumns(TRACK_OF_TYPE[IMU], '/imu')
        taken.take(block_of(IMU), 0)
        return taken.hand_over()

    compiled_stamp, compiled = columns()
    for name in ('little32', 'little64', 'is_expected', 'header_stamp', 'copy_group'):
        monkeypatch.setattr(cdr_kernels, name, getattr(cdr_kernels, name).py_func)
    plain = cdr_kernels.decode_messages.py_func
    monkeypatch.setattr('imu_recording.bags.decoding.topic_columns.decode_messages', plain)
    stamp, groups = columns()
    assert np.array_equal(stamp, compiled_stamp)
    assert all(np.array_equal(a, b) for a, b in zip(groups, compiled, strict=True))


def test_another_frame_id_is_decoded_slowly_once() -> None:
    columns = TopicColumns(TRACK_OF_TYPE[TEMPERATURE], '/imu/temperature')
    columns.take(block_of(TEMPERATURE, frame='first'), 0)
    columns.take(block_of(TEMPERATURE, frame='second_frame'), 0)
    assert columns.count == 10
    assert columns.slow == 1
    assert columns.frames == {'first': 5, 'second_frame': 5}
