# SPDX-License-Identifier: Apache-2.0
"""A coupled effect is told by all sensors that feel it, beside what else each of them lacks."""

import numpy as np
import pytest
from thermal_comp.data.preparation import prepare
from thermal_comp.diagnosis import sensor_search
from thermal_comp.diagnosis.coupled_effects import coupled_support, with_effect
from thermal_comp.diagnosis.sensor_answer import UNNAMED_CAUSES, SensorAnswer
from thermal_comp.diagnosis.sensor_search import Settings, search_sensors
from thermal_comp.effects import EFFECTS
from thermal_comp.effects.bias_temperature import BiasTemperature
from thermal_comp.effects.fixture_tilt import FixtureTilt
from thermal_comp.noise.of_runs import determined_noise

from ..campaign import chamber, run

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
    assert coupled_support(FixtureTilt(), answers) < 1.0


@pytest.mark.long
def test_a_sensor_whose_error_has_no_name_does_not_speak_for_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def probability(support: float) -> float:
        monkeypatch.setattr(sensor_search, 'coupled_support', lambda *_: support)
        time = chamber()[0]
        tilted = np.multiply.outer(chamber()[1] - 20.0, [3e-5, -2e-5, 1e-5])
        switched = np.multiply.outer(np.sign(np.sin(time / 900.0)), [1e-6, -2e-6, 1e-6])
        runs = prepare([
            run(up, seed=k, error={'linear_acceleration': tilted, 'magnetic_field': switched})
            for k, up in enumerate(UP)
        ])  # fmt: skip
        base = {sensor: (BiasTemperature(),) for sensor in SENSORS}
        settings = Settings({'fixture_tilt': EFFECTS['fixture_tilt']})
        found = search_sensors(runs, base, determined_noise(runs, base)[0], settings)
        assert found['magnetometer'].kind in UNNAMED_CAUSES
        return found['accelerometer'].probability_of('fixture_tilt')

    assert probability(4.0) == pytest.approx(probability(0.0), abs=1e-9)


def test_it_is_looked_for_beside_what_the_first_sensor_lacks(answers: list[SensorAnswer]) -> None:
    sets = with_effect('fixture_tilt', answers[0])
    assert ('fixture_tilt', 'warm_up') in {some.names for some in sets}
    assert all('fixture_tilt' in some.names for some in sets)
