# SPDX-License-Identifier: Apache-2.0
"""What effects look like in hindsight, and products of columns that are asked for."""

from collections.abc import Sequence

import numpy as np
from imu_recording.recording import ImuRecording
from thermal_comp.data.conditions import Conditions, Sensor
from thermal_comp.diagnosis.inputs import prepare_inputs
from thermal_comp.effects import EFFECTS
from thermal_comp.linear.candidate_design import CandidateDesign, ColumnSource
from thermal_comp.model.values import NoiseModel

STEP = 5.0
TIME = np.arange(4000) * STEP


def ramps() -> np.ndarray:
    """(n,) °C up and down at 2 K/min with dwells of half an hour."""
    rate = 2.0 / 60.0 * np.sign(np.sin(2.0 * np.pi * TIME / 7200.0))
    dwell = np.abs(np.sin(2.0 * np.pi * TIME / 7200.0)) < np.sin(np.pi / 4.0)
    return 20.0 + np.cumsum(np.where(dwell, 0.0, rate)) * STEP


def at_rest() -> Conditions:
    still = np.zeros((len(TIME), 3))
    return Conditions(TIME, ramps(), still, still, still)


def test_in_hindsight_a_rate_changes_at_the_corner_itself() -> None:
    conditions = at_rest()
    effect = EFFECTS['temperature_rate']()
    seen, live = effect.columns_in_hindsight(conditions)[:, 0], effect.columns(conditions)[0][:, 0]
    true = np.diff(ramps(), prepend=ramps()[0]) / STEP
    assert np.abs(seen - true).mean() < 0.3 * np.abs(live - true).mean()


def test_other_effects_look_the_same_in_hindsight() -> None:
    conditions = at_rest()
    effect = EFFECTS['thermal_lag']()
    np.testing.assert_array_equal(
        effect.columns_in_hindsight(conditions), effect.columns(conditions)[0]
    )


def at_rest_in(up_axis: str, seed: int) -> ImuRecording:
    rng = np.random.default_rng(seed)
    still = rng.normal(0.0, 1.0, (len(TIME), 3))
    stamp = (TIME * 1e9).astype(np.int64)
    force = still + 9.8 * np.eye(3)['xyz'.index(up_axis[1])]
    return ImuRecording(stamp, still, force, 1e-6 * still, ramps(), up_axis=up_axis)


def design(poses: Sequence[str], sensor: Sensor, *base: str) -> CandidateDesign:
    """Return that of a device at rest."""
    runs = prepare_inputs([at_rest_in(up, 3 + k) for k, up in enumerate(poses)]).runs
    noise = NoiseModel(np.ones(3), np.zeros(0), np.zeros((0, 3)))
    return CandidateDesign(ColumnSource(runs), sensor, noise, [EFFECTS[name]() for name in base])


def test_products_are_those_of_the_whitened_columns_whenever_they_are_asked_for() -> None:
    made = design(('+z',), 'gyroscope', 'bias_temperature')
    lags = [EFFECTS['thermal_lag'](time_constant=t) for t in (40.0, 90.0, 300.0)]
    first = made.terms([lags[0], EFFECTS['temperature_rate']()])
    with made.trials():
        made.equations([*first[0].columns, *made.term(lags[1]).columns])
    # What was tried is forgotten, and with it what was known of the place it stood in.
    last = made.term(lags[2])
    columns = [*first[0].columns, *first[1].columns, *last.columns]
    for axis, whitened in enumerate(made.whitened_columns([*first, last])):
        normal, right = (values[axis] for values in made.equations(columns))
        np.testing.assert_allclose(normal, whitened.T @ whitened, atol=1e-12)
        np.testing.assert_allclose(right, whitened.T @ made.target[axis], atol=1e-12)


def test_axes_that_share_coefficients_of_the_base_model_have_them_taken_out_together() -> None:
    made = design(('+x', '+y', '+z'), 'accelerometer', 'fixture_tilt')
    levels = design(('+x', '+y', '+z'), 'accelerometer')
    columns = levels.whitened_columns([levels.term(EFFECTS['fixture_tilt']())])
    fitted = np.linalg.lstsq(np.concatenate(columns), np.concatenate(levels.target), rcond=None)[0]
    left = np.stack([t - c @ fitted for t, c in zip(levels.target, columns, strict=True)])
    np.testing.assert_allclose(made.target, left, atol=1e-9)
    assert made.base_rank == levels.base_rank + 2  # a turn about the vertical does nothing


def test_what_others_tell_of_a_term_stays_when_further_products_are_computed() -> None:
    made = design(('+z',), 'gyroscope', 'bias_temperature')
    told = made.term(EFFECTS['thermal_lag'](time_constant=90.0))
    before = made.equations(told.columns)[0]
    made.inform(told, np.eye(len(told.columns)), np.ones(len(told.columns)))
    after = made.equations(told.columns)[0]
    assert (after != before).any()
    made.term(EFFECTS['temperature_rate']())
    np.testing.assert_array_equal(
        made.products(told.columns)[0][:, told.columns][:, :, told.columns], after
    )
