# SPDX-License-Identifier: Apache-2.0
"""Air of a chamber's node around a simulated board: simulated://dut1?temperature=chamber."""

from __future__ import annotations

import math
from typing import Final
from urllib.parse import parse_qs, urlsplit

CHAMBER: Final = 'chamber'
"""Value of `temperature` with which a board stands in the air of the chamber's node."""
BEFORE_C: Final = 20.0
"""Air before the chamber's first measurement [°C]."""


def follows_chamber(url: str) -> bool:
    """Tell whether the board of a transport stands in the air of a chamber's node.

    >>> follows_chamber('simulated://dut1?temperature=chamber'), follows_chamber('serial:///dev/x')
    (True, False)
    """
    parts = urlsplit(url)
    return parts.scheme == 'simulated' and parse_qs(parts.query).get('temperature') == [CHAMBER]


class ChamberAir:
    """Temperature of the air as the chamber measured it last [°C], whatever the time."""

    def __init__(self) -> None:
        self._celsius = BEFORE_C

    def update(self, celsius: float) -> None:
        """Take over a measurement; one that is not finite (a failed sensor) is ignored."""
        if math.isfinite(celsius):
            self._celsius = celsius

    def __call__(self, _time: float) -> float:
        """Return the temperature [°C]."""
        return self._celsius
