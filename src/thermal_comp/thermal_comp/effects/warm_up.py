# SPDX-License-Identifier: Apache-2.0
"""Turn-on transient of the sensor."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Self

import numpy as np
from imu_recording.recording import FloatArray

from thermal_comp.data.conditions import Conditions
from thermal_comp.effects.c_form import CColumns, CForm
from thermal_comp.effects.effect import Campaign, Candidate, Effect, Kin, State, shape_parameter


@dataclass(frozen=True)
class WarmUp(Effect):
    """The bias settles exponentially after power-on."""

    time_constant: float = shape_parameter(600.0, unit='s', bounds=(60.0, 7200.0))

    name: ClassVar[str] = 'warm_up'
    equation: ClassVar[str] = 'error = a · exp(−t / τ),  t since power-on [s]'
    coefficient_units: ClassVar[tuple[str, ...]] = ('{unit}',)
    mechanism: ClassVar[str] = 'Self-heating and settling of charge after power-on.'
    look_alikes: ClassVar[tuple[str, ...]] = ('bias_creep', 'bias_drift')
    separation: ClassVar[str] = 'Restarts with each power cycle, not with each thermal cycle.'
    typical_size: ClassVar[str] = 'accelerometer 1–5 mg, τ 3–25 min'
    reference: ClassVar[str] = 'IEEE 528 (warm-up time)'
    time_only: ClassVar[bool] = True
    first_order: ClassVar[bool] = True
    kin: ClassVar[Kin] = 'time'
    separating_action: ClassVar[str] = 'power cycle in the middle of a dwell'

    def columns(
        self, conditions: Conditions, state: State | None = None
    ) -> tuple[FloatArray, State | None]:
        """Return (n, 1): exp(−t / τ), t since power-on."""
        return np.exp(-conditions.time / self.time_constant)[:, None], None

    def c_columns(self, c: CForm) -> CColumns:
        """Return exp(−t / τ)."""
        return CColumns([c.exp(f'-{c.time} / {c.number(self.time_constant)}')])

    @classmethod
    def search_grid(cls, campaign: Campaign) -> list[Candidate]:
        """Return time constants from a minute to two hours, less in a short recording."""
        times = campaign.time_scale * np.geomspace(60.0, 7200.0, 10)
        return [Candidate(cls(float(t))) for t in times]

    @classmethod
    def sample_forms(cls) -> list[Self]:
        """Return time constants from a minute to half an hour."""
        return [cls(t) for t in (60.0, 120.0, 300.0, 900.0, 1800.0)]
