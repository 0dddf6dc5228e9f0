# SPDX-License-Identifier: Apache-2.0
"""The compiled complementary filter and its equations in numpy matrices give the same numbers."""

from __future__ import annotations

import numpy as np
import pytest
from imu_recording.recording import FloatArray, ImuRecording
from orientation_filters.complementary.adaptive import StepErrors, Unknowns, _turn
from orientation_filters.complementary.filter import Params
from orientation_filters.filters import filter_parameters, run_filter
from orientation_filters.rest_detection import is_bias, start_rest, update_rest
from orientation_filters.rotation.arrays import (
    from_rotation_vector,
    multiply,
    normalised,
    to_matrix,
)
from orientation_filters.rotation.scalars import ZERO
from orientation_filters.sample_checks import CheckedSample

from ..recordings import moving, random_attitude, rest

GRAVITY = 9.81


class Reference:
    """The complementary filter, step by step, from its first attitude on."""

    def __init__(self, params: Params, q: FloatArray, first: CheckedSample) -> None:
        self.params, self.q, self.bias, self.age = params, q, np.zeros(3), 0.0
        self.up = np.array([0.0, 0.0, params.up])
        self.north = np.array([*params.north, 0.0])
        self.rest = start_rest(
            first.angular_velocity, first.linear_acceleration, first.magnetic_field
        )

    def update(self, sample: CheckedSample) -> None:
        """Gyroscope, inclination, heading, then the bias."""
        dt, before = sample.interval, self.q
        rate = np.array(sample.angular_velocity) - self.bias
        q = multiply(before, from_rotation_vector(rate * dt))
        turned = self.inclination(q, np.array(sample.linear_acceleration), dt)
        if sample.has_field:
            turned = turned + self.heading(q, sample)
        self.learn(sample, to_matrix(q), turned)
        rescaled = 1.5 - 0.5 * float(before @ before)
        self.q = multiply(rescaled * np.array([*(0.5 * turned), 1.0]), q)
        self.age += dt

    def gain(self, cutoff: float, dt: float) -> float:
        """1 − exp(−2π f_c Δt)."""
        return float(1.0 - np.exp(-cutoff * dt))

    def inclination(self, q: FloatArray, force: FloatArray, dt: float) -> FloatArray:
        """The rotation from specific force to the vertical, by the gain."""
        gain = self.gain(self.params.inclination_rate, dt)
        up = to_matrix(q) @ force / np.linalg.norm(force)
        error = np.cross(up, self.up)
        return gain * (error if up @ self.up >= 0.0 else error / np.linalg.norm(error))

    def heading(self, q: FloatArray, sample: CheckedSample) -> FloatArray:
        """The rotation of the horizontal field to north, by the gain."""
        m = to_matrix(q) @ np.array(sample.magnetic_field)
        level = float(np.hypot(m[0], m[1]))
        error = np.cross([m[0], m[1], 0.0], self.north) / level
        if m @ self.north < 0.0:
            error = np.array([0.0, 0.0, -1.0 if error[2] < 0.0 else 1.0])
        return self.gain(self.params.heading_rate, sample.field_interval) * error

    def learn(self, sample: CheckedSample, attitude: FloatArray, turned: FloatArray) -> None:
        """The bias from the mean rate at rest, or from the corrections in motion."""
        p = self.params
        if not p.learn_bias:
            return
        known = tuple(self.bias.tolist())
        self.rest = update_rest(self.rest, p.rest, sample, known)
        rate = np.array(self.rest.angular_velocity)
        if self.rest.duration >= p.rest.duration:
            is_small = np.linalg.norm(rate) <= p.rest.bias_limit
            if is_bias(self.rest, p.rest) and is_small:
                part = sample.interval / (p.rest_bias_time + sample.interval)
                self.bias = self.bias + part * (rate - self.bias)
        elif p.bias_rate > 0.0 and self.age * p.inclination_rate >= 1.0:
            rates = np.array([p.inclination_rate, p.inclination_rate, p.heading_rate])
            changed = self.bias - attitude.T @ (p.bias_rate * rates * turned)
            if np.linalg.norm(changed) < p.rest.bias_limit:
                self.bias = changed


def checked(recording: ImuRecording) -> list[CheckedSample]:
    """The samples of a recording whose every number is good, missing fields excepted."""
    samples, last, last_field = [], 0, 0
    columns = (recording.angular_velocity, recording.linear_acceleration, recording.magnetic_field)
    for stamp, *row in zip(recording.stamp.tolist(), *columns, strict=True):
        w, f, m = (tuple(v.tolist()) for v in row)
        has_field = bool(np.isfinite(m).all())
        between = ((stamp - last) * 1e-9, (stamp - last_field) * 1e-9)
        samples.append(CheckedSample(stamp, w, f, m, True, has_field, *between))
        last, last_field = stamp, stamp if has_field else last_field
    return samples


@pytest.mark.parametrize(
    'world_frame', ['enu', *(pytest.param(f, marks=pytest.mark.long) for f in ('ned', 'nwu'))]
)
@pytest.mark.parametrize('options', [{'preset': 'paper'}, {'preset': 'paper', 'learn_bias': True}])
def test_kernel_equals_numpy(world_frame: str, options: dict) -> None:
    parameters = filter_parameters('complementary', world_frame=world_frame, **options)
    bias = np.radians([1.0, -2.0, 1.5])
    still = rest(random_attitude(2), seed=2, seconds=6.0, bias=bias, world_frame=world_frame)
    for recording in (moving(1, world_frame=world_frame, first_field=True), still):
        kernel = run_filter('complementary', recording, world_frame=world_frame, **options)
        samples = checked(recording)
        reference = Reference(parameters.kernel_params(), kernel.orientation[0], samples[0])
        for i, sample in enumerate(samples[1:], start=1):
            reference.update(sample)
            q = normalised(reference.q)
            np.testing.assert_allclose(kernel.orientation[i], q, rtol=0, atol=1e-10)
            np.testing.assert_allclose(kernel.bias[i], reference.bias, rtol=0, atol=1e-10)
    assert np.any(kernel.bias) == parameters.learn_bias


def joint(unknowns: Unknowns) -> FloatArray:
    """The 6×6 covariance of attitude and bias that noise, lag and bias stand for."""
    rows = [[0, 1, 2], [1, 3, 4], [2, 4, 5]]
    lag, bias = np.array(unknowns.lag), np.array(unknowns.bias)[rows]
    cross = lag @ bias
    return np.block([[np.diag(unknowns.noise) + cross @ lag.T, cross], [cross.T, bias]])


@pytest.mark.parametrize('axis', range(3))
def test_a_correction_is_that_of_the_joint_kalman_filter(axis: int) -> None:
    rng = np.random.default_rng(axis)
    root = rng.normal(size=(3, 3)) * 1e-3
    bias = tuple((root @ root.T)[np.triu_indices(3)].tolist())
    lag = tuple(tuple(row) for row in rng.normal(size=(3, 3)).tolist())
    unknowns = Unknowns(noise=(1e-4, 2e-4, 3e-4), lag=lag, bias=bias)
    unit = np.eye(6)[axis]
    found = _turn(StepErrors(ZERO, ZERO, unknowns), tuple(unit[:3].tolist()), 0.02, 5e-4)
    prior = joint(unknowns)
    gain = prior @ unit / (unit @ prior @ unit + 5e-4)
    posterior = prior - np.outer(gain, unit @ prior)
    np.testing.assert_allclose([*found.orientation, *found.bias], 0.02 * gain, rtol=1e-9)
    np.testing.assert_allclose(joint(found.unknowns), posterior, rtol=1e-6, atol=1e-12)
