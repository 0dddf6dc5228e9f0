# SPDX-License-Identifier: Apache-2.0
"""Sensitivity to the rate of change of temperature."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from imu_recording.recording import FloatArray

from thermal_comp.data.conditions import Conditions
from thermal_comp.effects.c_form import CColumns, CForm
from thermal_comp.effects.effect import Effect, Kin, State
from thermal_comp.effects.operators import follow

SMOOTHING = 30.0
"""Time constant of the derivative filter [s]; its second stage takes the delay out again."""


@dataclass(frozen=True)
class TemperatureRate(Effect):
    """The error is proportional to how fast the die temperature changes."""

    name: ClassVar[str] = 'temperature_rate'
    equation: ClassVar[str] = 'error = a · dT/dt'
    coefficient_units: ClassVar[tuple[str, ...]] = ('{unit}·s/K',)
    mechanism: ClassVar[str] = (
        'Thermo-elastic transients while heat flows through die and package.'
    )
    look_alikes: ClassVar[tuple[str, ...]] = ('thermal_gradient', 'thermal_lag')
    separation: ClassVar[str] = (
        'Constant in a ramp, zero in a dwell, without the tail of a lag; several ramp rates and '
        'many corners separate them, a changed heat path (fan) separates it from the gradient.'
    )
    typical_size: ClassVar[str] = 'gyroscope 1–10 m°/s per K/min'
    reference: ClassVar[str] = 'IEEE 952 and 1431 (temperature-rate sensitivity D_Ṫ)'
    kin: ClassVar[Kin] = 'temperature'
    twin: ClassVar[str] = 'thermal_gradient'
    separating_action: ClassVar[str] = 'change the heat path (fan speed) at the same profile'

    def columns(
        self, conditions: Conditions, state: State | None = None
    ) -> tuple[FloatArray, State | None]:
        """Return (n, 1): dT/dt [K/s], smoothed causally without delay to first order."""
        first_state, second_state = state if state is not None else (None, None)
        time, temperature = conditions.time, conditions.temperature
        lagged, first_state = follow(time, temperature, SMOOTHING, first_state)
        rate = (temperature - lagged) / SMOOTHING
        delayed, second_state = follow(time, rate, SMOOTHING, second_state)
        return (2.0 * rate - delayed)[:, None], (first_state, second_state)

    def c_columns(self, c: CForm) -> CColumns:
        """Return the smoothed derivative: rate plus what its second lag is behind it."""
        rate = f'(-{c.behind(c.temperature, SMOOTHING)} / {c.number(SMOOTHING)})'
        return CColumns([f'({rate} - {c.behind(rate, SMOOTHING)})'])

    def columns_in_hindsight(self, conditions: Conditions) -> FloatArray:
        """Return (n, 1): the derivative itself [K/s]; the temperature is smooth already."""
        return np.asarray(np.gradient(conditions.temperature, conditions.time))[:, None]
