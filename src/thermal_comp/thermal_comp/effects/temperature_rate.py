# SPDX-License-Identifier: Apache-2.0
"""Sensitivity to the rate of change of temperature."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

from imu_recording.recording import FloatArray

from thermal_comp.data.conditions import Conditions
from thermal_comp.effects.c_form import CColumns, CForm
from thermal_comp.effects.effect import Effect, Kin, State, shape_parameter
from thermal_comp.effects.operators import follow

SMOOTHINGS_S = (0.3, 1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1000.0)
"""Time constants of the derivative filter that are tried [s]."""


@dataclass(frozen=True)
class TemperatureRate(Effect):
    """The error is proportional to how fast the die temperature changes."""

    smoothing: float = shape_parameter(
        30.0, unit='s', bounds=(0.1, 10_000.0), given=True, assumed=True
    )
    """Time constant of the derivative filter, whose second stage takes the delay out again.

    The longer, the less of the thermometer's noise comes through, and the later its corners.
    """

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
    differentiates: ClassVar[bool] = True
    kin: ClassVar[Kin] = 'temperature'
    twin: ClassVar[str] = 'thermal_gradient'
    separating_action: ClassVar[str] = 'change the heat path (fan speed) at the same profile'

    def columns(
        self, conditions: Conditions, state: State | None = None
    ) -> tuple[FloatArray, State | None]:
        """Return (n, 1): dT/dt [K/s], smoothed causally without delay to first order."""
        first_state, second_state = state if state is not None else (None, None)
        time, temperature = conditions.time, conditions.temperature
        lagged, first_state = follow(time, temperature, self.smoothing, first_state)
        rate = (temperature - lagged) / self.smoothing
        delayed, second_state = follow(time, rate, self.smoothing, second_state)
        return (2.0 * rate - delayed)[:, None], (first_state, second_state)

    def live_forms(self) -> tuple[TemperatureRate, ...]:
        """Return it with derivatives smoothed over less than a second to a quarter of an hour."""
        others = [value for value in SMOOTHINGS_S if value != self.smoothing]
        return (self, *(replace(self, smoothing=value) for value in others))

    def c_columns(self, c: CForm) -> CColumns:
        """Return the smoothed derivative: rate plus what its second lag is behind it."""
        rate = f'(-{c.behind(c.temperature, self.smoothing)} / {c.number(self.smoothing)})'
        return CColumns([f'({rate} - {c.behind(rate, self.smoothing)})'])

    def columns_in_hindsight(self, conditions: Conditions) -> FloatArray:
        """Return (n, 1): the derivative itself [K/s]; the temperature is smooth already."""
        return conditions.temperature_rate[:, None]
