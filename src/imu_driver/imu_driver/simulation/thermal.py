# SPDX-License-Identifier: Apache-2.0
"""Heat in a sensor board: air → board → package → dies, coupled differential equations.

C dT/dt = Σ G·(T_neighbour − T) + P for each node, after Incropera & DeWitt, chapter 5 (lumped
capacitance); the convective conductance grows slowly with the difference between air and board.
Steps are implicit (backward Euler), so that the fast dies need no small steps.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from imu_recording.jit import njit
from imu_recording.recording import FloatArray

from imu_driver.simulation.devices import ThermalNetwork

BOARD, PACKAGE, DIE, MAGNETOMETER = 0, 1, 2, 3
NODE_COUNT = 4
"""Indices into the node temperatures [°C], and their number."""
LONGEST_SUBSTEP_S = 0.25
"""Longest step of the integration [s]."""


@njit(cache=True)
def convection(network: ThermalNetwork, difference: float) -> Any:
    """Return the conductance air → board [W/K] at a temperature difference [K]."""
    relative = (abs(difference) + 0.05) / network.convection_difference
    return network.air_to_board * relative**network.convection_exponent


@njit(cache=True)
def step_nodes(state: FloatArray, network: ThermalNetwork, air: float, step: float) -> None:
    """Advance the node temperatures in place by `step` seconds of air at `air` [°C]."""
    to_air = convection(network, air - state[0])
    # The dies hang on the package alone: eliminate them, then solve board and package.
    die_rate = network.die_capacity / step
    die_weight = die_rate + network.package_to_die
    die_source = die_rate * state[2] + network.die_power
    mag_rate = network.magnetometer_capacity / step
    mag_weight = mag_rate + network.package_to_magnetometer
    mag_source = mag_rate * state[3] + network.magnetometer_power
    link = network.board_to_package
    board_rate = network.board_capacity / step
    board_weight = board_rate + to_air + link
    board_source = board_rate * state[0] + to_air * air + network.board_power
    package_rate = network.package_capacity / step
    package_weight = (
        package_rate
        + link
        + network.air_to_package
        + network.package_to_die * die_rate / die_weight
        + network.package_to_magnetometer * mag_rate / mag_weight
    )
    package_source = (
        package_rate * state[1]
        + network.air_to_package * air
        + network.package_to_die * die_source / die_weight
        + network.package_to_magnetometer * mag_source / mag_weight
    )
    package = (package_source + link * board_source / board_weight) / (
        package_weight - link * link / board_weight
    )
    state[0] = (board_source + link * package) / board_weight
    state[1] = package
    state[2] = (die_source + network.package_to_die * package) / die_weight
    state[3] = (mag_source + network.package_to_magnetometer * package) / mag_weight


@njit(cache=True)
def _integrate(
    network: ThermalNetwork, air: FloatArray, period: float, substeps: int, state: FloatArray
) -> FloatArray:
    nodes = np.empty((len(air), NODE_COUNT))
    step = period / substeps
    for k in range(len(air)):
        for j in range(1, substeps + 1 if k else 0):
            part = j / substeps
            step_nodes(state, network, air[k - 1] + part * (air[k] - air[k - 1]), step)
        for i in range(NODE_COUNT):  # an array at once compiles the text of its error, too
            nodes[k, i] = state[i]
    return nodes


def steady_nodes(network: ThermalNetwork, air: float) -> FloatArray:
    """Return the (NODE_COUNT,) temperatures after a long time in air of one temperature [°C]."""
    state = np.full(NODE_COUNT, air)
    for step in (10.0, 100.0, 1e3, 1e5, 1e7, 1e7, 1e7, 1e7, 1e7, 1e7):
        step_nodes(state, network, air, step)
    return state


def node_temperatures(
    network: ThermalNetwork, air: FloatArray, period: float, *, powered_before: bool = True
) -> FloatArray:
    """Return (n, NODE_COUNT) temperatures [°C] in air (n,) [°C] sampled every `period` seconds.

    The device starts in equilibrium with the first air, powered, or cold from the shelf.
    """
    start = steady_nodes(network, float(air[0])) if powered_before else np.full(NODE_COUNT, air[0])
    substeps = max(1, int(np.ceil(period / LONGEST_SUBSTEP_S - 1e-9)))
    nodes: FloatArray = _integrate(
        network, np.ascontiguousarray(air, dtype=np.float64), period, substeps, start
    )
    return nodes
