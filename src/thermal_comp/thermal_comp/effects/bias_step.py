# SPDX-License-Identifier: Apache-2.0
"""A step of the bias."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np
from imu_recording.recording import FloatArray

from thermal_comp.data.conditions import Conditions
from thermal_comp.effects.effect import Campaign, Candidate, Effect, Kin, State, shape_parameter

SPACING_S = 1200.0
"""Distance of the step times a search tries [s]."""


@dataclass(frozen=True)
class BiasStep(Effect):
    """The bias changes once, within a moment, and stays."""

    step_time: tuple[float, ...] = shape_parameter(
        (20_000.0,), unit='s', bounds=(0.0, 1e7), step=400.0
    )
    duration: float = shape_parameter(0.0, unit='s', bounds=(0.0, 300.0), step=20.0)

    name: ClassVar[str] = 'bias_step'
    kind: ClassVar[Literal['device', 'campaign']] = 'campaign'
    per_run: ClassVar[bool] = True
    equation: ClassVar[str] = (
        'error = Σ_j a_jr · H((t − t_j) / d) in run r,  t since the first sample [s], '
        'H rises from 0 to 1 between −½ and ½'
    )
    coefficient_units: ClassVar[tuple[str, ...]] = ('{unit}',)
    mechanism: ClassVar[str] = (
        'Stress relief: a crack or slip of solder or glue, at once or within seconds.'
    )
    look_alikes: ClassVar[tuple[str, ...]] = ('turn_on_bias', 'bias_drift')
    separation: ClassVar[str] = (
        'One edge, often on several axes at once; if it falls on a cycle boundary it looks like '
        'a turn-on bias.'
    )
    typical_size: ClassVar[str] = 'accelerometer 0.5–5 mg, gyroscope 0.01–0.1 °/s'
    reference: ClassVar[str] = 'IEEE 528 (bias stability); common in data of packaged MEMS'
    repeatable: ClassVar[bool] = True
    time_only: ClassVar[bool] = True
    kin: ClassVar[Kin] = 'time'
    separating_action: ClassVar[str] = 'repeat the run'

    def columns(
        self, conditions: Conditions, state: State | None = None
    ) -> tuple[FloatArray, State | None]:
        """Return (n, p): 1 after each step, 0 before."""
        since = conditions.time[:, None] - np.array(self.step_time)
        if self.duration == 0.0:
            return (since >= 0.0).astype(float), None
        return np.clip(since / self.duration + 0.5, 0.0, 1.0), None

    @classmethod
    def search_grid(cls, campaign: Campaign) -> list[Candidate]:
        """Return steps all along, in all runs at once or in one, and each run's likeliest."""
        found = []
        for time in np.arange(SPACING_S, max(campaign.durations), SPACING_S):
            step = cls((float(time),))
            found.append(Candidate(step))
            found += [Candidate(step, run) for run in range(len(campaign.durations))]
        return found + [Candidate(cls((time,)), run) for run, time in campaign.step_times()]
