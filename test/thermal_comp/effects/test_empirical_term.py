# SPDX-License-Identifier: Apache-2.0
"""Groups of the empirical term that are not in use cost nothing and change nothing."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from imu_recording.user_error import UserError
from thermal_comp.data.conditions import Conditions
from thermal_comp.effects.c_form import CForm, Signals
from thermal_comp.effects.empirical_term import (
    COLUMN_GROUPS,
    GROUP_COUNT,
    LAG_GROUPS,
    PLAIN_GROUPS,
    PLAY_GROUPS,
    Empirical,
)


def conditions() -> Conditions:
    still = np.zeros((50, 3))
    time = np.linspace(0.0, 3000.0, 50)
    return Conditions(time, 20.0 + 15.0 * np.sin(time / 500.0), still, still, still)


@pytest.mark.parametrize('used', [(0,), (1,), (2,), (3,), (0, 3), (1, 2), (4,), (5,), (0, 6, 7)])
def test_only_groups_in_use_have_columns(used: tuple[int, ...]) -> None:
    whole, history = Empirical().columns(conditions())
    deviations = np.zeros((GROUP_COUNT, 3))
    deviations[list(used), 1] = 1.0
    form = Empirical(deviations=tuple(deviations.ravel().tolist()))
    part, after = form.columns(conditions())
    assert np.array_equal(part, whole[:, np.isin(COLUMN_GROUPS, used)])
    assert len(form.coefficient_deviations()) == part.shape[1]
    assert len(form.c_columns(CForm('gyroscope', Signals())).expressions) == part.shape[1]
    assert (after is None) == (not (LAG_GROUPS | PLAY_GROUPS) & set(used))
    assert history is not None


def test_groups_that_are_not_listed_are_not_in_use() -> None:
    curve = Empirical(deviations=(1.0,) * 3)
    assert curve.columns(conditions())[0].shape[1] == int((COLUMN_GROUPS == 0).sum())


@pytest.mark.parametrize('count', [2, 27])
def test_deviations_are_three_a_group(count: int) -> None:
    with pytest.raises(UserError, match=f'{count} deviations; give three'):
        Empirical(deviations=(1.0,) * count)


@pytest.mark.parametrize(
    'law',
    [
        lambda x, rate: np.cos(4.0 * np.pi * x),
        lambda x, rate: rate * x,
        lambda x, rate: rate**2,
    ],
)
def test_bumps_and_products_follow_what_curves_and_lags_do_not(
    law: Callable[[np.ndarray, np.ndarray], np.ndarray],
) -> None:
    time = np.arange(0.0, 40_000.0, 20.0)
    die = 20.0 + 20.0 * np.sin(time / 2500.0) + 10.0 * np.sin(time / 900.0)
    still = np.zeros((len(time), 3))
    columns = Empirical().columns(Conditions(time, die, still, still, still))[0]
    error = law((die - 20.0) / 30.0, np.gradient(die, time) / 0.02)

    def left(some: np.ndarray) -> float:
        seen = np.column_stack([np.ones(len(time)), die, some])
        seen = seen[time > 10_000.0]
        wanted = error[time > 10_000.0]
        return float((wanted - seen @ np.linalg.lstsq(seen, wanted, rcond=1e-9)[0]).std())

    assert left(columns) < 0.05 * error.std()
    assert left(columns[:, COLUMN_GROUPS < PLAIN_GROUPS]) > 3.0 * left(columns)
