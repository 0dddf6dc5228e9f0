# SPDX-License-Identifier: Apache-2.0
"""What gravity and field turn the attitude by: exponential approach, to level and to north."""

from __future__ import annotations

import math

import numpy as np
import pytest
from orientation_filters.complementary.corrections import (
    HeadingCorrection,
    InclinationCorrection,
    correct,
    heading_correction,
    inclination_correction,
)
from orientation_filters.complementary.parameters import ComplementaryParameters
from orientation_filters.rotation import arrays
from orientation_filters.rotation.scalars import ZERO, matrix, multiply
from orientation_filters.sample_checks import CheckedSample

FORCE, FIELD = (0.0, 0.0, 9.81), (0.0, 2e-5, -4e-5)
"""A board at rest, level, y to magnetic north."""
LEVEL = (0.0, 0.0, 0.0, 1.0)


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
    tilt = inclination_correction(params, sample(interval), matrix(LEVEL))
    turn = heading_correction(params, sample(interval), matrix(LEVEL), 0.123)
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
    assert heading_correction(params, down, matrix(LEVEL), 0.5).gain == 0.0
