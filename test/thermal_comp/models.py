# SPDX-License-Identifier: Apache-2.0
"""Small thermal models with known numbers."""

import numpy as np
from thermal_comp.effects import EFFECTS
from thermal_comp.model.values import NoiseModel, Provenance, SensorModel, ThermalModel

SLOPES = {'accelerometer': 2e-3, 'gyroscope': 1e-3, 'magnetometer': 3e-8}
"""Temperature coefficient of the x axis, per kelvin; y has −1/2, z none."""
NOISE = {'accelerometer': 1e-3, 'gyroscope': 1e-4, 'magnetometer': 1e-7}
"""White noise density per axis."""


def line_sensor(sensor: str) -> SensorModel:
    slope = SLOPES[sensor]
    return SensorModel(
        effects=(EFFECTS['bias_temperature'](),),
        coefficients=(slope * np.array([[1.0, -0.5, 0.0]]),),
        covariance=np.eye(3) * (0.01 * slope) ** 2,
        noise=NoiseModel(np.full(3, NOISE[sensor]), np.array([100.0]), np.zeros((1, 3))),
        levels={'z': np.array([0.1, 0.2, 0.3])},
        contributions={'bias_temperature': slope * 20.0 * np.array([1.0, 0.5, 0.0])},
        temperature_range=(-10.0, 50.0),
    )


def line_model() -> ThermalModel:
    """A straight line per axis, fitted from −10 to 50 °C."""
    return ThermalModel(
        device='dut1',
        sensors={sensor: line_sensor(sensor) for sensor in SLOPES},
        provenance=Provenance({'z': '0' * 64}, '0.1.0', ('made by hand',)),
    )
