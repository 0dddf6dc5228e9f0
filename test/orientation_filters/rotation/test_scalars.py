# SPDX-License-Identifier: Apache-2.0
"""Rotations of scalars are those of arrays, and symmetric matrices those of numpy."""

from __future__ import annotations

import numpy as np
import pytest
from orientation_filters.rotation import arrays, scalars

RNG = np.random.default_rng(3)


def random_quaternion() -> tuple[float, ...]:
    return tuple(arrays.normalised(RNG.normal(size=4)).tolist())


def test_quaternions_as_arrays() -> None:
    for _ in range(50):
        p, q = random_quaternion(), random_quaternion()
        v = tuple((RNG.normal(size=3) * RNG.choice([0.01, 0.19, 2.0])).tolist())
        product = arrays.multiply(np.array(p), np.array(q))
        np.testing.assert_allclose(scalars.multiply(p, q), product, atol=1e-15)
        np.testing.assert_allclose(scalars.normalised(q), q, atol=1e-15)
        turn = arrays.from_rotation_vector(np.array(v))
        np.testing.assert_allclose(scalars.from_rotation_vector(v), turn, atol=1e-14)
        rows = scalars.matrix(q)
        np.testing.assert_allclose(rows, arrays.to_matrix(np.array(q)), atol=1e-15)
        world = arrays.rotate(np.array(q), np.array(v))
        np.testing.assert_allclose(scalars.transform(rows, v), world, atol=1e-14)
        np.testing.assert_allclose(scalars.to_sensor(rows, tuple(world)), v, atol=1e-14)
        euler = arrays.euler_zyx(np.array(q))
        np.testing.assert_allclose(scalars.euler_zyx(q), euler, atol=1e-12)


@pytest.mark.parametrize('sign', [1.0, -1.0])
def test_euler_angles_at_a_vertical_pitch(sign: float) -> None:
    turn = arrays.from_rotation_vector(np.array([0.0, 0.0, 0.4]))
    q = arrays.multiply(turn, np.array([0.0, sign * np.sqrt(0.5), 0.0, np.sqrt(0.5)]))
    euler = scalars.euler_zyx(tuple(q.tolist()))
    np.testing.assert_allclose(euler, arrays.euler_zyx(q), atol=1e-12)
    np.testing.assert_allclose(euler, [0.0, sign * np.pi / 2, 0.4], atol=1e-7)


@pytest.mark.parametrize('up', [1.0, -1.0])
def test_attitude_from_two_vectors(up: float) -> None:
    north = (0.0, 1.0)
    for _ in range(20):
        f, m = tuple(RNG.normal(size=3).tolist()), tuple(RNG.normal(size=3).tolist())
        q = np.array(scalars.attitude_from_vectors(f, m, up, north))
        force, field = arrays.rotate(q, np.array(f)), arrays.rotate(q, np.array(m))
        np.testing.assert_allclose(force[:2], 0.0, atol=1e-9)
        assert force[2] * up > 0.0
        assert abs(field[0]) < 1e-9 < field[1]


def test_symmetric_matrices() -> None:
    a = RNG.normal(size=(3, 3))
    full = a @ a.T + np.eye(3)
    packed = tuple(full[np.triu_indices(3)].tolist())
    v = (0.3, -0.2, 0.5)
    np.testing.assert_allclose(scalars.apply_symmetric(packed, v), full @ v)
    inverse = np.linalg.inv(full)[np.triu_indices(3)]
    np.testing.assert_allclose(scalars.inverse_symmetric(packed), inverse, rtol=1e-12)
