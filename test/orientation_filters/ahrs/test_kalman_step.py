# SPDX-License-Identifier: Apache-2.0
"""One Kalman step: gravity tells the inclination, the field the heading, and a jam neither."""

from __future__ import annotations

import numpy as np
import pytest
from orientation_filters.ahrs.kalman_step import (
    ErrorEstimate,
    Innovation,
    Prior,
    measurement_update,
)
from orientation_filters.ahrs.state import Noise, Variances
from orientation_filters.rotation.scalars import ZERO

G, M = (2.0, -3.0, 9.1), (15.0, 20.0, -35.0)
ANGLE = np.array([0.01, -0.02, 0.03])
"""The attitude is wrong by this [rad]; the sensors measure without error."""
QUIET = Noise(1e-8, 1e-8, 0.0, 0.0, 1e-10, 0.5, 1e-10, 0.5)
LIMIT = 100.0


def corrected(
    *, force: bool = True, field: bool = True, disturbance: tuple[float, ...] = ZERO
) -> ErrorEstimate:
    """Return the correction of an attitude that is uncertain by 0.1 rad an axis."""
    seen = Innovation(
        gravity=G,
        field=M,
        z_gravity=tuple(-np.cross(G, ANGLE) * force),
        z_field=tuple((np.array(disturbance) - np.cross(M, ANGLE)) * field),
        has_gravity=force,
        has_field=field,
    )
    variances = Variances((0.01,) * 3, (1e-6,) * 3, (1e-8,) * 3, (1e-8,) * 3)
    return measurement_update(Prior(variances, ZERO), seen, QUIET, 0.01, LIMIT)


def across(vector: tuple[float, ...]) -> np.ndarray:
    """Return the part of the angle that turns a vector."""
    about = np.array(vector) / np.linalg.norm(vector)
    return ANGLE - about * (about @ ANGLE)


def test_both_sensors_together_tell_the_whole_angle() -> None:
    found = corrected()
    assert found.orientation == pytest.approx(ANGLE, abs=1e-5)
    assert max(found.variances.orientation) < 1e-6
    assert not found.jammed


@pytest.mark.parametrize(('alone', 'vector'), [({'field': False}, G), ({'force': False}, M)])
def test_a_single_sensor_tells_no_turn_about_itself(
    alone: dict[str, bool], vector: tuple[float, ...]
) -> None:
    found = corrected(**alone)
    assert found.orientation == pytest.approx(across(vector), abs=1e-5)
    left = np.array(found.variances.orientation)  # what stays is 0.01 rad² about the vector
    about = np.array(vector) / np.linalg.norm(vector)
    assert left == pytest.approx(0.01 * about**2, abs=1e-6)


def test_without_a_sample_nothing_changes() -> None:
    found = corrected(force=False, field=False)
    assert [*found.orientation, *found.bias] == [0.0] * 6
    assert found.variances.orientation == pytest.approx((0.01,) * 3)


def test_a_field_that_is_jammed_does_not_turn_the_attitude() -> None:
    loud = QUIET._replace(magnetic_disturbance=1e6)
    seen = Innovation(G, M, ZERO, (5e3, 0.0, 0.0), True, True)
    variances = Variances((0.01,) * 3, (1e-6,) * 3, (1e-8,) * 3, (1e6,) * 3)
    found = measurement_update(Prior(variances, ZERO), seen, loud, 0.01, LIMIT)
    assert found.jammed
    assert found.orientation == pytest.approx(ZERO)
