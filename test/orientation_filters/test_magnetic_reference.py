# SPDX-License-Identifier: Apache-2.0
"""The reference settles, rejects another field, and takes it over only after turning in it."""

from __future__ import annotations

import pytest
from orientation_filters.magnetic_reference import (
    FieldState,
    is_accepted,
    no_reference,
    norm_of,
    update_reference,
)
from orientation_filters.parameters import FilterParameters

PARAMS = FilterParameters().field_params()
EARTH, MAGNET = (20e-6, 45e-6), (60e-6, 45e-6)
DISTURBED = (11e-6, 44e-6)
STILL, TURNING = 0.0, 1.0


def after(
    state: FieldState,
    field: tuple[float, float],
    seconds: float,
    rate: float,
    *,
    contradicts: bool = False,
) -> FieldState:
    for _ in range(round(seconds / 0.05)):
        state = update_reference(state, PARAMS, field, rate, 0.05, contradicts)
    return state


@pytest.fixture
def settled() -> FieldState:
    return after(no_reference(), EARTH, 60.0, STILL)


def test_the_first_field_becomes_the_reference(settled: FieldState) -> None:
    assert settled.reference == pytest.approx(EARTH)
    assert norm_of(settled) == pytest.approx(49.2e-6, rel=1e-3)
    assert is_accepted(settled, PARAMS)


def test_another_field_is_rejected_and_does_not_move_the_reference(settled: FieldState) -> None:
    beside = after(settled, MAGNET, 60.0, STILL)
    assert not is_accepted(beside, PARAMS)
    assert beside.reference == pytest.approx(EARTH, rel=1e-2)
    back = after(beside, EARTH, 2.0 * PARAMS.hold, STILL)
    assert is_accepted(back, PARAMS)


def test_a_field_that_stays_the_same_while_turning_is_adopted(settled: FieldState) -> None:
    early = after(settled, MAGNET, 0.9 * PARAMS.adoption, TURNING)
    assert not is_accepted(early, PARAMS)
    late = after(early, MAGNET, 0.2 * PARAMS.adoption, TURNING)
    assert is_accepted(late, PARAMS)
    assert late.reference == pytest.approx(MAGNET, rel=0.1)


def test_a_reference_hardly_seen_is_given_up_sooner() -> None:
    young = after(no_reference(), MAGNET, 5.0, STILL)
    found = after(young, EARTH, 10.0, TURNING)
    assert is_accepted(found, PARAMS)
    assert found.reference == pytest.approx(EARTH, rel=0.15)


def test_the_field_on_the_way_to_an_adopted_one_is_no_part_of_it() -> None:
    young = after(no_reference(), DISTURBED, 5.0, STILL)
    found = after(young, EARTH, 8.0, TURNING, contradicts=True)
    assert found.reference == pytest.approx(EARTH, rel=0.01)
