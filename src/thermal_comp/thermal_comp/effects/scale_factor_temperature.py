# SPDX-License-Identifier: Apache-2.0
"""Temperature coefficient of the scale factor."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from imu_recording.recording import FloatArray

from thermal_comp.data.conditions import Conditions, Sensor
from thermal_comp.effects.c_form import CColumns, CForm
from thermal_comp.effects.effect import FLIP_ACTION, Effect, Kin, State


@dataclass(frozen=True)
class ScaleFactorTemperature(Effect):
    """The scale factor of each axis follows the die temperature."""

    name: ClassVar[str] = 'scale_factor_temperature'
    equation: ClassVar[str] = 'error_i = s_i · x · u_i,  u = true input, x = T − T₀ [K]'
    coefficient_units: ClassVar[tuple[str, ...]] = ('1/K', '1/K', '1/K')
    coefficient_symbols: ClassVar[tuple[str, ...]] = ('s_x', 's_y', 's_z')
    mechanism: ClassVar[str] = (
        'Spring constant of silicon (−60 ppm/K), gaps, reference voltage; bridge gain of the '
        'magnetometer.'
    )
    look_alikes: ClassVar[tuple[str, ...]] = (
        'bias_temperature',
        'misalignment_temperature',
        'fixture_tilt',
    )
    separation: ClassVar[str] = (
        'Its slope over temperature changes with orientation on the axis that carries the input '
        'only. Three upward orientations separate it from the bias only if cross-axis terms are '
        'zero; a flipped one settles it.'
    )
    typical_size: ClassVar[str] = 'accelerometer 0.01–0.03 %/K, magnetometer 0.03 %/K'
    reference: ClassVar[str] = 'IEEE 2700 (sensitivity temperature coefficient); IEEE 1293 (K₁)'
    kin: ClassVar[Kin] = 'orientation'
    separated_by_poses: ClassVar[tuple[Sensor, ...]] = ('accelerometer', 'magnetometer')
    separating_action: ClassVar[str] = FLIP_ACTION

    def columns(
        self, conditions: Conditions, state: State | None = None
    ) -> tuple[FloatArray, State | None]:
        """Return (n, 3, 3): x · u_i for axis i, one coefficient per axis."""
        product = conditions.temperature_difference[:, None] * conditions.true_input
        columns = np.zeros((len(conditions), 3, 3))
        for axis in range(3):
            columns[:, axis, axis] = product[:, axis]
        return columns, None

    def c_columns(self, c: CForm) -> CColumns:
        """Return x · u_i on axis i."""
        x, y, z = (f'{c.temperature_difference} * {c.true_input(axis)}' for axis in range(3))
        return CColumns([(x, '', ''), ('', y, ''), ('', '', z)])
