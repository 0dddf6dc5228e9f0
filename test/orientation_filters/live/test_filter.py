# SPDX-License-Identifier: Apache-2.0
"""Samples as they arrive give the attitudes of the batch, with the state in compiled memory."""

from __future__ import annotations

import numpy as np
import pytest
from imu_recording.recording import ImuRecording
from imu_recording.ros.messages import ImuSample, MagneticSample
from orientation_filters.ahrs import filterpy_kalman
from orientation_filters.filters import FILTERS, filter_parameters, run_filter
from orientation_filters.live.filter import (
    CompiledState,
    LiveEstimate,
    LiveFilter,
    PlainState,
    live_state,
)
from orientation_filters.parameters import PRESET_NAMES
from orientation_filters.rotation.arrays import rotate

from ..recordings import moving, random_attitude, rest, samples_of


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


@pytest.mark.parametrize('name', FILTERS)
@pytest.mark.parametrize('preset', PRESET_NAMES)
def test_the_compiled_state_follows_the_plain_one(name: str, preset: str) -> None:
    first = filter_parameters(name, preset=preset).kernel_params()
    later = filter_parameters(name, preset=preset, bias_limit=1e-3).kernel_params()
    compiled, plain = live_state(FILTERS[name], first), PlainState(FILTERS[name], first)
    assert isinstance(compiled, CompiledState)
    for i, sample in enumerate(samples_of(moving(2, seconds=1.0))):
        if i == 50:
            compiled.set_params(later)
            plain.set_params(later)
        one, other = compiled.update(sample), plain.update(sample)
        assert one.flags == other.flags
        np.testing.assert_array_equal(one.orientation, other.orientation)
        np.testing.assert_array_equal(one.covariance, other.covariance)
    assert compiled.state.stamp == plain.state.stamp > 0
    assert compiled.state.bias == plain.state.bias


def test_changed_parameters_apply_and_the_state_stays() -> None:
    slow = filter_parameters('complementary', cutoff_hz=0.1).kernel_params()
    fast = filter_parameters('complementary', cutoff_hz=10.0).kernel_params()
    samples = samples_of(moving(2, seconds=1.0))
    changed, kept = (live_state(FILTERS['complementary'], slow) for _ in range(2))
    for sample in samples[:50]:
        changed.update(sample)
        kept.update(sample)
    changed.set_params(fast)
    assert changed.state == kept.state
    assert changed.update(samples[50]).orientation != kept.update(samples[50]).orientation


def test_a_module_without_step_runs_in_plain_python() -> None:
    params = filter_parameters('ahrs', implementation='filterpy').kernel_params()
    state = live_state(filterpy_kalman, params)
    assert isinstance(state, PlainState)
    found = [state.update(sample) for sample in samples_of(moving(2, seconds=0.1))]
    assert np.linalg.norm(found[-1].orientation) == pytest.approx(1.0)
