# SPDX-License-Identifier: Apache-2.0
"""What no error and no uncertainty of a sensor can be."""

import numpy as np
from thermal_comp.effects.thermal_lag_two_stage import ThermalLagTwoStage
from thermal_comp.model.bounds import impossible_terms, typical_conditions


def test_coefficients_that_cancel_may_be_uncertain_if_their_error_is_not() -> None:
    effect, nothing = ThermalLagTwoStage(1238.5, 1238.9), np.zeros((2, 3))
    conditions = typical_conditions(-10.0, 50.0, 20.0, 'gyroscope')
    apart = 400.0**2 * np.eye(6)
    opposite = np.kron([[1.0, -1.0], [-1.0, 1.0]], 400.0**2 * np.eye(3))
    refused = [field for _, field, _ in impossible_terms([(effect, nothing, apart)], conditions)]
    assert refused == ['covariance']
    assert list(impossible_terms([(effect, nothing, opposite)], conditions)) == []
