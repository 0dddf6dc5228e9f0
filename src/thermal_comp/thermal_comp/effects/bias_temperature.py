# SPDX-License-Identifier: Apache-2.0
"""Linear temperature coefficient of the bias."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from imu_recording.recording import FloatArray

from thermal_comp.data.conditions import Conditions
from thermal_comp.effects.c_form import CColumns, CForm
from thermal_comp.effects.effect import Effect, State


@dataclass(frozen=True)
class BiasTemperature(Effect):
    """The bias follows the die temperature in a straight line."""

    name: ClassVar[str] = 'bias_temperature'
    equation: ClassVar[str] = 'error = a · x,  x = T − T₀ [K]'
    coefficient_units: ClassVar[tuple[str, ...]] = ('{unit}/K',)
    mechanism: ClassVar[str] = (
        'Different thermal expansion of die, glue and package, and the drift of the electronics.'
    )
    look_alikes: ClassVar[tuple[str, ...]] = ('scale_factor_temperature', 'fixture_hard_iron')
    separation: ClassVar[str] = (
        'The slope is the same in every orientation; a scale factor or fixture turns with it.'
    )
    typical_size: ClassVar[str] = (
        'accelerometer 0.15–1 mg/K, gyroscope 0.005–0.05 °/s/K, magnetometer 0.05–0.3 µT/K'
    )
    reference: ClassVar[str] = 'IEEE 2700 (zero-g, zero-rate, zero-field offset over temperature)'
    searched: ClassVar[bool] = False
    temperature_coefficient: ClassVar[bool] = True
    temperature_only: ClassVar[bool] = True

    def columns(
        self, conditions: Conditions, state: State | None = None
    ) -> tuple[FloatArray, State | None]:
        """Return (n, 1): temperature difference [K]."""
        return conditions.temperature_difference[:, None], None

    def c_columns(self, c: CForm) -> CColumns:
        """Return the temperature difference."""
        return CColumns([c.temperature_difference])
