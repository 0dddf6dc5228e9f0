# SPDX-License-Identifier: Apache-2.0
"""Forms of an error over temperature: alike where the temperature stands, apart where it moves."""

from __future__ import annotations

import numpy as np
import pytest
from thermal_comp.data.conditions import Conditions
from thermal_comp.effects.bias_temperature import BiasTemperature
from thermal_comp.effects.empirical_term import Empirical
from thermal_comp.effects.thermal_lag import ThermalLag
from thermal_comp.still.forms import CurveForm, forms_near

LAG = ThermalLag(60.0)
BENDS = Empirical(20.0, 30.0, (1.0,) * 3 + (0.0,) * 9)


def columns(form: CurveForm, temperature: np.ndarray) -> np.ndarray:
    """(n, p) columns at a sample a second that are not zero throughout by their design."""
    still = np.zeros((len(temperature), 3))
    conditions = Conditions(np.arange(float(len(still))), temperature, still, still, still)
    effects = form.effects(BiasTemperature(), BENDS)
    every = np.concatenate([effect.columns(conditions)[0] for effect in effects], axis=1)
    return every[:, np.abs(every).max(axis=0) > 0.0]


RAMP = 30.0 + np.r_[np.zeros(10), 0.05 * np.arange(590.0)]


@pytest.mark.parametrize('form', [CurveForm(), CurveForm(LAG), CurveForm(LAG, tied=True)])
def test_each_form_has_as_many_columns_as_it_says(form: CurveForm) -> None:
    assert columns(form, RAMP).shape[1] == form.coefficients


def test_an_element_that_lags_is_where_the_temperature_was() -> None:
    """Long into a ramp it is behind by rate × time constant."""
    now, then = columns(CurveForm(), RAMP), columns(CurveForm(LAG, tied=True), RAMP)
    assert then[-1, 0] == pytest.approx(now[-1, 0] - 0.05 * 60.0, abs=0.01)
    np.testing.assert_allclose(then[-1], now[-61], atol=0.01)


def test_where_the_temperature_stands_no_lag_is_felt() -> None:
    held = np.full(50, 41.0)
    plain = columns(CurveForm(), held)
    np.testing.assert_allclose(columns(CurveForm(LAG, tied=True), held), plain, rtol=1e-12)
    np.testing.assert_array_equal(columns(CurveForm(LAG), held), plain)  # its own are zero


def test_beside_the_likeliest_lag_others_are_tried_on_both_sides_and_none_below_the_least() -> (
    None
):
    seconds = sorted({form.lag.time_constant for form in forms_near(CurveForm(ThermalLag(80.0)))})
    assert seconds[3] == pytest.approx(80.0)
    assert seconds[0] * seconds[-1] == pytest.approx(80.0**2)
    assert min(form.lag.time_constant for form in forms_near(CurveForm(ThermalLag(10.0)))) == 10.0
    assert {form.tied for form in forms_near(CurveForm(ThermalLag(80.0)))} == {True, False}
