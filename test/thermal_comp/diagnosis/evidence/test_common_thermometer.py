# SPDX-License-Identifier: Apache-2.0
"""A thermometer that lags shows in all sensors alike: that is no effect of any of them."""

from dataclasses import replace

import numpy as np
import pytest
from thermal_comp.data.preparation import prepare
from thermal_comp.diagnosis.evidence import priors
from thermal_comp.diagnosis.evidence.common_thermometer import (
    Information,
    SensorInformation,
    information_of_others,
    with_likeliest_flaw,
)
from thermal_comp.diagnosis.sensor_search import Settings, search_sensors
from thermal_comp.effects import EFFECTS
from thermal_comp.noise.of_runs import determined_noise

import thermal_comp as tc
from imu_recording import ImuRecording

from ...campaign import chamber, lagging, measured_by, run

UP = ('+x', '+z')
SLOPES = {
    'linear_acceleration': 2e-2 * np.array([1.0, -0.6, 1.4]),
    'angular_velocity': 2e-3 * np.array([1.0, 1.5, -0.8]),
    'magnetic_field': 2e-6 * np.array([1.0, -1.2, 0.7]),
}
"""Ten to twenty times those of the quiet device: what the thermometer is off by shows."""


def late(time_constant: float, **own: np.ndarray) -> list[ImuRecording]:
    """Return a campaign whose thermometer follows the die, with further errors of its own."""
    time, die, *_ = chamber()
    read = lagging(die, time_constant, float(time[1] - time[0]))
    steep = {name: (die - 20.0)[:, None] * slope for name, slope in SLOPES.items()}
    errors = {name: steep[name] + own.get(name, 0.0) for name in steep}
    return [replace(run(up, seed=k, error=errors), temperature=read) for k, up in enumerate(UP)]


@pytest.mark.long
def test_a_lag_in_proportion_to_the_slopes_of_all_sensors_is_the_thermometers() -> None:
    diagnosis = tc.diagnose(late(25.0))
    assert {f.kind for f in diagnosis.findings} <= {'noise', 'quality'}
    # It is no effect of theirs, and a correction takes it out all the same.
    for prediction in diagnosis.predictions:
        assert prediction.error_before > 1.5 * prediction.noise_floor
        assert prediction.error_after < 1.15 * prediction.noise_floor
        assert prediction.empirical
        assert prediction.terms


@pytest.mark.long
def test_a_lag_of_one_sensor_beside_it_keeps_its_name() -> None:
    """What is left of the thermometer's lag may be a second, fast stage of it."""
    time, die, *_ = chamber()
    behind = die - lagging(die, 400.0, float(time[1] - time[0]))
    lag = 4e-4 * behind[:, None] * np.array([1.0, -0.5, 0.8])
    diagnosis = tc.diagnose(late(25.0, angular_velocity=lag))
    (found,) = (f for f in diagnosis.findings if f.kind not in {'noise', 'quality'})
    assert (found.sensor, found.name) == ('gyroscope', 'thermal_lag_two_stage')
    assert found.parameters['time_constant_slow']['value'] == pytest.approx(400.0, rel=0.03)
    assert found.parameters['time_constant_fast']['value'] < 25.0
    (prediction,) = (p for p in diagnosis.predictions if p.sensor == 'gyroscope')
    assert prediction.error_after < 1.1 * prediction.noise_floor


def test_beside_an_error_without_a_name_the_thermometer_is_corrected_all_the_same() -> None:
    """What has no name is a twentieth of what the lag does."""
    time, *_ = chamber()
    waves = 6e-4 * np.sin(2.0 * np.pi * time / 2300.0 + (time / 2e4) ** 2)
    course = np.multiply.outer(waves, [1.0, -1.5, 2.0])
    campaign = measured_by(late(25.0, linear_acceleration=course), 'accelerometer')
    diagnosis = tc.diagnose(campaign)
    assert {f.kind for f in diagnosis.findings} & {'unexplained', 'unlogged'}
    (prediction,) = diagnosis.predictions
    assert prediction.empirical
    assert prediction.error_after < 0.4 * prediction.error_before


def test_only_sensors_whose_errors_are_understood_tell_of_the_thermometer() -> None:
    """What sticks and slips in the gyroscope may look like errors of the thermometer."""
    time, *_ = chamber(1, 20.0)
    slip = np.multiply.outer((time / 2500.0) % 1.0 - 0.5, 8e-3 * np.array([-0.5, 1.0, 2.0]))
    runs = prepare([run(cycles=1, period=20.0, error={'angular_velocity': slip})])
    base = {sensor: (EFFECTS['bias_temperature'](),) for sensor in runs[0].measured}
    few = {name: EFFECTS[name] for name in ('warm_up', 'thermal_lag')}
    answers = search_sensors(runs, base, determined_noise(runs, base)[0], Settings(few))
    assert answers['gyroscope'].kind == 'unexplained'
    searched = {s: (a.hypotheses, a.sets) for s, a in answers.items()}
    understood = {s for s in searched if s != 'gyroscope'}
    told = information_of_others(searched, understood)
    alone = information_of_others({s: searched[s] for s in understood}, understood)
    assert np.array_equal(told['accelerometer'].normal, alone['accelerometer'].normal)
    assert not np.array_equal(
        told['accelerometer'].normal,
        information_of_others(searched, set(searched))['accelerometer'].normal,
    )
    assert information_of_others(searched, ()) == {}


def test_others_tell_with_the_flaw_that_agrees_with_what_a_sensor_sees() -> None:
    """A drift that looked like a thermometer's error made "humidity" of a sensor without one."""
    deviation = priors.thermometer_deviations(60.0, 14)
    precision = np.diag((100.0 / deviation) ** 2)
    told = Information(precision, precision @ (0.5 * deviation))
    limited = {}
    for seen in (0.5, -0.5):
        own = [SensorInformation(Information(precision, precision @ (seen * deviation)), 0.0)]
        limited[seen] = with_likeliest_flaw(told, own).normal
    least, most = (np.linalg.inv(limited[seen]) for seen in limited)
    expected = {0.5: 0.1, -0.5: 1.0}
    for seen, covariance in zip(expected, (least, most), strict=True):
        share = np.sqrt(np.diag(covariance)) / (0.5 * deviation)
        assert share == pytest.approx(expected[seen], rel=0.1)


def test_what_a_lag_looks_like_has_a_name_that_can_be_added() -> None:
    """Where the air was not logged, a gradient is guessed: it fits, and no model can have it."""
    runs = prepare(late(15.0))
    base = {'gyroscope': (EFFECTS['bias_temperature'](),)}
    noise = determined_noise(runs, base)[0]
    for names in (('thermal_gradient',), ('thermal_gradient', 'temperature_rate')):
        settings = Settings({name: EFFECTS[name] for name in names})
        answer = search_sensors(runs, base, noise, settings)['gyroscope']
        assert answer.hypotheses.guesses
        assert {effect.name for effect in answer.closest} <= {'temperature_rate'}
