# SPDX-License-Identifier: Apache-2.0
"""Field of magnetised fixture parts that changes with temperature."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

from imu_recording.recording import FloatArray

from thermal_comp.data.conditions import Conditions, Sensor
from thermal_comp.effects.effect import FLIP_ACTION, Effect, Kin, State
from thermal_comp.effects.operators import chamber_field


@dataclass(frozen=True)
class FixtureHardIron(Effect):
    """The field of the fixture follows the temperature."""

    name: ClassVar[str] = 'fixture_hard_iron'
    kind: ClassVar[Literal['device', 'campaign']] = 'campaign'
    sensors: ClassVar[tuple[Sensor, ...]] = ('magnetometer',)
    channels: ClassVar[tuple[str, ...]] = ('orientation',)
    equation: ClassVar[str] = (
        'error = R · b · x,  b fixed in the chamber, R = chamber → sensor, x = T − T₀ [K]'
    )
    coefficient_units: ClassVar[tuple[str, ...]] = ('{unit}/K',) * 3
    coefficient_symbols: ClassVar[tuple[str, ...]] = ('b_x', 'b_y', 'b_z')
    mechanism: ClassVar[str] = 'The remanence of chamber and fixture parts depends on temperature.'
    look_alikes: ClassVar[tuple[str, ...]] = (
        'bias_temperature',
        'scale_factor_temperature',
        'misalignment_temperature',
    )
    separation: ClassVar[str] = (
        "The vector turns with the orientation of the device; the sensor's own bias does not."
    )
    typical_size: ClassVar[str] = '0.01–0.1 µT/K'
    reference: ClassVar[str] = 'Remanence temperature coefficients of ferritic steel'
    kin: ClassVar[Kin] = 'orientation'
    separating_action: ClassVar[str] = FLIP_ACTION

    def columns(
        self, conditions: Conditions, state: State | None = None
    ) -> tuple[FloatArray, State | None]:
        """Return (n, 3, 3): x [K] × unit field along each chamber axis."""
        return chamber_field(conditions, conditions.temperature_difference), None
