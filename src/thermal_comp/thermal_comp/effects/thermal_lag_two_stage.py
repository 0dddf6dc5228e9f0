# SPDX-License-Identifier: Apache-2.0
"""A fast and a slow thermal lag, package and board."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import ClassVar

import numpy as np
from imu_recording.recording import FloatArray

from thermal_comp.data.conditions import Conditions
from thermal_comp.effects.c_form import CColumns, CForm
from thermal_comp.effects.effect import Campaign, Candidate, Effect, Kin, State, shape_parameter
from thermal_comp.effects.operators import follow
from thermal_comp.effects.thermal_lag import TIME_CONSTANTS_S, ThermalLag


@dataclass(frozen=True)
class ThermalLagTwoStage(Effect):
    """The element feels two lagged temperatures, a fast and a slow one."""

    time_constant_fast: float = shape_parameter(
        60.0, unit='s', bounds=(10.0, 1800.0), searched=(20.0, 1800.0)
    )
    time_constant_slow: float = shape_parameter(1200.0, unit='s', bounds=(120.0, 7200.0))

    name: ClassVar[str] = 'thermal_lag_two_stage'
    equation: ClassVar[str] = (
        'error = a₁ · (T_fast − T) + a₂ · (T_slow − T), each a first-order lag of T'
    )
    coefficient_units: ClassVar[tuple[str, ...]] = ('{unit}/K', '{unit}/K')
    coefficient_symbols: ClassVar[tuple[str, ...]] = ('a₁', 'a₂')
    mechanism: ClassVar[str] = (
        "Package and board reach the chamber's temperature at different speeds, and both stress "
        'the element.'
    )
    look_alikes: ClassVar[tuple[str, ...]] = ('thermal_lag', 'thermal_hysteresis')
    separation: ClassVar[str] = (
        'In a dwell the residual decays fast, then slowly: its logarithm is not straight. Needs '
        'a dwell of some hours.'
    )
    typical_size: ClassVar[str] = 'fast 0.5–2 min, slow 10–30 min; as thermal_lag'
    reference: ClassVar[str] = (
        'IEEE 1431 and 952 (environmentally sensitive drift), effects of temperature'
    )
    least_ratio: ClassVar[float] = 2.5
    kin: ClassVar[Kin] = 'temperature'

    def columns(
        self, conditions: Conditions, state: State | None = None
    ) -> tuple[FloatArray, State | None]:
        """Return (n, 2): T_fast − T and T_slow − T [K]."""
        time, temperature = conditions.time, conditions.temperature
        fast_state, slow_state = state if state is not None else (None, None)
        fast, fast_state = follow(time, temperature, self.time_constant_fast, fast_state)
        slow, slow_state = follow(time, temperature, self.time_constant_slow, slow_state)
        columns = np.stack([fast - temperature, slow - temperature], axis=1)
        return columns, (fast_state, slow_state)

    def c_columns(self, c: CForm) -> CColumns:
        """Return T_fast − T and T_slow − T_fast."""
        times = (self.time_constant_fast, self.time_constant_slow)
        return CColumns(c.behind_two(c.temperature, *times), np.array([[1.0, 1.0], [0.0, 1.0]]))

    @classmethod
    def search_grid(cls, campaign: Campaign) -> list[Candidate]:
        """Return pairs of lags that are well apart."""
        return [
            Candidate(cls(campaign.time_scale * fast, campaign.time_scale * slow))
            for fast, slow in combinations(TIME_CONSTANTS_S.tolist(), 2)
            if slow > cls.least_ratio * fast and fast <= 1800.0 and slow >= 120.0
        ]

    def parts(self) -> tuple[Effect, ...]:
        """Return the two lags."""
        return ThermalLag(self.time_constant_fast), ThermalLag(self.time_constant_slow)
