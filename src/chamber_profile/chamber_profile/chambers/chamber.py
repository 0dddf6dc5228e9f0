# SPDX-License-Identifier: Apache-2.0
"""The interface of a climatic chamber, the same for every protocol."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol


class ChamberError(OSError):
    """No answer, or none of the protocol; trying again may help."""


class ChamberRefusalError(ChamberError):
    """The chamber refused an order; the message holds its reason."""


@dataclass(frozen=True)
class ChamberReading:
    """Reading of a chamber at one moment; None where the protocol has no such value."""

    air: float
    """Air temperature of the chamber's own sensor [°C]."""
    setpoint: float | None
    """Set-point the chamber reports [°C]."""
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

    `emulated` is True only where the chamber itself reported it; on any other an accelerated
    clock is refused.
    """

    emulated: bool
    programs_limits: bool
    """Whether the protocol can program limits; where not, they are set at the panel."""

    @property
    def resolution_c(self) -> float:
        """Resolution of the set-point in the protocol [K]; known once connected."""

    def connect(self) -> str:
        """Open the link (again) and return the chamber's description of itself."""

    def read(self) -> ChamberReading:
        """Return the chamber's reading now."""

    def set_limits(self, low_c: float, high_c: float) -> None:
        """Program the limits of the chamber's own protection, independent of this program."""

    def set_temperature(self, temperature_c: float) -> None:
        """Write the set-point."""

    def run(self) -> None:
        """Begin to condition the air."""

    def stop(self) -> None:
        """Go to stand-by."""

    def close(self) -> None:
        """Release the link; the chamber goes on as it is."""
