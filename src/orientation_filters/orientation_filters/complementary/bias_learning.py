# SPDX-License-Identifier: Apache-2.0
"""The bias of the gyroscope, gains being fixed: the mean rate at rest, or integral action."""

from __future__ import annotations

from orientation_filters.complementary.corrections import (
    HeadingCorrection,
    InclinationCorrection,
)
from orientation_filters.complementary.state import Params, State
from orientation_filters.kernel import inline
from orientation_filters.rest_detection import RestState, is_bias, update_rest
from orientation_filters.result import AT_REST, BIAS_LIMITED
from orientation_filters.rotation.scalars import (
    Matrix,
    Vector,
    approach,
    dot,
    subtract,
    to_sensor,
)
from orientation_filters.sample_checks import CheckedSample


@inline
def learned_bias(
    state: State,
    params: Params,
    seen: CheckedSample,
    rows: Matrix,
    tilt: InclinationCorrection,
    turn: HeadingCorrection,
    learns: bool,
) -> tuple[RestState, Vector, int]:
    """Return rest, bias and flags: learned from the mean rate at rest, or from the corrections."""
    if not learns:
        return state.rest, state.bias, 0
    rest = state.rest
    if seen.has_force:
        rest = update_rest(rest, params.rest, seen, state.bias)
    if rest.duration >= params.rest.duration:
        bias, flags = _bias_at_rest(state.bias, rest, params, seen.interval)
        return rest, bias, flags
    has_settled = state.age * params.inclination_rate >= 1.0
    if params.learn_bias and params.bias_rate > 0.0 and has_settled:
        return rest, _bias_in_motion(state.bias, params, rows, tilt, turn), 0
    return rest, state.bias, 0


@inline
def _bias_at_rest(bias: Vector, rest: RestState, params: Params, dt: float) -> tuple[Vector, int]:
    """Let the bias approach the mean rate at rest, unless that is more than a bias can be."""
    mean = rest.angular_velocity
    if not (params.learn_bias and is_bias(rest, params.rest)):
        return bias, AT_REST
    if dot(mean, mean) > params.rest.bias_limit * params.rest.bias_limit:
        return bias, AT_REST | BIAS_LIMITED
    return approach(bias, mean, dt / (params.rest_bias_time + dt)), AT_REST


@inline
def _bias_in_motion(
    bias: Vector,
    params: Params,
    rows: Matrix,
    tilt: InclinationCorrection,
    turn: HeadingCorrection,
) -> Vector:
    """Let the bias take its part of the correction just made (integral action), sensor frame."""
    inclination = params.bias_rate * params.inclination_rate
    heading = params.bias_rate * params.heading_rate
    part = (
        inclination * (tilt.gain * tilt.x),
        inclination * (tilt.gain * tilt.y),
        heading * (turn.gain * turn.z),
    )
    corrected = subtract(bias, to_sensor(rows, part))
    limit = params.rest.bias_limit
    return corrected if dot(corrected, corrected) < limit * limit else bias
