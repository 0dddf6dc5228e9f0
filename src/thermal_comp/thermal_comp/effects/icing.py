# SPDX-License-Identifier: Apache-2.0
"""Condensed water and ice on the board."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np
from imu_recording.recording import FloatArray

from thermal_comp.data.conditions import Conditions
from thermal_comp.effects.effect import Campaign, Candidate, Effect, Kin, State, shape_parameter
from thermal_comp.effects.operators import grow_and_melt


@dataclass(frozen=True)
class Icing(Effect):
    """Ice grows below 0 °C and melts above."""

    growth_time: float = shape_parameter(3600.0, unit='s', bounds=(60.0, 100_000.0))
    melt_time: float = shape_parameter(600.0, unit='s', bounds=(30.0, 20_000.0))

    name: ClassVar[str] = 'icing'
    kind: ClassVar[Literal['device', 'campaign']] = 'campaign'
    optional_channels: ClassVar[tuple[str, ...]] = ('device_temperature',)
    equation: ClassVar[str] = (
        'error = a · m,  dm/dt = (1 − m) / t_grow below 0 °C, −m / t_melt above'
    )
    coefficient_units: ClassVar[tuple[str, ...]] = ('{unit}',)
    mechanism: ClassVar[str] = (
        'Frost grows on board and package below 0 °C and melts above, and stresses both.'
    )
    look_alikes: ClassVar[tuple[str, ...]] = (
        'humidity',
        'bias_temperature_curvature',
        'thermal_hysteresis',
    )
    separation: ClassVar[str] = (
        'Appears only after temperatures below 0 °C, remembers them until the melt, is absent '
        'with dry purge.'
    )
    typical_size: ClassVar[str] = 'as humidity; vanishes with a bag of desiccant'
    reference: ClassVar[str] = 'IEC 60068-2-30 (damp heat), condensation'
    kin: ClassVar[Kin] = 'temperature'
    separating_action: ClassVar[str] = 'purge with dry gas; stay 2 K above and below 0 °C'

    def columns(
        self, conditions: Conditions, state: State | None = None
    ) -> tuple[FloatArray, State | None]:
        """Return (n, 1): amount of ice, 0 … 1, by the thermometer on the device or the die's."""
        surface = conditions.device_temperature
        ice, state = grow_and_melt(
            conditions.time,
            conditions.temperature if surface is None else surface,
            self.growth_time,
            self.melt_time,
            state,
        )
        return ice[:, None], state

    @classmethod
    def search_grid(cls, campaign: Campaign) -> list[Candidate]:
        """Return pairs of times in which ice grows and melts."""
        grow, melt = np.geomspace(300.0, 10_000.0, 6), np.geomspace(60.0, 2500.0, 7)
        return [Candidate(cls(float(g), float(m))) for g in grow for m in melt]
