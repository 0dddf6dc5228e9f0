# SPDX-License-Identifier: Apache-2.0
"""Alias of a mains-frequency field."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np
from imu_recording.recording import FloatArray

from thermal_comp.data.conditions import Conditions, Sensor
from thermal_comp.effects.effect import Campaign, Candidate, Effect, State, shape_parameter


@dataclass(frozen=True)
class MainsAlias(Effect):
    """A field at mains frequency appears as a slow sine."""

    frequency: float = shape_parameter(0.01, unit='Hz', bounds=(1e-4, 500.0), step=2e-5)

    name: ClassVar[str] = 'mains_alias'
    kind: ClassVar[Literal['device', 'campaign']] = 'campaign'
    sensors: ClassVar[tuple[Sensor, ...]] = ('gyroscope', 'magnetometer', 'accelerometer')
    per_run: ClassVar[bool] = True
    equation: ClassVar[str] = (
        'error = a · cos 2πft + b · sin 2πft,  f = |f_mains − n · output data rate|'
    )
    coefficient_units: ClassVar[tuple[str, ...]] = ('{unit}', '{unit}')
    mechanism: ClassVar[str] = (
        '50 or 60 Hz currents are sampled slower than twice their frequency.'
    )
    look_alikes: ClassVar[tuple[str, ...]] = ('heater_hard_iron',)
    separation: ClassVar[str] = (
        'A line in the spectrum whose frequency depends on the output data rate: change the rate.'
    )
    typical_size: ClassVar[str] = 'up to several µT next to a heater'
    reference: ClassVar[str] = 'Sampling theorem; mains at 50 or 60 Hz'
    time_only: ClassVar[bool] = True
    separating_action: ClassVar[str] = 'change the output data rate'

    def columns(
        self, conditions: Conditions, state: State | None = None
    ) -> tuple[FloatArray, State | None]:
        """Return (n, 2): cosine and sine at the alias frequency."""
        angle = 2.0 * np.pi * self.frequency * conditions.time
        return np.stack([np.cos(angle), np.sin(angle)], axis=1), None

    @classmethod
    def search_grid(cls, campaign: Campaign) -> list[Candidate]:
        """Return the most prominent lines."""
        return [Candidate(cls(frequency)) for frequency in campaign.spectral_lines()]

    @property
    def line_frequency(self) -> float | None:
        """The alias frequency [Hz]."""
        return self.frequency
