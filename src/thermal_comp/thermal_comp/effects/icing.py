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

ENDLESS_WATER_S = 100_000.0
"""Time in which the water would be used up at −10 °C where it never is."""
MELT_RATIOS = (0.5, 1.0, 2.0, 4.0)
"""How much faster ice melts at 10 °C than it grows at −10 °C."""


@dataclass(frozen=True)
class Icing(Effect):
    """Ice grows below 0 °C and melts above."""

    growth_time: float = shape_parameter(3600.0, unit='s', bounds=(60.0, 100_000.0))
    melt_time: float = shape_parameter(600.0, unit='s', bounds=(30.0, 200_000.0))
    by_degrees: float = shape_parameter(0.0, unit='1', bounds=(0.0, 1.0))
    """1: growth and melt are proportional to the distance from 0 °C, the times those at 10 K from
    it, and growth ends when the water is used up; 0: m nears 1 and 0 at its own pace."""

    name: ClassVar[str] = 'icing'
    kind: ClassVar[Literal['device', 'campaign']] = 'campaign'
    optional_channels: ClassVar[tuple[str, ...]] = ('device_temperature',)
    equation: ClassVar[str] = (
        'error = a · m,  dm/dt = (1 − m) / t_grow below 0 °C, −m / t_melt above;  by degrees: '
        'dm/dt = −T / (10 K · t_grow) below 0 °C, −T / (10 K · t_melt) above, 0 ≤ m ≤ 1'
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
    reference: ClassVar[str] = (
        'IEC 60068-2-30 (damp heat), condensation; growth and melt by degrees: Hock, Temperature '
        'index melt modelling in mountain areas, J. Hydrology 282, 2003'
    )
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
            by_degrees=self.by_degrees > 0.5,
        )
        return ice[:, None], state

    @classmethod
    def search_grid(cls, campaign: Campaign) -> list[Candidate]:
        """Return pairs of times in which ice grows and melts, the water used up or not."""
        grow, melt = np.geomspace(300.0, 10_000.0, 6), np.geomspace(60.0, 2500.0, 7)
        own = [cls(float(g), float(m)) for g in grow for m in melt]
        times = [*np.geomspace(750.0, 6000.0, 4).tolist(), ENDLESS_WATER_S]
        by_degrees = [cls(time, time / ratio, 1.0) for time in times for ratio in MELT_RATIOS]
        return [Candidate(form) for form in (*own, *by_degrees)]
