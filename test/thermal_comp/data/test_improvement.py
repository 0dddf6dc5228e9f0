# SPDX-License-Identifier: Apache-2.0
"""Errors on held-out parts fall where they do so in every part, by more than a twentieth."""

from __future__ import annotations

import numpy as np
import pytest
from thermal_comp.data.improvement import (
    falls,
    falls_enough,
    may_fall,
    parts_that_fall,
    rises,
)

BEFORE = np.array([100.0, 110.0, 95.0, 105.0, 98.0])
"""Mean squares of five parts, of noise 1."""


def test_a_fall_in_every_part_is_no_chance() -> None:
    assert falls(BEFORE, 0.5 * BEFORE, 1.0)


def test_a_fall_of_some_parts_may_be_chance() -> None:
    after = BEFORE * [0.05, 1.6, 0.05, 1.6, 0.05]
    assert falls_enough(BEFORE.sum(), after.sum())
    assert not falls(BEFORE, after, 1.0)
    assert parts_that_fall(BEFORE, after, 1.0) == 3


def test_two_parts_tell_no_scatter() -> None:
    assert not falls(BEFORE[:2], 0.5 * BEFORE[:2], 1.0)


@pytest.mark.parametrize(('share', 'enough'), [(0.94, True), (0.96, False)])
def test_a_fall_matters_from_a_twentieth_of_the_rms(share: float, enough: bool) -> None:
    assert falls_enough(1.0, share**2) is enough
    assert falls(BEFORE, share**2 * BEFORE, 1e-3) is enough


def test_a_rise_matters_from_a_twentieth_of_the_rms() -> None:
    assert rises(1.0, 1.06)
    assert not rises(1.0, 1.04)


def test_below_the_noise_nothing_falls() -> None:
    assert not falls(BEFORE / 200.0, BEFORE / 2000.0, 1.0)
    assert not may_fall(BEFORE / 200.0, 1.0)
    assert may_fall(BEFORE, 1.0)
    assert not may_fall(np.empty(0), 1.0)


def test_an_axis_at_its_noise_hides_no_fall_of_another() -> None:
    noise = np.array([1.0, 1e6])
    before = np.stack([BEFORE, np.full(5, 5e5)], axis=1)
    after = np.stack([0.1 * BEFORE, np.full(5, 9e5)], axis=1)
    assert falls(before, after, noise)
