# SPDX-License-Identifier: Apache-2.0
"""Temperature coefficient of the gyroscope's sensitivity to acceleration."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from imu_recording.recording import FloatArray

from thermal_comp.data.conditions import Conditions, Sensor
from thermal_comp.effects.c_form import CColumns, CForm
from thermal_comp.effects.effect import FLIP_ACTION, Effect, Kin, State


@dataclass(frozen=True)
class GSensitivityTemperature(Effect):
    """The gyroscope's response to acceleration follows the die temperature."""

    name: ClassVar[str] = 'g_sensitivity_temperature'
    sensors: ClassVar[tuple[Sensor, ...]] = ('gyroscope',)
    equation: ClassVar[str] = 'error_i = x · Σ_j g_ij · f_j,  f = specific force, x = T − T₀ [K]'
    coefficient_units: ClassVar[tuple[str, ...]] = ('{unit}/(K·m/s²)',) * 3
    coefficient_symbols: ClassVar[tuple[str, ...]] = ('g_ix', 'g_iy', 'g_iz')
    mechanism: ClassVar[str] = (
        'Unequal masses of the tuning fork, whose balance shifts with temperature.'
    )
    look_alikes: ClassVar[tuple[str, ...]] = ('bias_temperature', 'turn_on_bias')
    separation: ClassVar[str] = (
        'The slope of the rate over temperature changes with orientation. The constant part is '
        'an offset per run and cannot be told from the turn-on bias.'
    )
    typical_size: ClassVar[str] = (
        '0.015–0.2 °/s/g at constant temperature; a few percent of that over 10 K'
    )
    reference: ClassVar[str] = 'IEEE 528 (acceleration-sensitive drift rate); IEEE 1431'
    kin: ClassVar[Kin] = 'orientation'
    separated_by_poses: ClassVar[tuple[Sensor, ...]] = ('gyroscope',)
    separating_action: ClassVar[str] = FLIP_ACTION

    def columns(
        self, conditions: Conditions, state: State | None = None
    ) -> tuple[FloatArray, State | None]:
        """Return (n, 3): x · f [K·m/s²]."""
        return conditions.temperature_difference[:, None] * conditions.specific_force, None

    def c_columns(self, c: CForm) -> CColumns:
        """Return x · f_j."""
        x = c.temperature_difference
        return CColumns([f'{x} * {c.specific_force(axis)}' for axis in range(3)])
