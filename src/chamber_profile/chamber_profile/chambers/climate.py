# SPDX-License-Identifier: Apache-2.0
"""Physics of a climatic chamber with its own controller: air, walls, evaporator, vapour, frost.

Heat flows between air, walls and evaporator (lumped, differential equations, 1 s explicit steps);
an electric heater and a refrigerant circuit work against each other, as in chambers with balanced
temperature control; the compressor keeps minimum times on and off. Humidity is a consequence:
vapour leaks in from the room, condenses on the evaporator and freezes there.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from imu_recording.jit import njit
from imu_recording.recording import FloatArray

AIR, WALL, EVAPORATOR, VAPOUR, FROST, DEVICE = 0, 1, 2, 3, 4, 5
INTEGRAL, HEATER, COMPRESSOR, SWITCHED, DEMAND = 6, 7, 8, 9, 10
CONTROL, PROBE, PROBE_2, EDDY, EDDY_2, RATE, LAST_SETPOINT = 11, 12, 13, 14, 15, 16, 17
PROBE_NOISE, PROBE_2_NOISE = 18, 19
STATE_SIZE = 20
"""Indices into the state vector; temperatures [°C], vapour [kg/kg], frost [kg], times [s]."""

NOISE_VARIATES = 4
"""Number of standard normal variates one second of the chamber takes."""


class Climate(NamedTuple):
    """Parameters of a bench-top chamber of about 100 l with an inner shell of 25 kg."""

    room_temperature: float = 23.0
    """[°C]"""
    room_humidity: float = 0.45
    """Relative, 0 … 1."""
    air_capacity: float = 14e3
    """Air, ducts and shelves [J/K]."""
    wall_capacity: float = 42e3
    """Inner shell [J/K]."""
    evaporator_capacity: float = 6e3
    """[J/K]"""
    air_to_wall: float = 55.0
    """[W/K]"""
    air_to_evaporator: float = 160.0
    """[W/K] with the fan on."""
    wall_to_room: float = 4.5
    """[W/K]"""
    heater_power: float = 4500.0
    """[W]"""
    cooling_power: float = 5000.0
    """Largest heat the refrigerant takes up at 0 °C evaporator temperature [W]."""
    fan_power: float = 120.0
    """[W]"""
    heater_time: float = 4.0
    """Lag of the heating element [s]."""
    device_time: float = 180.0
    """Lag of a device on the shelf [s]."""
    device_heating: float = 1.2
    """Self-heating of the device above the air [K]."""
    compressor_on_time: float = 180.0
    """Least running time of the compressor [s]."""
    compressor_off_time: float = 180.0
    """Least rest of the compressor [s]."""
    gain: float = 1100.0
    """Proportional gain of the controller [W/K]."""
    integral_time: float = 170.0
    """[s]"""
    feed_forward: float = 26e3
    """Heat capacity of the controller's feed-forward [J/K]."""
    eddy: float = 0.035
    """Standard deviation of the air's own fluctuation [K], correlated over 20 s."""
    probe_time: float = 9.0
    probe_2_time: float = 16.0
    """Lags of the two PT100 [s]."""
    probe_offset: float = 0.0
    probe_2_offset: float = 0.0
    """Calibration errors of the two PT100 [K]."""
    probe_2_wall: float = 0.03
    """Share of the wall's temperature the second PT100 sees, near the back of the chamber."""
    probe_noise: float = 0.006
    """Noise of a PT100 reading [K]."""
    vapour_leak: float = 9e-5
    """Share of the air exchanged with the room per second [1/s]."""
    cooling_available: float = 1.0
    """Factor on the cooling power; 0: a compressor that does not start."""


def initial_state(climate: Climate) -> FloatArray:
    """Return the state of a chamber in equilibrium with the room, switched off."""
    state = np.full(STATE_SIZE, climate.room_temperature)
    state[VAPOUR] = climate.room_humidity * saturation(climate.room_temperature)
    for place in (FROST, INTEGRAL, HEATER, COMPRESSOR, DEMAND, EDDY, EDDY_2, RATE):
        state[place] = 0.0
    state[[PROBE_NOISE, PROBE_2_NOISE]] = 0.0
    state[SWITCHED] = 3600.0
    state[LAST_SETPOINT] = math.nan
    return state


@njit(cache=True)
def saturation(temperature: float) -> float:
    """Return saturation vapour content of air [kg/kg] at 101 325 Pa (Magnus, over water/ice)."""
    if temperature >= 0.0:
        pressure = 611.2 * math.exp(17.62 * temperature / (243.12 + temperature))
    else:
        pressure = 611.2 * math.exp(22.46 * temperature / (272.62 + temperature))
    return 0.622 * pressure / (101325.0 - pressure)


@njit(cache=True)
def _control(state: FloatArray, climate: Climate, setpoint: float) -> None:
    """One second of the chamber's controller: PI with feed-forward, heater against compressor."""
    last = state[LAST_SETPOINT]
    step = 0.0 if math.isnan(last) else setpoint - last
    state[LAST_SETPOINT] = setpoint
    state[RATE] += (step - state[RATE]) / 25.0
    error = setpoint - state[CONTROL]
    low, high = -climate.cooling_power, climate.heater_power
    ahead = climate.feed_forward * min(max(state[RATE], -0.1), 0.1)
    wanted = climate.gain * error + state[INTEGRAL] + ahead
    power = min(max(wanted, low), high)
    if wanted == power:
        state[INTEGRAL] += climate.gain / climate.integral_time * error
    state[DEMAND] += (power - state[DEMAND]) / 20.0
    state[SWITCHED] += 1.0
    if state[COMPRESSOR] > 0.5:
        if state[DEMAND] > 350.0 and state[SWITCHED] >= climate.compressor_on_time:
            state[COMPRESSOR], state[SWITCHED] = 0.0, 0.0
    elif state[DEMAND] < -60.0 and state[SWITCHED] >= climate.compressor_off_time:
        state[COMPRESSOR], state[SWITCHED] = 1.0, 0.0
    # The heater replaces the heat that the evaporator takes from the air.
    taken = climate.air_to_evaporator * (state[AIR] - state[EVAPORATOR])
    duty = min(max((power + taken) / climate.heater_power, 0.0), 1.0)
    state[HEATER] += (duty - state[HEATER]) / climate.heater_time


@njit(cache=True)
def _heat(state: FloatArray, climate: Climate, fan: float) -> None:
    """One second of heat flow between room, walls, air, evaporator and device."""
    air, wall, evaporator = state[AIR], state[WALL], state[EVAPORATOR]
    still = 0.15 + 0.85 * fan
    to_wall = climate.air_to_wall * still * (air - wall)
    to_evaporator = climate.air_to_evaporator * still * (air - evaporator)
    valve = min(max((250.0 - state[DEMAND]) / climate.cooling_power, 0.05), 1.0)
    capacity = climate.cooling_power * (1.0 + 0.012 * evaporator) * climate.cooling_available
    taken = state[COMPRESSOR] * fan * valve * max(capacity, 0.0)
    heating = climate.heater_power * state[HEATER] * fan + climate.fan_power * fan
    state[AIR] += (heating - to_wall - to_evaporator) / climate.air_capacity
    to_room = climate.wall_to_room * (wall - climate.room_temperature)
    state[WALL] += (to_wall - to_room) / climate.wall_capacity
    state[EVAPORATOR] += (to_evaporator - taken) / climate.evaporator_capacity
    state[DEVICE] += (air + climate.device_heating - state[DEVICE]) / climate.device_time


@njit(cache=True)
def _moisten(state: FloatArray, climate: Climate, room_vapour: float) -> None:
    """One second of vapour: leak, condensation on the evaporator, sublimation of its frost."""
    air_mass = 0.13
    state[VAPOUR] += climate.vapour_leak * (room_vapour - state[VAPOUR])
    surface = saturation(state[EVAPORATOR])
    flow = 0.004 * (state[VAPOUR] - surface)
    if flow < 0.0:
        flow = max(flow, -state[FROST] / air_mass)
    state[VAPOUR] -= flow
    state[FROST] += flow * air_mass
    excess = state[VAPOUR] - saturation(state[AIR])
    if excess > 0.0:
        state[VAPOUR] -= excess
        state[FROST] += excess * air_mass


@njit(cache=True)
def advance(
    state: FloatArray, climate: Climate, setpoint: float, running: bool, noise: FloatArray
) -> FloatArray:
    """Advance the state in place by one second per row of `noise` (k, NOISE_VARIATES).

    Returns the state after each second (k, STATE_SIZE).
    """
    states = np.empty((noise.shape[0], STATE_SIZE))
    room_vapour = climate.room_humidity * saturation(climate.room_temperature)
    fan = 1.0 if running else 0.0
    decay = math.exp(-1.0 / 20.0)
    kick = math.sqrt(1.0 - decay * decay) * climate.eddy
    for k in range(noise.shape[0]):
        if running:
            _control(state, climate, setpoint)
        else:
            state[HEATER] = state[COMPRESSOR] = state[INTEGRAL] = state[DEMAND] = 0.0
            state[LAST_SETPOINT] = math.nan
            state[SWITCHED] += 1.0
        _heat(state, climate, fan)
        _moisten(state, climate, room_vapour)
        state[EDDY] = decay * state[EDDY] + kick * fan * noise[k, 0]
        state[EDDY_2] = decay * state[EDDY_2] + kick * fan * noise[k, 1]
        here = state[AIR] + state[EDDY]
        radiated = climate.probe_2_wall * (state[WALL] - state[AIR])
        there = state[AIR] + radiated + state[EDDY_2]
        state[CONTROL] += (here - state[CONTROL]) / 5.0
        state[PROBE] += (here - state[PROBE]) / climate.probe_time
        state[PROBE_2] += (there - state[PROBE_2]) / climate.probe_2_time
        state[PROBE_NOISE] = climate.probe_noise * noise[k, 2]
        state[PROBE_2_NOISE] = climate.probe_noise * noise[k, 3]
        for place in range(STATE_SIZE):  # an array at once compiles the text of its error, too
            states[k, place] = state[place]
    return states


@njit(cache=True)
def sensed(states: FloatArray, climate: Climate) -> FloatArray:
    """Return what the sensors see in states (n, STATE_SIZE): two PT100 [°C], humidity 0 … 1."""
    columns = np.empty((3, states.shape[0]))
    for i in range(states.shape[0]):
        state = states[i]
        columns[0, i] = state[PROBE] + climate.probe_offset + state[PROBE_NOISE]
        columns[1, i] = state[PROBE_2] + climate.probe_2_offset + state[PROBE_2_NOISE]
        columns[2, i] = min(state[VAPOUR] / saturation(state[AIR]), 1.0)
    return columns
