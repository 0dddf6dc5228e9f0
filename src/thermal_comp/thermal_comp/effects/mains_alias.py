# SPDX-License-Identifier: Apache-2.0
"""Alias of a mains-frequency field."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

import numpy as np
from imu_recording.recording import FloatArray

from thermal_comp.data.acting_channels import MACHINES
from thermal_comp.data.conditions import Conditions, Sensor
from thermal_comp.effects.effect import Campaign, Candidate, Effect, State, shape_parameter
from thermal_comp.effects.operators import time_integral

LEAST_DRIFT_HZ_PER_K = 1e-5
"""Drift from which a line moves with a clock [Hz/K]: 0.2 ppm/K of 50 Hz, as a quartz has it."""


@dataclass(frozen=True)
class MainsAlias(Effect):
    """A field at mains frequency appears as a slow sine."""

    frequency: float = shape_parameter(0.01, unit='Hz', bounds=(1e-4, 500.0), step=2e-5)
    drift: float = shape_parameter(0.0, unit='Hz/K', bounds=(-0.01, 0.01), step=1e-6)
    machine: float = shape_parameter(0.0, unit='1', bounds=(0.0, 2.0), given=True)
    """What draws the current: 0 anything that is always on, 1 the heater, 2 the compressor."""

    name: ClassVar[str] = 'mains_alias'
    kind: ClassVar[Literal['device', 'campaign']] = 'campaign'
    sensors: ClassVar[tuple[Sensor, ...]] = ('gyroscope', 'magnetometer', 'accelerometer')
    per_run: ClassVar[bool] = True
    optional_channels: ClassVar[tuple[str, ...]] = MACHINES
    equation: ClassVar[str] = (
        'error = a · cos φ + b · sin φ,  φ = 2π ∫ (f + d · x) dt,  '
        'f = |f_mains − n · output data rate| at T₀;  of a machine: times how far it is on'
    )
    coefficient_units: ClassVar[tuple[str, ...]] = ('{unit}', '{unit}')
    coefficient_symbols: ClassVar[tuple[str, ...]] = ('a', 'b')
    mechanism: ClassVar[str] = (
        '50 or 60 Hz currents are sampled slower than twice their frequency; the clock that paces '
        'the samples feels the temperature, and the alias moves with it.'
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
        difference = conditions.temperature_difference
        integral, state = time_integral(conditions.time, difference, state)
        angle = 2.0 * np.pi * (self.frequency * conditions.time + self.drift * integral)
        wave = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        machine = None if self.machine < 0.5 else MACHINES[round(self.machine) - 1]
        on = getattr(conditions, machine) if machine else None
        return (wave if on is None else wave * on[:, None]), state

    @classmethod
    def search_grid(cls, campaign: Campaign) -> list[Candidate]:
        """Return the most prominent lines, steady and with each machine that was logged."""
        machines = [k + 1.0 for k, name in enumerate(MACHINES) if name in campaign.channels]
        lines = campaign.spectral_lines()
        return [Candidate(cls(*line, on)) for line in lines for on in (0.0, *machines)]

    @property
    def line_frequency(self) -> float | None:
        """The alias frequency [Hz]."""
        return self.frequency

    @property
    def of_any_cause(self) -> bool:
        """Whether it stands still and is always there, as any oscillation may be.

        An alias moves with the clock, a machine's comes and goes with it.
        """
        return abs(self.drift) < LEAST_DRIFT_HZ_PER_K and self.machine == 0.0
