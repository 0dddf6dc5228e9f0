# SPDX-License-Identifier: Apache-2.0
"""Curvature of the bias over temperature."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from imu_recording.recording import FloatArray

from thermal_comp.data.conditions import Conditions
from thermal_comp.effects.c_form import CColumns, CForm
from thermal_comp.effects.effect import Effect, Kin, State


@dataclass(frozen=True)
class BiasTemperatureCurvature(Effect):
    """The bias bends over the die temperature."""

    name: ClassVar[str] = 'bias_temperature_curvature'
    equation: ClassVar[str] = 'error = a₂ · x² + a₃ · x³,  x = T − T₀ [K]'
    coefficient_units: ClassVar[tuple[str, ...]] = ('{unit}/K²', '{unit}/K³')
    coefficient_symbols: ClassVar[tuple[str, ...]] = ('a₂', 'a₃')
    mechanism: ClassVar[str] = (
        'Stress that does not grow in proportion to temperature, curvature of the bandgap '
        'reference. Both powers are one effect: an offset of the temperature sensor turns part '
        'of x³ into x².'
    )
    look_alikes: ClassVar[tuple[str, ...]] = ('icing', 'thermal_hysteresis')
    separation: ClassVar[str] = (
        'The same in every cycle and on both branches; icing needs temperatures below 0 °C and '
        'remembers them, hysteresis differs between heating and cooling.'
    )
    typical_size: ClassVar[str] = "5–50 % of the linear coefficient's effect over 60 K"
    reference: ClassVar[str] = (
        'IEEE 2700 (offset over temperature); IEEE 1293 (bias temperature model)'
    )
    bends: ClassVar[bool] = True
    temperature_only: ClassVar[bool] = True
    kin: ClassVar[Kin] = 'temperature'
    separated_by_cycles: ClassVar[tuple[str, ...]] = (
        'thermal_lag',
        'thermal_hysteresis',
        'warm_up',
    )

    def columns(
        self, conditions: Conditions, state: State | None = None
    ) -> tuple[FloatArray, State | None]:
        """Return (n, 2): x² [K²] and x³ [K³]."""
        x = conditions.temperature_difference
        square = x * x  # powers by multiplication: x**3 takes forty times as long
        return np.stack([square, square * x], axis=1), None

    def c_columns(self, c: CForm) -> CColumns:
        """Return x² and x³."""
        x = c.let(c.temperature_difference)
        return CColumns([f'{x} * {x}', f'{x} * {x} * {x}'])
