# SPDX-License-Identifier: Apache-2.0
"""How well a time constant is known says whether its equation is the whole of what happens."""

import numpy as np
import pytest
from imu_recording.recording import FloatArray
from thermal_comp.data.preparation import prepare
from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.diagnosis.model_form import with_model_form
from thermal_comp.effects import EFFECTS
from thermal_comp.effects.bias_temperature import BiasTemperature
from thermal_comp.fitting.fit import fit_prepared
from thermal_comp.model.document import model_from_document
from thermal_comp.model.values import NoiseModel, ThermalModel

from ..campaign import PERIOD, WHITE, chamber, lagging, run

DENSITY = WHITE['angular_velocity']
AXES = np.array([1.0, -0.6, 0.8])
NOISE = NoiseModel(np.full(3, DENSITY), np.array([200.0, 4000.0]), np.full((2, 3), 0.4 * DENSITY))


def fitted(
    behind: FloatArray, effect: str = 'thermal_lag'
) -> tuple[ThermalModel, list[PreparedRun]]:
    """The gyroscope's model of a line and an effect whose temperature is `behind` (n,) [K]."""
    error = 1e-3 * behind[:, None] * AXES
    runs = prepare([run(seed=3, cycles=2, error={'angular_velocity': error})])
    for sensor in ('accelerometer', 'magnetometer'):
        runs[0].measured[sensor][:] = np.nan
    effects = {'gyroscope': (BiasTemperature(), EFFECTS[effect]())}
    return fit_prepared(effects, runs, noise={'gyroscope': NOISE}), runs


def stds(
    model: ThermalModel, runs: list[PreparedRun], effect: str = 'thermal_lag'
) -> tuple[float, float, float]:
    """Time constant, its standard deviation by the fit and with its form's."""
    value = model.sensors['gyroscope'].effects[1].shape_parameters['time_constant']
    name = f'{effect}.time_constant'
    (alone,) = model.sensors['gyroscope'].shape_std[name]
    told = model_from_document(with_model_form(model, runs).to_dict(), EFFECTS).sensors[
        'gyroscope'
    ]
    (with_form,), (form,) = told.shape_std[name], told.shape_form_std[name]
    assert form**2 == pytest.approx(with_form**2 - alone**2)
    return value, alone, with_form


def test_an_equation_that_holds_leaves_a_time_constant_well_known() -> None:
    temperature = chamber(2)[1]
    value, alone, with_form = stds(*fitted(lagging(temperature, 150.0, PERIOD) - temperature))
    assert abs(value - 150.0) < 2.0 * with_form
    assert alone <= with_form < 5.0  # the thermometer's own lag is some seconds


def test_an_equation_that_is_nearly_right_leaves_it_less_well_known() -> None:
    time, temperature = chamber(2)[:2]
    way = np.tanh(np.gradient(temperature, time) / 0.01)
    behind = lagging(temperature, 150.0, PERIOD) - temperature
    value, alone, with_form = stds(*fitted(behind * (1.0 + 0.15 * way)))  # heated or cooled
    assert abs(value - 150.0) > 4.0 * alone
    assert abs(value - 150.0) < 2.5 * with_form < 40.0


def test_a_body_of_two_parts_leaves_the_time_constant_of_one_uncertain() -> None:
    time = chamber(2)[0]
    settling = 0.75 * np.exp(-time / 600.0) + 0.25 * np.exp(-time / 2400.0)
    value, alone, with_form = stds(*fitted(10.0 * settling, 'warm_up'), 'warm_up')
    assert abs(value - 600.0) > 4.0 * alone
    assert abs(value - 600.0) < 2.0 * with_form < 600.0


def test_what_the_thermometer_lags_by_is_missing_from_a_time_constant() -> None:
    time, temperature = chamber(2)[:2]
    die = temperature + 8.0 * np.gradient(temperature, time)
    value, alone, with_form = stds(*fitted(lagging(die, 60.0, PERIOD) - die))
    assert abs(value - 60.0) > 4.0 * alone
    assert abs(value - 60.0) < 2.0 * with_form < 40.0


def test_an_equation_that_is_wrong_leaves_it_within_the_range_that_is_searched() -> None:
    time, temperature = chamber(2)[:2]
    rate = np.gradient(temperature, time)
    behind = lagging(temperature, 150.0, PERIOD) - temperature + 90.0 * np.abs(rate)
    value, alone, with_form = stds(*fitted(behind))
    assert alone < 0.1 * value < with_form < 4.0 * value


@pytest.mark.parametrize('effect', ['bias_step', 'mains_alias'])
def test_what_a_row_or_a_period_limits_stays_as_the_fit_has_it(effect: str) -> None:
    time = chamber(2)[0]
    model, runs = fitted((time >= 5003.0) * 10.0, effect)
    assert with_model_form(model, runs).sensors['gyroscope'].shape_std == (
        model.sensors['gyroscope'].shape_std
    )
