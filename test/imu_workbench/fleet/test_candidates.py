# SPDX-License-Identifier: Apache-2.0
"""What effects take up of one device's residual: a lag that was put in, and noise alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from imu_workbench.fleet.candidates import try_candidates
from thermal_comp.data.preparation import prepare
from thermal_comp.effects import EFFECTS
from thermal_comp.effects.bias_temperature import BiasTemperature
from thermal_comp.effects.operators import follow
from thermal_comp.effects.thermal_lag import ThermalLag
from thermal_comp.fitting.fit import fit_prepared

LAG_S = 150.0
SIZE = 3e-4
"""Of the lag's error on x [rad/s/K]."""


CATALOGUE = {**EFFECTS, 'own_lag': type('OwnLag', (ThermalLag,), {'name': 'own_lag'})}


@pytest.fixture(scope='module')
def found(run):
    recording = run(cycles=3)
    lagged, _ = follow(recording.time, recording.temperature, LAG_S)
    error = np.outer(recording.temperature - lagged, [SIZE, 0.0, 0.0])
    runs = prepare([replace(recording, angular_velocity=recording.angular_velocity + error)])
    line = fit_prepared([BiasTemperature()], prepare([recording]))
    noise = line.sensors['gyroscope'].noise
    assert noise is not None
    tried = try_candidates(runs, 'gyroscope', noise, BiasTemperature(), CATALOGUE)
    return {one.effect: one for one in tried}


def test_the_lag_takes_most_up_at_its_own_time_constant_and_size(found) -> None:
    lag = found['thermal_lag']
    assert lag.degrees == 1
    for other in found.values():
        assert not (other.delta_chi2[:, 0] > lag.delta_chi2[:, 0].max()).any(), other.effect
    best = int(lag.delta_chi2[:, 0].argmax())
    assert lag.shapes[best] == pytest.approx(LAG_S, rel=0.4)  # of a grid of thirteen
    assert abs(lag.coefficients[best, 0]) == pytest.approx(SIZE, rel=0.4)


def test_on_axes_of_noise_alone_it_takes_up_its_degrees_of_freedom(found) -> None:
    left = found['thermal_lag'].delta_chi2[:, 1:]
    assert left.max() < 15.0  # χ² with one degree of freedom, in any form
    assert found['thermal_lag'].delta_chi2[:, 0].max() > 1000.0


def test_an_effect_of_the_users_own_is_tried_as_that_of_the_catalogue(found) -> None:
    own, shipped = found['own_lag'], found['thermal_lag']
    assert own.shapes == shipped.shapes
    np.testing.assert_array_equal(own.coefficients, shipped.coefficients)


def test_shared_or_unlogged_effects_are_not_tried(found) -> None:
    assert 'supply_sensitivity' not in found  # its channel was not logged
    assert 'bias_temperature' not in found  # the line itself
    assert 'heater_hard_iron' not in found  # stays in the chamber
