# SPDX-License-Identifier: Apache-2.0
"""A step of the bias."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np
from imu_recording.recording import FloatArray
from imu_recording.user_error import UserError

from thermal_comp.data.conditions import Conditions
from thermal_comp.effects.effect import Campaign, Candidate, Effect, Kin, State, shape_parameter
from thermal_comp.effects.operators import rise

LONGEST_DURATION_S = 300.0
"""How long a step may last [s]."""
SEARCH_SPACING_S = 1200.0
"""Distance of the step times a search tries [s]."""


@dataclass(frozen=True)
class BiasStep(Effect):
    """The bias changes once, within a moment, and stays."""

    step_time: tuple[float, ...] = shape_parameter(
        (20_000.0,), unit='s', bounds=(0.0, 1e7), step=400.0
    )
    duration: tuple[float, ...] = shape_parameter(
        (0.0,), unit='s', bounds=(0.0, LONGEST_DURATION_S), given=True
    )

    name: ClassVar[str] = 'bias_step'
    kind: ClassVar[Literal['device', 'campaign']] = 'campaign'
    per_run: ClassVar[bool] = True
    equation: ClassVar[str] = (
        'error = Σ_j a_jr · H((t − t_j) / d_j) in run r,  t since the first sample [s], '
        'H rises from 0 to 1 between 0 and 1'
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

    def __post_init__(self) -> None:
        """Give every step the duration that one alone was given; refuse other numbers of them."""
        if len(self.duration) == 1:
            object.__setattr__(self, 'duration', self.duration * len(self.step_time))
        if len(self.duration) != len(self.step_time):
            raise UserError(
                f'bias_step: {len(self.step_time)} step times and {len(self.duration)} durations; '
                'give one duration for all, or one each'
            )

    @property
    def occurrences(self) -> tuple[float, ...]:
        """Times of the steps [s]."""
        return self.step_time

    def columns(
        self, conditions: Conditions, state: State | None = None
    ) -> tuple[FloatArray, State | None]:
        """Return (n, p): 1 after each step, 0 before."""
        steps = zip(self.step_time, self.duration, strict=True)
        return np.stack([rise(conditions.time, *step) for step in steps], axis=1), None

    @classmethod
    def search_grid(cls, campaign: Campaign) -> list[Candidate]:
        """Return steps all along, in all runs at once or in one, and each run's likeliest."""
        found = []
        spacing = campaign.time_scale * SEARCH_SPACING_S
        for time in np.arange(spacing, max(campaign.durations), spacing):
            step = cls((float(time),))
            found.append(Candidate(step))
            found += [Candidate(step, run) for run in range(len(campaign.durations))]
        found += [Candidate(cls((t,), (d,)), run) for run, t, d in campaign.step_times()]
        return [c for c in found if not _is_edge(c, campaign)]


def _is_edge(candidate: Candidate, campaign: Campaign) -> bool:
    """Tell whether a step belongs to one that is known: no two lie so close together."""
    (time,) = candidate.effect.occurrences
    return any(
        abs(time - known) < campaign.time_scale * LONGEST_DURATION_S
        and (run == candidate.run or None in (run, candidate.run))
        for run, known in campaign.occurred
    )
