# SPDX-License-Identifier: Apache-2.0
"""Sums over pieces are the sums over the whole."""

from dataclasses import replace

import numpy as np
import pytest
from thermal_comp.data.conditions import static_conditions
from thermal_comp.effects import EFFECTS
from thermal_comp.linear import normal_equations as gram_module
from thermal_comp.linear.normal_equations import gram, solve
from thermal_comp.model.values import ModelError

from ..campaign import run

NAMES = ('bias_temperature', 'bias_temperature_curvature', 'thermal_lag', 'thermal_hysteresis')


def test_piecewise_normal_equations_give_numpys_least_squares(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(gram_module, 'SAMPLES_AT_A_TIME', 333)
    recording = run()
    conditions = static_conditions(recording)
    effects = [EFFECTS[name]() for name in NAMES]
    measured = [recording.angular_velocity, recording.linear_acceleration]
    found = solve(gram(effects, conditions, measured).equations())
    columns = [effect.columns(conditions)[0] for effect in effects]
    design = np.concatenate([*columns, np.ones((len(recording), 1))], axis=1)
    expected = np.linalg.lstsq(design, np.concatenate(measured, axis=1), rcond=None)
    np.testing.assert_allclose(found.estimate, expected[0][:-1], rtol=1e-7)
    np.testing.assert_allclose(found.chi_square, expected[1], rtol=1e-9)


def test_rows_that_are_not_finite_do_not_count() -> None:
    recording = run()
    broken = recording.angular_velocity.copy()
    broken[100, 1] = np.nan
    kept = np.arange(len(recording)) != 100
    effects = [EFFECTS['bias_temperature']()]
    conditions = static_conditions(recording)
    with_hole = gram(effects, conditions, [broken]).equations()
    without = gram(effects, conditions.rows(kept), [recording.angular_velocity[kept]]).equations()
    assert with_hole.rows == without.rows
    np.testing.assert_allclose(solve(with_hole).estimate, solve(without).estimate, rtol=1e-9)


def test_columns_shared_by_axes_are_refused_by_name() -> None:
    recording = replace(run(cycles=1), up_axis='+x')
    effect = EFFECTS['scale_factor_temperature']()
    with pytest.raises(ModelError, match='scale_factor_temperature: its axes share'):
        gram([effect], static_conditions(recording), [recording.linear_acceleration])
