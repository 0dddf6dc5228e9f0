# SPDX-License-Identifier: Apache-2.0
"""What every climatic chamber can do, whatever protocol it speaks."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol


class ChamberError(OSError):
    """The chamber did not answer, or not in its protocol; trying again may help."""


class ChamberRefusalError(ChamberError):
    """The chamber understood and refused; the message holds its reason."""


@dataclass(frozen=True)
class ChamberReading:
    """What a chamber says about itself at one moment; None where it does not say."""

    air: float
    """Air temperature of the chamber's own sensor [°C]."""
    setpoint: float | None
    """Set-point the chamber holds now [°C]."""
    running: bool
    """Whether it conditions the air."""
    alarms: tuple[str, ...] = ()
    """Active alarms; empty: none."""
    humidity: float | None = None
    """Relative, 0 … 1."""
    air_2: float | None = None
    """Second air sensor [°C]."""
    device: float | None = None
    """Sensor on the device [°C]."""
    heater: float | None = None
    """Heater duty, 0 … 1."""
    compressor: float | None = None
    """Compressor state, 0 … 1."""
    fan: float | None = None
    """Fan state, 0 … 1."""


class Chamber(Protocol):
    """A climatic chamber. Calls raise ChamberError when the link fails, and may then be retried.

    `emulated` is True only where the chamber itself said so: an accelerated clock is refused on
    all others.
    """

    emulated: bool
    programs_limits: bool
    """Whether `set_limits` reaches the chamber; where not, they are set at its panel."""

    @property
    def resolution_c(self) -> float:
        """Step of the set-point the protocol can express [K]; known once connected."""

    def connect(self) -> str:
        """Open the link (again) and return what the chamber says it is."""

    def read(self) -> ChamberReading:
        """Return the chamber's state now."""

    def set_limits(self, low_c: float, high_c: float) -> None:
        """Program the chamber's own limits, its protection independent of this program."""

    def set_temperature(self, temperature_c: float) -> None:
        """Write the set-point."""

    def run(self) -> None:
        """Begin to condition the air."""

    def stop(self) -> None:
        """Go to stand-by."""

    def close(self) -> None:
        """Release the link; the chamber goes on as it is."""
