# SPDX-License-Identifier: Apache-2.0
"""Sensitivity to the supply voltage."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from imu_recording.recording import FloatArray

from thermal_comp.data.conditions import Conditions
from thermal_comp.effects.c_form import CColumns, CForm
from thermal_comp.effects.effect import Effect, State

NOMINAL_SUPPLY_V = 3.3
"""Voltage the bias refers to [V]."""


@dataclass(frozen=True)
class SupplySensitivity(Effect):
    """The bias follows the supply voltage."""

    name: ClassVar[str] = 'supply_sensitivity'
    channels: ClassVar[tuple[str, ...]] = ('supply_voltage',)
    equation: ClassVar[str] = 'error = a · (V − V₀),  V₀ = 3.3 V'
    coefficient_units: ClassVar[tuple[str, ...]] = ('{unit}/V',)
    mechanism: ClassVar[str] = 'Finite supply rejection: regulator drift, load steps.'
    look_alikes: ClassVar[tuple[str, ...]] = ('warm_up', 'compressor_hard_iron')
    separation: ClassVar[str] = (
        'Follows the logged voltage with the same shape in several channels.'
    )
    typical_size: ClassVar[str] = '0.1–1 % of full-scale offset per volt: 10 mV are 0.1–1 mg'
    reference: ClassVar[str] = (
        'Datasheets: offset change with supply; IEEE 952 (voltage sensitivity)'
    )
    separating_action: ClassVar[str] = 'log and step the supply voltage'

    def columns(
        self, conditions: Conditions, state: State | None = None
    ) -> tuple[FloatArray, State | None]:
        """Return (n, 1): V − 3.3 V."""
        assert conditions.supply_voltage is not None  # noqa: S101 (declared in channels)
        return (conditions.supply_voltage - NOMINAL_SUPPLY_V)[:, None], None

    def c_columns(self, c: CForm) -> CColumns:
        """Return V − 3.3 V."""
        return CColumns([f'({c.channel("supply_voltage")} - {c.number(NOMINAL_SUPPLY_V)})'])
