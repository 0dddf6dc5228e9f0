# SPDX-License-Identifier: Apache-2.0
"""The fixture turns with temperature, and accelerometer and magnetometer with it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np
from imu_recording.recording import FloatArray

from thermal_comp.data.conditions import Conditions, Sensor
from thermal_comp.effects.effect import FLIP_ACTION, Effect, Kin, State


@dataclass(frozen=True)
class FixtureTilt(Effect):
    """The fixture tilts with temperature."""

    name: ClassVar[str] = 'fixture_tilt'
    kind: ClassVar[Literal['device', 'campaign']] = 'campaign'
    sensors: ClassVar[tuple[Sensor, ...]] = ('accelerometer', 'magnetometer')
    coupled: ClassVar[bool] = True
    channels: ClassVar[tuple[str, ...]] = ('orientation',)
    equation: ClassVar[str] = (
        'error = x · (R ω) × u,  ω fixed in the chamber, shared by both sensors; R = chamber → '
        'sensor, x = T − T₀ [K]'
    )
    coefficient_units: ClassVar[tuple[str, ...]] = ('rad/K',) * 3
    coefficient_symbols: ClassVar[tuple[str, ...]] = ('ω_x', 'ω_y', 'ω_z')
    mechanism: ClassVar[str] = 'Brackets bend and foam softens.'
    look_alikes: ClassVar[tuple[str, ...]] = (
        'misalignment_temperature',
        'scale_factor_temperature',
        'fixture_hard_iron',
    )
    separation: ClassVar[str] = (
        "Accelerometer and magnetometer agree on one rotation in the chamber's frame; a "
        'misalignment of the sensor turns with the device.'
    )
    typical_size: ClassVar[str] = '10–100 µrad/K: 6–60 mm/s² over 60 K'
    reference: ClassVar[str] = (
        'Titterton and Weston, Strapdown Inertial Navigation Technology, 2004, ch. 3'
    )
    kin: ClassVar[Kin] = 'orientation'
    separating_action: ClassVar[str] = FLIP_ACTION

    def columns(
        self, conditions: Conditions, state: State | None = None
    ) -> tuple[FloatArray, State | None]:
        """Return (n, 3, 3): x · (R e_k) × u for a turn about each chamber axis."""
        assert conditions.orientation is not None  # noqa: S101 (declared in channels)
        felt = conditions.true_input
        if conditions.sensor == 'magnetometer' and conditions.hard_iron is not None:
            felt = felt - conditions.hard_iron  # the offset turns with the device
        columns = np.cross(conditions.orientation.T[None, :, :], felt[:, None, :])
        columns = columns.transpose(0, 2, 1)
        return conditions.temperature_difference[:, None, None] * columns, None
