# SPDX-License-Identifier: Apache-2.0
"""What a certificate says of its recordings: plan, loss, gaps, an unset clock."""

from dataclasses import replace

import numpy as np
import pytest
from imu_workbench.report.certificate.recordings import conditions, losses, recording_row
from imu_workbench.report.html.document import report_page

from .certificates import content_of


def test_a_plan_without_a_name_is_that_of_the_set_points(run) -> None:
    named = run('dut1', 'z', cycles=3)
    bare = replace(named, profile='')
    assert conditions([named], 0.0, 1.0)['plan'] == 'short_plan'
    assert conditions([bare], 0.0, 1.0)['plan'] == 'set-points as recorded'
    assert conditions([replace(bare, setpoint=None)], 0.0, 1.0)['plan'] == 'not stated'


@pytest.mark.long
def test_loss_and_damage_stand_on_the_first_page(analysis) -> None:
    def page_of(*notes: str) -> str:
        first, *others = analysis.runs
        runs = (replace(first, recording=first.recording.with_notes(*notes)), *others)
        return report_page(content_of(replace(analysis, runs=runs))).partition('6 Result')[0]

    closed = 'metadata.yaml is missing: the recording was not closed'
    said = page_of(closed, 'up_axis +x is inferred from gravity')
    assert f'{closed} (dut1_x).' in said
    assert 'inferred' not in said
    assert 'Loss and damage' not in page_of()
    many = page_of(*(f'imu/{k}: {k} damaged messages left out' for k in range(1, 7)))
    assert 'imu/4: 4 damaged messages left out (dut1_x); 2 more in the annex.' in many


def test_gaps_of_a_recording_are_told(analysis) -> None:
    whole = analysis.runs[0].recording
    assert losses([whole]) == []
    cut = whole.rows(np.r_[0:1000, 1100 : len(whole)])
    assert losses([cut]) == ['1 gap, 100 s in all (dut1_x)']


def test_a_clock_that_was_not_set_is_told(run) -> None:
    late = run('dut1', 'z', cycles=3)
    early = replace(late, stamp=late.stamp - late.stamp[0] + 10**17)
    assert recording_row(early, '')['start'] == '1973-03-03 09:46, clock not set'
    assert 'clock' not in recording_row(late, '')['start']
