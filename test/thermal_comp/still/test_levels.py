# SPDX-License-Identifier: Apache-2.0
"""Curve and levels together, on numbers drawn from the stated equation."""

from __future__ import annotations

import numpy as np
import pytest
from thermal_comp.still.levels import LevelEquations, solve_levels

LOGS, EACH, SLOPE = 40, 3, 2.0
SIGMA = np.array([0.5, 0.05, 1.0, 0.01])


def equations(seed: int, odd: float = 0.0) -> LevelEquations:
    """Return logs at a temperature each: only their levels tell the slope of the curve."""
    rng = np.random.default_rng(seed)
    k = LOGS * EACH
    of_log = np.repeat(np.arange(LOGS), EACH)
    temperature = rng.uniform(-1.0, 1.0, LOGS)[of_log]
    turn_on = SIGMA[0] * rng.standard_normal(LOGS)[of_log]
    level = 3.0 + turn_on + SIGMA[1] * rng.standard_normal(k)
    level[0] += odd
    weight = 1e4
    # Unknowns: k levels, line, k slopes; each stretch measures level + line · T once.
    rows = np.zeros((k, 2 * k + 1))
    rows[np.arange(k), np.arange(k)] = 1.0
    rows[:, k] = temperature
    measured = level + SLOPE * temperature
    return LevelEquations(
        gram=weight * rows.T @ rows,
        moment=weight * rows.T @ measured,
        seen=np.eye(k),
        target=np.zeros(k),
        common=np.ones((k, 1)),
        common_std=np.array([np.inf]),
        same_log=(of_log[:, None] == of_log).astype(float),
        floor=np.zeros(k),
        fixed=np.full(k + 1, np.inf),
        bending=np.full(k + 1, np.inf),
        slopes=np.arange(k + 1) > 0,
        usual=SIGMA * [0.3, 3.0, 1.0, 1.0],
    )


@pytest.mark.long
def test_levels_of_many_logs_tell_the_slope_and_how_sure_it_is() -> None:
    apart, widths = [], []
    for seed in range(20):
        solution = solve_levels(equations(seed))
        k = LOGS * EACH
        std = float(np.sqrt(solution.covariance[k, k]))
        apart.append((solution.estimate[k] - SLOPE) / std)
        widths.append(solution.sigma[:2] / SIGMA[:2])
    assert 0.6 < np.std(apart) < 1.5
    assert np.abs(np.mean(widths, axis=0) - 1.0).max() < 0.2


def test_a_level_unlike_the_others_stands_out() -> None:
    assert solve_levels(equations(1)).apart.max() < 5.0
    solution = solve_levels(equations(1, odd=3.0))
    assert int(np.argmax(solution.apart)) == 0
    assert solution.apart[0] > 6.0
