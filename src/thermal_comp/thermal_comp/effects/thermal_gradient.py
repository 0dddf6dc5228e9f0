# SPDX-License-Identifier: Apache-2.0
"""Sensitivity to the temperature difference across the package."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from imu_recording.recording import FloatArray

from thermal_comp.data.conditions import Conditions
from thermal_comp.effects.c_form import CColumns, CForm
from thermal_comp.effects.effect import Effect, Kin, State


@dataclass(frozen=True)
class ThermalGradient(Effect):
    """The error is proportional to the difference between a second thermometer and the die."""

    name: ClassVar[str] = 'thermal_gradient'
    channels: ClassVar[tuple[str, ...]] = ('chamber_temperature',)
    equation: ClassVar[str] = 'error = a · (T_outside − T), outside = second thermometer'
    coefficient_units: ClassVar[tuple[str, ...]] = ('{unit}/K',)
    mechanism: ClassVar[str] = (
        'A temperature difference between surroundings and die bends the package.'
    )
    look_alikes: ClassVar[tuple[str, ...]] = ('temperature_rate', 'thermal_lag')
    separation: ClassVar[str] = (
        'Peaks at the start of a ramp. On a slow symmetrical profile nearly the same as the '
        'rate: needs a second thermometer and asymmetrical heating.'
    )
    typical_size: ClassVar[str] = 'as temperature_rate'
    reference: ClassVar[str] = 'IEEE 952 and 1431 (temperature-gradient sensitivity D_∇T)'
    kin: ClassVar[Kin] = 'temperature'
    twin: ClassVar[str] = 'temperature_rate'
    separating_action: ClassVar[str] = (
        'log a second thermometer and change the heat path (fan speed)'
    )

    def columns(
        self, conditions: Conditions, state: State | None = None
    ) -> tuple[FloatArray, State | None]:
        """Return (n, 1): T_outside − T [K], of the thermometer on the device or of the air."""
        outside = conditions.chamber_temperature
        assert outside is not None  # noqa: S101 (declared in channels)
        return (outside - conditions.temperature)[:, None], None

    def c_columns(self, c: CForm) -> CColumns:
        """Return T_outside − T."""
        return CColumns([f'({c.channel("chamber_temperature")} - {c.temperature})'])
