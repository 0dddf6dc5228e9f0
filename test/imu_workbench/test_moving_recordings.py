# SPDX-License-Identifier: Apache-2.0
"""A device that moves is told from one at rest; nothing is said of its temperature error."""

from dataclasses import replace

import numpy as np
import pytest
from imu_workbench.__main__ import main
from imu_workbench.report.analysis import analyse_recordings
from imu_workbench.report.content import report_content
from imu_workbench.report.html.document import report_page, report_text
from thermal_comp.data.motion import MovingError, motion_of


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


def test_a_device_turned_level_moves(run) -> None:
    still = run(cycles=1)
    heading = np.radians(60.0) * np.sin(2 * np.pi * still.time / 60.0)
    rate = np.gradient(heading, still.time)
    field = still.magnetic_field.copy()
    field[:, 0] = 2e-5 * np.cos(heading)
    field[:, 1] = 2e-5 * np.sin(heading)
    velocity = still.angular_velocity + rate[:, None] * [0.0, 0.0, 1.0]
    turning = replace(still, magnetic_field=field, angular_velocity=velocity)
    assert motion_of(turning).startswith('the device moves in ')


def test_a_device_at_rest_does_not_move_whatever_its_data_suffer(run) -> None:
    still = run(cycles=2)
    in_degrees = np.degrees(still.angular_velocity)
    rng = np.random.default_rng(5)
    spiky = still.linear_acceleration.copy()
    spiky[rng.integers(0, len(still), 20)] = 30.0
    turned_once = still.linear_acceleration.copy()
    turned_once[len(still) // 2 :] = np.roll(turned_once[len(still) // 2 :], 1, axis=1)
    glitches = still.linear_acceleration.copy()
    glitches[rng.random(len(still)) < 0.08] += 15.0
    switched = still.magnetic_field + 2e-5 * (still.time[:, None] % 40.0 < 12.0)
    for values in (
        {'magnetic_field': switched},
        {'linear_acceleration': glitches},
        {'angular_velocity': in_degrees},
        {'linear_acceleration': still.linear_acceleration / 9.81},
        {'linear_acceleration': spiky},
        {'linear_acceleration': turned_once},
        {'magnetic_field': np.full((len(still), 3), np.nan)},
    ):
        assert motion_of(replace(still, **values)) == '', list(values)
