# SPDX-License-Identifier: Apache-2.0
"""What happens round the device and inside it: air, board, die, supply, vibration, moisture.

The air follows a set-point through a second-order controller, or is a room, a freezer's thaw or a
hair-dryer. Board, die and thermometers follow through first-order thermal nodes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from itertools import accumulate
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

Array = NDArray[Any]
ROOM = 22.0
"""Temperature of the laboratory [°C]."""
GRAVITY = 9.80665
PHASES = ('precondition', 'ramp_down', 'dwell_cold', 'ramp_up', 'dwell_hot', 'dwell_reference')


@dataclass(frozen=True)
class Segment:
    """A stretch of the programme: linear from the previous target to this one."""

    duration: float
    target: float
    phase: int = -1
    cycle: int = 0


@dataclass(frozen=True)
class Programme:
    """One run: what the surroundings do, in which pose, and on which grid it is computed."""

    kind: str
    """'chamber', 'room', 'freezer' or 'dryer'."""
    segments: tuple[Segment, ...]
    start: float
    """Temperature at the beginning [°C]."""
    begins: float
    """Time of the run's first instant since the campaign's [s]."""
    up_axis: str
    dt: float
    """Step of the grid [s]."""


@dataclass(frozen=True)
class Conditions:
    """Everything an effect may depend on, on a regular grid of one run (n,)."""

    dt: float
    time: Array
    """Since the campaign's first instant [s]."""
    power_on: Array
    """Since the device was switched on [s]."""
    air: Array
    board: Array
    die: Array
    """[°C]."""
    rate: Array
    """Of the die [K/s]."""
    setpoint: Array
    phase: Array
    cycle: Array
    humidity: Array
    heater: Array
    compressor: Array
    fan: Array
    supply: Array
    vibration: Array
    """(n, 3) variance of acceleration within a second [(m/s²)²]."""
    rotation: Array
    """(3, 3) chamber frame → sensor frame."""
    field: Array
    """(3,) magnetic field in the chamber frame [T]."""

    def every(self, step: int) -> Conditions:
        """Return every `step`-th instant, on a grid as much coarser."""
        thinned = {
            f.name: getattr(self, f.name)[::step]
            for f in fields(self)
            if f.name not in ('dt', 'rotation', 'field')
        }
        return replace(self, dt=self.dt * step, **thinned)

    @property
    def force(self) -> Array:
        """(3,) specific force in the sensor frame [m/s²]."""
        return self.rotation @ np.array([0.0, 0.0, GRAVITY])


@dataclass(frozen=True)
class House:
    """What stays the same through a campaign: heat paths, currents, machines, field."""

    air_period: float
    air_damping: float
    board_time: float
    die_time: float
    self_heating: float
    self_heating_time: float
    heater_window: float
    compressor_period: float
    ripple: float
    supply_steps: float
    supply_wander: float
    supply_per_kelvin: float
    vibration_quiet: float
    vibration_machine: float
    vibration_axes: tuple[float, float, float]
    field: tuple[float, float, float]
    room_humidity: float


def draw_house(rng: np.random.Generator, kind: str) -> House:
    heading = rng.uniform(0.0, 2.0 * np.pi)
    shielding = rng.uniform(0.5, 1.0) if kind == 'chamber' else 1.0
    horizontal, vertical = 24e-6 * shielding, -39e-6 * shielding
    machine = rng.uniform(0.5, 3.0) if kind == 'chamber' else rng.uniform(0.02, 0.06)
    x, y, z = rng.uniform(0.3, 1.0, 3)
    quick = {'dryer': 0.35, 'freezer': 1.5}.get(kind, 1.0)
    return House(
        air_period=rng.uniform(200.0, 500.0),
        air_damping=rng.uniform(0.55, 0.95),
        board_time=quick * rng.uniform(60.0, 240.0),
        die_time=rng.uniform(3.0, 15.0),
        self_heating=rng.uniform(0.3, 1.0),
        self_heating_time=rng.uniform(60.0, 300.0),
        heater_window=rng.choice([2.0, 5.0, 10.0, 20.0]),
        compressor_period=rng.uniform(360.0, 900.0),
        ripple=rng.uniform(0.0, 0.15),
        supply_steps=rng.uniform(0.01, 0.05),
        supply_wander=rng.uniform(0.001, 0.005),
        supply_per_kelvin=rng.uniform(-2e-4, 2e-4),
        vibration_quiet=rng.uniform(0.003, 0.02),
        vibration_machine=machine,
        vibration_axes=(x, y, z),
        field=(horizontal * np.cos(heading), horizontal * np.sin(heading), vertical),
        room_humidity=rng.uniform(0.3, 0.6),
    )


def lag(signal: Array, dt: float, time_constant: float) -> Array:
    """Return the first-order lag, at rest on the first value before it."""
    a = float(np.exp(-dt / time_constant))
    return lfilter([1.0 - a], [1.0, -a], signal, axis=0, zi=a * signal[:1])[0]


def play(signal: Array, half_width: float) -> Array:
    """Return the backlash of `half_width`, in the middle of its gap at first."""
    steps = accumulate(signal.tolist(), lambda y, x: min(max(y, x - half_width), x + half_width))
    return np.fromiter(steps, float, len(signal))


def wandering(rng: np.random.Generator, n: int, dt: float, time_constant: float) -> Array:
    """Return an Ornstein–Uhlenbeck process of unit variance, stationary from its start."""
    a = float(np.exp(-dt / time_constant))
    kicks = rng.standard_normal(n) * np.sqrt(1.0 - a * a)
    return lfilter([1.0], [1.0, -a], kicks, zi=[a * rng.standard_normal()])[0]


def switching(rng: np.random.Generator, n: int, dt: float, mean_dwell: float) -> Array:
    """Return a state 0 or 1 that changes after exponentially distributed times."""
    count = max(8, int(4.0 * n * dt / mean_dwell) + 8)
    edges = np.cumsum(rng.exponential(mean_dwell, count))
    return ((np.searchsorted(edges, np.arange(n) * dt) + rng.integers(2)) % 2).astype(float)


def saturation_pressure(celsius: Array) -> Array:
    """Return the vapour pressure over water [hPa] (Magnus)."""
    return 6.112 * np.exp(17.62 * celsius / (243.12 + celsius))


UP = {
    '+x': np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]]),
    '-x': np.array([[0.0, 0, -1], [1, 0, 0], [0, -1, 0]]),
    '+y': np.array([[0.0, 1, 0], [0, 0, 1], [1, 0, 0]]),
    '-y': np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]]),
    '+z': np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 1]]),
    '-z': np.array([[1.0, 0, 0], [0, -1, 0], [0, 0, -1]]),
}
"""Chamber frame (z up) → sensor frame."""


def _placed(up_axis: str, rng: np.random.Generator) -> Array:
    """Return the rotation of a pose that is met to a few milliradians."""
    x, y, z = rng.normal(0.0, 0.004, 3)
    small = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return (np.eye(3) + small + 0.5 * small @ small) @ UP[up_axis]


def _plan(programme: Programme) -> tuple[Array, Array, Array]:
    """Return set-point, phase and cycle on the grid."""
    ends = np.cumsum([0.0] + [segment.duration for segment in programme.segments])
    targets = [programme.start] + [segment.target for segment in programme.segments]
    time = np.arange(0.0, ends[-1], programme.dt)
    where = np.clip(np.searchsorted(ends, time, 'right') - 1, 0, len(programme.segments) - 1)
    phase = np.array([segment.phase for segment in programme.segments])[where]
    cycle = np.array([segment.cycle for segment in programme.segments])[where]
    return np.interp(time, ends, targets), phase, cycle


def _second_order(signal: Array, dt: float, period: float, damping: float) -> Array:
    """Return the answer of a controlled air volume to its set-point."""
    w = 2.0 * np.pi / period
    step = min(dt, 0.1 / w)
    many = max(1, int(np.ceil(dt / step)))
    h = dt / many
    rough = np.repeat(signal, many)
    denominator = [1.0 + 2.0 * damping * w * h + (w * h) ** 2, -2.0 - 2.0 * damping * w * h, 1.0]
    level = float(signal[0])
    answer = lfilter([(w * h) ** 2], denominator, rough - level)
    return level + answer[many - 1 :: many]


def _machines(air: Array, setpoint: Array, house: House, dt: float) -> tuple[Array, Array]:
    """Return heater state (in the windows of its relay) and compressor state."""
    time = np.arange(len(air)) * dt
    demand = lag(np.gradient(setpoint, dt) * 60.0 / 4.0 + (air - ROOM) / 60.0, dt, 60.0)
    share = np.clip(-1.6 * demand, 0.0, 1.0)
    beginning = (time - time % house.compressor_period) / dt
    share = share[np.minimum(beginning.astype(int), len(share) - 1)]
    compressor = (time % house.compressor_period < share * house.compressor_period).astype(float)
    duty = np.clip(demand + 0.35 * compressor + 0.05, 0.0, 1.0)
    window = max(house.heater_window, dt)
    # The share of each grid step within which the relay is closed.
    phase = time % window
    heater = np.clip((duty * window - phase) / dt, 0.0, 1.0)
    return heater, compressor


def _air(
    programme: Programme, setpoint: Array, house: House, rng: np.random.Generator
) -> tuple[Array, Array, Array, Array]:
    """Return air temperature, heater, compressor and fan."""
    n, dt = len(setpoint), programme.dt
    time = np.arange(n) * dt
    if programme.kind == 'chamber':
        ripple = house.ripple * np.sin(2.0 * np.pi * time / house.compressor_period * 3.0)
        air = _second_order(setpoint, dt, house.air_period, house.air_damping) + ripple
        heater, compressor = _machines(air, setpoint, house, dt)
        return air, heater, compressor, np.ones(n)
    nothing = np.zeros(n)
    if programme.kind == 'dryer':
        blowing = (setpoint > programme.start + 5.0).astype(float)
        draught = 1.0 + 0.05 * wandering(rng, n, dt, 20.0)
        air = programme.start + lag((setpoint - programme.start) * draught, dt, 15.0)
        return air, blowing, nothing, blowing
    room = np.full(n, ROOM) if programme.kind == 'freezer' else setpoint
    air = room + 0.15 * wandering(rng, n, dt, 200.0)
    if programme.kind == 'room':
        day = (programme.begins + time) / 86400.0 + rng.uniform()
        air = air + rng.uniform(1.5, 4.0) * np.sin(2.0 * np.pi * day)
        air = air + rng.uniform(0.5, 2.0) * wandering(rng, n, dt, 10_000.0)
        air = lag(air + 1.5 * switching(rng, n, dt, 2400.0), dt, 600.0)
    return air, nothing, nothing, nothing


def _humidity(air: Array, house: House, dt: float) -> Array:
    """Return relative humidity 0 … 1: a lab's vapour, dried at the coldest surface."""
    outside = house.room_humidity * saturation_pressure(np.array(ROOM))
    vapour = np.minimum(outside, lag(saturation_pressure(air - 1.0), dt, 1200.0))
    return np.clip(vapour / saturation_pressure(air), 0.02, 1.0)


def surroundings(programme: Programme, house: House, rng: np.random.Generator) -> Conditions:
    """Return what happens in one run."""
    setpoint, phase, cycle = _plan(programme)
    n, dt = len(setpoint), programme.dt
    air, heater, compressor, fan = _air(programme, setpoint, house, rng)
    time = np.arange(n) * dt
    power_on = time + rng.uniform(0.5, 30.0)
    if programme.kind == 'freezer':  # the air round a thawing device is not the room's
        cold = programme.start - ROOM
        air = air + cold * np.exp(-time / 40.0)
        board = lag(np.concatenate([[programme.start], air]), dt, house.board_time)[1:]
    else:
        board = lag(air, dt, house.board_time)
    warmth = house.self_heating * (1.0 - np.exp(-power_on / house.self_heating_time))
    die = lag(board, dt, house.die_time) + warmth
    supply = 5.0 + house.supply_steps * (
        switching(rng, n, dt, n * dt / 7.0) + 0.5 * switching(rng, n, dt, n * dt / 12.0) - 0.7
    )
    supply = supply + house.supply_wander * wandering(rng, n, dt, 1200.0)
    supply = supply + house.supply_per_kelvin * (die - 20.0) - 0.005 * heater
    return Conditions(
        dt, programme.begins + time, power_on, air, board, die, np.gradient(die, dt), setpoint,
        phase, cycle, _humidity(air, house, dt), heater, compressor, fan, supply,
        _vibration(compressor, fan, house, programme, rng), _placed(programme.up_axis, rng),
        np.array(house.field),
    )  # fmt: skip


def _vibration(
    compressor: Array, fan: Array, house: House, programme: Programme, rng: np.random.Generator
) -> Array:
    n, dt = len(compressor), programme.dt
    machine = compressor if programme.kind == 'chamber' else fan
    if programme.kind == 'room':
        machine = switching(rng, n, dt, 5400.0)
    load = 1.0 + 0.25 * wandering(rng, n, dt, 900.0)
    level = house.vibration_quiet + house.vibration_machine * machine * np.abs(load)
    shares: Sequence[float] = house.vibration_axes
    return np.outer(level**2, shares)
