# SPDX-License-Identifier: Apache-2.0
"""The gyroscope's bias: the mean rate at rest, a part of the corrections in motion."""

from __future__ import annotations

import math

import pytest
from orientation_filters.complementary.bias_learning import learned_bias
from orientation_filters.complementary.corrections import (
    HeadingCorrection,
    InclinationCorrection,
)
from orientation_filters.complementary.parameters import ComplementaryParameters
from orientation_filters.complementary.state import State, initial_state
from orientation_filters.rest_detection import start_rest
from orientation_filters.result import AT_REST, BIAS_LIMITED
from orientation_filters.rotation.scalars import IDENTITY, ZERO, Vector, matrix
from orientation_filters.sample_checks import CheckedSample

FORCE, FIELD = (0.0, 0.0, 9.81), (0.0, 2e-5, -4e-5)
NO_TILT, NO_TURN = InclinationCorrection(0.0, 0.0, 0.0), HeadingCorrection(0.0, 0.0)
PARAMS = ComplementaryParameters(learn_bias=True, rest_bias_time=2.0).kernel_params()


def rested(rate: Vector, seconds: float, *, learns: bool = True) -> tuple[Vector, int]:
    """Return bias and flags of a board that rests while its gyroscope shows a rate."""
    seen = CheckedSample(0, rate, FORCE, FIELD, True, True, 0.01, 0.01)
    state = initial_state()._replace(rest=start_rest(rate, FORCE, FIELD))
    flags = 0
    for _ in range(round(seconds * 100)):
        rest, bias, flags = learned_bias(
            state, PARAMS, seen, matrix(IDENTITY), NO_TILT, NO_TURN, learns
        )
        state = state._replace(rest=rest, bias=bias)
    return state.bias, flags


def test_at_rest_the_bias_approaches_the_mean_rate_exponentially() -> None:
    rate = (2e-3, -1e-3, 1e-3)
    bias, flags = rested(rate, 1.5 + 2.0)  # rest shows after 1.5 s, the time constant is 2 s
    assert flags == AT_REST
    assert bias == pytest.approx([(1.0 - math.exp(-1.0)) * w for w in rate], rel=0.03)
    assert rested(rate, 20.0)[0] == pytest.approx(rate, rel=1e-3)


def test_before_rest_shows_and_where_nothing_is_learned_there_is_no_bias() -> None:
    assert rested((2e-3, 0.0, 0.0), 1.0) == (ZERO, 0)
    assert rested((2e-3, 0.0, 0.0), 20.0, learns=False) == (ZERO, 0)


def test_a_rate_that_is_too_large_is_no_bias() -> None:
    assert rested((0.3, 0.0, 0.0), 15.0) == (ZERO, AT_REST | BIAS_LIMITED)


def in_motion(age: float, bias: Vector = ZERO) -> Vector:
    """Return the bias after one correction of +1 mrad about each axis of the world."""
    state: State = initial_state()._replace(age=age, bias=bias)
    seen = CheckedSample(0, ZERO, FORCE, FIELD, True, True, 0.01, 0.01)
    tilt, turn = InclinationCorrection(1e-3, 1e-3, 1.0), HeadingCorrection(1e-3, 1.0)
    return learned_bias(state, PARAMS, seen, matrix(IDENTITY), tilt, turn, True)[1]


def test_in_motion_an_attitude_that_has_to_be_turned_forward_had_too_much_taken_off() -> None:
    first = in_motion(age=100.0)
    assert first[0] == first[1] < 0.0
    assert first[2] < 0.0
    assert in_motion(age=0.0) == ZERO  # the first corrections are those of a wrong start
    limited = (-0.19999, 0.0, 0.0)
    assert in_motion(age=100.0, bias=limited) == limited
