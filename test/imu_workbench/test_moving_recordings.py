# SPDX-License-Identifier: Apache-2.0
"""Recordings of a device that moves are left out of reports and refused by verbs."""

from dataclasses import replace

import numpy as np
import pytest
from imu_workbench.__main__ import main
from imu_workbench.report.analysis import analyse_recordings
from imu_workbench.report.content import report_content
from imu_workbench.report.html.document import report_page, report_text
from thermal_comp.data.motion import MovingError


def content_of(recordings):
    analysis = analyse_recordings(recordings, attitudes=False, diagnosis=False)
    return report_content(analysis, commands=['report'], versions={})


def moved(recording):
    """The recording of a device that is tilted to and fro."""
    swing = np.radians(40.0) * np.sin(2 * np.pi * recording.time / 30.0)
    turned = recording.linear_acceleration.copy()
    turned[:, 0] += 9.81 * np.sin(swing)
    turned[:, 2] += 9.81 * (np.cos(swing) - 1.0)
    return replace(recording, linear_acceleration=turned, run='carried')


def test_what_moves_is_left_out_with_one_message(run) -> None:
    still = run(cycles=2)
    content = content_of([still, moved(still)])
    assert list(content['fits']) == [still.run]
    assert len(content['left_out']) == 1
    for said in (report_text(content), report_page(content)):
        assert said.count('carried is left out: the device moves in') == 1
    with pytest.raises(MovingError, match='carried is left out'):
        content_of([moved(still)])


def test_the_commands_refuse_in_one_sentence(bags, tmp_path, capsys) -> None:
    for verb in (['fit', '-o', str(tmp_path / 'm.yaml')], ['diagnose'], ['compare']):
        assert main([verb[0], str(bags / 'dut1_motion'), *verb[1:]]) == 2
        told = capsys.readouterr().err
        assert told.count('\n') == 1
        assert 'the device moves in 37% of the time' in told
        assert 'spike' not in told
    assert not (tmp_path / 'm.yaml').exists()
