# SPDX-License-Identifier: Apache-2.0
"""How the complementary filter learns the gyroscope's bias: at rest, and from its corrections."""

from __future__ import annotations

from orientation_filters.complementary_state import Params
from orientation_filters.flags import AT_REST, BIAS_LIMITED
from orientation_filters.kernel import inline
from orientation_filters.quaternion import Matrix, Vector, approach, dot, subtract, to_sensor
from orientation_filters.rest import RestState, is_bias


@inline
def learn(
    bias: Vector,
    params: Params,
    rest: RestState,
    rows: Matrix,
    turned: Vector,
    age: float,
    dt: float,
) -> tuple[Vector, int]:
    """Return the bias after a sample that turned the attitude by `turned` [rad], and flags."""
    if rest.duration >= params.rest.duration:
        return _learn_at_rest(bias, rest, params, dt)
    if params.learn_bias and params.bias_rate > 0.0 and age * params.inclination_rate >= 1.0:
        return _learn_in_motion(bias, params, rows, turned), 0
    return bias, 0


@inline
def _learn_at_rest(bias: Vector, rest: RestState, params: Params, dt: float) -> tuple[Vector, int]:
    """Let the bias approach the mean rate at rest, unless that is more than a bias can be."""
    mean = rest.angular_velocity
    if not (params.learn_bias and is_bias(rest, params.rest)):
        return bias, AT_REST
    if dot(mean, mean) > params.rest.bias_limit * params.rest.bias_limit:
        return bias, AT_REST | BIAS_LIMITED
    return approach(bias, mean, dt / (params.rest_bias_time + dt)), AT_REST


@inline
def _learn_in_motion(bias: Vector, params: Params, rows: Matrix, turned: Vector) -> Vector:
    """Let the bias take its part of the correction just made (integral action), sensor frame."""
    tilt = params.bias_rate * params.inclination_rate
    spin = params.bias_rate * params.heading_rate
    part = (tilt * turned[0], tilt * turned[1], spin * turned[2])
    corrected = subtract(bias, to_sensor(rows, part))
    limit = params.rest.bias_limit
    return corrected if dot(corrected, corrected) < limit * limit else bias
