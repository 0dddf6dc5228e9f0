# SPDX-License-Identifier: Apache-2.0
"""Samples as they arrive give the attitudes of the batch, in the axes of the body."""

from __future__ import annotations

import numpy as np
import pytest
from imu_recording.recording import ImuRecording
from imu_recording.ros.messages import ImuSample, MagneticSample
from orientation_filters.filters import FILTERS, filter_parameters, run_filter
from orientation_filters.live.filter import LiveEstimate, LiveFilter
from orientation_filters.rotation.arrays import rotate

from ..recordings import random_attitude, rest


def feed(live: LiveFilter, recording: ImuRecording) -> list[LiveEstimate]:
    found: list[LiveEstimate] = []
    for i, stamp in enumerate(recording.stamp.tolist()):
        w, f = recording.angular_velocity[i], recording.linear_acceleration[i]
        found += live.add_imu(ImuSample(stamp, tuple(w.tolist()), tuple(f.tolist())))
        field = tuple(recording.magnetic_field[i].tolist())
        found += live.add_field(MagneticSample(stamp, field))
    return found + live.flush()


@pytest.mark.parametrize('name', FILTERS)
def test_a_mounted_sensor_gives_the_attitude_of_the_body(name: str) -> None:
    mount = random_attitude(7)
    recording = rest(random_attitude(6), seed=6, seconds=2.0)
    parameters = filter_parameters(name, mount=mount.tolist())
    found = feed(LiveFilter(name, parameters), recording)
    batch = run_filter(name, recording, mount=mount.tolist())
    np.testing.assert_allclose([e.orientation for e in found], batch.orientation, atol=1e-12)
    covariance = np.reshape([e.covariance for e in found], (-1, 3, 3))
    np.testing.assert_allclose(covariance, batch.covariance, atol=1e-15)
    force = rotate(mount, recording.linear_acceleration)
    np.testing.assert_allclose([e.sample.linear_acceleration for e in found], force, atol=1e-12)


def test_status_tells_rate_jitter_and_counts() -> None:
    live = LiveFilter('ahrs', filter_parameters('ahrs'))
    assert live.status()[:2] == (0, 'waiting for samples')
    feed(live, rest(random_attitude(1), seed=1, seconds=3.0))
    level, line, values = live.status()
    assert (level, line) == (0, 'estimating')
    assert values['rate_hz'] == pytest.approx(100.0)
    assert values['jitter_ms'] == pytest.approx(0.0)
    assert values['exact_pairs'] == 300
    assert values['resets'] == values['dropped'] == 0
