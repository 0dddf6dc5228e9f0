# SPDX-License-Identifier: Apache-2.0
"""Air temperature of a chamber as the environment of a simulated board: ?temperature=chamber."""

from __future__ import annotations

import math
from typing import Final
from urllib.parse import parse_qs, urlsplit

CHAMBER_OPTION: Final = 'chamber'
"""Value of the option `temperature` for a board in the chamber's air."""
INITIAL_AIR_C: Final = 20.0
"""Air temperature before the chamber's first measurement [°C]."""


def follows_chamber(url: str) -> bool:
    """Tell whether the board of a transport is in the air that a chamber's node measures.

    >>> follows_chamber('simulated://dut1?temperature=chamber'), follows_chamber('serial:///dev/x')
    (True, False)
    """
    parts = urlsplit(url)
    return parts.scheme == 'simulated' and parse_qs(parts.query).get('temperature') == [
        CHAMBER_OPTION
    ]


class ChamberAir:
    """Air temperature by the chamber's last measurement [°C], called as a function of time."""

    def __init__(self) -> None:
        self._celsius = INITIAL_AIR_C

    def update(self, celsius: float) -> None:
        """Take over a measurement; one that is not finite (a failed sensor) is ignored."""
        if math.isfinite(celsius):
            self._celsius = celsius

    def __call__(self, _time: float) -> float:
        """Return the temperature [°C]."""
        return self._celsius
