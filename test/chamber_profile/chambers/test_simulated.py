# SPDX-License-Identifier: Apache-2.0
"""The simulated chamber by itself: limits, alarms, and the physics behind them."""

import numpy as np
import pytest
from chamber_profile.chambers import climate as physics
from chamber_profile.chambers.chamber import ChamberRefusalError
from chamber_profile.chambers.climate import Climate, initial_state, saturation
from chamber_profile.chambers.simulated import SimulatedChamber


def test_the_chamber_refuses_what_is_outside_its_limits_and_trips_on_its_own() -> None:
    chamber = SimulatedChamber(seed=1)
    chamber.set_limits(10, 30)
    with pytest.raises(ChamberRefusalError, match='40'):
        chamber.set_temperature(40)
    chamber.run()
    chamber.state[physics.AIR] = 36.0
    chamber.advance(1.0)
    assert chamber.read().alarms
    assert not chamber.read().running


def test_a_chamber_that_stands_off_goes_to_room_temperature() -> None:
    chamber = SimulatedChamber(seed=1)
    chamber.state[[physics.AIR, physics.WALL, physics.EVAPORATOR]] = -10.0
    chamber.advance(24 * 3600.0)
    assert chamber.read().air == pytest.approx(chamber.climate.room_temperature, abs=1.0)


def test_equal_seeds_and_calls_give_equal_chambers() -> None:
    first, second = SimulatedChamber(seed=4), SimulatedChamber(seed=4)
    for chamber in (first, second):
        chamber.run()
        chamber.advance(100.0)
    np.testing.assert_array_equal(first.state, second.state)
    assert first.read() == second.read()


def test_fractions_of_a_second_are_carried_over() -> None:
    whole, parts = SimulatedChamber(seed=4), SimulatedChamber(seed=4)
    whole.advance(10.0)
    for _ in range(40):
        parts.advance(0.25)
    np.testing.assert_array_equal(whole.state, parts.state)


@pytest.mark.parametrize(
    ('temperature', 'content'), [(-20.0, 0.64e-3), (0.0, 3.8e-3), (20.0, 14.7e-3), (50.0, 87e-3)]
)
def test_saturated_air_holds_as_much_vapour_as_the_tables_say(
    temperature: float, content: float
) -> None:
    assert saturation(temperature) == pytest.approx(content, rel=0.02)  # kg/kg at 1013 hPa


def test_without_a_refrigerant_circuit_nothing_gets_colder_than_the_room() -> None:
    climate = Climate(cooling_available=0.0, eddy=0.0)
    state = initial_state(climate)
    noise = np.zeros((3600, physics.NOISE_VARIATES))
    physics.advance(state, climate, -10.0, True, noise)
    assert state[physics.AIR] >= climate.room_temperature - 0.1
