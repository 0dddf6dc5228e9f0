# SPDX-License-Identifier: Apache-2.0
"""Heat in the simulated board: energy is conserved, steps are the differential equation's."""

import numpy as np
import pytest
from imu_driver.simulation.devices import ThermalNetwork
from imu_driver.simulation.thermal import (
    BOARD,
    DIE,
    MAGNETOMETER,
    PACKAGE,
    convection,
    node_temperatures,
    steady_nodes,
)
from scipy.integrate import solve_ivp

NETWORK = ThermalNetwork()
POWER = NETWORK.board_power + NETWORK.die_power + NETWORK.magnetometer_power


def flow_from_air(nodes: np.ndarray, air: np.ndarray) -> np.ndarray:
    """Heat from the air into board and package [W]."""
    difference = air - nodes[..., BOARD]
    forced = np.array([convection(NETWORK, d) for d in np.ravel(difference)])
    return forced * np.ravel(difference) + NETWORK.air_to_package * np.ravel(
        air - nodes[..., PACKAGE]
    )


def derivative(time: float, nodes: np.ndarray, air: float) -> np.ndarray:
    """The network written down once more, as Σ G·ΔT + P over C."""
    n = NETWORK
    board, package, die, mag = nodes
    return np.array(
        [
            (
                convection(n, air - board) * (air - board)
                + n.board_to_package * (package - board)
                + n.board_power
            )
            / n.board_capacity,
            (
                n.air_to_package * (air - package)
                + n.board_to_package * (board - package)
                + n.package_to_die * (die - package)
                + n.package_to_magnetometer * (mag - package)
            )
            / n.package_capacity,
            (n.package_to_die * (package - die) + n.die_power) / n.die_capacity,
            (n.package_to_magnetometer * (package - mag) + n.magnetometer_power)
            / n.magnetometer_capacity,
        ]
    )


@pytest.mark.parametrize('air', [-10.0, 20.0, 50.0])
def test_steady_state_gives_its_power_to_the_air(air: float) -> None:
    nodes = steady_nodes(NETWORK, air)
    assert flow_from_air(nodes, np.array(air))[0] == pytest.approx(-POWER, rel=1e-6)
    assert 0.3 < nodes[DIE] - air < 1.2  # self-heating of a device of this size
    assert nodes[DIE] > nodes[PACKAGE] > nodes[BOARD] > air


def test_a_switched_off_device_takes_the_temperature_of_the_air() -> None:
    dark = NETWORK._replace(board_power=0.0, die_power=0.0, magnetometer_power=0.0)
    np.testing.assert_allclose(steady_nodes(dark, 35.0), 35.0, atol=1e-9)


def test_a_ramp_follows_the_differential_equation() -> None:
    time = np.arange(0.0, 1801.0)
    air = 20.0 + np.clip(time - 60.0, 0.0, 900.0) / 30.0
    nodes = node_temperatures(NETWORK, air, 1.0)
    solution = solve_ivp(
        lambda t, y: derivative(t, y, float(np.interp(t, time, air))),
        (0.0, 1800.0),
        nodes[0],
        method='Radau',
        t_eval=time[::60],
        rtol=1e-8,
        atol=1e-9,
        max_step=20.0,
    )
    # Backward Euler lags by half a step: 0.125 s × 2 K/min = 4 mK.
    np.testing.assert_allclose(nodes[::60], solution.y.T, atol=8e-3)


def test_heat_is_conserved() -> None:
    air = np.concatenate([np.full(60, 20.0), np.full(3000, 45.0)])
    nodes = node_temperatures(NETWORK, air, 1.0)
    capacity = np.array(
        [
            NETWORK.board_capacity,
            NETWORK.package_capacity,
            NETWORK.die_capacity,
            NETWORK.magnetometer_capacity,
        ]
    )
    stored = float(capacity @ (nodes[-1] - nodes[60]))
    flow = flow_from_air(nodes[60:], air[60:]) + POWER
    taken = float(np.sum(0.5 * (flow[1:] + flow[:-1])))
    assert taken == pytest.approx(stored, rel=5e-3)


def test_the_board_lags_and_the_dies_hardly() -> None:
    air = np.concatenate([np.full(10, 20.0), np.full(1200, 30.0)])
    nodes = node_temperatures(NETWORK, air, 1.0)
    rise = nodes[10:, BOARD] - nodes[0, BOARD]
    time_constant = int(np.argmax(rise > 0.632 * 10.0))
    expected = NETWORK.board_capacity / NETWORK.air_to_board
    assert 0.7 * expected < time_constant < 1.2 * expected
    behind = nodes[10:, DIE] - nodes[10:, MAGNETOMETER]
    assert np.ptp(behind[5:]) < 0.02  # one substrate: a constant difference, no lag to speak of


def test_power_on_from_the_shelf_warms_the_die() -> None:
    nodes = node_temperatures(NETWORK, np.full(1500, 20.0), 1.0, powered_before=False)
    assert nodes[0, DIE] == 20.0
    assert nodes[-1, DIE] == pytest.approx(steady_nodes(NETWORK, 20.0)[DIE], abs=0.01)
