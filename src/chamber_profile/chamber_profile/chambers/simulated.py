# SPDX-License-Identifier: Apache-2.0
"""A simulated chamber: the physics of `climate` behind the interface of a real one."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from imu_recording.jit import entry_of
from imu_recording.recording import FloatArray

from chamber_profile.chambers import climate as physics
from chamber_profile.chambers.chamber import ChamberReading, ChamberRefusalError
from chamber_profile.chambers.climate import Climate

AIR_RANGE_C = (-70.0, 180.0)
"""Temperature range of the simulated chamber [°C]."""
_NOISE_ROWS = 4096


def drawn_climate(rng: np.random.Generator) -> Climate:
    """Return a chamber with calibration errors and a room drawn at random."""
    return Climate(
        room_temperature=23.0 + rng.uniform(-1.5, 1.5),
        room_humidity=rng.uniform(0.35, 0.55),
        probe_offset=rng.normal(0.0, 0.05),
        probe_2_offset=rng.normal(0.0, 0.05),
        probe_2_wall=rng.uniform(0.01, 0.05),
    )


@dataclass
class SimulatedChamber:
    """A chamber in this process. Nothing moves until `advance` is called.

    `seed` draws calibration errors, room and noise: two chambers with one seed and the same calls
    are equal to the last bit.
    """

    seed: int = 0
    emulated: bool = True
    resolution_c: float = 0.1
    programs_limits: bool = True

    def __post_init__(self) -> None:
        self._rng = np.random.default_rng(self.seed)
        self.climate = drawn_climate(self._rng)
        self.state = physics.initial_state(self.climate)
        self.setpoint = 23.0
        self.limits = AIR_RANGE_C
        self.running = False
        self._advance, self._sensed = self._entries()
        self.alarms: tuple[str, ...] = ()
        self._noise = np.empty((0, physics.NOISE_VARIATES))
        self._used = 0
        self._elapsed = 0.0

    def _entries(self) -> tuple[Callable[..., FloatArray], Callable[..., FloatArray]]:
        """Return the kernels as they are called every second: without a look at the types."""
        seen = (self.state[None], self.climate)
        no_time = np.empty((0, physics.NOISE_VARIATES))
        moved = (self.state, self.climate, self.setpoint, self.running, no_time)
        physics.advance(*moved)
        physics.sensed(*seen)
        return entry_of(physics.advance, moved), entry_of(physics.sensed, seen)

    def advance(self, seconds: float) -> FloatArray:
        """Advance the chamber; the physics takes whole seconds, the rest is carried over.

        Returns its state after each of these seconds (k, STATE_SIZE).
        """
        self._elapsed += seconds
        steps = int(self._elapsed + 1e-9)
        self._elapsed -= steps
        states = [np.empty((0, physics.STATE_SIZE))]
        while steps > 0:
            if self._used == len(self._noise):
                self._noise = self._rng.standard_normal((_NOISE_ROWS, physics.NOISE_VARIATES))
                self._used = 0
            take = min(steps, len(self._noise) - self._used)
            noise = self._noise[self._used : self._used + take]
            states.append(
                self._advance(self.state, self.climate, self.setpoint, self.running, noise)
            )
            self._used += take
            steps -= take
        self._protect()
        return np.concatenate(states)

    def connect(self) -> str:
        """Return the description of this chamber."""
        return f'simulated chamber, seed {self.seed}'

    @property
    def true_air(self) -> float:
        """Air temperature at the devices, which no sensor shows [°C]."""
        return float(self.state[physics.AIR] + self.state[physics.EDDY])

    def read(self) -> ChamberReading:
        """Return the readings of the chamber's sensors now."""
        state: list[float] = self.state.tolist()
        air, air_2, humidity = self._sensed(self.state[None], self.climate)[:, 0].tolist()
        return ChamberReading(
            air=_shown(air),
            setpoint=self.setpoint,
            running=self.running,
            alarms=self.alarms,
            humidity=humidity,
            air_2=_shown(air_2),
            device=_shown(state[physics.DEVICE]),
            heater=state[physics.HEATER],
            compressor=state[physics.COMPRESSOR],
            fan=1.0 if self.running else 0.0,
        )

    def set_limits(self, low_c: float, high_c: float) -> None:
        """Program the limits; outside them the chamber stops with an alarm."""
        if not AIR_RANGE_C[0] <= low_c < high_c <= AIR_RANGE_C[1]:
            reach = f'{AIR_RANGE_C[0]:g} … {AIR_RANGE_C[1]:g} °C'
            raise ChamberRefusalError(f'limits {low_c:g} … {high_c:g} °C, it reaches {reach}')
        self.limits = (low_c, high_c)

    def set_temperature(self, temperature_c: float) -> None:
        """Write the set-point."""
        low, high = self.limits
        if not low <= temperature_c <= high:
            wanted = f'set-point {temperature_c:g} °C'
            raise ChamberRefusalError(f'{wanted}, limits {low:g} … {high:g} °C')
        self.setpoint = round(round(temperature_c / self.resolution_c) * self.resolution_c, 6)

    def run(self) -> None:
        """Switch on."""
        if self.alarms:
            raise ChamberRefusalError(f'alarm {self.alarms[0]} is not acknowledged')
        self.running = True

    def stop(self) -> None:
        """Switch off."""
        self.running = False

    def close(self) -> None:
        """Nothing is open."""

    def _protect(self) -> None:
        """Stop with an alarm 5 K beyond the limits, as a chamber's own limiter does."""
        air = self.state[physics.AIR]
        if self.running and not self.limits[0] - 5.0 <= air <= self.limits[1] + 5.0:
            self.alarms = ('temperature limit',)
            self.running = False


def _shown(temperature: float) -> float:
    """Return a PT100's reading: 0.01 K steps."""
    return round(temperature, 2)
