# SPDX-License-Identifier: Apache-2.0
"""A course over time that the noise model follows is betrayed by the runs that repeat it."""

from collections.abc import Callable
from functools import lru_cache

import numpy as np
import pytest
from thermal_comp.data.preparation import prepare
from thermal_comp.diagnosis.evidence.common_mode import runs_in_step
from thermal_comp.effects.bias_temperature import BiasTemperature
from thermal_comp.linear.candidate_design import CandidateDesign, ColumnSource
from thermal_comp.noise.estimation import fit_noise

from ...campaign import WHITE, chamber, run

HOUR = 3600.0
GAINS = np.array([1.2, -0.7, 0.9])


@lru_cache
def design_with(
    course: Callable[[np.ndarray, int], np.ndarray] | None, seed: int
) -> CandidateDesign:
    """Return the design of three runs with a course of twice the gyroscope's noise of 1 s."""
    size = 2.0 * WHITE['angular_velocity']
    runs = []
    for number, up in enumerate(('+x', '+y', '+z')):
        wave = course(chamber(period=20.0)[0], number) if course else np.zeros(1)
        error = {'angular_velocity': size * np.multiply.outer(wave, GAINS)} if course else None
        runs.append(run(up, seed=10 * seed + number, period=20.0, error=error))
    prepared = prepare(runs)
    noise = fit_noise(prepared, 'gyroscope')
    return CandidateDesign(ColumnSource(prepared), 'gyroscope', noise, [BiasTemperature()])


def rhythm(time: np.ndarray, number: int) -> np.ndarray:
    """A wave of 3.5 h that every run repeats."""
    del number
    return np.sin(2.0 * np.pi * time / (3.5 * HOUR) + 1.0)


def wander(time: np.ndarray, number: int) -> np.ndarray:
    """A supply that wanders anew in every run."""
    steps = np.random.default_rng(70 + number).standard_normal(len(time))
    keep = np.exp(-20.0 / HOUR)
    level = np.empty(len(time))
    state = 0.0
    for i, step in enumerate(steps):
        state = keep * state + np.sqrt(1.0 - keep**2) * step
        level[i] = state
    return level


@pytest.mark.parametrize('seed', range(2))
def test_noise_has_nothing_in_common(seed: int) -> None:
    assert runs_in_step(design_with(None, seed)) < 8.0


def test_a_rhythm_is_common_to_the_runs() -> None:
    assert runs_in_step(design_with(rhythm, 5)) > 8.0


def test_a_supply_that_wanders_anew_is_not() -> None:
    assert runs_in_step(design_with(wander, 6)) < 8.0


def test_nothing_is_common_once_the_course_is_known() -> None:
    design = design_with(rhythm, 5)
    waves = design.generic_terms(
        [(lambda r: np.column_stack([rhythm(r.time, 0), rhythm(r.time + 0.9 * HOUR, 0)]), False)]
    )
    assert runs_in_step(design, waves) < 8.0
