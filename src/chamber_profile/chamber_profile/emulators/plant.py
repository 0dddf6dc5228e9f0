# SPDX-License-Identifier: Apache-2.0
"""The plant behind an emulated chamber's protocol: a simulated chamber that follows a clock."""

from __future__ import annotations

from chamber_profile.chambers import climate as physics
from chamber_profile.chambers.simulated import SimulatedChamber

STANDBY, CONSTANT = 'STANDBY', 'CONSTANT'
MAX_ADVANCE_S = 3600.0
"""Longest time the chamber is advanced at once [s]; the rest of a longer gap is dropped."""


class EmulatedPlant:
    """A simulated chamber whose time runs `time_scale` times faster than the clock's.

    `advance_to(now)` follows the clock. Faults act through the plain attributes.
    """

    def __init__(self, seed: int = 0, time_scale: float = 1.0) -> None:
        self.chamber = SimulatedChamber(seed=seed)
        self.time_scale = time_scale
        self.refuses = False
        self.identity = f'EMULATED CHAMBER x{time_scale:g}'
        self._time: float | None = None

    def advance_to(self, now: float) -> None:
        """Advance the chamber to a time of the clock [s]."""
        before, self._time = self._time, now
        if before is not None and now > before:
            self.chamber.advance(min((now - before) * self.time_scale, MAX_ADVANCE_S))

    @property
    def mode(self) -> str:
        """CONSTANT or STANDBY; an emulated chamber is never OFF."""
        return CONSTANT if self.chamber.running else STANDBY

    def stick_compressor(self, *, stuck: bool) -> None:
        """Switch the cooling power off, or on again."""
        self.chamber.climate = self.chamber.climate._replace(
            cooling_available=0.0 if stuck else 1.0
        )

    @property
    def heater_percent(self) -> float:
        """Heater output [%]."""
        return float(100.0 * self.chamber.state[physics.HEATER])
