# SPDX-License-Identifier: Apache-2.0
"""Stated standard deviations of shape parameters are those by which they miss the truth."""

import numpy as np
import pytest
from imu_recording.recording import FloatArray
from thermal_comp.data.preparation import prepare
from thermal_comp.effects import EFFECTS
from thermal_comp.effects.bias_temperature import BiasTemperature
from thermal_comp.effects.effect import Effect
from thermal_comp.fitting.fit import fit_prepared
from thermal_comp.fitting.shape_uncertainty import solve_with_shapes
from thermal_comp.linear.design import Design
from thermal_comp.linear.normal_equations import solve
from thermal_comp.model.values import NoiseModel, SensorModel

from ..campaign import PERIOD, WHITE, chamber, lagging, run

FIELD = 'magnetometer'
DENSITY = WHITE['angular_velocity']
AXES = np.array([1.0, -0.6, 0.8])
NOISE = NoiseModel(np.full(3, DENSITY), np.array([200.0, 4000.0]), np.full((2, 3), 0.4 * DENSITY))


def fitted(effect: Effect, error: FloatArray, seeds: range) -> list[SensorModel]:
    """The gyroscope's model of a line and an effect, from one run of two cycles per seed."""
    models = []
    for seed in seeds:
        runs = prepare([run(seed=seed, cycles=2, error={'angular_velocity': error})])
        for sensor in ('accelerometer', 'magnetometer'):
            runs[0].measured[sensor][:] = np.nan
        effects = {'gyroscope': (BiasTemperature(), effect)}
        model = fit_prepared(effects, runs, noise={'gyroscope': NOISE})
        models.append(model.sensors['gyroscope'])
    return models


def test_a_time_constant_misses_the_truth_by_its_standard_deviation() -> None:
    temperature = chamber(2)[1]
    wave = 5e-5 * (lagging(temperature, 150.0, PERIOD) - temperature)[:, None] * AXES
    off = []
    for model in fitted(EFFECTS['thermal_lag'](), wave, range(14)):
        (std,) = model.shape_std['thermal_lag.time_constant']
        off.append((model.effects[1].time_constant - 150.0) / std)
    assert 0.65 < np.sqrt(np.mean(np.square(off))) < 1.4


def test_a_step_is_known_to_about_a_row() -> None:
    time = chamber(2)[0]
    for at in (5003.0, 9001.0):
        wave = 10.0 * DENSITY * (time >= at)[:, None] * AXES
        for model in fitted(EFFECTS['bias_step'](), wave, range(2)):
            (std,) = model.shape_std['bias_step.step_time']
            assert 0.5 * PERIOD < std < 2.0 * PERIOD
            assert abs(model.effects[1].step_time[0] - at) < 2.0 * std


def test_the_frequency_of_a_line_is_known_to_a_part_of_a_period_over_the_run() -> None:
    time = chamber(2)[0]
    wave = DENSITY * np.cos(2.0 * np.pi * 0.0102 * time)[:, None] * AXES
    (model,) = fitted(EFFECTS['mains_alias'](0.01022), wave, range(1))
    (std,) = model.shape_std['mains_alias.frequency']
    assert 0.01 / time[-1] < std < 0.5 / time[-1]
    assert abs(model.effects[1].frequency - 0.0102) < 2.0 * std


def iced(temperature: FloatArray, offset: float) -> FloatArray:
    """(n,) ice that grows in 1500 s and melts in 400; the thermometer reads `offset` too much."""
    ice = [0.0]
    for now in temperature[1:]:
        change = (1.0 - ice[-1]) / 1500.0 if now < offset else -ice[-1] / 400.0
        ice.append(ice[-1] + PERIOD * change)
    return np.array(ice)


def test_where_water_freezes_is_part_of_what_is_not_known_about_ice() -> None:
    wave = 100.0 * DENSITY * iced(chamber(2)[1], 0.4)[:, None] * AXES
    for model in fitted(EFFECTS['icing'](1500.0, 400.0), wave, range(2)):
        for name, truth in (('growth_time', 1500.0), ('melt_time', 400.0)):
            (std,) = model.shape_std[f'icing.{name}']
            off = abs(getattr(model.effects[1], name) - truth)
            assert off < 2.0 * std
            assert std < 0.05 * truth


def test_ice_is_known_as_well_beside_an_effect_that_other_sensors_share() -> None:
    """Columns of the other sensor's shapes stood where those of the ice were looked up."""
    density = WHITE['magnetic_field']
    wave = 100.0 * density * iced(chamber(2)[1], 0.4)[:, None] * AXES
    runs = prepare([run(seed=3, cycles=2, error={'magnetic_field': wave})])
    noise = {
        sensor: NoiseModel(np.full(3, white), np.zeros(0), np.zeros((0, 3)))
        for sensor, white in (('accelerometer', WHITE['linear_acceleration']), (FIELD, density))
    }
    ice, tilt = EFFECTS['icing'](1500.0, 400.0), EFFECTS['fixture_tilt']()
    alone = {FIELD: (BiasTemperature(), ice)}
    together = {
        'accelerometer': (BiasTemperature(), EFFECTS['thermal_lag'](150.0), tilt),
        FIELD: (BiasTemperature(), ice, tilt),
    }
    stated = [
        fit_prepared(effects, runs, noise={s: noise[s] for s in effects}, refine=False)
        .sensors[FIELD]
        .shape_std['icing.growth_time']
        for effects in (alone, together)
    ]
    assert stated[1] == pytest.approx(stated[0], rel=0.1)


def test_a_shape_that_is_not_known_makes_its_coefficients_more_uncertain() -> None:
    """Columns of shapes come last: the others keep their places."""
    temperature = chamber(2)[1]
    wave = 5e-5 * (lagging(temperature, 150.0, PERIOD) - temperature)[:, None] * AXES
    runs = prepare([run(seed=1, cycles=2, error={'angular_velocity': wave})])
    effects = {'gyroscope': (BiasTemperature(), EFFECTS['thermal_lag'](150.0))}
    design = Design(runs, effects, {'gyroscope': NOISE})
    known = solve(design.equations())
    wider, unknown = solve_with_shapes(design, known.estimate[:, 0])
    size = design.size
    assert wider.size == size + 1
    change = np.abs(unknown.estimate[:size, 0] - known.estimate[:, 0])
    assert (change < 0.5 * np.sqrt(np.diag(known.covariance))).all()
    lag = design.terms[1].unknowns
    variances = [np.diag(found.covariance)[lag] for found in (known, unknown)]
    assert (variances[1] > 1.05 * variances[0]).all()
