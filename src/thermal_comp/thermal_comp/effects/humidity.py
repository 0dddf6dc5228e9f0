# SPDX-License-Identifier: Apache-2.0
"""Moisture in the package, by a humidity that was logged or by one that is guessed."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from imu_recording.recording import FloatArray

from thermal_comp.data.conditions import Conditions
from thermal_comp.effects.c_form import CColumns, CForm
from thermal_comp.effects.effect import Campaign, Candidate, Effect, Kin, State, shape_parameter
from thermal_comp.effects.operators import follow

DIFFUSION_MODES = (1, 3, 5, 7)
"""Modes of a slab that lag behind; faster ones follow at once, a twentieth of the whole."""


@dataclass(frozen=True)
class Humidity(Effect):
    """The bias follows the moisture in the package."""

    time_constant: float = shape_parameter(1800.0, unit='s', bounds=(60.0, 100_000.0))
    by_diffusion: float = shape_parameter(0.0, unit='1', bounds=(0.0, 1.0), assumed=True)
    """1: moisture diffuses into a slab, whose slowest mode has the time constant; 0: it is taken
    up with that time constant alone."""

    name: ClassVar[str] = 'humidity'
    channels: ClassVar[tuple[str, ...]] = ('humidity',)
    equation: ClassVar[str] = (
        'error = a · h_in,  dh_in/dt = (h − h_in) / τ,  h = relative humidity (0 … 1);  by '
        'diffusion: h_in = Σ 8 / (π n)² h_n,  dh_n/dt = n² (h − h_n) / τ,  n = 1, 3, 5, …'
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
    reference: ClassVar[str] = (
        'JMEMS 2021-0212 (humidity-induced drift of packaged MEMS); diffusion: Crank, The '
        'Mathematics of Diffusion, 1975, ch. 4 (plane sheet)'
    )
    first_order: ClassVar[bool] = True
    kin: ClassVar[Kin] = 'temperature'
    separating_action: ClassVar[str] = 'log humidity; purge with dry gas'

    def columns(
        self, conditions: Conditions, state: State | None = None
    ) -> tuple[FloatArray, State | None]:
        """Return (n, 1): relative humidity (0 … 1) behind a first-order lag, or in a slab."""
        humidity = conditions.humidity
        assert humidity is not None  # noqa: S101 (declared in channels)
        taken_up, states = humidity.copy(), []
        known = state or len(self._parts) * [None]
        for (share, lag), before in zip(self._parts, known, strict=True):
            lagged, after = follow(conditions.time, humidity, lag, before)
            taken_up += share * (lagged - humidity)
            states.append(after)
        return taken_up[:, None], states

    @property
    def _parts(self) -> list[tuple[float, float]]:
        """Share and time constant [s] of each part that lags behind; the rest does not."""
        if self.by_diffusion < 0.5:
            return [(1.0, self.time_constant)]
        return [(8.0 / (np.pi * n) ** 2, self.time_constant / n**2) for n in DIFFUSION_MODES]

    @classmethod
    def search_grid(cls, campaign: Campaign) -> list[Candidate]:
        """Return time constants, taken up with one of them and by diffusion."""
        forms = [one.effect for one in super().search_grid(campaign)]
        times = [form.shape_parameters['time_constant'] for form in forms]
        return [Candidate(cls(time, by_diffusion=way)) for way in (0.0, 1.0) for time in times]

    @classmethod
    def guess(cls) -> type[Effect] | None:
        """Return the effect of air whose dew point is searched."""
        return GuessedHumidity

    def c_columns(self, c: CForm) -> CColumns:
        """Return the lagged humidity: the humidity plus what the lags are above it."""
        humidity = c.channel('humidity')
        behind = [f'{c.number(share)} * {c.behind(humidity, lag)}' for share, lag in self._parts]
        return CColumns([f'({" + ".join([humidity, *behind])})'])


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
        """Return (n, 1): guessed relative humidity (0 … 1), taken up as one that was logged."""
        logged = conditions.chamber_temperature
        air = conditions.temperature if logged is None else logged
        excess = 17.62 * (self.dew_point / (243.12 + self.dew_point) - air / (243.12 + air))
        humidity: FloatArray = np.exp(np.minimum(excess, 0.0))
        return super().columns(replace(conditions, humidity=humidity), state)

    @classmethod
    def search_grid(cls, campaign: Campaign) -> list[Candidate]:
        """Return time constants and dew points; how it is taken up is not told beside these."""
        return super(Humidity, cls).search_grid(campaign)

    @classmethod
    def guess(cls) -> type[Effect] | None:
        """Return nothing: it is the guess."""
        return None
