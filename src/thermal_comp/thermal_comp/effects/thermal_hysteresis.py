# SPDX-License-Identifier: Apache-2.0
"""Thermal hysteresis as a sum of play operators."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from imu_recording.recording import FloatArray

from thermal_comp.data.conditions import Conditions
from thermal_comp.effects.effect import Effect, State, shape_parameter
from thermal_comp.effects.operators import play


@dataclass(frozen=True)
class ThermalHysteresis(Effect):
    """Heating and cooling take different branches, independent of speed."""

    half_widths: tuple[float, ...] = shape_parameter((6.0,), unit='K', bounds=(0.5, 60.0))

    name: ClassVar[str] = 'thermal_hysteresis'
    equation: ClassVar[str] = (
        'error = Σ_j w_j · (P_rj[T] − T),  P_r = play operator of half-width r '
        '(Prandtl–Ishlinskii)'
    )
    coefficient_units: ClassVar[tuple[str, ...]] = ('{unit}/K',)
    mechanism: ClassVar[str] = 'Plastic flow and creep of glue, mould and solder.'
    look_alikes: ClassVar[tuple[str, ...]] = (
        'thermal_lag',
        'thermal_lag_two_stage',
        'bias_temperature_curvature',
    )
    separation: ClassVar[str] = (
        'A loop over temperature that does not close in dwells and does not shrink at slow '
        'ramps: run the same loop at 0.25 and 2 K/min, and minor loops.'
    )
    typical_size: ClassVar[str] = 'gyroscope 0.1 °/s, accelerometer 1–5 mg'
    reference: ClassVar[str] = (
        'IEEE 528 (hysteresis error); Brokate and Sprekels, Hysteresis and Phase Transitions, '
        '1996 (play operator)'
    )

    def columns(
        self, conditions: Conditions, state: State | None = None
    ) -> tuple[FloatArray, State | None]:
        """Return (n, p): play of T with each half-width minus T [K]."""
        temperature = conditions.temperature
        before = state if state is not None else (None,) * len(self.half_widths)
        plays = [play(temperature, r, s) for r, s in zip(self.half_widths, before, strict=True)]
        columns = np.stack([played for played, _ in plays], axis=1) - temperature[:, None]
        return columns, tuple(last for _, last in plays)
