# SPDX-License-Identifier: Apache-2.0
"""The next experiment promises what the physics allows, within what the chamber allows."""

from dataclasses import replace

import numpy as np
import pytest
from thermal_comp.effects import EFFECTS
from thermal_comp.experiment.design import (
    LEAST_REPEATS,
    ChamberLimits,
    Proposal,
    best_plan,
    design_experiment,
    within,
)
from thermal_comp.experiment.plan import PAPER_PLAN, Plan, Segment, predict_runs, set_points
from thermal_comp.experiment.predicted_design import PredictedDesign, Rival
from thermal_comp.model.values import ModelError, NoiseModel, ThermalModel

from ..models import line_model

CATALOGUE = dict(EFFECTS)
QUIET = NoiseModel(np.full(3, 1e-3), np.geomspace(30.0, 4e4, 7), np.full((7, 3), 3e-4))


def model(**effects: float) -> ThermalModel:
    """A line per axis with realistic noise; `effects` are added with that coefficient."""
    plain = line_model()
    sensors = {s: replace(part, noise=QUIET) for s, part in plain.sensors.items()}
    for name, value in effects.items():
        part = sensors['gyroscope']
        effect = EFFECTS[name]()
        sensors['gyroscope'] = replace(
            part,
            effects=(*part.effects, effect),
            coefficients=(*part.coefficients, np.full((1, 3), value)),
            covariance=np.eye(6) * 1e-12,
        )
    return replace(plain, sensors=sensors)


def proposed(one: str, other: str, *, evaluations: int = 4, **limits: float) -> Proposal:
    names = (one, other)
    return design_experiment(
        names, model(), ChamberLimits(**limits), CATALOGUE, evaluations=evaluations
    )


def test_a_plan_with_corners_tells_lag_from_rate_better_than_the_usual_one() -> None:
    found = proposed('thermal_lag', 'temperature_rate', evaluations=16)
    assert found.evidence_after > 1.3 * found.evidence_before > 0.0
    setpoint, _ = set_points(found.plan)
    assert np.ptp(setpoint) > 10.0


def test_the_usual_plan_is_enough_for_rivals_of_another_kind() -> None:
    found = proposed('thermal_lag', 'thermal_hysteresis', evaluations=4)
    assert found.separable
    assert found.actions == ()
    assert found.evidence_after >= found.evidence_before > 100.0


@pytest.mark.parametrize(
    ('one', 'other', 'advice'),
    [
        ('scale_factor_temperature', 'misalignment_temperature', 'flip'),
        ('fixture_tilt', 'misalignment_temperature', 'flip'),
        ('bias_drift', 'bias_creep', 'soak'),
        ('temperature_rate', 'thermal_gradient', 'second thermometer'),
    ],
)
def test_where_temperature_cannot_tell_it_says_what_can(one: str, other: str, advice: str) -> None:
    found = proposed(one, other, evaluations=0)
    assert not found.separable
    assert any(advice in action for action in found.actions)


def test_orientation_pairs_are_blind_on_three_runs_and_seen_with_one_turned() -> None:
    device = model()
    noise, base = device.sensors['accelerometer'].noise, [EFFECTS['bias_temperature']()]
    assert noise is not None
    three, four = (
        PredictedDesign(predict_runs(PAPER_PLAN, axes), 'accelerometer', noise, base)
        for axes in (('+x', '+y', '+z'), ('+x', '+y', '+z', '-z'))
    )
    scale, misaligned = (
        Rival.of(name, device, 'accelerometer', CATALOGUE).sized(three)
        for name in ('scale_factor_temperature', 'misalignment_temperature')
    )
    assert three.evidence(scale, misaligned) < 1e-3
    assert four.evidence(scale, misaligned) > 100.0


def test_rivals_are_as_large_as_what_is_missing_in_the_sensor_that_lacks_most() -> None:
    names = ('thermal_lag', 'temperature_rate')
    small, large = (
        design_experiment(
            names, model(), ChamberLimits(), CATALOGUE, evaluations=0,
            missing={'magnetometer': rms, 'gyroscope': 1e-5},
        )
        for rms in (2e-3, 6e-3)
    )  # fmt: skip
    assert small.sensor == large.sensor == 'magnetometer'
    assert large.evidence_before == pytest.approx(9.0 * small.evidence_before, rel=1e-6)


def test_evidence_grows_with_the_square_of_the_fitted_size() -> None:
    small, large = (
        design_experiment(
            ('thermal_lag', 'temperature_rate'),
            model(thermal_lag=value),
            ChamberLimits(),
            CATALOGUE,
            evaluations=0,
        )
        for value in (1e-4, 3e-4)
    )
    assert small.sensor == large.sensor == 'gyroscope'
    runs = PredictedDesign(
        predict_runs(PAPER_PLAN), 'gyroscope', QUIET, [EFFECTS['bias_temperature']()]
    )
    rate = Rival.of('temperature_rate', model(), 'gyroscope', CATALOGUE).sized(runs)
    promised = [
        runs.evidence(Rival.of('thermal_lag', model(thermal_lag=v), 'gyroscope', CATALOGUE), rate)
        for v in (1e-4, 3e-4)
    ]
    assert promised[1] == pytest.approx(9.0 * promised[0], rel=1e-6)


@pytest.mark.parametrize(
    'limits',
    [
        ChamberLimits(),
        ChamberLimits(0.0, 40.0, 1.0, 12.0),
        ChamberLimits(-30.0, 70.0, 5.0, 20.0),
        ChamberLimits(10.0, 30.0, 0.3, 9.0),
    ],
)
def test_every_plan_keeps_range_rate_hours_and_repeats(limits: ChamberLimits) -> None:
    names = ('thermal_lag', 'thermal_gradient')
    plan = design_experiment(names, model(), limits, CATALOGUE, evaluations=4).plan
    assert plan.repeats >= LEAST_REPEATS
    assert plan.hours <= limits.hours
    for segment in plan.cycle:
        assert limits.low <= segment.target <= limits.high
        assert 0.0 < segment.rate <= limits.max_rate
    setpoint, cycle = set_points(plan)
    assert np.abs(np.diff(setpoint)).max() <= limits.max_rate / 3.0 + 1e-9
    assert set(np.unique(cycle)) == set(range(plan.repeats + 1))


def test_no_plan_goes_where_it_is() -> None:
    home, cold = Segment(20.0, 2.0, 300.0), Segment(-40.0, 2.0, 600.0)
    plan = within(Plan((home, cold, replace(cold, target=-50.0), home, home), 3), ChamberLimits())
    assert plan.cycle == (Segment(-10.0, 2.0, 1200.0), Segment(20.0, 2.0, 600.0))


def test_every_plan_tried_can_be_run() -> None:
    seen: list[Plan] = []

    def promise(plan: Plan) -> float:
        seen.append(plan)
        return float(len(seen) % 7)

    best_plan(promise, ChamberLimits(18.0, 22.0), np.random.default_rng(3), 400)
    assert len(seen) > 200
    for plan in seen:
        levels = [20.0, *(segment.target for segment in plan.cycle)]
        assert np.diff(levels).all()


def test_too_short_a_time_is_refused() -> None:
    with pytest.raises(ModelError, match='2 h are too short for 3 cycles'):
        within(PAPER_PLAN, ChamberLimits(hours=2.0))


@pytest.mark.parametrize(
    ('names', 'message'),
    [
        (('thermal_lag', 'magic'), "'magic' is not known; known: bias_temperature"),
        (('thermal_lag', 'thermal_lag'), 'are the same effect'),
        (('g_sensitivity_temperature', 'heater_hard_iron'), 'no common sensor'),
    ],
)
def test_pairs_that_make_no_sense_are_refused(names: tuple[str, str], message: str) -> None:
    with pytest.raises(ModelError, match=message):
        design_experiment(names, model(), ChamberLimits(), CATALOGUE)


def test_the_predicted_air_cannot_outrun_the_chamber() -> None:
    plan = Plan((Segment(50.0, 60.0, 600.0), Segment(20.0, 60.0, 600.0)), 3)
    (run,) = predict_runs(plan, ('+z',))
    air = run.chamber_temperature
    assert air is not None
    assert np.abs(np.diff(air)).max() * 3.0 < 20.0
    assert np.abs(run.temperature - 20.0).max() < np.abs(air - 20.0).max()
