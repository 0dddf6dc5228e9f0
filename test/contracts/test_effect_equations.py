# SPDX-License-Identifier: Apache-2.0
"""Columns of every effect without a test of its own against its equation, computed by hand."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from thermal_comp.data.conditions import Conditions, Sensor
from thermal_comp.effects import EFFECTS

T0, T1 = 30.0, 10.0
"""Die temperature of two samples a hundred seconds apart [°C]; the reference is 20 °C."""
FORCE = (2.0, -3.0, 9.0)
FIELD = (2e-5, 1e-5, -4e-5)
TURNED = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
"""Chamber → sensor of a device whose x axis points up."""
FAST, SLOW = np.exp(-100.0 / 50.0), np.exp(-100.0 / 1000.0)


def lag(share: float) -> float:
    """T_lag − T [K] after a straight fall from T0, which a lag τ follows: τ (1 − e^(−Δt/τ))."""
    time_constant = -100.0 / np.log(share)
    return (T0 - T1) / 100.0 * time_constant * (1.0 - share)


CASES: dict[str, tuple[Sensor, dict[str, Any], Any]] = {
    'bias_creep': ('gyroscope', {'time_constant': 1000.0}, [np.log(1.7)]),
    'bias_drift': ('gyroscope', {}, [700.0]),
    'bias_temperature': ('gyroscope', {}, [-10.0]),
    'bias_temperature_curvature': ('gyroscope', {}, [100.0, -1000.0]),
    'compressor_hard_iron': (
        'magnetometer',
        {},
        [[0, 0, 0.25, 0.25, 0, 0], [0.25, 0, 0, 0, 0.25, 0], [0, 0.25, 0, 0, 0, 0.25]],
    ),
    'fixture_hard_iron': ('magnetometer', {}, [[0, 0, -10], [-10, 0, 0], [0, -10, 0]]),
    'fixture_tilt': ('accelerometer', {}, [[-90, -30, 0], [0, -20, 90], [20, 0, 30]]),
    'g_sensitivity_temperature': ('gyroscope', {}, [-20.0, 30.0, -90.0]),
    'heater_hard_iron': (
        'magnetometer',
        {},
        [[0, 0, 0.5, 0.5, 0, 0], [0.5, 0, 0, 0, 0.5, 0], [0, 0.5, 0, 0, 0, 0.5]],
    ),
    'misalignment_temperature': (
        'accelerometer',
        {},
        [[30, -90, 0, 0, 0, 0], [0, 0, -20, -90, 0, 0], [0, 0, 0, 0, -20, 30]],
    ),
    'scale_factor_temperature': ('accelerometer', {}, [[-20, 0, 0], [0, 30, 0], [0, 0, -90]]),
    'supply_sensitivity': ('gyroscope', {}, [0.2]),
    'thermal_gradient': ('gyroscope', {}, [-15.0]),
    'thermal_hysteresis': ('gyroscope', {'half_widths': (5.0, 30.0)}, [5.0, 20.0]),
    'thermal_lag': ('gyroscope', {'time_constant': 1000.0}, [lag(SLOW)]),
    'thermal_lag_two_stage': (
        'gyroscope',
        {'time_constant_fast': 50.0, 'time_constant_slow': 1000.0},
        [lag(FAST), lag(SLOW)],
    ),
    'turn_on_bias': ('gyroscope', {'first': 1.0, 'cycles': 2.0}, [0.0, 1.0]),
    'vibration_rectification': ('accelerometer', {}, [[1, 0, 0], [0, 2, 0], [0, 0, 4]]),
    'warm_up': ('gyroscope', {'time_constant': 700.0}, [np.exp(-1.0)]),
}
"""Effect → sensor, shape parameters, columns of the second sample."""


def conditions(sensor: Sensor) -> Conditions:
    both = np.ones((2, 1))
    return Conditions(
        time=np.array([600.0, 700.0]),
        temperature=np.array([T0, T1]),
        specific_force=both * FORCE,
        angular_velocity=np.zeros((2, 3)),
        magnetic_field=both * FIELD,
        sensor=sensor,
        orientation=TURNED,
        chamber_temperature=np.array([20.0, -5.0]),
        supply_voltage=np.array([3.3, 3.5]),
        heater=np.array([0.0, 0.5]),
        compressor=np.array([1.0, 0.25]),
        vibration=both * (1.0, 2.0, 4.0),
        cycle=np.array([1, 2]),
    )


@pytest.mark.parametrize('name', CASES)
def test_columns_are_those_of_the_equation(name: str) -> None:
    sensor, shape, expected = CASES[name]
    columns = EFFECTS[name](**shape).columns(conditions(sensor))[0]
    np.testing.assert_allclose(columns[1], expected, rtol=1e-9, atol=1e-12)
