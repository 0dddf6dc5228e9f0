# SPDX-License-Identifier: Apache-2.0
"""Runs in several orientations tell the magnetometer's offset from the field, and headings."""

from dataclasses import replace

import numpy as np
import pytest
from thermal_comp.data.conditions import Conditions, mounting_rotation
from thermal_comp.data.headings import QUARTER_TURN, hard_iron_of, turned_orientations
from thermal_comp.effects import EFFECTS

FIELD, OFFSET = np.array([2.1e-5, -0.4e-5, -4.3e-5]), np.array([1.5e-5, -2.2e-5, 0.7e-5])


def run(up: str, *, bent: float = 0.0, turns: int = 0, tilt: float = 0.0) -> Conditions:
    """A run whose fixture was turned by so many right angles, and is tilted at random."""
    rotation = mounting_rotation(up)
    lean = tilt * np.random.default_rng(ord(up[1])).standard_normal(3)
    field = FIELD + np.cross(lean, FIELD)
    reading = (
        rotation @ np.linalg.matrix_power(QUARTER_TURN, turns) @ field
        + OFFSET
        + bent * np.array([1.0, 0.0, 0.0])
    )
    still = np.zeros((50, 3))
    temperature = np.linspace(-10.0, 50.0, 50)
    return Conditions(
        np.arange(50.0), temperature, still, still, np.tile(reading, (50, 1)), orientation=rotation
    )


def test_four_orientations_tell_all_of_it() -> None:
    found = hard_iron_of([run(up) for up in ('+x', '+y', '+z', '-z')])
    np.testing.assert_allclose(found, OFFSET, atol=1e-12)


def test_three_turns_about_one_axis_leave_its_share_along_the_axis_open() -> None:
    found = hard_iron_of([run(up) for up in ('+x', '+y', '+z')])
    assert found is not None
    axis = np.ones(3) / np.sqrt(3.0)
    along = (found - OFFSET) @ axis
    np.testing.assert_allclose(found - OFFSET, along * axis, atol=1e-12)
    assert along == pytest.approx(0.5 * (FIELD - OFFSET) @ axis)


@pytest.mark.parametrize(
    'runs',
    [
        [],
        [run('+x')],
        [run('+x'), run('+x')],
        [run('+x'), run('+y', bent=9e-5), run('+z'), run('-z', bent=-9e-5)],
    ],
    ids=['none', 'one', 'twice the same', 'no one field'],
)
def test_what_does_not_tell_it_says_so(runs: list[Conditions]) -> None:
    assert hard_iron_of(runs) is None


def test_a_tilt_turns_the_field_and_not_the_offset() -> None:
    tilt = EFFECTS['fixture_tilt']()
    run_x = run('+x').of('magnetometer')
    rotation = run_x.orientation
    assert rotation is not None
    known = Conditions(**{**vars(run_x), 'hard_iron': OFFSET})
    turned = tilt.columns(known)[0] @ [1e-4, -2e-4, 3e-4]
    expected = rotation @ np.cross([1e-4, -2e-4, 3e-4], FIELD)
    np.testing.assert_allclose(
        turned, known.temperature_difference[:, None] * expected, atol=1e-15
    )


@pytest.mark.parametrize(
    ('readings', 'known'),
    [([], False), ([np.nan, np.nan], False), ([np.nan, 0.4], True), ([0.4, np.nan], True)],
)
def test_a_channel_was_logged_where_any_sample_is_finite(readings: list[float], known) -> None:
    none = np.zeros((len(readings), 3))
    at = np.arange(float(len(readings)))
    logged = Conditions(at, at, none, none, none, humidity=np.array(readings))
    assert logged.has('humidity') is known
    assert not logged.has('setpoint')


@pytest.mark.parametrize('turns', [(0, 1, 0), (0, 2, 3), (0, 0, 1), (0, 3, 3)])
def test_right_angles_about_the_vertical_are_found(turns: tuple[int, ...]) -> None:
    runs = [run(up, turns=n, tilt=0.02) for up, n in zip(('+x', '+y', '+z'), turns, strict=True)]
    found = turned_orientations(runs)
    assert found is not None
    for one, up, n in zip(found, ('+x', '+y', '+z'), turns, strict=True):
        expected = mounting_rotation(up) @ np.linalg.matrix_power(QUARTER_TURN, n)
        np.testing.assert_allclose(one, expected, atol=1e-12)


@pytest.mark.parametrize(
    'runs',
    [
        [run(up, tilt=0.02) for up in ('+x', '+y', '+z')],
        [run('+x'), run('+y', turns=1)],
        [run('+x'), run('+y', bent=9e-5), run('+z', bent=-9e-5)],
    ],
    ids=['the usual fixture', 'two runs', 'no one field'],
)
def test_else_they_are_those_of_the_fixture(runs: list[Conditions]) -> None:
    assert turned_orientations(runs) is None


def test_of_random_campaigns_most_are_found_and_hardly_one_wrongly() -> None:
    rng = np.random.default_rng(3)
    right = wrong = 0
    for _ in range(300):
        turns = (0, *rng.integers(0, 4, 2).tolist())
        offset, readings = rng.normal(0.0, 15e-6, 3), []
        for up, number in zip(('+x', '+y', '+z'), turns, strict=True):
            field = FIELD + np.cross(0.02 * rng.standard_normal(3), FIELD)
            turned = np.linalg.matrix_power(QUARTER_TURN, number) @ field
            readings.append(mounting_rotation(up) @ turned + offset)
        runs = [
            replace(run(up), magnetic_field=np.tile(reading, (50, 1)))
            for up, reading in zip(('+x', '+y', '+z'), readings, strict=True)
        ]
        found = turned_orientations(runs)
        if found is not None:
            expected = [
                mounting_rotation(up) @ np.linalg.matrix_power(QUARTER_TURN, number)
                for up, number in zip(('+x', '+y', '+z'), turns, strict=True)
            ]
            is_right = np.allclose(found, expected)
            right, wrong = right + is_right, wrong + (not is_right)
    assert right > 240
    assert wrong <= 2
