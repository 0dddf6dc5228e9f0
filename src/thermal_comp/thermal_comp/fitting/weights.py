# SPDX-License-Identifier: Apache-2.0
"""The weights of a fit: those of the noise, or without slow noise where that predicts better.

Where what is left of a model is an effect that it lacks, slow noise large enough to allow for it
leaves the slope to what changes fast: an hour's cooling then outweighs the day that follows.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from imu_recording.recording import FloatArray

from thermal_comp.data.conditions import Sensor
from thermal_comp.data.improvement import falls
from thermal_comp.data.kept_results import kept
from thermal_comp.data.prepared_run import PreparedRun
from thermal_comp.effects.effect import Effect
from thermal_comp.fitting.part_sums import part_sums
from thermal_comp.linear.design import Design
from thermal_comp.linear.normal_equations import Solution, solve
from thermal_comp.linear.whitening import apply_transposed
from thermal_comp.model.values import NoiseModel
from thermal_comp.noise.covariance import noise_product

AXES = 3
LARGEST_CHANCE = 0.1
"""Probability that other weights predict better by chance: a wrong choice costs little."""


def with_best_weights(
    runs: Sequence[PreparedRun],
    effects: Mapping[Sensor, Sequence[Effect]],
    noise: Mapping[Sensor, NoiseModel],
) -> dict[Sensor, NoiseModel]:
    """Return the noise of each sensor, its fits weighing as predicts held-out parts better.

    An axis is weighed without slow noise where this lowers the error by enough to matter. Effects
    whose coefficients have priors are left out of the trial.
    """
    free = {s: [e for e in effects[s] if e.coefficient_deviations() is None] for s in noise}
    return {sensor: _best(runs, sensor, free[sensor], noise[sensor]) for sensor in noise}


def notes_of_weights(noise: Mapping[str, NoiseModel]) -> list[str]:
    """Return a sentence on each sensor with axes that are weighed without slow noise."""
    axes = {
        s: [a for a, on in zip('xyz', n.white_weights, strict=True) if on]
        for s, n in noise.items()
    }
    return [
        f'{sensor} {", ".join(some)}: fitted without the weight of slow noise, which predicts '
        'held-out parts better'
        for sensor, some in axes.items()
        if some
    ]


@kept
def _best(
    runs: Sequence[PreparedRun], sensor: Sensor, effects: Sequence[Effect], noise: NoiseModel
) -> NoiseModel:
    weighed, white = (replace(noise, white_weights=(on,) * AXES) for on in (False, True))
    if not noise.amplitudes.any():
        return weighed
    before, after = (_left(runs, sensor, effects, one) for one in (weighed, white))
    least = white.weights.variance_of_means(runs[0].period)
    lower = [
        falls(before[:, k], after[:, k], least[k], chance=LARGEST_CHANCE) for k in range(AXES)
    ]
    return replace(noise, white_weights=tuple(lower))


def _left(
    runs: Sequence[PreparedRun], sensor: Sensor, effects: Sequence[Effect], noise: NoiseModel
) -> FloatArray:
    """Return (k, 3) mean squares that effects leave on held-out pieces [unit²]."""
    sums = part_sums(runs, sensor, effects, (), noise)
    errors = [sums.errors(part, sums.known) for part in sums.parts()]
    return np.concatenate([np.zeros((0, AXES)), *errors])


def solved(design: Design) -> Solution:
    """Return the least-squares solution with the weights of a fit, χ² by those of the noise.

    With weights W other than S⁻¹, S the covariance of the noise, the covariance of the estimate is
    C Xᵀ W S W X C, C = (Xᵀ W X)⁻¹.
    """
    weighted = design.weighted
    equations = weighted.equations()
    solution = solve(equations)
    if weighted is design:
        return solution
    estimate, by_noise = solution.estimate[:, 0], design.equations()
    chi_square = by_noise.energy[0] + estimate @ (
        by_noise.gram @ estimate - 2.0 * by_noise.moment[:, 0]
    )
    spread = equations.gram.copy()
    for run, sensor, axis in design.pieces():
        noise = design.noise[sensor]
        if noise.white_weights[axis]:
            index, white, _ = weighted.piece(run, sensor, axis)
            gains = weighted.whitening(sensor).gains_of(run, axis)
            turned = apply_transposed(white, gains)
            rows = design.valid(run, sensor)
            product = noise_product(noise, design.runs[run], axis, turned, rows)
            spread[np.ix_(index, index)] += turned.T @ product - white.T @ white
    return replace(
        solution,
        covariance=solution.response @ spread @ solution.response,
        chi_square=np.array([max(float(chi_square), 0.0)]),
    )
