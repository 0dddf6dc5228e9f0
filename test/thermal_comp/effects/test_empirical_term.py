# SPDX-License-Identifier: Apache-2.0
"""Groups of the empirical term that are not in use cost nothing and change nothing."""

from __future__ import annotations

import numpy as np
import pytest
from thermal_comp.data.conditions import Conditions
from thermal_comp.effects.c_form import CForm
from thermal_comp.effects.empirical_term import COLUMN_GROUPS, Empirical


def conditions() -> Conditions:
    still = np.zeros((50, 3))
    time = np.linspace(0.0, 3000.0, 50)
    return Conditions(time, 20.0 + 15.0 * np.sin(time / 500.0), still, still, still)


@pytest.mark.parametrize('used', [(0,), (1,), (2,), (3,), (0, 3), (1, 2)])
def test_only_groups_in_use_have_columns(used: tuple[int, ...]) -> None:
    whole, history = Empirical().columns(conditions())
    deviations = np.zeros((4, 3))
    deviations[list(used), 1] = 1.0
    part, after = Empirical(deviations=tuple(deviations.ravel().tolist())).columns(conditions())
    there = np.isin(COLUMN_GROUPS, used)
    assert np.array_equal(part[:, there], whole[:, there])
    assert not part[:, ~there].any()
    assert (after is None) == (not {1, 2} & set(used))
    assert history is not None


def test_c_says_only_what_is_in_use() -> None:
    curve = Empirical(deviations=(1.0,) * 3 + (0.0,) * 9)
    assert len(curve.c_columns(CForm('gyroscope', 20.0)).expressions) == int(
        (COLUMN_GROUPS == 0).sum()
    )
