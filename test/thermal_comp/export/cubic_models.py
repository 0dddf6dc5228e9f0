# SPDX-License-Identifier: Apache-2.0
"""Models that autopilots can take whole, and the precision of their files."""

import numpy as np
from thermal_comp.effects import EFFECTS
from thermal_comp.model.values import NoiseModel, SensorModel, ThermalModel

NOISE = NoiseModel(
    np.array([1e-3, 2e-3, 1e-3]), np.array([20.0, 500.0]), np.array([[0.0] * 3, [1e-4] * 3])
)


def model_of(**coefficients: np.ndarray) -> ThermalModel:
    """A model of accelerometer and gyroscope with these effects, alike in both."""
    effects = tuple(EFFECTS[name]() for name in coefficients)
    part = SensorModel(
        effects=effects,
        coefficients=tuple(coefficients.values()),
        covariance=np.zeros((0, 0)),
        noise=NOISE,
        contributions={'supply_sensitivity': np.array([1e-3, 2e-3, 1e-3])},
        temperature_range=(-10.0, 50.0),
    )
    return ThermalModel('dut1', {'accelerometer': part, 'gyroscope': part})


LINE = np.array([[2e-3, -1e-3, 5e-4]])
CURVE = np.array([[1e-5, -2e-5, 3e-5], [1e-7, 2e-7, -3e-7]])
CUBIC = model_of(bias_temperature=LINE, bias_temperature_curvature=CURVE)


def ulps(one: np.ndarray, other: np.ndarray) -> float:
    """Greatest distance in units of the last place of single precision."""
    a, b = np.float32(one), np.float32(other)
    return float(np.max(np.abs(a - b) / np.spacing(np.maximum(np.abs(a), np.float32(1e-30)))))
