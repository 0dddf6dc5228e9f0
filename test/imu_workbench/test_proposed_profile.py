# SPDX-License-Identifier: Apache-2.0
"""A proposed experiment is a profile that the chamber package accepts, and its timetable."""

from __future__ import annotations

import pytest
from chamber_profile.profile.file import profile_from_content
from chamber_profile.profile.timetable import timetable
from imu_workbench.profile_timetable import clock, timetable_content, timetable_text
from imu_workbench.proposed_profile import profile_content
from thermal_comp.experiment.design import ChamberLimits, Proposal
from thermal_comp.experiment.plan import FINAL_S, PRECONDITION_S, REFERENCE_C, Plan, Segment

LIMITS = ChamberLimits(-5.0, 45.0, 2.0, 12.0)
PLAN = Plan((Segment(40.0, 2.0, 1200.0), Segment(0.0, 1.0, 600.0)), 3)


@pytest.fixture
def content():
    proposal = Proposal(PLAN, 'gyroscope', 3.0, 40.0, separable=True, actions=())
    profile = profile_from_content(profile_content(proposal, ('one', 'other'), LIMITS))
    return timetable_content(profile, timetable(profile))


def test_the_profile_runs_the_plan(content) -> None:
    assert content['profile'] == 'one_or_other'
    assert content['cycles'] == PLAN.repeats
    assert (content['lowest_c'], content['highest_c']) == (0.0, 40.0)
    dwells = [s['dwell_s'] for s in content['steps'] if s['id'].startswith('dwell')]
    assert dwells == [1200.0, 600.0] * PLAN.repeats
    fastest = max(abs(step['rate_c_per_min']) for step in content['steps'])
    assert fastest <= LIMITS.max_rate


def test_its_length_is_that_of_the_plan(content) -> None:
    first = (40.0 - REFERENCE_C) / 2.0 * 60.0
    later = 40.0 / 2.0 * 60.0
    cycles = PLAN.repeats * (1200.0 + 40.0 / 1.0 * 60.0 + 600.0) + first + 2 * later
    back = REFERENCE_C / LIMITS.max_rate * 60.0
    assert content['duration_s'] == pytest.approx(PRECONDITION_S + cycles + back + FINAL_S)


def test_the_text_has_a_line_per_step(content) -> None:
    lines = timetable_text(content).splitlines()
    assert len(lines) == 2 + len(content['steps']) + 2
    assert clock(content['duration_s']) in lines[-2]
