# SPDX-License-Identifier: Apache-2.0
"""Small campaigns with physics of their own: integrated step by step, noise from a recursion."""

from collections.abc import Callable, Iterable
from dataclasses import replace
from functools import lru_cache

import numpy as np
from imu_recording.recording import PHASES, SENSOR_FIELDS
from scipy.signal import lfilter

from imu_recording import ImuRecording

GRAVITY = 9.80665
PERIOD = 5.0
SLOPES = {
    'linear_acceleration': np.array([2e-3, -1e-3, 3e-3]),
    'angular_velocity': np.array([1e-4, 2e-4, -1e-4]),
    'magnetic_field': np.array([3e-8, -2e-8, 1e-8]),
}
WHITE = {'linear_acceleration': 1e-3, 'angular_velocity': 1e-4, 'magnetic_field': 1e-7}
"""Standard deviation of a one-second mean."""
FIELD = np.array([1.8e-5, 0.6e-5, -4.0e-5])
"""In the chamber's frame [T]."""


@lru_cache
def chamber(cycles: int = 4, period: float = PERIOD) -> tuple[np.ndarray, ...]:
    """Time, die temperature, phase and cycle: 30 min still, then 20 → −10 → 50 → 20 °C."""
    legs = [('precondition', 20.0, 30.0)]
    for _ in range(cycles):
        legs += [('ramp_down', -10.0, 15.0), ('dwell_cold', -10.0, 30.0)]
        legs += [('ramp_up', 50.0, 30.0), ('dwell_hot', 50.0, 30.0)]
        legs += [('ramp_down', 20.0, 15.0), ('dwell_reference', 20.0, 30.0)]
    time, setpoint, phase, cycle = [], [], [], []
    now, level, number = 0.0, 20.0, 0
    for name, target, minutes in legs:
        number += name == 'ramp_down' and target < 0.0
        steps = int(minutes * 60 / period)
        setpoint += np.linspace(level, target, steps).tolist()
        time += (now + period * np.arange(steps)).tolist()
        phase += [PHASES.index(name)] * steps
        cycle += [number] * steps
        now, level = now + steps * period, target
    die = lagging(np.array(setpoint), 200.0, period)
    return np.array(time), die, np.array(phase), np.array(cycle)


def lagging(values: np.ndarray, time_constant: float, period: float) -> np.ndarray:
    """Follow the values as a first-order node would, in twenty small steps per sample."""
    followed = np.empty_like(values)
    state = values[0]
    for i, target in enumerate(values):
        start = values[max(i - 1, 0)]
        for part in range(20):
            drive = start + (target - start) * (part + 0.5) / 20
            state += (drive - state) * period / 20 / time_constant
        followed[i] = state
    return followed


def coloured(shape: tuple[int, int], rng: np.random.Generator, period: float) -> np.ndarray:
    """White noise of unit density plus two slower processes of 0.4 each."""
    noise = rng.standard_normal(shape) / np.sqrt(period)
    for time_constant in (200.0, 4000.0):
        keep = np.exp(-period / time_constant)
        drive = 0.4 * np.sqrt(1 - keep**2) * rng.standard_normal(shape)
        noise += lfilter([1.0], [1.0, -keep], drive, axis=0)
    return noise


def run(
    up_axis: str = '+z',
    *,
    seed: int = 0,
    device: str = 'board',
    cycles: int = 4,
    error: dict[str, np.ndarray] | None = None,
    slope_factor: float = 1.0,
    noise: float = 1.0,
    period: float = PERIOD,
) -> ImuRecording:
    """One run of a device with linear coefficients SLOPES and a further `error` (n, 3)."""
    time, temperature, phase, cycle = chamber(cycles, period)
    rng = np.random.default_rng(seed)
    axis = 'xyz'.index(up_axis[1])
    sign = 1.0 if up_axis[0] == '+' else -1.0
    turn = np.roll(np.eye(3), axis + 1, axis=0)
    inputs = {
        'linear_acceleration': sign * GRAVITY * np.eye(3)[axis],
        'angular_velocity': np.zeros(3),
        'magnetic_field': turn @ FIELD,
    }
    measured = {}
    for name, slope in SLOPES.items():
        value = inputs[name] + (temperature - 20.0)[:, None] * slope * slope_factor
        value = value + WHITE[name] * noise * coloured(value.shape, rng, period)
        if error and name in error:
            value = value + error[name]
        measured[name] = value
    return ImuRecording(
        stamp=np.round(time * 1e9).astype(np.int64) + 1_700_000_000_000_000_000,
        temperature=temperature,
        phase=phase,
        cycle=cycle,
        device=device,
        run=f'{up_axis} {seed}',
        up_axis=up_axis,
        **measured,
    )


def slow_days(error: Callable[[np.ndarray, np.ndarray], dict[str, np.ndarray]]) -> ImuRecording:
    """Two days at a window, +z up: 25 ± 5 °C read to 0.15 K; `error` of time and temperature."""
    rng = np.random.default_rng(5)
    time = np.arange(0.0, 2 * 86_400.0, 10.0)
    die = 25.0 + 4.0 * np.sin(2.0 * np.pi * time / 86_400.0) + np.sin(2.0 * np.pi * time / 7e3)
    measured = {
        name: (die - 20.0)[:, None] * slope + WHITE[name] * coloured((len(time), 3), rng, 10.0)
        for name, slope in SLOPES.items()
    }
    measured['linear_acceleration'][:, 2] += GRAVITY
    for name, values in error(time, die).items():
        measured[name] += values
    return ImuRecording(
        stamp=np.round(time * 1e9).astype(np.int64),
        temperature=0.125 * np.round((die + 0.15 * rng.standard_normal(len(time))) / 0.125),
        device='board',
        up_axis='+z',
        **measured,
    )


def measured_by(recordings: Iterable[ImuRecording], *sensors: str) -> list[ImuRecording]:
    """Return the recordings as of a device that has these sensors alone."""
    others = [field for sensor, field in SENSOR_FIELDS.items() if sensor not in sensors]
    return [replace(r, **{f: np.full((len(r), 3), np.nan) for f in others}) for r in recordings]
