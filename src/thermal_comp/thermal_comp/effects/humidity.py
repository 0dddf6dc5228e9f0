# SPDX-License-Identifier: Apache-2.0
"""Moisture in the package, by a humidity that was logged or by one that is guessed."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from imu_recording.recording import FloatArray

from thermal_comp.data.conditions import Conditions
from thermal_comp.effects.c_form import CColumns, CForm
from thermal_comp.effects.effect import Effect, Kin, State, shape_parameter
from thermal_comp.effects.operators import follow


@dataclass(frozen=True)
class Humidity(Effect):
    """The bias follows the moisture in the package."""

    time_constant: float = shape_parameter(1800.0, unit='s', bounds=(60.0, 100_000.0))

    name: ClassVar[str] = 'humidity'
    channels: ClassVar[tuple[str, ...]] = ('humidity',)
    equation: ClassVar[str] = (
        'error = a · h_in,  dh_in/dt = (h − h_in) / τ,  h = relative humidity (0 … 1)'
    )
    coefficient_units: ClassVar[tuple[str, ...]] = ('{unit}',)
    mechanism: ClassVar[str] = 'The mould swells as it takes up moisture, and stresses the die.'
    look_alikes: ClassVar[tuple[str, ...]] = ('icing', 'bias_creep')
    separation: ClassVar[str] = (
        'Absent with dry purge; slow compared with temperature; a humidity log tells.'
    )
    typical_size: ClassVar[str] = (
        'an accelerometer of this class shifted by about 85 mg at high humidity and recovered dry'
    )
    reference: ClassVar[str] = 'JMEMS 2021-0212 (humidity-induced drift of packaged MEMS)'
    first_order: ClassVar[bool] = True
    kin: ClassVar[Kin] = 'temperature'
    separating_action: ClassVar[str] = 'log humidity; purge with dry gas'

    def columns(
        self, conditions: Conditions, state: State | None = None
    ) -> tuple[FloatArray, State | None]:
        """Return (n, 1): relative humidity (0 … 1) behind a first-order lag."""
        assert conditions.humidity is not None  # noqa: S101 (declared in channels)
        taken_up, state = follow(conditions.time, conditions.humidity, self.time_constant, state)
        return taken_up[:, None], state

    @classmethod
    def guess(cls) -> type[Effect] | None:
        """Return the effect of air whose dew point is searched."""
        return GuessedHumidity

    def c_columns(self, c: CForm) -> CColumns:
        """Return the lagged humidity: the humidity plus what the lag is above it."""
        humidity = c.channel('humidity')
        return CColumns([f'({humidity} + {c.behind(humidity, self.time_constant)})'])


@dataclass(frozen=True)
class GuessedHumidity(Humidity):
    """The bias follows the moisture of air whose humidity was not logged.

    Closed air holds its water: its dew point stays while the temperature does not. Relative
    humidity is h = min(1, e_s(dew point) / e_s(air)), e_s(T) ∝ exp(17.62 T / (243.12 + T))
    (Magnus formula, WMO No. 8); the air is the chamber's or else as warm as the die.
    """

    dew_point: float = shape_parameter(0.0, unit='°C', bounds=(-30.0, 30.0))

    name: ClassVar[str] = 'guessed_humidity'
    channels: ClassVar[tuple[str, ...]] = ()
    optional_channels: ClassVar[tuple[str, ...]] = ('chamber_temperature',)
    guessed_channel: ClassVar[str] = 'humidity'

    def columns(
        self, conditions: Conditions, state: State | None = None
    ) -> tuple[FloatArray, State | None]:
        """Return (n, 1): guessed relative humidity (0 … 1) behind a first-order lag."""
        logged = conditions.chamber_temperature
        air = conditions.temperature if logged is None else logged
        excess = 17.62 * (self.dew_point / (243.12 + self.dew_point) - air / (243.12 + air))
        humidity: FloatArray = np.exp(np.minimum(excess, 0.0))
        taken_up, state = follow(conditions.time, humidity, self.time_constant, state)
        return taken_up[:, None], state

    @classmethod
    def guess(cls) -> type[Effect] | None:
        """Return nothing: it is the guess."""
        return None
