# SPDX-License-Identifier: Apache-2.0
"""Conditions of a start, and the faults that take a run to the safe state."""

from dataclasses import replace

import pytest
from chamber_profile.profile.file import load_profile
from chamber_profile.profile.unroll import closed_steps
from chamber_profile.profile.values import Stabilisation
from chamber_profile.run.supervision import check_problems, trip_reason
from chamber_profile.run.values import Readings

PROFILE = load_profile('short_20min')  # air 10 … 35 °C, device -40 … 85 °C
STEPS = closed_steps(PROFILE)
GOOD = Readings(0.0, air=23.0, device=23.0, setpoint=23.0, running=False, disk_free=2.0**40)

FAULTS = [
    ({'alarms': ('4', '19')}, 'alarm 4'),
    ({'device': 90.0}, 'device'),
    ({'imu_alive': False}, 'IMU'),
    ({'disk_free': 2.0**29}, '0.50 GiB of disk left, 1 GiB needed'),
    ({'fault': 'recorder: disk full'}, 'recorder: disk full'),
]


def test_without_faults_nothing_prevents_a_start_or_ends_a_run() -> None:
    assert check_problems(PROFILE, STEPS, GOOD) == []
    assert trip_reason(PROFILE, GOOD, waiting=False) == ''


@pytest.mark.parametrize(('change', 'words'), [*FAULTS, ({'air': 36.5}, 'air')])
def test_each_fault_prevents_a_start_and_ends_a_run(change: dict, words: str) -> None:
    faulty = replace(GOOD, **change)
    assert any(words in problem for problem in check_problems(PROFILE, STEPS, faulty))
    assert words in trip_reason(PROFILE, faulty, waiting=False)


def test_all_problems_of_a_start_are_named_at_once() -> None:
    faulty = replace(GOOD, **{key: value for change, _ in FAULTS for key, value in change.items()})
    assert len(check_problems(PROFILE, STEPS, faulty)) == len(FAULTS) + 1  # two alarms


def test_the_air_may_overshoot_by_a_kelvin_during_a_run() -> None:
    assert trip_reason(PROFILE, replace(GOOD, air=35.9), waiting=False) == ''
    assert check_problems(PROFILE, STEPS, replace(GOOD, air=35.9))


def test_a_silent_imu_is_no_fault_while_an_operator_turns_the_devices() -> None:
    silent = replace(GOOD, imu_alive=False)
    assert trip_reason(PROFILE, silent, waiting=True) == ''
    full = replace(silent, disk_free=0.0)
    assert 'GiB' in trip_reason(PROFILE, full, waiting=True)


def test_a_profile_that_needs_the_device_temperature_does_not_start_without() -> None:
    steps = [replace(STEPS[0], stabilise=Stabilisation(source='device'))]
    (problem,) = check_problems(PROFILE, steps, replace(GOOD, device=None))
    assert problem == 'the profile needs the device temperature, and no sensor reports it'


def test_a_chamber_that_does_not_answer_does_not_start() -> None:
    for lost in (replace(GOOD, link='failing'), replace(GOOD, air=None)):
        assert check_problems(PROFILE, STEPS, lost)[0] == 'the chamber does not answer'
