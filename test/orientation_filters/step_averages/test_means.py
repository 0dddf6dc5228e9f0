# SPDX-License-Identifier: Apache-2.0
"""What averages measure: acceleration, the angle of a field, the bias at rest, and how well."""

from __future__ import annotations

import math

import pytest
from orientation_filters.filters import filter_parameters
from orientation_filters.result import SIX_AXIS
from orientation_filters.rotation.scalars import IDENTITY, ZERO, Vector, matrix
from orientation_filters.sample_checks import GRAVITY, CheckedSample
from orientation_filters.step_averages.accumulation import (
    accumulate,
    no_averages,
    no_integrals,
    start_averages,
)
from orientation_filters.step_averages.means import Means, after_step, take_means

PARAMS = filter_parameters('ahrs', preset='robust').kernel_params().averaging
REST, NORTH = (0.0, 0.0, GRAVITY), (0.0, 2e-5, -4e-5)
KNOWN = (1e-6, 0.0, 0.0, 1e-6, 0.0, 1e-4)
"""Covariance of the orientation [rad²]."""


def steps(
    count: int,
    force: Vector = REST,
    field: Vector | None = NORTH,
    rate: Vector = ZERO,
    bias: Vector = ZERO,
    *,
    flags: int = 0,
    later: Vector | None = None,
) -> Means:
    """Return the means of the last of so many steps of 0.1 s; `later`: the field of the last."""
    seen = CheckedSample(0, rate, force, field or NORTH, True, field is not None, 0.01, 0.01)
    state = start_averages(no_averages(), PARAMS, seen, 0)
    for step in range(count):
        if later is not None and step == count - 1:
            seen = seen._replace(magnetic_field=later)
        for _ in range(10):
            state = accumulate(state, PARAMS, seen, IDENTITY, bias)
        means = take_means(state, PARAMS, bias, matrix(IDENTITY), KNOWN, KNOWN, flags)
        state = after_step(state, means, IDENTITY)
        assert state.integrals == no_integrals()
    return means


def test_at_rest_nothing_is_accelerated_and_the_field_is_the_reference() -> None:
    means = steps(50)
    assert means.force.acceleration == pytest.approx(ZERO, abs=1e-9)
    assert means.field.disturbance == pytest.approx(ZERO, abs=1e-12)
    assert means.field.east == pytest.approx(0.0, abs=1e-12)
    assert 0.0 < means.force.variance < 1.0


def test_a_push_to_the_east_is_measured_and_makes_the_vertical_uncertain() -> None:
    means = steps(50, (1.0, 0.0, GRAVITY))
    assert means.force.acceleration == pytest.approx((1.0, 0.0, 0.0), abs=1e-3)
    assert means.force.variance > 5.0 * steps(50).force.variance
    assert means.force.added_tilt_variance == pytest.approx((1.0 / GRAVITY) ** 2, rel=0.05)
    assert steps(50).force.added_tilt_variance == 0.0


@pytest.mark.parametrize('degrees', [-10.0, 5.0])
def test_a_field_turned_to_the_east_shows_the_sine_of_its_angle(degrees: float) -> None:
    angle = math.radians(degrees)
    east = (2e-5 * math.sin(angle), 2e-5 * math.cos(angle), -4e-5)
    means = steps(50, later=east)
    assert means.field.east == pytest.approx(math.sin(angle))
    assert means.field.variance > 0.0


def test_without_a_field_there_is_no_heading() -> None:
    assert steps(3, field=None).field.variance < 0.0


def test_at_rest_the_bias_is_off_by_what_the_mean_rate_is_not() -> None:
    rate, bias = (2e-3, -1e-3, 0.0), (3e-3, 0.0, 1e-3)
    means = steps(60, rate=rate, bias=bias)
    assert means.rest.error == pytest.approx((1e-3, 1e-3, 1e-3), rel=0.01)
    assert min(means.rest.variance) > 0.0
    assert steps(5, rate=rate).rest.variance == (-1.0, -1.0, -1.0)  # rest has not shown yet


def test_with_six_axes_a_turn_about_the_vertical_is_no_sure_bias() -> None:
    nine, six = (steps(60, rate=(0.0, 0.0, 2e-3), flags=f).rest.variance for f in (0, SIX_AXIS))
    assert six[:2] == nine[:2]
    assert six[2] != nine[2]
