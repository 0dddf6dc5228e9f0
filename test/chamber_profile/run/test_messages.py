# SPDX-License-Identifier: Apache-2.0
"""The time that a run reports as left agrees with the ideal timetable at every step and stage."""

import pytest
from chamber_profile.profile.file import load_profile
from chamber_profile.profile.timetable import timetable
from chamber_profile.profile.unroll import closed_steps
from chamber_profile.profile.values import Step
from chamber_profile.run.messages import time_left
from chamber_profile.run.values import CONFIRM, DONE, DWELL, MOVE, RUN, STOP, Progress

PROFILE = load_profile('short_20min')
STEPS = closed_steps(PROFILE)
ENTRIES = timetable(PROFILE)


@pytest.mark.parametrize('number', range(len(STEPS)))
def test_a_dwell_and_all_that_follows_is_left(number: int) -> None:
    step, entry = STEPS[number], ENTRIES[number]
    dwelt = step.dwell_s / 4
    _, run_s = time_left(STEPS, Progress(RUN, number, DWELL, step.target_c), dwelt)
    assert run_s == pytest.approx(ENTRIES[-1].end_s - (entry.end_s - entry.dwell_s + dwelt))


@pytest.mark.parametrize('number', range(len(STEPS)))
def test_half_way_to_a_target_half_of_the_way_is_left(number: int) -> None:
    entry = ENTRIES[number]
    setpoint = (entry.from_c + entry.to_c) / 2
    _, run_s = time_left(STEPS, Progress(RUN, number, MOVE, setpoint), 0.0)
    assert run_s == pytest.approx(ENTRIES[-1].end_s - entry.start_s - entry.move_s / 2)


def test_the_phase_ends_where_the_next_begins() -> None:
    first = ENTRIES[0]
    other = next(e for e in ENTRIES if (e.phase, e.cycle) != (first.phase, first.cycle))
    phase_s, _ = time_left(STEPS, Progress(RUN, 0, MOVE, first.from_c), 0.0)
    assert phase_s == pytest.approx(other.start_s)


@pytest.mark.parametrize('progress', [Progress(RUN, 0, STOP), Progress(DONE, len(STEPS) - 1)])
def test_nothing_is_left_of_a_run_that_is_over(progress: Progress) -> None:
    assert time_left(STEPS, progress, 0.0) == (0.0, 0.0)


def test_a_dwell_that_was_overstayed_leaves_nothing_negative() -> None:
    last = len(STEPS) - 1
    progress = Progress(RUN, last, DWELL, STEPS[last].target_c)
    assert time_left(STEPS, progress, 1e6) == (0.0, 0.0)


def test_an_operator_is_expected_to_take_his_time() -> None:
    step = Step('turn', 'operator', 20.0, 1.0, expected_s=300.0)
    progress = Progress(RUN, 0, CONFIRM, 20.0)
    assert time_left([step], progress, 0.0) == (300.0, 300.0)
