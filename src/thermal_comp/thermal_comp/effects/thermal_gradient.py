# SPDX-License-Identifier: Apache-2.0
"""Sensitivity to the temperature difference across the package."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product
from typing import ClassVar

import numpy as np
from imu_recording.recording import FloatArray

from thermal_comp.data.conditions import Conditions
from thermal_comp.effects.c_form import CColumns, CForm
from thermal_comp.effects.effect import Campaign, Candidate, Effect, Kin, State, shape_parameter
from thermal_comp.effects.temperature_rate import TemperatureRate


@dataclass(frozen=True)
class ThermalGradient(Effect):
    """The error is proportional to the difference between a second thermometer and the die."""

    outside: float = shape_parameter(0.0, unit='1', bounds=(0.0, 2.0), given=True)
    """Second thermometer: 0 air in the chamber, 1 on the device, 2 second sensor in the air."""

    name: ClassVar[str] = 'thermal_gradient'
    channels: ClassVar[tuple[str, ...]] = ('chamber_temperature',)
    substitutes: ClassVar[tuple[str, ...]] = ('device_temperature', 'chamber_temperature_2')
    equation: ClassVar[str] = (
        'error = a · (T_outside − T),  outside: 0 air in the chamber, 1 on the device, '
        '2 second sensor in the air'
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
    kin: ClassVar[Kin] = 'temperature'
    twin: ClassVar[str] = 'temperature_rate'
    separating_action: ClassVar[str] = (
        'log a second thermometer and change the heat path (fan speed)'
    )

    def columns(
        self, conditions: Conditions, state: State | None = None
    ) -> tuple[FloatArray, State | None]:
        """Return (n, 1): T_outside − T [K]."""
        outside = getattr(conditions, self.needs[0])
        return (outside - conditions.temperature)[:, None], None

    @property
    def needs(self) -> tuple[str, ...]:
        """The channel of the second thermometer."""
        return ((*self.channels, *self.substitutes)[round(self.outside)],)

    @classmethod
    def search_grid(cls, campaign: Campaign) -> list[Candidate]:
        """Return the differences to all thermometers that were logged."""
        forms = [cls(float(number)) for number in range(1 + len(cls.substitutes))]
        return [Candidate(form) for form in forms if campaign.channels.issuperset(form.needs)]

    @classmethod
    def guess(cls) -> type[Effect] | None:
        """Return the effect of surroundings that the die follows, and heats itself above."""
        return GuessedGradient

    def c_columns(self, c: CForm) -> CColumns:
        """Return T_outside − T."""
        return CColumns([f'({c.channel(self.needs[0])} - {c.temperature})'])


SELF_HEATING_K = 0.6
"""What a die is warmer than its surroundings by when it has settled [K]: 0.3 to 1 K."""


@dataclass(frozen=True)
class GuessedGradient(Effect):
    """The error follows a difference to surroundings whose temperature was not logged.

    A die that follows them with a time constant θ, and heats itself by ΔT (1 − exp(−t/τ)) after
    power-on, is cooler than they are by θ (dT/dt + ΔT (1/θ − 1/τ) exp(−t/τ)), up to a constant.
    """

    settling: float = shape_parameter(300.0, unit='s', bounds=(5.0, 3000.0))
    heating_time: float = shape_parameter(150.0, unit='s', bounds=(40.0, 600.0))

    name: ClassVar[str] = 'guessed_gradient'
    equation: ClassVar[str] = 'error = a · (dT/dt + ΔT (1/θ − 1/τ) exp(−t/τ)),  ΔT = 0.6 K'
    coefficient_units: ClassVar[tuple[str, ...]] = ('{unit}·s/K',)
    kin: ClassVar[Kin] = 'temperature'
    guessed_channel: ClassVar[str] = 'chamber_temperature'

    def columns(
        self, conditions: Conditions, state: State | None = None
    ) -> tuple[FloatArray, State | None]:
        """Return (n, 1): guessed difference over θ [K/s]."""
        rate, state = TemperatureRate().columns(conditions, state)
        return rate + self._since_power_on(conditions), state

    def columns_in_hindsight(self, conditions: Conditions) -> FloatArray:
        """Return (n, 1): the same with the derivative itself, of a smooth temperature."""
        rate = TemperatureRate().columns_in_hindsight(conditions)
        return np.asarray(rate + self._since_power_on(conditions))

    def _since_power_on(self, conditions: Conditions) -> FloatArray:
        """Return (n, 1) what self-heating makes of the difference over θ [K/s]."""
        size = SELF_HEATING_K * (1.0 / self.settling - 1.0 / self.heating_time)
        return np.asarray(size * np.exp(-conditions.time / self.heating_time)[:, None])

    @classmethod
    def search_grid(cls, campaign: Campaign) -> list[Candidate]:
        """Return settling times of a board to those of a housing."""
        settling, heating = np.geomspace(8.0, 2000.0, 9), (60.0, 150.0, 400.0)
        return [Candidate(cls(float(s), h)) for s, h in product(settling, heating)]
