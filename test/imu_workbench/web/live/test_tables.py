# SPDX-License-Identifier: Apache-2.0
"""Tables of the live view: values, the verdict on what compensation leaves, silent topics."""

import re

import numpy as np
import pytest
from imu_recording.recording import SECOND_NS
from imu_workbench.web.live import readings as view
from imu_workbench.web.live.state import LiveState
from imu_workbench.web.live.tables import verdict

from .heard import GRAVITY, TRUE_RATE, Clock, imu, put, stamps


def test_the_verdict_is_on_the_noise_and_names_the_axis_that_drifts(clock: Clock) -> None:
    """Three minutes at 20 Hz; accelerometer y drifts by ten times the noise of a second."""
    rng = np.random.default_rng(5)
    stamp = stamps(180, 20)
    time = (stamp - stamp[0])[:, None] / SECOND_NS
    rate = TRUE_RATE + rng.normal(0.0, 1e-3, (len(stamp), 3))
    force = GRAVITY + rng.normal(0.0, 0.01, (len(stamp), 3))
    drift = 10.0 * 0.01 / np.sqrt(20.0) * np.array([0.0, 1.0, 0.0])
    for drifts, said in (
        (0.0, r'^What is left is noise: at most 1\.\d+ ×'),
        (drift, r'beyond the noise of means of a second: accelerometer y \d'),
    ):
        state = LiveState(clock)
        put(state, 'raw', imu(stamp, rate, force + drifts * time / 180.0))
        state.absorb()
        assert re.search(said, verdict(state, 0))
    ratios = view.over_noise(state, 'accelerometer', 0)
    assert 0.8 < ratios[0] < 1.3
    assert ratios[1] == pytest.approx(10.0 / np.sqrt(3.0), rel=0.2)  # rms of a ramp
    assert np.isnan(view.over_noise(state, 'magnetometer', 0)).all()


def test_there_is_no_verdict_before_a_minute(state: LiveState) -> None:
    assert verdict(state, 0) == 'A verdict needs 60 s at rest since the zero.'
    why = '/imu/data_raw has 2 publishers (/one, /other)'
    assert verdict(state, 0, {'raw': why}) == f'No verdict: {why}.'
    assert verdict(state, 0, {'ahrs': why}).startswith('A verdict needs')
