# SPDX-License-Identifier: Apache-2.0
"""Logarithmic creep of the bias."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np
from imu_recording.recording import FloatArray

from thermal_comp.data.conditions import Conditions
from thermal_comp.effects.effect import Campaign, Candidate, Effect, Kin, State, shape_parameter


@dataclass(frozen=True)
class BiasCreep(Effect):
    """The bias creeps ever more slowly."""

    time_constant: float = shape_parameter(
        1800.0, unit='s', bounds=(30.0, 30_000.0), searched=(30.0, 8000.0)
    )
    from_first_run: float = shape_parameter(0.0, unit='1', bounds=(0.0, 1.0))
    """1: t counts from the first run of the campaign, as after one change of stress; 0: from the
    start of each run."""

    name: ClassVar[str] = 'bias_creep'
    kind: ClassVar[Literal['device', 'campaign']] = 'campaign'
    equation: ClassVar[str] = (
        'error = a · ln(1 + t / t₀),  t since the first sample of the run, or of the first run [s]'
    )
    coefficient_units: ClassVar[tuple[str, ...]] = ('{unit}',)
    mechanism: ClassVar[str] = 'The adhesive creeps after a change of stress.'
    look_alikes: ClassVar[tuple[str, ...]] = ('bias_drift', 'warm_up', 'turn_on_bias')
    separation: ClassVar[str] = (
        'Its slope decays from cycle to cycle; a power cycle in mid-soak restarts a warm-up but '
        'not creep.'
    )
    typical_size: ClassVar[str] = 'a fraction of the drift, in the first hours'
    reference: ClassVar[str] = (
        'Findley, Creep and Relaxation of Nonlinear Viscoelastic Materials, 1976 (logarithmic '
        'creep)'
    )
    time_only: ClassVar[bool] = True
    kin: ClassVar[Kin] = 'time'
    separating_action: ClassVar[str] = (
        'power cycle in the middle of a dwell; soak ten times the expected t₀'
    )

    def columns(
        self, conditions: Conditions, state: State | None = None
    ) -> tuple[FloatArray, State | None]:
        """Return (n, 1): ln(1 + t / t₀)."""
        time = conditions.time + self.from_first_run * conditions.time_before
        return np.log1p(np.maximum(time, 0.0) / self.time_constant)[:, None], None

    @classmethod
    def search_grid(cls, campaign: Campaign) -> list[Candidate]:
        """Return times up to where a run of some hours cannot tell creep from drift."""
        counted = (0.0, 1.0) if any(campaign.times_before) else (0.0,)
        times = (campaign.time_scale * np.geomspace(60.0, 8000.0, 6)).tolist()
        return [Candidate(cls(time, first)) for first in counted for time in times]
