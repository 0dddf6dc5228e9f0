# SPDX-License-Identifier: Apache-2.0
"""The unrolled covariance is the 6×6 one of the textbook, whatever the order of measurements."""

from __future__ import annotations

import numpy as np
import pytest
from imu_recording.recording import FloatArray
from orientation_filters.ahrs.covariance import (
    Errors,
    JointCovariance,
    independent,
    observe,
    predict,
    widen,
    with_independent_bias,
)
from orientation_filters.rotation.scalars import ZERO, ZERO_SYMMETRIC

RNG = np.random.default_rng(8)
UPPER = np.triu_indices(3)


def joint(p: FloatArray) -> JointCovariance:
    rows = tuple(tuple(row) for row in p[:3, 3:].tolist())
    return JointCovariance(tuple(p[:3, :3][UPPER]), rows, tuple(p[3:, 3:][UPPER]))


def whole(c: JointCovariance) -> FloatArray:
    p = np.zeros((6, 6))
    for place, part in ((0, c.orientation), (3, c.bias)):
        block = np.zeros((3, 3))
        block[UPPER] = part
        p[place : place + 3, place : place + 3] = block + np.triu(block, 1).T
    p[:3, 3:] = c.cross
    p[3:, :3] = np.array(c.cross).T
    return p


def random_covariance() -> FloatArray:
    root = RNG.normal(size=(6, 6))
    return root @ root.T


def test_a_bias_turns_the_attitude_while_time_passes() -> None:
    p, f = random_covariance(), RNG.normal(size=(3, 3))
    step = np.block([[np.eye(3), f], [np.zeros((3, 3)), np.eye(3)]])
    noise = np.diag([0.3] * 3 + [0.2] * 3)
    found = predict(joint(p), tuple(map(tuple, f.tolist())), 0.3, 0.2)
    np.testing.assert_allclose(whole(found), step @ p @ step.T + noise, rtol=1e-12)


def test_measurements_in_any_order_are_the_joint_one() -> None:
    p, h = random_covariance(), RNG.normal(size=(3, 6))
    z, r = RNG.normal(size=3), np.array([0.1, 1.0, 3.0])
    gain = p @ h.T @ np.linalg.inv(h @ p @ h.T + np.diag(r))
    for order in ([0, 1, 2], [2, 0, 1]):
        errors = Errors(ZERO, ZERO, joint(p))
        for k in order:
            errors = observe(errors, tuple(h[k, :3]), tuple(h[k, 3:]), z[k], r[k])
        np.testing.assert_allclose([*errors.orientation, *errors.bias], gain @ z, rtol=1e-9)
        np.testing.assert_allclose(whole(errors.covariance), p - gain @ h @ p, atol=1e-9)


def test_a_bias_without_variance_is_never_learned() -> None:
    fixed = with_independent_bias(joint(random_covariance()), ZERO_SYMMETRIC)
    errors = observe(Errors(ZERO, ZERO, fixed), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), 5.0, 0.1)
    assert errors.bias == ZERO
    assert errors.orientation[0] != 0.0


def test_doubt_is_added_where_it_belongs() -> None:
    wider = widen(independent(1.0, 2.0, 3.0), 0.5, 0.25)
    assert np.diag(whole(wider)) == pytest.approx([1.5, 1.5, 2.25, 3.0, 3.0, 3.0])
