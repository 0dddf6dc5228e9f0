# SPDX-License-Identifier: Apache-2.0
"""Magnetic field of the chamber's heater."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

from imu_recording.recording import FloatArray

from thermal_comp.data.conditions import Conditions, Sensor
from thermal_comp.effects.effect import Effect, State
from thermal_comp.effects.operators import chamber_and_device_field


@dataclass(frozen=True)
class HeaterHardIron(Effect):
    """The field of the heater adds to the measured one."""

    name: ClassVar[str] = 'heater_hard_iron'
    kind: ClassVar[Literal['device', 'campaign']] = 'campaign'
    sensors: ClassVar[tuple[Sensor, ...]] = ('magnetometer',)
    channels: ClassVar[tuple[str, ...]] = ('heater', 'orientation')
    equation: ClassVar[str] = (
        'error = (R · b + d) · s(t),  s = heater state (0 … 1), '
        "b fixed in the chamber, d on the device's mount, R = chamber → sensor"
    )
    coefficient_units: ClassVar[tuple[str, ...]] = ('{unit}',) * 6
    coefficient_symbols: ClassVar[tuple[str, ...]] = ('b_x', 'b_y', 'b_z', 'd_x', 'd_y', 'd_z')
    mechanism: ClassVar[str] = "The heater's current loop makes a magnetic field."
    look_alikes: ClassVar[tuple[str, ...]] = ('temperature_rate', 'compressor_hard_iron')
    separation: ClassVar[str] = (
        'A square wave in step with the logged heater, in a direction that is fixed in the '
        'chamber: drive heater and temperature independently.'
    )
    typical_size: ClassVar[str] = '1 A at 0.2 m: 1 µT (long straight wire)'
    reference: ClassVar[str] = 'Biot–Savart law'
    separating_action: ClassVar[str] = (
        'log the heater current; switch the heater at constant temperature'
    )

    def columns(
        self, conditions: Conditions, state: State | None = None
    ) -> tuple[FloatArray, State | None]:
        """Return (n, 3, 6): heater state × unit field along each chamber and each sensor axis."""
        assert conditions.heater is not None  # noqa: S101 (declared in channels)
        return chamber_and_device_field(conditions, conditions.heater), None
