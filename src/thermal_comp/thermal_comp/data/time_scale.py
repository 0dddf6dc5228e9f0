# SPDX-License-Identifier: Apache-2.0
"""How fast that is which a recording can tell.

In a chamber dies follow in minutes; what a heat gun does to a chip in a minute happens in seconds.
Where no run lasts USUAL_LENGTH_S all time constants that are looked for, and those of the noise,
are shorter in proportion.
"""

from __future__ import annotations

USUAL_LENGTH_S = 1000.0
"""Length of a run from which times are as usual [s]."""
LEAST_TIME_SCALE = 0.02
"""Scale of a recording of 20 s; none is smaller."""


def time_scale(longest: float) -> float:
    """Return the share of the usual times that those are which a recording can tell.

    `longest`: end of the longest run, from the start of its recording [s]; parts at rest of one
    recording have its temperature in common, and its times.

    >>> time_scale(43200.0), time_scale(100.0)
    (1.0, 0.1)
    """
    return min(1.0, max(longest / USUAL_LENGTH_S, LEAST_TIME_SCALE))
