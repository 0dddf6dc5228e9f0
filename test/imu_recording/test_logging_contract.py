# SPDX-License-Identifier: Apache-2.0
"""The logging contract and the recording name the same tracks."""

from __future__ import annotations

from collections import Counter
from dataclasses import fields

from imu_recording.bags.decoding.cdr import LAYOUTS
from imu_recording.logging_contract import (
    CHANNEL_FIELDS,
    MEASURED_FIELDS,
    OPTIONAL_FIELDS,
    STRING,
    TRACKS,
)
from imu_recording.recording import SENSOR_FIELDS
from imu_recording.tables.mapping import UNITS

from imu_recording import ImuRecording

ARRAYS = {item.name: item for item in fields(ImuRecording) if 'Array' in str(item.type)}


def test_every_track_of_a_recording_comes_from_one_topic() -> None:
    filled = Counter(name for track in TRACKS for name in track.fields)
    assert set(filled) == set(ARRAYS) - {'stamp', 'temperature_stamp'}
    assert set(filled.values()) == {1}


def test_optional_tracks_are_those_without_which_there_is_a_recording() -> None:
    absent = {name for name, item in ARRAYS.items() if item.default is None}
    assert {*OPTIONAL_FIELDS, 'temperature_stamp'} == absent
    assert set(OPTIONAL_FIELDS) - set(CHANNEL_FIELDS) == {
        'phase',
        'cycle',
        'reference_orientation',
    }


def test_the_sensors_measure_what_is_not_held() -> None:
    assert set(MEASURED_FIELDS) == set(SENSOR_FIELDS.values())


def test_layouts_and_units_are_of_known_tracks() -> None:
    assert {track.message_type for track in TRACKS} - {STRING} == set(LAYOUTS)
    assert set(UNITS) < set(ARRAYS)
    assert set(CHANNEL_FIELDS) < set(UNITS)  # a CSV file may hold any of them
