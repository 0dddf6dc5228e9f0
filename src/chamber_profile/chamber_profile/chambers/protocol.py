# SPDX-License-Identifier: Apache-2.0
"""Entry of the catalogue for one protocol: its driver, its options, its default baud rate."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from imu_recording.user_error import UserError

from chamber_profile.chambers.chamber import Chamber
from chamber_profile.chambers.line import Line


class ChamberAddressError(UserError):
    """A `chamber` parameter that names no chamber; the message gives an example."""


@dataclass(frozen=True)
class ChamberProtocol:
    """A protocol of the catalogue."""

    make: Callable[[Line, Mapping[str, int]], Chamber]
    """Return the chamber on a line; `options` are those of the address, and 'tcp' (0 or 1)."""
    options: tuple[str, ...] | None = None
    """Whole-number options of an address beside `baudrate` and `timeout`; None: any."""
    baudrate: int = 9600
    """Default of a serial line."""
