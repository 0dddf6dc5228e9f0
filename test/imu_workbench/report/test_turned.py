# SPDX-License-Identifier: Apache-2.0
"""A recording of a device that was turned in mid-file: the report has each part as a run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from imu_workbench.report.analysis import analyse_recordings
from imu_workbench.report.content import report_content
from imu_workbench.report.html.document import report_page

from imu_recording import ImuRecording

TURNED_AT_S = 1000.0
HALF_TURN = np.array([-1.0, -1.0, 1.0])
"""About z: of a device whose x axis was up, it is down afterwards."""


def turned(recording: ImuRecording) -> ImuRecording:
    later = recording.time >= TURNED_AT_S
    force, rate = recording.linear_acceleration.copy(), recording.angular_velocity.copy()
    gravity = np.median(force, axis=0)
    force[later] += gravity * HALF_TURN - gravity
    rate[np.flatnonzero(later)[0]] += [0.3, 0.2, -0.5]
    return replace(recording, linear_acceleration=force, angular_velocity=rate)


def test_each_part_has_its_figures_and_tables(run: Callable[..., ImuRecording]) -> None:
    whole = turned(run('dut1', 'x', cycles=2))
    analysis = analyse_recordings([whole], diagnosis=False)
    assert [part.recording.up_axis for part in analysis.runs] == ['+x', '-x']
    assert all(part.errors for part in analysis.runs)
    first, second = analysis.runs
    assert len(first.recording) + len(second.recording) <= len(whole)
    assert first.attitudes
    assert not second.attitudes  # the filters saw the whole of it
    page = report_page(report_content(analysis, commands=[], versions={}))
    assert f'{first.name} from 100' in page
