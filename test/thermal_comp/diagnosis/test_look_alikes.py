# SPDX-License-Identifier: Apache-2.0
"""Effects that look alike are told apart by what only one of them does."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from thermal_comp.diagnosis.diagnose import diagnose
from thermal_comp.diagnosis.result import Diagnosis, Finding
from thermal_comp.effects import EFFECTS

from imu_recording import ImuRecording

from ..campaign import FIELD, GRAVITY, PERIOD, chamber, lagging, measured_by, run

UP = ('+x', '+y', '+z')
HEAT = ('thermal_lag', 'thermal_lag_two_stage', 'temperature_rate', 'thermal_hysteresis')
TURNS = ('scale_factor_temperature', 'misalignment_temperature', 'fixture_tilt')


def diagnosed(recordings: Sequence[ImuRecording], names: Sequence[str]) -> Diagnosis:
    """Return the diagnosis by a part of the catalogue."""
    return diagnose(recordings, catalogue={name: EFFECTS[name] for name in names})


def findings(recordings: Sequence[ImuRecording], names: Sequence[str]) -> list[Finding]:
    """Return what is found of a part of the catalogue."""
    return effects_in(diagnosed(recordings, names))


def effects_in(diagnosis: Diagnosis) -> list[Finding]:
    return [f for f in diagnosis.findings if f.kind == 'effect']


def in_gyroscope(process: np.ndarray) -> list[ImuRecording]:
    """Return two runs of a gyroscope that feels a process (n,), differently on its axes."""
    error = np.multiply.outer(process, np.array([1.0, -0.6, 0.8]))
    runs = [run(up, seed=k, error={'angular_velocity': error}) for k, up in enumerate(UP[:2])]
    return measured_by(runs, 'gyroscope')


@pytest.mark.long
def test_a_lag_is_no_rate_and_no_pair_of_lags() -> None:
    die = chamber()[1]
    (found,) = findings(in_gyroscope(2e-4 * (lagging(die, 90.0, PERIOD) - die)), HEAT)
    assert found.name == 'thermal_lag'
    assert 'temperature_rate' not in found.ambiguous_with
    fitted = found.parameters['time_constant']
    assert fitted['value'] == pytest.approx(90.0, abs=4.0 * fitted['std'])


@pytest.mark.long
def test_a_rate_is_no_short_lag_but_may_be_a_gradient_nobody_logged() -> None:
    time, die, *_ = chamber()
    names = (*HEAT, 'thermal_gradient')
    (found,) = findings(in_gyroscope(2e-2 * np.gradient(die, time)), names)
    assert found.name == 'temperature_rate'
    assert found.ambiguous_with == ('thermal_gradient',)


@pytest.mark.long
def test_a_gradient_inside_the_device_is_told_by_the_thermometer_on_it() -> None:
    time, die, *_ = chamber()
    warmth = -0.8 * np.expm1(-time / 400.0)  # self-heating, after a power-on at the start
    board = die + 12.0 * np.gradient(die, time) - warmth
    air = board + 150.0 * np.gradient(board, time)
    recordings = [
        replace(one, device_temperature=board, chamber_temperature=air)
        for one in in_gyroscope(1e-3 * (board - die))
    ]
    (found,) = findings(recordings, (*HEAT, 'thermal_gradient', 'warm_up'))
    assert found.name == 'thermal_gradient'
    assert found.parameters['outside']['value'] == 1.0


@pytest.mark.long
def test_a_gradient_inside_the_device_is_told_by_the_die_where_no_thermometer_shows_it() -> None:
    # What lags as much as the die itself shows neither the board's rate nor how the die warms it.
    time, die, *_ = chamber()
    warmth = -0.8 * np.expm1(-time / 300.0)
    board = die + 12.0 * np.gradient(die, time) - warmth
    air = board + 150.0 * np.gradient(board, time)
    read = 0.05 * np.round(lagging(board, 15.0, PERIOD) / 0.05)
    recordings = [
        replace(one, device_temperature=read, chamber_temperature=air)
        for one in in_gyroscope(1e-3 * (board - die))
    ]
    (found,) = findings(recordings, (*HEAT, 'thermal_gradient', 'warm_up'))
    assert found.name == 'thermal_gradient'
    assert found.parameters['outside']['value'] == 3.0


@pytest.mark.long
def test_two_lags_far_apart_are_two() -> None:
    die = chamber()[1]
    fast, slow = lagging(die, 60.0, PERIOD) - die, lagging(die, 1500.0, PERIOD) - die
    (found,) = findings(in_gyroscope(4e-4 * fast + 1e-4 * slow), HEAT)
    assert found.name == 'thermal_lag_two_stage'


@pytest.mark.long
def test_a_step_between_the_times_tried_is_found_where_it_is() -> None:
    time = chamber()[0]
    recordings = [run(up, seed=k) for k, up in enumerate(UP)]
    slip = 6e-4 * (time >= 19_730.0)[:, None] * np.array([1.0, -1.0, 0.7])
    recordings[1] = run('+y', seed=1, error={'angular_velocity': slip})
    timed = ('bias_step', 'bias_drift', 'bias_creep', 'warm_up')
    (found,) = findings(measured_by(recordings, 'gyroscope'), timed)
    assert (found.name, found.sensor) == ('bias_step', 'gyroscope')
    assert found.parameters['step_time']['value'] == pytest.approx([19_730.0], abs=60.0)


def turned(rate: float, *, field_too: bool, magnet: float = 0.0) -> list[ImuRecording]:
    """Return runs on a bracket that turns about two chamber axes by rate [rad/K] of heat each.

    `magnet`: a field that stands in the chamber grows by this [T/K], across and along its own.
    """
    warmth = chamber()[1] - 20.0
    recordings = []
    for k, up in enumerate(UP):
        pose = np.roll(np.eye(3), k + 1, axis=0)
        turn = pose @ np.array([1.0, -1.0, 0.0])
        gravity, field = pose @ np.array([0.0, 0.0, GRAVITY]), pose @ FIELD
        error = {'linear_acceleration': rate * np.multiply.outer(warmth, np.cross(turn, gravity))}
        if field_too:
            change = rate * np.cross(turn, field) + magnet * pose @ np.array([0.6, -0.5, -0.6])
            error['magnetic_field'] = np.multiply.outer(warmth, change)
        recordings.append(run(up, seed=k, error=error))
    return measured_by(recordings, 'accelerometer', 'magnetometer')


@pytest.fixture(scope='module')
def tilted() -> Diagnosis:
    return diagnosed(turned(1e-4, field_too=True), TURNS)


@pytest.mark.long
def test_the_magnetometer_tells_a_tilt_from_a_scale_factor(tilted: Diagnosis) -> None:
    (tilt,) = effects_in(tilted)
    assert (tilt.name, tilt.sensor) == ('fixture_tilt', 'accelerometer+magnetometer')
    (scale,) = findings(turned(1e-4, field_too=False), TURNS)
    assert (scale.name, scale.sensor) == ('scale_factor_temperature', 'accelerometer')
    assert scale.ambiguous_with == ()


@pytest.mark.long
def test_a_tilt_stands_among_the_explanations_of_every_sensor_that_it_turns(
    tilted: Diagnosis,
) -> None:
    for sensor in ('accelerometer', 'magnetometer'):
        own = [one for one in tilted.explanations if one.sensor == sensor]
        assert own[0].names == ('fixture_tilt',)
        assert own[0].probability > 0.9
        assert sum(one.probability for one in own) < 1.0 + 1e-9


@pytest.mark.long
def test_a_tilt_keeps_its_name_beside_a_field_that_grows_in_the_chamber() -> None:
    names = (*TURNS, 'fixture_hard_iron')
    found = findings(turned(1e-4, field_too=True, magnet=3e-8), names)
    assert ('fixture_tilt', 'accelerometer+magnetometer') in {(f.name, f.sensor) for f in found}
    assert 'misalignment_temperature' not in {f.name for f in found}
