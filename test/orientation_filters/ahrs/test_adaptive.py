# SPDX-License-Identifier: Apache-2.0
"""The adaptive step takes away the angle that its means show."""

from __future__ import annotations

import numpy as np
import pytest
from orientation_filters.ahrs.adaptive import (
    adaptive_update,
    start_adaptive,
)
from orientation_filters.ahrs.state import State, initial_state
from orientation_filters.filters import filter_parameters
from orientation_filters.result import AT_REST
from orientation_filters.rotation import arrays
from orientation_filters.rotation.scalars import ZERO
from orientation_filters.sample_checks import GRAVITY, CheckedSample

PARAMS = filter_parameters('ahrs', preset='robust').kernel_params()
FORCE, FIELD = (0.0, 0.0, GRAVITY), (0.0, 2e-5, -4e-5)
"""A board at rest, level, y to magnetic north."""
STEP = 0.01


def sample(number: int, *, has_field: bool = True) -> CheckedSample:
    return CheckedSample(
        number * 10_000_000, ZERO, FORCE, FIELD, True, has_field, STEP, STEP if has_field else 9.0
    )


def started(angle: list[float], *, has_field: bool = True) -> State:
    """Return the state of an attitude that is wrong by `angle` [rad], world."""
    state = initial_state()
    wrong = tuple(arrays.from_rotation_vector(np.array(angle)).tolist())
    first = sample(0, has_field=has_field)
    adaptive = start_adaptive(state.adaptive, PARAMS.averaging, first, 0)
    return state._replace(stamp=0, orientation=wrong, adaptive=adaptive)


def error_of(state: State) -> np.ndarray:
    return arrays.to_rotation_vector(np.array(state.orientation))


def test_without_a_field_any_heading_is_as_likely() -> None:
    """An even distribution over a turn has the variance (2π)² / 12."""
    heading = started([0.0] * 3, has_field=False).adaptive.covariance.orientation[5]
    assert heading == pytest.approx((2.0 * np.pi) ** 2 / 12.0, rel=1e-3)
    assert started([0.0] * 3).adaptive.covariance.orientation[5] < heading


@pytest.mark.parametrize('angle', [[0.1, 0.0, 0.0], [0.0, -0.1, 0.0], [0.06, 0.05, 0.0]])
def test_one_step_levels_the_attitude(angle: list[float]) -> None:
    state = started(angle)
    for k in range(1, 12):
        state, _ = adaptive_update(state, PARAMS, sample(k), state.orientation, 0)
    assert state.updates == 1
    assert np.linalg.norm(error_of(state)[:2]) < 0.2 * np.linalg.norm(angle)
    assert np.linalg.norm(state.linear_acceleration) < 0.2 * GRAVITY * np.linalg.norm(angle)
    assert state.adaptive.averages.integrals.elapsed < PARAMS.averaging.interval


def test_what_is_right_stays_and_is_known_better() -> None:
    state = started([0.0, 0.0, 0.0])
    for k in range(1, 101):
        state, _ = adaptive_update(state, PARAMS, sample(k), state.orientation, 0)
    assert error_of(state) == pytest.approx(ZERO, abs=1e-9)
    assert state.adaptive.covariance.orientation[0] < 0.01 * PARAMS.averaging.initial_inclination


def test_nothing_measured_is_nothing_estimated() -> None:
    before = started([0.1, 0.0, 0.2])
    blind = sample(1)._replace(has_force=False, has_field=False, interval=0.1)
    after, _ = adaptive_update(before, PARAMS, blind, before.orientation, 0)
    assert after.updates == 1
    assert error_of(after) == pytest.approx([0.1, 0.0, 0.2])
    known, now = before.adaptive.covariance.orientation, after.adaptive.covariance.orientation
    assert all(now[k] >= known[k] for k in (0, 3, 5))


def test_a_steady_rate_at_rest_is_the_bias() -> None:
    state, rate = started([0.0, 0.0, 0.0]), (2e-3, -1e-3, 1.5e-3)
    for k in range(1, 1001):
        turn = STEP * (np.array(rate) - state.bias)
        carried = arrays.multiply(np.array(state.orientation), arrays.from_rotation_vector(turn))
        seen = sample(k)._replace(angular_velocity=rate)
        state, flags = adaptive_update(state, PARAMS, seen, tuple(carried.tolist()), 0)
    assert flags & AT_REST
    assert state.bias == pytest.approx(rate, abs=3e-4)
    assert error_of(state) == pytest.approx(ZERO, abs=3e-3)
