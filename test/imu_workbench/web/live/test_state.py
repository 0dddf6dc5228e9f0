# SPDX-License-Identifier: Apache-2.0
"""State of a running device: samples subtracted stamp by stamp, restarts, another topic."""

import numpy as np
import pytest
from imu_workbench.web.live import readings as view
from imu_workbench.web.live.state import LiveState

from .heard import GRAVITY, TRUE_RATE, Clock, imu, put, stamps


def test_raw_and_compensated_are_subtracted_stamp_by_stamp(state: LiveState) -> None:
    difference = state.tracks['difference'].recent.since(0)
    assert len(difference.stamp) == 1800
    np.testing.assert_allclose(difference.values[:, :3], 0.004)
    np.testing.assert_allclose(difference.values[:, 3:], 0.03)


@pytest.mark.parametrize('lead', [-40, -1, 0, 40])
def test_partners_meet_whichever_comes_first(clock: Clock, lead: int) -> None:
    """The compensated stream is `lead` samples of 50 Hz ahead of the raw one."""
    state = LiveState(clock)
    stamp = stamps(4, 50)
    raw, compensated = imu(stamp, TRUE_RATE, GRAVITY), imu(stamp, TRUE_RATE - 1.0, GRAVITY)
    for now in range(-40, 250, 5):
        put(state, 'raw', raw[max(now, 0) : max(now + 5, 0)])
        put(state, 'compensated', compensated[max(now + lead, 0) : max(now + lead + 5, 0)])
        state.absorb()
    difference = state.tracks['difference'].recent.since(0)
    np.testing.assert_array_equal(difference.stamp, stamp)
    np.testing.assert_allclose(difference.values[:, :3], 1.0)


def test_a_bag_that_starts_again_clears_the_history(state: LiveState) -> None:
    put(state, 'raw', imu(stamps(2, 100), TRUE_RATE, GRAVITY))
    state.absorb()
    assert state.restarts == 1
    assert view.newest(state) == stamps(2, 100)[-1]
    assert len(view.line(state, 'raw', 3600.0).time) == 1


def test_late_samples_within_a_second_do_not_clear_it(state: LiveState) -> None:
    put(state, 'raw', imu(stamps(0.1, 100, begin_s=19.5), TRUE_RATE, GRAVITY))
    state.absorb()
    assert state.restarts == 0


def test_another_topic_in_a_role_starts_it_afresh(state: LiveState) -> None:
    state.forget('raw')
    assert state.tracks['raw'].newest == -1
    assert state.tracks['difference'].newest == -1
    assert state.tracks['compensated'].newest > 0
