# SPDX-License-Identifier: Apache-2.0
"""Thermal hysteresis as a sum of play operators."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations, pairwise
from typing import ClassVar, Self

import numpy as np
from imu_recording.recording import FloatArray

from thermal_comp.data.conditions import Conditions
from thermal_comp.effects.c_form import CColumns, CForm
from thermal_comp.effects.effect import Campaign, Candidate, Effect, Kin, State, shape_parameter
from thermal_comp.effects.operators import play

HALF_WIDTHS_K = np.geomspace(0.8, 28.0, 13)
"""Half-widths of plays a search tries [K]."""


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
    kin: ClassVar[Kin] = 'temperature'

    def columns(
        self, conditions: Conditions, state: State | None = None
    ) -> tuple[FloatArray, State | None]:
        """Return (n, p): play of T with each half-width minus T [K]."""
        temperature = conditions.temperature
        before = state if state is not None else (None,) * len(self.half_widths)
        plays = [play(temperature, r, s) for r, s in zip(self.half_widths, before, strict=True)]
        columns = np.stack([played for played, _ in plays], axis=1) - temperature[:, None]
        return columns, tuple(last for _, last in plays)

    def c_columns(self, c: CForm) -> CColumns:
        """Return play minus T of each half-width."""
        t = c.temperature
        return CColumns([f'({c.play(t, width)} - {t})' for width in self.half_widths])

    @classmethod
    def search_grid(cls, campaign: Campaign) -> list[Candidate]:
        """Return single plays, and two, three and four whose half-widths are well apart."""
        widths = HALF_WIDTHS_K.tolist()
        chosen: list[tuple[float, ...]] = [(width,) for width in widths]
        for count in (2, 3):
            chosen += [
                some
                for some in combinations(widths, count)
                if all(wide > 1.7 * narrow for narrow, wide in pairwise(some))
            ]
        for four in ((1, 4, 7, 10), (3, 6, 8, 10)):
            chosen.append(tuple(widths[k] for k in four))
        return [Candidate(cls(some)) for some in chosen]

    @classmethod
    def sample_forms(cls) -> list[Self]:
        """Return single plays, narrow to wide."""
        return [cls((width,)) for width in (1.0, 2.0, 4.0, 8.0)]

    def parts(self) -> tuple[Effect, ...]:
        """Return the single plays."""
        return tuple(ThermalHysteresis((width,)) for width in self.half_widths)
