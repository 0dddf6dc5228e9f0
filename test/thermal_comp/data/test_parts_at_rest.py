# SPDX-License-Identifier: Apache-2.0
"""A device that is turned in mid-file: when is said, and each part at rest is a run of its own."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from thermal_comp.comparison.compare import compare_prepared
from thermal_comp.data.parts_at_rest import parts_at_rest
from thermal_comp.data.preparation import prepare
from thermal_comp.data.quality import check_quality
from thermal_comp.diagnosis.diagnose import diagnose
from thermal_comp.effects.bias_temperature import BiasTemperature
from thermal_comp.fitting.fit import fit

from imu_recording import ImuRecording

from ..campaign import FIELD, GRAVITY, SLOPES, run

ANGLE = np.radians(12.0)
TILT = np.array(
    [[np.cos(ANGLE), 0.0, np.sin(ANGLE)], [0.0, 1.0, 0.0], [-np.sin(ANGLE), 0.0, np.cos(ANGLE)]]
)
HALF_TURN = np.diag([1.0, -1.0, -1.0])
QUARTER_TURN = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


def turned(
    recording: ImuRecording, at: float, turn: np.ndarray, until: float = np.inf
) -> ImuRecording:
    """The recording of a device that is turned at a time [s], and back again."""
    later = (recording.time >= at) & (recording.time < until)
    force, field = recording.linear_acceleration.copy(), recording.magnetic_field.copy()
    force[later] += turn @ [0.0, 0.0, GRAVITY] - [0.0, 0.0, GRAVITY]
    field[later] += turn @ FIELD - FIELD
    rate = recording.angular_velocity.copy()
    rate[np.flatnonzero(later)[0]] += [0.3, 0.2, -0.5]
    return replace(
        recording, linear_acceleration=force, magnetic_field=field, angular_velocity=rate
    )


@pytest.mark.parametrize(
    ('turn', 'up'), [(TILT, '+z'), (HALF_TURN, '-z'), (QUARTER_TURN, '+z')], ids=str
)
def test_each_part_is_a_run_with_its_axis_up(turn: np.ndarray, up: str) -> None:
    still = run(cycles=2, seed=1, period=1.0)
    found = parts_at_rest(turned(still, 7000.0, turn))
    assert [part.up_axis for part in found.recordings] == ['+z', up]
    assert found.is_turned == (up != '+z')
    assert found.left_out <= 6
    first, second = found.recordings
    assert second.run == f'{first.run} from {second.time[_known(second)][0]:.0f} s'
    assert abs(second.time[_known(second)][0] - 7000.0) <= 3.0
    assert not (_known(first) & _known(second)).any()
    np.testing.assert_array_equal(second.temperature, still.temperature)
    for part in found.recordings:
        assert parts_at_rest(part).recordings == [part]


def _known(recording: ImuRecording) -> np.ndarray:
    return np.isfinite(recording.linear_acceleration).all(axis=1)


def test_what_is_too_short_is_left_out_and_counted() -> None:
    still = run(cycles=2, seed=1, period=1.0)
    found = parts_at_rest(turned(still, 7000.0, HALF_TURN, until=7300.0))
    assert len(found.recordings) == 2
    assert 295 <= found.left_out <= 315
    assert not found.is_turned


def test_bursts_and_slow_sampling_warm_up_without_being_turned() -> None:
    still = run(cycles=2, seed=1, period=1.0)
    warm = still.linear_acceleration + 0.05 * (still.temperature - 20.0)[:, None]
    steep = replace(still, linear_acceleration=warm)
    for rows in (np.flatnonzero(still.time % 3600.0 < 20.0), slice(None, None, 30)):
        assert not parts_at_rest(steep.rows(rows)).text


def test_a_step_of_the_sensor_is_no_turn() -> None:
    still = run(cycles=2, seed=1, period=1.0)
    force = still.linear_acceleration.copy()
    force[still.time >= 7000.0, 2] += 1.0
    assert not parts_at_rest(replace(still, linear_acceleration=force)).text


def test_data_whose_axes_were_changed_are_no_turn() -> None:
    still = run(cycles=2, seed=1, period=1.0)
    force = still.linear_acceleration.copy()
    force[still.time >= 12000.0] *= [1.0, -1.0, -1.0]
    found = parts_at_rest(replace(still, linear_acceleration=force))
    assert len(found.recordings) == 1
    assert found.left_out == (still.time >= 11997.0).sum()
    assert 'axes or signs had been changed' in found.text


@pytest.mark.parametrize(
    ('turn', 'name'),
    [
        pytest.param(HALF_TURN, 'orientation_flip', id='half'),
        pytest.param(TILT, 'moved', id='tilt', marks=pytest.mark.long),
    ],
)
def test_a_turn_hides_no_slope_and_adds_no_effect(turn: np.ndarray, name: str) -> None:
    still = run(cycles=3, seed=4)
    moved = turned(still, still.time[-1] / 2.0, turn)
    model = fit([BiasTemperature()], [moved])
    for sensor, track in (
        ('accelerometer', 'linear_acceleration'),
        ('magnetometer', 'magnetic_field'),
    ):
        found, true = model.sensors[sensor], SLOPES[track]
        std = np.sqrt(np.diag(found.covariance))
        assert (np.abs(found.coefficients[0][0] - true) < 4.0 * std).all()
    diagnosis = diagnose([moved])
    assert [finding.name for finding in diagnosis.findings] == [name]
    assert {state.verdict for state in diagnosis.sensors.values()} == {'complete'}
    clean, findings = check_quality([moved])
    assert len(clean) == 2
    assert 'moved at' in findings[0].text
    comparison = compare_prepared(model, prepare([moved]))
    assert any('2 parts are runs of their own' in note for note in comparison.notes)
    for sensor in comparison.sensors.values():
        assert (sensor.held_out_rms < 1.2 * sensor.noise_floor).all()


def test_a_device_that_stands_askew_keeps_the_axis_that_was_stated() -> None:
    still = run(cycles=2, seed=1, period=1.0)
    askew = turned(still, -1.0, TILT @ TILT @ TILT, until=7000.0)
    found = parts_at_rest(turned(askew, 7000.0, TILT @ TILT @ TILT @ TILT))
    assert [part.up_axis for part in found.recordings] == ['+z', '+z']
