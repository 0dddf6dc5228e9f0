# SPDX-License-Identifier: Apache-2.0
"""What no error and no uncertainty of a sensor can be."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from thermal_comp.effects.thermal_lag_two_stage import ThermalLagTwoStage
from thermal_comp.model.bounds import impossible_terms, typical_conditions
from thermal_comp.model.file import save_model
from thermal_comp.model.values import ModelError

from ..models import line_model


def test_coefficients_that_cancel_may_be_uncertain_if_their_error_is_not() -> None:
    effect, nothing = ThermalLagTwoStage(1238.5, 1238.9), np.zeros((2, 3))
    conditions = typical_conditions(-10.0, 50.0, 20.0, 'gyroscope')
    apart = 400.0**2 * np.eye(6)
    opposite = np.kron([[1.0, -1.0], [-1.0, 1.0]], 400.0**2 * np.eye(3))
    refused = [field for _, field, _ in impossible_terms([(effect, nothing, apart)], conditions)]
    assert refused == ['covariance']
    assert list(impossible_terms([(effect, nothing, opposite)], conditions)) == []


def test_a_line_that_is_fitted_far_from_its_reference_is_possible(tmp_path: Path) -> None:
    """0.5 m/s²/K from 47 to 49 °C are 1 m/s²; what they make of 20 °C is in the levels."""
    model = line_model()
    sensor = model.sensors['accelerometer']
    steep = replace(sensor, coefficients=(np.full((1, 3), 0.5),), temperature_range=(47.0, 49.0))
    save_model(replace(model, sensors={'accelerometer': steep}), tmp_path / 'm.yaml')
    wide = replace(steep, temperature_range=(13.0, 49.0))
    with pytest.raises(ModelError, match=r'would make an error of 14\.5'):
        save_model(replace(model, sensors={'accelerometer': wide}), tmp_path / 'm.yaml')
