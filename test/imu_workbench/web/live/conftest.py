# SPDX-License-Identifier: Apache-2.0
"""A device heard for twenty seconds, by a clock that is set by hand."""

import numpy as np
import pytest
from imu_workbench.web.live.state import LiveState

from .heard import GRAVITY, TRUE_RATE, Clock, imu, put, stamps


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def state(clock: Clock) -> LiveState:
    """Twenty seconds at 100 Hz; the compensated stream lacks a bias and every tenth sample."""
    state = LiveState(clock)
    stamp = stamps(20, 100)
    put(state, 'raw', imu(stamp, TRUE_RATE, GRAVITY))
    kept = stamp[np.arange(len(stamp)) % 10 != 3]
    put(state, 'compensated', imu(kept, TRUE_RATE - 0.004, GRAVITY - 0.03))
    state.absorb()
    return state
