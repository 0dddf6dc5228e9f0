# SPDX-License-Identifier: Apache-2.0
"""Air around a simulated board that a chamber's node tells: simulated://dut1?temperature=chamber."""

from __future__ import annotations

import math
from typing import Final
from urllib.parse import parse_qs, urlsplit

CHAMBER: Final = 'chamber'
"""Value of `temperature` with which a board stands in the air that is heard of."""
BEFORE_C: Final = 20.0
"""Air until the chamber has told of its own [°C]."""


def follows_chamber(url: str) -> bool:
    """Tell whether the board of a transport stands in the air of a chamber's node.

    >>> follows_chamber('simulated://dut1?temperature=chamber'), follows_chamber('serial:///dev/x')
    (True, False)
    """
    parts = urlsplit(url)
    return parts.scheme == 'simulated' and parse_qs(parts.query).get('temperature') == [CHAMBER]


class HeardAir:
    """Temperature of the air as it was heard last [°C], whatever the time."""

    def __init__(self) -> None:
        self._celsius = BEFORE_C

    def hear(self, celsius: float) -> None:
        """Take over a temperature; what is not finite, a sensor that failed, is passed over."""
        if math.isfinite(celsius):
            self._celsius = celsius

    def __call__(self, _time: float) -> float:
        """Return it."""
        return self._celsius
