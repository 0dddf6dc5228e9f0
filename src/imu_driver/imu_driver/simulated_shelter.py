# SPDX-License-Identifier: Apache-2.0
"""A device in the lee of a heavy fixture: what warms it is no longer the chamber's air alone."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from imu_recording.recording import FloatArray

from imu_driver.simulated_environment import low_pass
from imu_driver.simulated_run import DeviceRun, thermal_load
from imu_driver.simulated_thermal import node_temperatures

SHELTERED = 0.25
"""Share of the air at the device that has passed the fixture first."""
FIXTURE_TIME = 1200.0
"""Time constant of the fixture: 2 kg of aluminium in moved air [s]."""


def shelter(run: DeviceRun) -> DeviceRun:
    """Return the run with the device in the lee; one that is there already comes back as it is.

    The free stream, which the chamber's thermometers measure and one face of the package feels,
    and the air that warms the board part: their difference lasts through dwells with the time
    constant of the fixture and is not proportional to the rate of the die's temperature.
    """
    environment = run.environment
    if environment.free_stream is not None:
        return run
    free, period = environment.air_temperature, environment.period
    fixture = low_pass(free, FIXTURE_TIME, period)
    lee = replace(
        environment,
        air_temperature=free + SHELTERED * (fixture - free),
        free_stream=free,
    )
    nodes = node_temperatures(run.device.network, lee.air_temperature, period)
    errors = {sensor: values + _moved(run, nodes, sensor) for sensor, values in run.errors.items()}
    return replace(run, environment=lee, nodes=nodes, errors=errors)


def _moved(run: DeviceRun, nodes: FloatArray, sensor: str) -> FloatArray:
    """Return (n, 3) the change of the thermal bias from the run's own nodes to others."""
    parameters = run.device.sensor(sensor)
    load = thermal_load(nodes, sensor, parameters.stiffening) - thermal_load(
        run.nodes, sensor, parameters.stiffening
    )
    moved: FloatArray = np.multiply.outer(load, parameters.slope)
    return moved
