# SPDX-License-Identifier: Apache-2.0
"""What jumps is neither taken for noise nor for something that was not logged."""

from dataclasses import replace

import numpy as np
import pytest
from thermal_comp.data.preparation import prepare
from thermal_comp.diagnosis.diagnose import diagnose
from thermal_comp.effects import EFFECTS
from thermal_comp.effects.effect import Effect
from thermal_comp.noise.estimation import fit_noise

from ..campaign import chamber, measured_by, run

UP = ('+x', '+y', '+z')
AXES = np.array([1.0, -1.0, 0.7])
TIMED = {
    name: EFFECTS[name]
    for name in ('turn_on_bias', 'bias_step', 'bias_drift', 'bias_creep', 'warm_up')
}


@pytest.mark.long
def test_a_large_step_is_not_taken_for_noise() -> None:
    time = chamber()[0]
    slip = 3e-3 * (time >= 19_730.0)[:, None] * AXES
    recordings = measured_by((run(up, seed=k) for k, up in enumerate(UP)), 'gyroscope')
    quiet = diagnose(recordings, catalogue=TIMED)
    slipping = run('+y', seed=1, error={'angular_velocity': slip})
    (recordings[1],) = measured_by([slipping], 'gyroscope')
    jumped = diagnose(recordings, catalogue=TIMED)
    alarms = {(f.kind, f.name) for f in quiet.findings if f.sensor == 'gyroscope'}
    found = {(f.kind, f.name) for f in jumped.findings if f.sensor == 'gyroscope'}
    assert found == alarms | {('effect', 'bias_step')}
    step = next(f for f in jumped.findings if f.name == 'bias_step')
    assert step.noise_floor == pytest.approx(
        np.sqrt(np.mean(np.square(quiet.sensors['gyroscope'].noise_floor))), rel=0.1
    )
    assert step.error_after == pytest.approx(step.noise_floor, rel=0.2)


def test_a_session_may_begin_with_the_first_cycle() -> None:
    cycle = chamber()[3]
    rng = np.random.default_rng(5)
    runs = [
        run(up, seed=k, error={'angular_velocity': 3e-4 * rng.normal(size=(5, 3))[cycle]})
        for k, up in enumerate(UP)
    ]
    findings = diagnose(measured_by(runs, 'gyroscope'), catalogue=TIMED).findings
    (found,) = (f for f in findings if f.kind != 'noise')
    assert (found.kind, found.name, found.sensor) == ('effect', 'turn_on_bias', 'gyroscope')
    assert found.parameters['first']['value'] == 1.0


@pytest.mark.long
def test_creep_goes_on_from_run_to_run_or_begins_anew() -> None:
    time = chamber()[0]
    begins = 60_000.0 * np.arange(3)  # the chamber waits between the runs

    def creeping(since: np.ndarray) -> dict[str, np.ndarray]:
        # Relaxations spread evenly in logarithm from 400 s on: ln(1 + t/t₀) step by step.
        rates = np.exp(-np.linspace(np.log(400.0), np.log(4e7), 60))
        crept = -np.expm1(-since[:, None] * rates).sum(axis=1) * np.log(1e5) / 60.0
        return {'angular_velocity': 2e-4 * crept[:, None] * AXES}

    for counted, starts in ((1.0, begins), (0.0, np.zeros(3))):
        runs = [
            run(up, seed=k, error=creeping(time + start))
            for k, (up, start) in enumerate(zip(UP, starts, strict=True))
        ]
        dated = [
            replace(one, stamp=one.stamp + round(begin * 1e9))
            for one, begin in zip(runs, begins, strict=True)
        ]
        findings = diagnose(measured_by(dated, 'gyroscope'), catalogue=TIMED).findings
        (found,) = (f for f in findings if f.kind == 'effect')
        assert (found.name, found.ambiguous_with) == ('bias_creep', ())
        assert found.parameters['from_first_run']['value'] == counted


class Ripple(Effect):
    """A wave whose frequency is another one for each sensor."""

    name = 'ripple'

    def columns(self, conditions, state=None):
        frequency = {'accelerometer': 4e-3, 'gyroscope': 7e-3}[conditions.sensor]
        return np.sin(2.0 * np.pi * frequency * conditions.time)[:, None], None


def test_a_known_effect_is_taken_out_of_the_sensor_it_acts_on() -> None:
    wave = np.sin(2.0 * np.pi * 7e-3 * chamber()[0])[:, None] * AXES
    rippled = prepare([run('+z', seed=3, error={'angular_velocity': 5e-4 * wave})])
    quiet = fit_noise(prepare([run('+z', seed=3)]), 'gyroscope').variance_of_means(20.0)
    ripple = Ripple()
    fit_noise(rippled, 'accelerometer', [ripple])
    beside = fit_noise(rippled, 'gyroscope', [ripple]).variance_of_means(20.0)
    assert beside == pytest.approx(quiet, rel=0.05)
    assert (fit_noise(rippled, 'gyroscope').variance_of_means(20.0) > 5.0 * quiet).all()
