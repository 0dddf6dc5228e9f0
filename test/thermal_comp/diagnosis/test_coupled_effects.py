# SPDX-License-Identifier: Apache-2.0
"""A coupled effect is told by all sensors that feel it, beside what else each of them lacks."""

from dataclasses import replace

import numpy as np
import pytest
from thermal_comp.data.preparation import prepare
from thermal_comp.diagnosis.coupled_effects import weighed_by_all, with_effect
from thermal_comp.diagnosis.sensor_answer import UNNAMED_CAUSES, SensorAnswer
from thermal_comp.diagnosis.sensor_search import SensorSearches, Settings, search_sensors
from thermal_comp.effects import EFFECTS
from thermal_comp.effects.bias_temperature import BiasTemperature
from thermal_comp.effects.fixture_tilt import FixtureTilt
from thermal_comp.linear.candidate_design import ColumnSource
from thermal_comp.noise.of_runs import determined_noise

from ..campaign import FIELD, GRAVITY, PERIOD, chamber, lagging, run

UP = ('+x', '+y', '+z')
SENSORS = ('accelerometer', 'magnetometer')
"""Those that feel a tilt; the first of them looks for it."""


@pytest.fixture(scope='module')
def answers() -> list[SensorAnswer]:
    """Return what is said of an accelerometer that warms up and a field that grows with heat."""
    time, die, *_ = chamber()
    warming = np.multiply.outer(np.exp(-time / 700.0), [-1.3e-2, 1.0e-2, 0.7e-2])
    poses = [np.roll(np.eye(3), k + 1, axis=0) for k in range(len(UP))]
    field = [np.multiply.outer(die - 20.0, pose @ [6e-8, -4e-8, 0.0]) for pose in poses]
    runs = prepare([
        run(up, seed=k, error={'linear_acceleration': warming, 'magnetic_field': field[k]})
        for k, up in enumerate(UP)
    ])  # fmt: skip
    base = {sensor: (BiasTemperature(),) for sensor in SENSORS}
    names = ('warm_up', 'fixture_hard_iron', 'fixture_tilt')
    noise = determined_noise(runs, base)[0]
    found = search_sensors(runs, base, noise, Settings({name: EFFECTS[name] for name in names}))
    return [found[sensor] for sensor in SENSORS]


def test_what_turns_with_the_field_alone_is_no_tilt(answers: list[SensorAnswer]) -> None:
    accelerometer, magnetometer = answers
    assert accelerometer.likeliest.names == ('warm_up',)
    assert magnetometer.likeliest.names == ('fixture_hard_iron',)
    assert accelerometer.probability_of('fixture_tilt') < 0.05


def test_others_that_know_it_by_another_name_do_not_speak_for_it(
    answers: list[SensorAnswer],
) -> None:
    before = {some.names: some.log_posterior for some in with_effect('fixture_tilt', answers[0])}
    for some in weighed_by_all(FixtureTilt(), answers):
        if 'fixture_tilt' in some.names:
            assert some.log_posterior < before[some.names] + 1.0


def test_what_another_sensor_has_is_not_left_to_it_once_it_is_called_a_flaw(
    answers: list[SensorAnswer],
) -> None:
    """Whatever explanations say, a tilt is fitted to nothing that a set of effects explains."""
    accelerometer, magnetometer = answers
    silent = tuple(
        replace(e, probability=1.0 if e.names == () else 0.0) for e in magnetometer.explanations
    )
    weighed = [
        {s.names: s.log_posterior for s in weighed_by_all(FixtureTilt(), [accelerometer, other])}
        for other in (magnetometer, replace(magnetometer, explanations=silent))
    ]
    assert magnetometer.sets[0].names == ('fixture_hard_iron',)
    assert weighed[0] == weighed[1]


@pytest.mark.long
def test_a_sensor_whose_error_has_no_name_does_not_speak_for_it() -> None:
    """It feels the tilt, too, so that it would."""
    time, die = chamber()[:2]
    switched = np.multiply.outer(np.sign(np.sin(time / 900.0)), [1e-6, -2e-6, 1e-6])
    turned = np.array([3e-4, -2.2e-4, 0.8e-4])
    vertical = np.array([0.0, 0.0, GRAVITY])
    recordings = []
    for k, up in enumerate(UP):
        pose = np.roll(np.eye(3), k + 1, axis=0)
        force, field = (
            np.multiply.outer(die - 20.0, pose @ np.cross(turned, felt))
            for felt in (vertical, FIELD)
        )
        error = {'linear_acceleration': force, 'magnetic_field': field + switched}
        recordings.append(run(up, seed=k, error=error))
    runs = prepare(recordings)
    base = {sensor: (BiasTemperature(),) for sensor in SENSORS}
    settings = Settings({'fixture_tilt': EFFECTS['fixture_tilt']})
    searches = SensorSearches(ColumnSource(runs), base, determined_noise(runs, base)[0], settings)
    alone = [searches.of_sensor(sensor) for sensor in SENSORS]
    assert alone[1].kind in UNNAMED_CAUSES
    before = {some.names: some.log_posterior for some in alone[0].sets}
    for some in weighed_by_all(FixtureTilt(), alone):
        assert some.log_posterior <= before[some.names] + 0.1


@pytest.mark.long
def test_what_a_misalignment_hides_in_one_sensor_another_sees() -> None:
    """In three poses it does all that a tilt does to gravity; a tilted field is like another."""
    warmth = chamber()[1] - 20.0
    turned = np.array([1.5e-4, -1.1e-4, 0.4e-4])
    runs = []
    for k, up in enumerate(UP):
        pose = np.roll(np.eye(3), k + 1, axis=0)
        crossed = np.array([[0.0, 5e-4, -2e-4], [-3e-4, 0.0, 6e-4], [4e-4, -5e-4, 0.0]])
        vertical = np.array([0.0, 0.0, GRAVITY])
        force = pose @ np.cross(turned, vertical) + crossed @ pose @ vertical
        field = pose @ np.cross(turned, FIELD)
        error = {'linear_acceleration': force, 'magnetic_field': field}
        felt = {name: np.multiply.outer(warmth, each) for name, each in error.items()}
        runs.append(run(up, seed=k, error=felt))
    prepared = prepare(runs)
    base = {sensor: (BiasTemperature(),) for sensor in SENSORS}
    names = ('misalignment_temperature', 'fixture_hard_iron', 'fixture_tilt')
    settings = Settings({name: EFFECTS[name] for name in names})
    found = search_sensors(prepared, base, determined_noise(prepared, base)[0], settings)
    accelerometer, magnetometer = (found[sensor] for sensor in SENSORS)
    assert accelerometer.probability_of('misalignment_temperature') > 0.95
    assert accelerometer.probability_of('fixture_tilt') > 0.3
    assert magnetometer.with_coupled[0].names == ('fixture_tilt',)


def test_it_is_looked_for_beside_what_the_first_sensor_lacks(answers: list[SensorAnswer]) -> None:
    sets = with_effect('fixture_tilt', answers[0])
    assert ('fixture_tilt', 'warm_up') in {some.names for some in sets}
    assert all('fixture_tilt' in some.names for some in sets)


def test_what_a_rate_makes_of_its_thermometer_speaks_for_no_tilt() -> None:
    """What a rate gains by its thermometer's lag counted again beside a tilt."""
    die = chamber(1)[1]
    rate = np.gradient(die, PERIOD)
    felt = np.multiply.outer(rate, [9e-5, -5e-5, 7e-5])
    shown = lagging(die, 25.0, PERIOD)
    runs = prepare([
        replace(run(up, seed=k, cycles=1, error={'magnetic_field': felt}), temperature=shown)
        for k, up in enumerate(UP[:2])
    ])  # fmt: skip
    base = {sensor: (BiasTemperature(),) for sensor in SENSORS}
    names = ('temperature_rate', 'fixture_tilt')
    noise = determined_noise(runs, base)[0]
    found = search_sensors(runs, base, noise, Settings({name: EFFECTS[name] for name in names}))
    rates = found['magnetometer']
    assert 'temperature_rate' in rates.likeliest.names
    assert rates.hypotheses.log_odds_of_felt_errors(rates.likeliest.components) > 5.0
    assert found['accelerometer'].likeliest.names == ()
