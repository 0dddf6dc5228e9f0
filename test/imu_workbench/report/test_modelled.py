# SPDX-License-Identifier: Apache-2.0
"""Errors of a run against its model, version names, and how the error falls with the versions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from imu_workbench.report.error_steps import degree_steps
from imu_workbench.report.model_content import model_content, version_names
from imu_workbench.report.modelled import binned, errors_of_run, failure_map
from thermal_comp.data.preparation import prepare
from thermal_comp.effects import EFFECTS
from thermal_comp.effects.bias_temperature import BiasTemperature
from thermal_comp.fitting.fit import fit_prepared


@pytest.fixture(scope='module')
def fitted(run):
    runs = prepare([run(cycles=2)])
    return runs[0], fit_prepared([BiasTemperature()], runs)


def test_measured_is_modelled_plus_residual_and_the_residual_is_noise(fitted) -> None:
    errors = errors_of_run(*fitted)
    for sensor, measured in errors.measured.items():
        residual = errors.residual(sensor)
        np.testing.assert_allclose(errors.modelled[sensor] + residual, measured)
        assert np.nanstd(residual) < 0.2 * np.nanstd(measured)


def test_a_run_the_model_has_not_seen_gets_a_level_of_its_own(fitted) -> None:
    prepared, model = fitted
    moved = replace(
        prepared, name='other', measured={s: v + 1.0 for s, v in prepared.measured.items()}
    )
    errors = errors_of_run(moved, model)
    for sensor in errors.measured:
        np.testing.assert_allclose(np.nanmean(errors.residual(sensor), axis=0), 0.0, atol=1e-12)


def test_an_error_of_one_cycle_shows_in_its_cells_of_the_map(fitted) -> None:
    errors = errors_of_run(*fitted)
    floor = np.ones(3)
    residual = np.where((errors.cycle == 2)[:, None], 5.0, 1.0) * np.ones((1, 3))
    where = failure_map(errors, residual, floor)
    assert where is not None
    assert where['cycles'] == [1, 2]
    assert all(row == pytest.approx([1.0, 5.0]) for row in where['ratio'])


def test_bins_hold_mean_and_spread() -> None:
    temperature = np.array([20.1, 20.9, 31.0])
    values = np.array([[1.0], [3.0], [7.0]]) * np.ones((1, 3))
    centre, mean, spread = binned(temperature, values)
    np.testing.assert_allclose(centre, [20.5, 31.0])
    np.testing.assert_allclose(mean[:, 0], [2.0, 7.0])
    np.testing.assert_allclose(spread[:, 0], [1.0, 0.0])


def test_versions_are_named_by_what_was_added(fitted) -> None:
    prepared, line = fitted
    curved = fit_prepared([BiasTemperature(), EFFECTS['bias_temperature_curvature']()], [prepared])
    model = line.succeeded_by(curved)
    assert version_names(model) == ['bias temperature', '+ bias temperature curvature']
    content = model_content(model)
    assert [version['name'] for version in content['history']] == version_names(model)
    assert {term['sensor'] for term in content['terms']} == set(model.sensors)


def test_degrees_of_several_runs_are_their_rms() -> None:
    rows = [{'filter': 'ahrs', 'sigma': [3.0, 0.0]}, {'filter': 'ahrs', 'sigma': [4.0, 0.0]}]
    steps = degree_steps({'degrees': rows, 'versions': ['raw', 'line']})['ahrs']['steps']
    assert [step['error'] for step in steps] == pytest.approx([np.sqrt(12.5), 0.0])
