# SPDX-License-Identifier: Apache-2.0
"""What a filter says about each row besides the attitude, as bits of one integer.

>>> names(SIX_AXIS | AT_REST)
('six_axis', 'at_rest')
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

NOT_STARTED = 1
DROPPED = 2
REINITIALISED = 4
JUMPED_BACK = 8
SIX_AXIS = 16
DISTURBED = 32
JAMMED = 64
AT_REST = 128
BIAS_LIMITED = 256
INVALID_GYROSCOPE = 512
INVALID_ACCELEROMETER = 1024
INVALID_MAGNETOMETER = 2048

FLAGS = {
    NOT_STARTED: ('not_started', 'no attitude yet: no usable specific force so far'),
    DROPPED: ('dropped', 'row not used: stamp not later than the last, or unusable gyroscope'),
    REINITIALISED: ('reinitialised', 'attitude set anew: start, gap, or first heading'),
    JUMPED_BACK: ('jumped_back', 'time jumped back (a bag looped): everything was forgotten'),
    SIX_AXIS: ('six_axis', 'heading from the gyroscope: no magnetometer sample for too long'),
    DISTURBED: ('disturbed', 'magnetometer rejected: field unlike the reference'),
    JAMMED: ('jammed', 'magnetic disturbance larger than twice the field: magnetometer ignored'),
    AT_REST: ('at_rest', 'no motion: the gyroscope shows its bias'),
    BIAS_LIMITED: ('bias_limited', 'at rest with a rate above the bias limit: not learned'),
    INVALID_GYROSCOPE: ('invalid_gyroscope', 'angular velocity not finite or absurd: ignored'),
    INVALID_ACCELEROMETER: ('invalid_accelerometer', 'specific force zero, not finite or absurd'),
    INVALID_MAGNETOMETER: ('invalid_magnetometer', 'magnetic field zero, not finite or absurd'),
}
"""Bit → name and meaning."""


def names(flags: int) -> tuple[str, ...]:
    """Return the names of the bits that are set."""
    return tuple(name for bit, (name, _) in FLAGS.items() if flags & bit)


def counts(flags: NDArray[np.integer]) -> dict[str, int]:
    """Return in how many rows each flag is set, flags that never are left out."""
    count = {name: int(np.count_nonzero(flags & bit)) for bit, (name, _) in FLAGS.items()}
    return {name: number for name, number in count.items() if number}
