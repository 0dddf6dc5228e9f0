# SPDX-License-Identifier: Apache-2.0
"""Temperature coefficient of the cross-axis sensitivity."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from imu_recording.recording import FloatArray

from thermal_comp.data.conditions import Conditions
from thermal_comp.effects.c_form import CColumns, CForm
from thermal_comp.effects.effect import FLIP_ACTION, Effect, Kin, State

AXIS_PAIRS = ((0, 1), (0, 2), (1, 0), (1, 2), (2, 0), (2, 1))
"""Erring axis i and input axis j of each coefficient."""


@dataclass(frozen=True)
class MisalignmentTemperature(Effect):
    """The cross-axis sensitivity follows the die temperature."""

    name: ClassVar[str] = 'misalignment_temperature'
    equation: ClassVar[str] = 'error_i = x · Σ_{j ≠ i} k_ij · u_j,  u = true input, x = T − T₀ [K]'
    coefficient_units: ClassVar[tuple[str, ...]] = ('rad/K',) * 6
    coefficient_symbols: ClassVar[tuple[str, ...]] = (
        'k_xy',
        'k_xz',
        'k_yx',
        'k_yz',
        'k_zx',
        'k_zy',
    )
    mechanism: ClassVar[str] = (
        'The die turns and shears on its soft glue as package stress changes.'
    )
    look_alikes: ClassVar[tuple[str, ...]] = (
        'scale_factor_temperature',
        'fixture_tilt',
        'g_sensitivity_temperature',
    )
    separation: ClassVar[str] = (
        'Its slope differs between orientations on the axes that do not carry the input. An '
        'antisymmetric part that accelerometer and magnetometer share is a rotation of package '
        'or fixture.'
    )
    typical_size: ClassVar[str] = '10–50 µrad/K'
    reference: ClassVar[str] = (
        'IEEE 2700 (cross-axis sensitivity); IEEE 1293 (misalignment δ_o, δ_p)'
    )
    kin: ClassVar[Kin] = 'orientation'
    separating_action: ClassVar[str] = FLIP_ACTION

    def columns(
        self, conditions: Conditions, state: State | None = None
    ) -> tuple[FloatArray, State | None]:
        """Return (n, 3, 6): x · u_j on axis i, in the order of `AXIS_PAIRS`."""
        product = conditions.temperature_difference[:, None] * conditions.true_input
        columns = np.zeros((len(conditions), 3, len(AXIS_PAIRS)))
        for k, (i, j) in enumerate(AXIS_PAIRS):
            columns[:, i, k] = product[:, j]
        return columns, None

    def c_columns(self, c: CForm) -> CColumns:
        """Return x · u_j on axis i, in the order of `AXIS_PAIRS`."""
        x = c.temperature_difference
        columns = []
        for i, j in AXIS_PAIRS:
            product = f'{x} * {c.true_input(j)}'
            columns.append((product * (i == 0), product * (i == 1), product * (i == 2)))
        return CColumns(columns)
