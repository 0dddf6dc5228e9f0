# SPDX-License-Identifier: Apache-2.0
"""Bias that is new in every cycle of every run."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np
from imu_recording.recording import FloatArray

from thermal_comp.data.conditions import Conditions
from thermal_comp.effects.effect import Campaign, Candidate, Effect, Kin, State, shape_parameter


@dataclass(frozen=True)
class TurnOnBias(Effect):
    """Every cycle of every run has a bias of its own."""

    cycles: float = shape_parameter(4.0, unit='1', bounds=(2.0, 100.0))
    first: float = shape_parameter(2.0, unit='1', bounds=(1.0, 2.0))
    """First cycle with a bias of its own; 2: the first cycle has that of the time before it."""

    name: ClassVar[str] = 'turn_on_bias'
    kind: ClassVar[Literal['device', 'campaign']] = 'campaign'
    per_run: ClassVar[bool] = True
    channels: ClassVar[tuple[str, ...]] = ('cycle',)
    equation: ClassVar[str] = (
        'error = c_k,r in cycle k of run r, relative to what is before `first`'
    )
    coefficient_units: ClassVar[tuple[str, ...]] = ('{unit}',) * 3
    mechanism: ClassVar[str] = 'Power cycling, remagnetisation and handling between cycles.'
    look_alikes: ClassVar[tuple[str, ...]] = ('bias_drift', 'bias_creep', 'bias_step')
    separation: ClassVar[str] = 'Jumps at logged cycle or power boundaries and nowhere else.'
    typical_size: ClassVar[str] = (
        'between sessions: gyroscope 0.02–0.08 °/s, accelerometer 0.06–0.3 m/s²'
    )
    reference: ClassVar[str] = (
        'IEEE 528 (repeatability, turn-on to turn-on); Betta et al. 2022, Tables III–V'
    )
    time_only: ClassVar[bool] = True
    kin: ClassVar[Kin] = 'time'
    separating_action: ClassVar[str] = 'keep the power on between the cycles'

    def columns(
        self, conditions: Conditions, state: State | None = None
    ) -> tuple[FloatArray, State | None]:
        """Return (n, k): 1 in cycles `first`, …; what follows a cycle belongs to it."""
        assert conditions.cycle is not None  # noqa: S101 (declared in channels)
        before = 0 if state is None else state
        seen = np.maximum.accumulate(np.r_[before, conditions.cycle])
        numbers = np.arange(int(self.first), int(self.cycles) + 1)
        return (seen[1:, None] == numbers).astype(float), int(seen[-1])

    @classmethod
    def search_grid(cls, campaign: Campaign) -> list[Candidate]:
        """Return the levels of all cycles, with and without one before the first."""
        if campaign.cycles < 2:
            return []
        return [Candidate(cls(float(campaign.cycles), first)) for first in (2.0, 1.0)]
