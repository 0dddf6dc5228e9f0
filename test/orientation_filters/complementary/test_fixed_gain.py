# SPDX-License-Identifier: Apache-2.0
"""Corrections to level and north as of low-passes; the bias from rest, and from corrections."""

from __future__ import annotations

import math

import numpy as np
import pytest
from orientation_filters.complementary.fixed_gain import (
    HeadingCorrection,
    InclinationCorrection,
    State,
    correct,
    heading_correction,
    inclination_correction,
    initial_state,
    learned_bias,
)
from orientation_filters.complementary.parameters import ComplementaryParameters
from orientation_filters.rest_detection import start_rest
from orientation_filters.result import AT_REST, BIAS_LIMITED
from orientation_filters.rotation import arrays
from orientation_filters.rotation.scalars import IDENTITY, ZERO, Vector, matrix, multiply
from orientation_filters.sample_checks import CheckedSample

FORCE, FIELD = (0.0, 0.0, 9.81), (0.0, 2e-5, -4e-5)
"""A board at rest, level, y to magnetic north."""
NO_TILT, NO_TURN = InclinationCorrection(0.0, 0.0, 0.0), HeadingCorrection(0.0, 0.0)
PARAMS = ComplementaryParameters(learn_bias=True, rest_bias_time=2.0).kernel_params()


def sample(interval: float, **usable: bool) -> CheckedSample:
    known = {'has_force': True, 'has_field': True} | usable
    return CheckedSample(
        0, ZERO, FORCE, FIELD, **known, interval=interval, field_interval=interval
    )


def turned(angle: list[float]) -> tuple[float, ...]:
    return tuple(arrays.from_rotation_vector(np.array(angle)).tolist())


@pytest.mark.parametrize('interval', [1e-6, 0.01, 0.0265, 0.0266, 1.0])
def test_the_part_that_is_done_is_that_of_a_low_pass(interval: float) -> None:
    """Of 3 Hz: all but exp(−2π · 3 Hz · Δt), on both sides of where the series ends."""
    params = ComplementaryParameters(cutoff_hz=3.0).kernel_params()
    done = -math.expm1(-2.0 * math.pi * 3.0 * interval)
    tilt = inclination_correction(params, sample(interval), matrix(IDENTITY))
    turn = heading_correction(params, sample(interval), matrix(IDENTITY), 0.123)
    assert tilt.gain == pytest.approx(done, rel=1e-7)
    assert turn.gain == 0.123  # the same as the tilt's, which is not computed again


@pytest.mark.parametrize('angle', [[0.2, 0.0, 0.0], [0.1, -0.3, 0.0], [0.0, 0.0, 0.4]])
def test_steps_lead_to_level_and_north_and_keep_the_length(angle: list[float]) -> None:
    params = ComplementaryParameters(cutoff_hz=1.0, heading_cutoff_hz=0.8).kernel_params()
    q = turned(angle)
    for _ in range(300):
        tilt = inclination_correction(params, sample(0.01), matrix(q))
        turn = heading_correction(params, sample(0.01), matrix(q), tilt.gain)
        q = correct(q, q, tilt, turn)
    assert np.linalg.norm(arrays.to_rotation_vector(np.array(q))) < 1e-4
    assert np.linalg.norm(q) == pytest.approx(1.0, abs=1e-6)


def test_a_correction_is_a_turn_about_the_worlds_axes() -> None:
    q = turned([0.3, -0.2, 1.0])
    tilt = InclinationCorrection(x=2e-3, y=-1e-3, gain=1.0)
    found = correct(q, q, tilt, HeadingCorrection(z=3e-3, gain=0.5))
    np.testing.assert_allclose(found, multiply(turned([2e-3, -1e-3, 1.5e-3]), q), atol=1e-5)


def test_what_is_not_usable_and_a_field_straight_down_turn_nothing() -> None:
    params = ComplementaryParameters().kernel_params()
    rows = matrix(turned([0.2, 0.1, 0.3]))
    assert inclination_correction(params, sample(0.01, has_force=False), rows).gain == 0.0
    assert heading_correction(params, sample(0.01, has_field=False), rows, 0.5).gain == 0.0
    down = sample(0.01)._replace(magnetic_field=(0.0, 1e-9, -4e-5))
    assert heading_correction(params, down, matrix(IDENTITY), 0.5).gain == 0.0


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
