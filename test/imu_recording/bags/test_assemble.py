# SPDX-License-Identifier: Apache-2.0
"""Topics joined to one recording: what is absent, broken or told twice is said in a note."""

from __future__ import annotations

import numpy as np
import pytest
from imu_recording.bags.assemble import assemble_recording
from imu_recording.bags.decoding.topic_columns import TopicColumns
from imu_recording.logging_contract import TRACK_OF_TOPIC
from imu_recording.recording import BagError, ImuRecording

START = 1_700_000_000_000_000_000
STEP = 10_000_000
UP = [0.0, 0.0, 9.8]


def topic(name: str) -> TopicColumns:
    return TopicColumns(TRACK_OF_TOPIC[name], f'/{name}')


def imu(count: int = 50, *, unit: int = 1, rate: float = 0.1) -> TopicColumns:
    """Samples of a board at rest; stamps count in `unit` ns."""
    columns = topic('imu/data_raw')
    for k in range(count):
        received = START + k * STEP
        columns.append(received // unit, ([rate, 0.0, 0.0], UP), 'imu_link', received)
    return columns


def assembled(*columns: TopicColumns, **metadata: str) -> ImuRecording:
    topics = {column.topic: column for column in columns}
    return assemble_recording(topics, metadata, '/dut7', 'bag', [])


def test_what_no_topic_told_is_nan_and_said() -> None:
    recording = assembled(imu(), run='a\nb')
    assert np.isnan(recording.magnetic_field).all()
    assert np.isnan(recording.temperature).all()
    assert 'no samples on imu/mag: magnetic_field is NaN' in recording.notes
    assert 'up_axis +z is inferred from gravity' in recording.notes
    assert (recording.device, recording.run, recording.up_axis) == ('dut7', 'a b', '+z')


def test_the_axis_of_the_metadata_holds_and_gravity_may_object() -> None:
    recording = assembled(imu(), up_axis='-x')
    assert recording.up_axis == '-x'
    assert 'up_axis is -x in the metadata, gravity says +z' in recording.notes


@pytest.mark.parametrize('unit', [1000, 1_000_000])
def test_stamps_in_another_unit_are_refused(unit: int) -> None:
    with pytest.raises(BagError, match=rf'^bag: the stamps of .* advance {unit} times slower'):
        assembled(imu(unit=unit))


def test_an_unknown_phase_and_a_value_that_is_infinite_are_counted() -> None:
    phase, heater = topic('chamber/phase'), topic('chamber/heater')
    for k, text in enumerate(['ramp_up 2', 'lunch']):
        phase.append(None, [], text, START + 10 * k * STEP)
        heater.append(None, [[np.inf if k else 0.5]], '', START + 10 * k * STEP)
    recording = assembled(imu(), phase, heater)
    assert recording.phase[[0, 9, 10]].tolist() == [3, 3, -1]
    assert recording.cycle[0] == 2
    assert recording.heater[0] == 0.5
    assert "chamber/phase: 'lunch' is no phase; such rows are −1" in recording.notes
    assert any('chamber/heater: 1 of 2 samples are NaN or infinite' in n for n in recording.notes)
