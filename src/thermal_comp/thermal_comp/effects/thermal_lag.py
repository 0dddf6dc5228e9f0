# SPDX-License-Identifier: Apache-2.0
"""The sensing element follows the temperature sensor with a first-order lag."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np
from imu_recording.recording import FloatArray

from thermal_comp.data.conditions import Conditions
from thermal_comp.effects.c_form import CColumns, CForm
from thermal_comp.effects.effect import Campaign, Candidate, Effect, Kin, State, shape_parameter
from thermal_comp.effects.operators import follow

TIME_CONSTANTS_S = np.geomspace(20.0, 7000.0, 18)
"""Time constants a search tries [s]; a faster lag looks like a rate of change in block means."""


@dataclass(frozen=True)
class ThermalLag(Effect):
    """The sensing element follows the temperature sensor with a first-order lag."""

    time_constant: float = shape_parameter(
        300.0, unit='s', bounds=(10.0, 3600.0), searched=(20.0, 3600.0)
    )

    name: ClassVar[str] = 'thermal_lag'
    equation: ClassVar[str] = 'error = a · (T_lag − T),  dT_lag/dt = (T − T_lag) / τ'
    coefficient_units: ClassVar[tuple[str, ...]] = ('{unit}/K',)
    mechanism: ClassVar[str] = (
        "The stress or temperature of the element lags behind the die's thermometer: package "
        '5–15 s, board minutes.'
    )
    look_alikes: ClassVar[tuple[str, ...]] = (
        'temperature_rate',
        'thermal_gradient',
        'thermal_lag_two_stage',
        'thermal_hysteresis',
    )
    separation: ClassVar[str] = (
        'A loop that opens in ramps in proportion to their rate and closes exponentially in '
        'dwells: look at the first three time constants of each dwell; temperature rate has no '
        'such tail, hysteresis does not close.'
    )
    typical_size: ClassVar[str] = (
        'loop width = linear coefficient × τ × rate: 0.05 °/s/K · 2 min · 2 K/min = 0.2 °/s'
    )
    reference: ClassVar[str] = (
        'IEEE 1431 and 952 (environmentally sensitive drift), effects of temperature'
    )
    first_order: ClassVar[bool] = True
    kin: ClassVar[Kin] = 'temperature'
    separated_by_cycles: ClassVar[tuple[str, ...]] = ('thermal_hysteresis', 'temperature_rate')

    def columns(
        self, conditions: Conditions, state: State | None = None
    ) -> tuple[FloatArray, State | None]:
        """Return (n, 1): T_lag − T [K]."""
        lagged, state = follow(conditions.time, conditions.temperature, self.time_constant, state)
        return (lagged - conditions.temperature)[:, None], state

    def c_columns(self, c: CForm) -> CColumns:
        """Return T_lag − T."""
        return CColumns([c.behind(c.temperature, self.time_constant)])

    @classmethod
    def search_grid(cls, campaign: Campaign) -> list[Candidate]:
        """Return lags from the fastest that is more than a rate of change in such runs."""
        times = TIME_CONSTANTS_S[TIME_CONSTANTS_S <= 3600.0]
        return [Candidate(cls(float(t))) for t in campaign.time_scale * times]

    @classmethod
    def sample_forms(cls) -> list[Self]:
        """Return lags from a package's to a board's."""
        return [cls(t) for t in (60.0, 120.0, 300.0, 900.0, 1800.0)]
