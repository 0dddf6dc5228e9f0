# SPDX-License-Identifier: Apache-2.0
"""Linear drift of the bias in time."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar, Literal

from imu_recording.recording import FloatArray

from thermal_comp.data.conditions import Conditions
from thermal_comp.effects.effect import Effect, Kin, State


@dataclass(frozen=True)
class BiasDrift(Effect):
    """The bias drifts in proportion to time."""

    name: ClassVar[str] = 'bias_drift'
    kind: ClassVar[Literal['device', 'campaign']] = 'campaign'
    equation: ClassVar[str] = 'error = a · t,  t since the first sample [s]'
    coefficient_units: ClassVar[tuple[str, ...]] = ('{unit}/s',)
    mechanism: ClassVar[str] = 'Ageing: relaxation of package stress.'
    look_alikes: ClassVar[tuple[str, ...]] = ('bias_creep', 'turn_on_bias', 'warm_up')
    separation: ClassVar[str] = (
        'A straight line over time that predicts later cycles: a long soak at constant '
        'temperature.'
    )
    typical_size: ClassVar[str] = 'accelerometer 0.1–0.5 mg in 12 h when new'
    reference: ClassVar[str] = 'IEEE 952 (rate ramp)'
    time_only: ClassVar[bool] = True
    kin: ClassVar[Kin] = 'time'
    separating_action: ClassVar[str] = 'soak at constant temperature with the power on'

    def columns(
        self, conditions: Conditions, state: State | None = None
    ) -> tuple[FloatArray, State | None]:
        """Return (n, 1): time since the first sample [s]."""
        return conditions.time[:, None], None
