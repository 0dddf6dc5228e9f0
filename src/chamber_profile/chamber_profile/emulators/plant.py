# SPDX-License-Identifier: Apache-2.0
"""What stands behind an emulated chamber's protocol: the simulated physics on a clock."""

from __future__ import annotations

from chamber_profile.chambers import climate as physics
from chamber_profile.chambers.simulated_chamber import SimulatedChamber

OFF, STANDBY, CONSTANT = 'OFF', 'STANDBY', 'CONSTANT'
LONGEST_S = 3600.0
"""What passes at most between two looks at the clock [s]; the rest of a longer gap is dropped."""


class EmulatedPlant:
    """A simulated chamber whose time runs `time_scale` times faster than the clock's.

    `look(now)` brings it up to the clock. Faults act through the plain attributes.
    """

    def __init__(self, seed: int = 0, time_scale: float = 1.0) -> None:
        self.chamber = SimulatedChamber(seed=seed)
        self.time_scale = time_scale
        self.refuses = False
        self.identity = f'EMULATED CHAMBER x{time_scale:g}'
        self._looked: float | None = None

    def look(self, now: float) -> None:
        """Let the time pass since the last look [s]."""
        before, self._looked = self._looked, now
        if before is not None and now > before:
            self.chamber.advance(min((now - before) * self.time_scale, LONGEST_S))

    @property
    def mode(self) -> str:
        """OFF is not emulated: an emulated chamber stands by."""
        return CONSTANT if self.chamber.running else STANDBY

    def stick_compressor(self, *, stuck: bool) -> None:
        """Take the cooling away, or give it back."""
        self.chamber.climate = self.chamber.climate._replace(
            cooling_available=0.0 if stuck else 1.0
        )

    @property
    def heater_percent(self) -> float:
        """Heater output [%]."""
        return float(100.0 * self.chamber.state[physics.HEATER])
