# SPDX-License-Identifier: Apache-2.0
"""Sensitivity to the temperature difference across the package."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import product
from typing import Any, ClassVar

import numpy as np
from imu_recording.recording import FloatArray

from thermal_comp.data.conditions import Conditions
from thermal_comp.effects.c_form import CColumns, CForm
from thermal_comp.effects.effect import Campaign, Candidate, Effect, Kin, State, shape_parameter
from thermal_comp.effects.temperature_rate import TemperatureRate

ESTIMATED_FROM_DIE = 3.0
"""`outside` of a form that needs no second thermometer."""
SELF_HEATING_K = 0.6
"""What a die is warmer than its surroundings by when it has settled [K]: 0.3 to 1 K."""
BOARD_SETTLINGS_S = tuple(np.geomspace(4.0, 500.0, 7).tolist())
"""Time constants with which dies follow their board [s]."""
SETTLINGS_S = tuple(np.geomspace(8.0, 2000.0, 9).tolist())
"""Time constants with which they follow their surroundings: a board to a housing [s]."""
HEATING_TIMES_S = (60.0, 150.0, 400.0)
"""Time constants with which they heat themselves [s]."""


@dataclass(frozen=True)
class ThermalGradient(Effect):
    """The error is proportional to the difference between a second thermometer and the die.

    A thermometer on the board may lag as much as the die does; then the board's temperature is
    estimated from the die's. By Newton's law of cooling a die that follows the board with a time
    constant θ [s], and heats itself by ΔT (1 − exp(−t/τ)) [K] after power-on, is cooler than the
    board by θ dT/dt + ΔT (1 − θ/τ) exp(−t/τ) [K], up to a constant.
    """

    outside: float = shape_parameter(0.0, unit='1', bounds=(0.0, 3.0), given=True)
    """Second thermometer: 0 air in the chamber, 1 on the device, 2 second sensor in the air; 3:
    none, the board is estimated from the die."""
    settling: float = shape_parameter(30.0, unit='s', bounds=(2.0, 3000.0), assumed=True)
    """Time constant θ with which the die follows the board, of form 3."""
    heating_time: float = shape_parameter(150.0, unit='s', bounds=(40.0, 600.0), assumed=True)
    """Time constant τ with which it heats itself, of form 3."""
    smoothing: float = shape_parameter(
        30.0, unit='s', bounds=(0.1, 10_000.0), given=True, assumed=True
    )
    """Time constant of the derivative filter, of form 3: as that of `temperature_rate`."""

    name: ClassVar[str] = 'thermal_gradient'
    channels: ClassVar[tuple[str, ...]] = ('chamber_temperature',)
    substitutes: ClassVar[tuple[str, ...]] = ('device_temperature', 'chamber_temperature_2')
    equation: ClassVar[str] = (
        'error = a · (T_outside − T),  outside: 0 air in the chamber, 1 on the device, '
        '2 second sensor in the air, 3 the board as estimated from the die: '
        'a · (θ dT/dt + ΔT (1 − θ/τ) exp(−t/τ)),  ΔT = 0.6 K'
    )
    coefficient_units: ClassVar[tuple[str, ...]] = ('{unit}/K',)
    mechanism: ClassVar[str] = (
        'A temperature difference between surroundings and die bends the package.'
    )
    look_alikes: ClassVar[tuple[str, ...]] = ('temperature_rate', 'thermal_lag')
    separation: ClassVar[str] = (
        'Peaks at the start of a ramp. On a slow symmetrical profile nearly the same as the '
        'rate: needs a second thermometer and asymmetrical heating.'
    )
    typical_size: ClassVar[str] = 'as temperature_rate'
    reference: ClassVar[str] = 'IEEE 952 and 1431 (temperature-gradient sensitivity D_∇T)'
    differentiates: ClassVar[bool] = True
    kin: ClassVar[Kin] = 'temperature'
    twin: ClassVar[str] = 'temperature_rate'
    separating_action: ClassVar[str] = (
        'log a second thermometer and change the heat path (fan speed)'
    )

    def columns(
        self, conditions: Conditions, state: State | None = None
    ) -> tuple[FloatArray, State | None]:
        """Return (n, 1): T_outside − T [K]."""
        if self._is_estimated:
            rate, state = self._rate.columns(conditions, state)
            return self._estimated(rate, conditions), state
        outside = getattr(conditions, self.needs[0])
        return (outside - conditions.temperature)[:, None], None

    def columns_in_hindsight(self, conditions: Conditions) -> FloatArray:
        """Return (n, 1): the same, with the derivative of a smooth temperature."""
        if self._is_estimated:
            return self._estimated(self._rate.columns_in_hindsight(conditions), conditions)
        return self.columns(conditions)[0]

    def _estimated(self, rate: FloatArray, conditions: Conditions) -> FloatArray:
        """Return (n, 1) the board above the die [K], of dT/dt (n, 1) [K/s]."""
        heating = self._heating * np.exp(-conditions.time / self.heating_time)
        return np.asarray(self.settling * rate + heating[:, None])

    @property
    def _is_estimated(self) -> bool:
        return round(self.outside) == ESTIMATED_FROM_DIE

    @property
    def _rate(self) -> TemperatureRate:
        return TemperatureRate(self.smoothing)

    @property
    def _heating(self) -> float:
        """What self-heating makes of the difference at power-on [K]."""
        return SELF_HEATING_K * (1.0 - self.settling / self.heating_time)

    @property
    def needs(self) -> tuple[str, ...]:
        """The channel of the second thermometer; none where the board is estimated."""
        return (*self.channels, *self.substitutes)[round(self.outside) :][:1]

    @property
    def shape_parameters(self) -> dict[str, Any]:
        """Shape parameters by name: a measured difference has its thermometer alone."""
        return super().shape_parameters if self._is_estimated else {'outside': self.outside}

    @classmethod
    def search_grid(cls, campaign: Campaign) -> list[Candidate]:
        """Return the differences to all thermometers that were logged, and to the board.

        Without a second thermometer the difference is a guess of what was not logged.
        """
        forms = [cls(float(number)) for number in range(1 + len(cls.substitutes))]
        measured = [form for form in forms if campaign.channels.issuperset(form.needs)]
        scale = campaign.time_scale
        estimated = [
            cls(ESTIMATED_FROM_DIE, scale * settling, scale * heating)
            for settling, heating in product(BOARD_SETTLINGS_S, HEATING_TIMES_S)
        ]
        return [Candidate(form) for form in (*measured, *estimated)] if measured else []

    @classmethod
    def guess(cls) -> type[Effect] | None:
        """Return the effect of surroundings that the die follows, and heats itself above."""
        return GuessedGradient

    def live_forms(self) -> tuple[ThermalGradient, ...]:
        """Return it, and where it needs a derivative, with that smoothed otherwise."""
        if not self._is_estimated:
            return (self,)
        return tuple(replace(self, smoothing=rate.smoothing) for rate in self._rate.live_forms())

    def c_columns(self, c: CForm) -> CColumns:
        """Return T_outside − T, or its estimate from the die."""
        if not self._is_estimated:
            return CColumns([f'({c.channel(self.needs[0])} - {c.temperature})'])
        (rate,) = self._rate.c_columns(c).expressions
        heating = c.exp(f'-{c.time} / {c.number(self.heating_time)}')
        return CColumns(
            [f'({c.number(self.settling)} * {rate} + {c.number(self._heating)} * {heating})']
        )


@dataclass(frozen=True)
class GuessedGradient(Effect):
    """The error follows a difference to surroundings whose temperature was not logged."""

    settling: float = shape_parameter(300.0, unit='s', bounds=(5.0, 3000.0))
    heating_time: float = shape_parameter(150.0, unit='s', bounds=(40.0, 600.0))

    name: ClassVar[str] = 'guessed_gradient'
    equation: ClassVar[str] = 'error = a · (θ dT/dt + ΔT (1 − θ/τ) exp(−t/τ)),  ΔT = 0.6 K'
    coefficient_units: ClassVar[tuple[str, ...]] = ('{unit}/K',)
    differentiates: ClassVar[bool] = True
    kin: ClassVar[Kin] = 'temperature'
    guessed_channel: ClassVar[str] = 'chamber_temperature'
    twin: ClassVar[str] = 'temperature_rate'

    def columns(
        self, conditions: Conditions, state: State | None = None
    ) -> tuple[FloatArray, State | None]:
        """Return (n, 1): guessed difference [K]."""
        return self._gradient.columns(conditions, state)

    def columns_in_hindsight(self, conditions: Conditions) -> FloatArray:
        """Return (n, 1): the same with the derivative itself, of a smooth temperature."""
        return self._gradient.columns_in_hindsight(conditions)

    @property
    def _gradient(self) -> ThermalGradient:
        return ThermalGradient(ESTIMATED_FROM_DIE, self.settling, self.heating_time)

    @classmethod
    def search_grid(cls, campaign: Campaign) -> list[Candidate]:
        """Return settling times of a board to those of a housing."""
        scale = campaign.time_scale
        return [
            Candidate(cls(scale * settling, scale * heating))
            for settling, heating in product(SETTLINGS_S, HEATING_TIMES_S)
        ]
