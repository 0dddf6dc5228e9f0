# SPDX-License-Identifier: Apache-2.0
"""Vibration rectification: even-order response to vibration."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from imu_recording.recording import FloatArray

from thermal_comp.data.conditions import Conditions, Sensor
from thermal_comp.effects.c_form import CColumns, CForm
from thermal_comp.effects.effect import Effect, State


@dataclass(frozen=True)
class VibrationRectification(Effect):
    """Vibration leaves an offset that grows with its variance."""

    name: ClassVar[str] = 'vibration_rectification'
    sensors: ClassVar[tuple[Sensor, ...]] = ('accelerometer', 'gyroscope')
    channels: ClassVar[tuple[str, ...]] = ('vibration',)
    equation: ClassVar[str] = (
        'error_i = k_i · ⟨a_i²⟩ (accelerometer), k_i · Σ_j ⟨a_j²⟩ (gyroscope), variance within '
        "the sample's interval"
    )
    coefficient_units: ClassVar[tuple[str, ...]] = ('{unit}/(m/s²)²',) * 3
    coefficient_symbols: ClassVar[tuple[str, ...]] = ('k_x', 'k_y', 'k_z')
    mechanism: ClassVar[str] = (
        'Even-order non-linearity and asymmetric clipping turn vibration into an offset.'
    )
    look_alikes: ClassVar[tuple[str, ...]] = ('compressor_hard_iron', 'supply_sensitivity')
    separation: ClassVar[str] = (
        'Follows the variance of the vibration, not merely whether the compressor runs.'
    )
    typical_size: ClassVar[str] = '0.1–1 mg/g²; a compressor gives 0.002–0.1 mg'
    reference: ClassVar[str] = 'IEEE 1293 (vibration rectification error, K₂)'
    separating_action: ClassVar[str] = 'log vibration; run the compressor at constant temperature'

    def columns(
        self, conditions: Conditions, state: State | None = None
    ) -> tuple[FloatArray, State | None]:
        """Return (n, 3, 3): the variance along each axis (accelerometer); (n, 1): its sum."""
        vibration = conditions.vibration
        assert vibration is not None  # noqa: S101 (declared in channels)
        if conditions.sensor == 'accelerometer':
            return vibration[:, :, None] * np.eye(3), None
        return vibration.sum(axis=1)[:, None], None

    def c_columns(self, c: CForm) -> CColumns:
        """Return the variance along each axis (accelerometer), its sum (gyroscope)."""
        x, y, z = (c.channel('vibration', axis) for axis in range(3))
        if c.sensor == 'accelerometer':
            return CColumns([(x, '', ''), ('', y, ''), ('', '', z)])
        return CColumns([f'({x} + {y} + {z})'])
