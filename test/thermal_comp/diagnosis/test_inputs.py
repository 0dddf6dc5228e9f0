# SPDX-License-Identifier: Apache-2.0
"""Recordings are taken in one at a time, with the answer they have together."""

import gc
import weakref
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from thermal_comp.data.preparation import prepare
from thermal_comp.data.quality import check_quality
from thermal_comp.diagnosis.inputs import prepare_inputs

from imu_recording import ImuRecording

from ..campaign import run

PERIOD = 20.0


@pytest.fixture(scope='module')
def recordings() -> list[ImuRecording]:
    made = [run(up, seed=k, cycles=2) for k, up in enumerate(('+x', '+y', '+z'))]
    stuck = made[1].angular_velocity.copy()
    stuck[400:440] = stuck[400]
    foreign = made[2].magnetic_field * 1e6
    return [
        made[0],
        replace(made[1], angular_velocity=stuck),
        replace(made[2], magnetic_field=foreign),
    ]


def test_the_runs_are_those_of_the_whole_list(recordings: list[ImuRecording]) -> None:
    clean, defects = check_quality(recordings)
    wanted = prepare(clean, period=PERIOD)
    inputs = prepare_inputs(iter(recordings), period=PERIOD)
    assert [d.name for d in inputs.defects] == [d.name for d in defects]
    assert {d.name for d in defects} == {'stuck_value', 'unit_mismatch'}
    for found, whole in zip(inputs.runs, wanted, strict=True):
        assert found.name == whole.name
        for sensor, values in whole.measured.items():
            np.testing.assert_array_equal(found.measured[sensor], values)
        np.testing.assert_array_equal(
            found.conditions.magnetic_field, whole.conditions.magnetic_field
        )
    assert np.isnan(inputs.runs[2].measured['magnetometer']).all()


def test_runs_that_are_prepared_stand_where_nothing_is_defective(
    recordings: list[ImuRecording],
) -> None:
    prepared = prepare(recordings, period=PERIOD)
    mended = prepare_inputs(recordings, period=PERIOD, prepared=prepared).runs
    anew = prepare_inputs(recordings, period=PERIOD).runs
    for found, wanted in zip(mended, anew, strict=True):
        np.testing.assert_array_equal(found.measured['gyroscope'], wanted.measured['gyroscope'])
        np.testing.assert_array_equal(found.conditions.hard_iron, wanted.conditions.hard_iron)
    sound = prepare(recordings[:1], period=PERIOD)
    assert prepare_inputs(recordings[:1], period=PERIOD, prepared=sound).runs == sound


def test_recordings_that_are_read_when_needed_are_not_kept(
    recordings: list[ImuRecording],
) -> None:
    alive: list[weakref.ref[ImuRecording]] = []
    most = 0

    def reading() -> Iterator[ImuRecording]:
        nonlocal most
        for recording in (*recordings, *recordings):
            copy = replace(recording, run=f'{recording.run} {len(alive)}')
            gc.collect()
            most = max(most, sum(ref() is not None for ref in alive))
            alive.append(weakref.ref(copy))
            yield copy
            del copy

    assert len(prepare_inputs(reading(), period=PERIOD).runs) == 6
    assert most <= 2


def test_what_goes_wrong_while_reading_ahead_reaches_the_caller(
    recordings: list[ImuRecording],
) -> None:
    def reading() -> Iterator[ImuRecording]:
        yield recordings[0]
        raise ValueError('bag: cut short')

    with pytest.raises(ValueError, match='cut short'):
        prepare_inputs(reading())
