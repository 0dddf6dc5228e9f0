# SPDX-License-Identifier: Apache-2.0
"""The cubic of an autopilot: what of a model it keeps, and what it cannot hold costs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from thermal_comp.data.preparation import prepare
from thermal_comp.effects import EFFECTS
from thermal_comp.export.cubic import Cubic, fitted_cubic, loss, reduced
from thermal_comp.fitting.fit import fit

from imu_recording import read_bag

from .cubic_models import CUBIC, CURVE, LINE, model_of


def test_a_cubic_model_is_kept_whole() -> None:
    cubic = reduced(CUBIC, 'gyroscope')
    temperature = np.linspace(-10.0, 50.0, 13)
    x = (temperature - 20.0)[:, None]
    expected = LINE * x + CURVE[0] * x**2 + CURVE[1] * x**3
    np.testing.assert_allclose(cubic.error(temperature), expected, atol=1e-12)
    np.testing.assert_allclose(cubic.about(35.0).error(temperature), expected, atol=1e-12)
    lost = loss(CUBIC, 'gyroscope', cubic)
    assert lost.kept == pytest.approx(1.0, abs=1e-9)
    assert lost.costs == {}


def test_a_lag_costs_its_rate_times_its_time_constant() -> None:
    lagging = np.array([[4e-3, 1e-3, 0.0]])
    model = model_of(bias_temperature=LINE, thermal_lag=lagging)
    lost = loss(model, 'accelerometer', reduced(model, 'accelerometer'))
    behind = 300.0 * 2.0 / 60.0  # K, in a ramp of 2 K/min
    assert list(lost.costs) == ['thermal_lag']
    assert lost.costs['thermal_lag'] == pytest.approx(behind * 4e-3, rel=0.25)
    assert 0.3 < lost.kept < 0.8


def test_what_an_autopilot_does_not_follow_is_said() -> None:
    supply = np.array([[0.1, 0.2, 0.1]])
    model = model_of(bias_temperature=LINE, supply_sensitivity=supply, warm_up=0.01 * LINE / 2e-3)
    lost = loss(model, 'accelerometer', reduced(model, 'accelerometer'))
    assert lost.not_followed == ('supply_sensitivity',)
    assert lost.costs['supply_sensitivity'] == 2e-3
    assert lost.costs['warm_up'] == pytest.approx(0.01, rel=0.05)  # at power-on
    assert lost.kept > 0.99  # long after it


def test_a_scale_factor_is_no_bias() -> None:
    model = model_of(bias_temperature=LINE, scale_factor_temperature=np.full(3, 1e-4))
    cubic = reduced(model, 'accelerometer')
    np.testing.assert_allclose(cubic.about(20.0).coefficients[1], LINE[0], rtol=1e-9)
    lost = loss(model, 'accelerometer', cubic)
    assert lost.costs['scale_factor_temperature'] == pytest.approx(1e-4 * 30.0 * 9.80665, rel=1e-3)


@pytest.mark.long
def test_the_fitted_cubic_is_judged_on_parts_it_has_not_seen(bags: Path) -> None:
    recordings = [read_bag(bags / f'hidden_effect_{axis}') for axis in 'xyz']
    effects = [EFFECTS['bias_temperature'](), EFFECTS['thermal_lag'](74.0)]
    model = fit(effects, recordings)
    cubics, held_out = fitted_cubic(model, prepare(recordings))
    cubic, whole = held_out['accelerometer']
    assert np.all(cubic > 5.0 * whole)  # the hidden lag is none of temperature's
    assert isinstance(cubics['gyroscope'], Cubic)
    t = np.linspace(0.0, 45.0, 10)
    line = model.sensors['gyroscope'].coefficients[0] * (t - 20.0)[:, None]
    np.testing.assert_allclose(cubics['gyroscope'].error(t), line, atol=2e-5)
