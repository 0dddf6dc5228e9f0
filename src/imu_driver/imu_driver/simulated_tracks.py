# SPDX-License-Identifier: Apache-2.0
"""The slow columns of a simulated recording: chamber tracks, thermocouple, means of intervals."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from imu_recording.recording import FloatArray

from imu_driver.simulated_environment import low_pass
from imu_driver.simulated_run import DeviceRun
from imu_driver.simulated_thermal import BOARD, PACKAGE

if TYPE_CHECKING:
    from imu_driver.simulated_device import ReadOut

AVERAGED = (
    'chamber_temperature',
    'chamber_temperature_2',
    'heater',
    'compressor',
    'fan',
    'humidity',
)
DECIMALS = {False: 2, True: 3}
"""What a data logger shows: PT100 0.01 K, duty and humidity 1 %; means a digit more."""
HELD = ('setpoint', 'phase', 'cycle')
THERMOCOUPLE_TIME = 4.0
"""Lag of a thin thermocouple taped to the package [s]."""
THERMOCOUPLE_NOISE = 0.03
"""[K]"""


def sampled(run: DeviceRun, values: FloatArray, time: FloatArray, how: ReadOut) -> FloatArray:
    """Return values (g, …) of the environment's rows at `time`: there, or as interval means."""
    grid = run.environment.time
    flat = values.reshape(len(grid), -1)
    if how.mean:
        steps = 0.5 * (flat[1:] + flat[:-1]) * run.environment.period
        integral = np.vstack([np.zeros((1, flat.shape[1])), np.cumsum(steps, axis=0)])
        interval = 1.0 / how.rate_hz
        columns = [
            (np.interp(time, grid, c) - np.interp(time - interval, grid, c)) / interval
            for c in integral.T
        ]
    else:
        columns = [np.interp(time, grid, c) for c in flat.T]
    taken: FloatArray = np.stack(columns, axis=-1).reshape(len(time), *values.shape[1:])
    return taken


def tracks(run: DeviceRun, time: FloatArray, how: ReadOut) -> dict[str, Any]:
    """Return the chamber's tracks at the rows' times; set-point, phase and cycle are held."""
    environment = run.environment
    taken: dict[str, Any] = {}
    for name in AVERAGED:
        values = getattr(environment, name)
        if values is not None:
            taken[name] = np.round(sampled(run, values, time, how), DECIMALS[how.mean])
    row = np.searchsorted(environment.time, time + 1e-9, side='right') - 1
    for name in HELD:
        values = getattr(environment, name)
        if values is not None:
            taken[name] = values[row]
    return taken


def thermocouple(
    run: DeviceRun, time: FloatArray, how: ReadOut, generator: np.random.Generator
) -> FloatArray:
    """Return (n,) the thermocouple on the device's package [°C], 0.01 K steps.

    It touches package and board, lags by its own mass and has its calibration error.
    """
    contact = 0.7 * run.nodes[:, PACKAGE] + 0.3 * run.nodes[:, BOARD]
    offset = 0.2 * generator.standard_normal()
    felt = low_pass(contact, THERMOCOUPLE_TIME, run.environment.period) + offset
    noise = THERMOCOUPLE_NOISE * generator.standard_normal(len(time))
    if how.mean:
        noise = noise * np.sqrt(min(how.rate_hz, 1.0))
    shown: FloatArray = np.round(sampled(run, felt, time, how) + noise, 2)
    return shown
