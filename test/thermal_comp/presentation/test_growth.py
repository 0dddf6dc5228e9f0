# SPDX-License-Identifier: Apache-2.0
"""An added effect is shown with its parameters and the error that is left, in noise floors."""

import numpy as np
from thermal_comp.effects import EFFECTS
from thermal_comp.model.values import SensorModel, ThermalModel, fitted_shapes
from thermal_comp.presentation.growth import shape_lines


def model(*effects: str, **std: tuple[float, ...]) -> ThermalModel:
    return ThermalModel(
        device='board',
        sensors={
            'gyroscope': SensorModel(
                effects=tuple(EFFECTS[name]() for name in effects),
                coefficients=(),
                covariance=np.zeros((0, 0)),
                shape_std={name.replace('__', '.'): value for name, value in std.items()},
            )
        },
    )


def test_parameters_are_told_with_their_standard_deviations() -> None:
    grown = model('thermal_lag', 'turn_on_bias', thermal_lag__time_constant=(3.46,))
    (row,) = fitted_shapes(grown)
    assert (row['value'], row['std'], row['unit']) == (300.0, 3.46, 's')
    assert shape_lines([row]) == ['gyroscope, thermal_lag: time constant 300.0 ± 3.5 s']


def test_several_values_and_unknown_deviations_are_told() -> None:
    (row,) = fitted_shapes(model('thermal_hysteresis', thermal_hysteresis__half_widths=(0.15,)))
    assert shape_lines([row]) == ['gyroscope, thermal_hysteresis: half widths 6.00 ± 0.15 K']
    (bare,) = fitted_shapes(model('warm_up'))
    assert bare['std'] is None
    assert shape_lines([bare]) == ['gyroscope, warm_up: time constant 600 s']
