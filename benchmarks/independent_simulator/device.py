# SPDX-License-Identifier: Apache-2.0
"""The device and the logger: noise, thermometer, quantisation, and which rows are kept."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from independent_simulator.surroundings import Array, Conditions, lag, play

SENSORS = ('accelerometer', 'gyroscope', 'magnetometer')
ONE_SECOND = {'accelerometer': 1.04e-3, 'gyroscope': np.deg2rad(7.1e-3), 'magnetometer': 1e-7}
"""Standard deviation of a one-second mean of an LSM9DS1 [m/s², rad/s, T]."""
FLICKER = {'accelerometer': 0.35, 'gyroscope': 0.6, 'magnetometer': 0.25}
"""Standard deviation of each of the slow processes, in one-second means."""
SLOW_TIMES = np.geomspace(30.0, 40_000.0, 7)
LEAST_COUNTS = {
    'accelerometer': tuple(9.80665e-3 * mg for mg in (0.061, 0.122, 0.244, 0.732)),
    'gyroscope': tuple(np.deg2rad(mdps * 1e-3) for mdps in (8.75, 17.5, 70.0)),
    'magnetometer': tuple(1e-7 * mg for mg in (0.14, 0.29, 0.43, 0.58)),
}
"""Per full scale, the finest first [m/s², rad/s, T]."""
SLOPES = {
    'accelerometer': (1.5e-3, 1e-2),
    'gyroscope': (np.deg2rad(0.005), np.deg2rad(0.05)),
    'magnetometer': (0.05e-6, 0.3e-6),
}
"""Usual range of the linear temperature coefficient [unit/K]."""
OFFSETS = {
    'accelerometer': (0.3, 0.1),
    'gyroscope': (np.deg2rad(2.0), np.deg2rad(0.04)),
    'magnetometer': (3e-5, 5e-7),
}
"""Standard deviation of the device's offset, and of its change from power-on to power-on."""


@dataclass(frozen=True)
class Noise:
    """Of one sensor."""

    one_second: float
    """Standard deviation of a one-second mean, its white part."""
    slow: float
    """Standard deviation of each slow process, in `one_second`."""
    mixing: Array
    """(3, 3) lower triangle that correlates the axes."""


@dataclass(frozen=True)
class Thermometer:
    lag: float
    offset: float
    gain: float
    noise: float
    least_count: float
    transient: float
    transient_time: float
    hysteresis: float
    period: float
    """A value is held this long [s]."""


@dataclass(frozen=True)
class Device:
    noise: Mapping[str, Noise]
    thermometer: Thermometer
    offsets: Mapping[str, Array]
    slopes: Mapping[str, Array]
    rate: float
    """Samples a second, before a logger averages."""
    least_count: float
    """Least counts, in those of an LSM9DS1; a quiet chip has finer ones."""


@dataclass(frozen=True)
class Logger:
    """What is kept of a run."""

    period: float
    """Between rows [s]."""
    averaging: bool
    """Rows are means over their period, else single samples."""
    jitter: float = 0.0
    """Of the stamps, in periods."""
    keep: tuple[tuple[float, float], ...] = ()
    """Stretches that were kept, from … to [s]; empty: everything."""
    magnetometer_every: int = 1
    """Rows to a sample of the magnetometer."""


def draw_noise(rng: np.random.Generator, sensor: str, kind: str) -> Noise:
    level = {'lsm9ds1': (0.85, 1.2), 'quiet': (0.08, 0.5), 'loud': (1.5, 5.0)}[kind]
    slow = (0.7, 1.3) if kind == 'lsm9ds1' else (0.3, 1.8)
    most = 0.15 if kind == 'lsm9ds1' else float(rng.choice([0.2, 0.9]))
    correlation = np.eye(3)
    i, j = rng.choice(3, 2, replace=False)
    correlation[i, j] = correlation[j, i] = most * rng.choice([-1.0, 1.0]) * rng.uniform(0.5, 1.0)
    return Noise(
        ONE_SECOND[sensor] * np.exp(rng.uniform(*np.log(level))),
        FLICKER[sensor] * np.exp(rng.uniform(*np.log(slow))),
        np.linalg.cholesky(correlation),
    )


def draw_thermometer(rng: np.random.Generator, quality: str) -> Thermometer:
    low, high = {'good': (0.5, 2.0), 'fair': (2.0, 8.0), 'poor': (8.0, 40.0)}[quality]
    poor = quality == 'poor'
    return Thermometer(
        lag=rng.uniform(low, high),
        offset=rng.normal(0.0, 1.0),
        gain=1.0 + rng.normal(0.0, 0.004),
        noise=rng.uniform(0.02, 0.06),
        least_count=0.0625 if quality == 'good' else float(rng.choice([0.0625, 0.125])),
        transient=rng.uniform(0.3, 1.0) if poor else 0.0,
        transient_time=rng.uniform(60.0, 300.0),
        hysteresis=rng.uniform(0.05, 0.2) if poor else 0.0,
        period=float(rng.choice([0.1, 1.0, 1.0, 10.0])) if poor else float(rng.choice([0.1, 1.0])),
    )


def draw_device(rng: np.random.Generator, noise: str, thermometer: str) -> Device:
    slopes, offsets = {}, {}
    better = 0.3 if noise == 'quiet' else 1.0
    for sensor in SENSORS:
        size = np.exp(rng.uniform(*np.log(SLOPES[sensor]), 3))
        slopes[sensor] = better * size * rng.choice([-1.0, 1.0], 3)
        offsets[sensor] = rng.normal(0.0, OFFSETS[sensor][0], 3)
    return Device(
        {sensor: draw_noise(rng, sensor, noise) for sensor in SENSORS},
        draw_thermometer(rng, thermometer),
        offsets,
        slopes,
        float(rng.choice([59.5, 104.0, 119.0, 238.0])),
        0.1 if noise == 'quiet' else 1.0,
    )


def followed(thermometer: Thermometer, run: Conditions) -> Array:
    """Return the temperature of the thermometer itself on the run's grid [°C]."""
    behind = lag(run.die, run.dt, max(thermometer.lag, 0.2 * run.dt))
    if thermometer.hysteresis:
        behind = play(behind, thermometer.hysteresis)
    transient = thermometer.transient * np.exp(-run.power_on / thermometer.transient_time)
    return thermometer.offset + thermometer.gain * behind - transient


def reading(
    thermometer: Thermometer, temperature: Array, dt: float, rng: np.random.Generator
) -> Array:
    """Return what is read from it: noisy, in steps, held for a while [°C]."""
    raw = temperature + rng.normal(0.0, thermometer.noise, len(temperature))
    steps = np.round(raw / thermometer.least_count) * thermometer.least_count
    every = max(1, round(thermometer.period / dt))
    return steps[np.arange(len(steps)) // every * every]


def slow_noise(noise: Noise, n: int, dt: float, rng: np.random.Generator) -> Array:
    """Return (n, 3) flicker-like noise on the grid, straight lines over a few seconds."""
    from scipy.signal import lfilter  # takes half a second

    step = max(1, int(4.0 / dt))
    m = n // step + 2
    total = np.zeros((3, m))
    for time_constant in SLOW_TIMES:
        a = float(np.exp(-dt * step / time_constant))
        kicks = rng.standard_normal((3, m)) * np.sqrt(1.0 - a * a)
        begin = a * rng.standard_normal((3, 1))
        total += lfilter([1.0], [1.0, -a], kicks, zi=begin)[0]
    correlated = noise.one_second * noise.slow * noise.mixing @ total
    at, knots = np.arange(n), np.arange(m) * step
    return np.column_stack([np.interp(at, knots, axis) for axis in correlated])


@dataclass(frozen=True)
class Rows:
    """Where the rows of one run lie on its grid."""

    time: Array
    """(m,) since the run's first instant [s]."""
    dt: float
    means: int
    """Grid steps a row is the mean of; 0 where it is a sample between two steps."""
    first: Array
    """(m,) first grid step of each mean."""
    averaged_s: float
    """Time a row is the mean of; 0 for a single sample [s]."""
    rate: float
    """Samples of the chip a second."""
    samples: float
    """Samples of the chip in each row."""

    def of(self, signal: Array) -> Array:
        """Return a signal of the grid, (n,) or (n, k), at the rows."""
        if self.means:
            total = np.concatenate([np.zeros((1, *signal.shape[1:])), np.cumsum(signal, 0)])
            return (total[self.first + self.means] - total[self.first]) / self.means
        if signal.ndim == 1:
            return np.interp(self.time, np.arange(len(signal)) * self.dt, signal)
        return np.column_stack([self.of(column) for column in signal.T])

    def held(self, signal: Array) -> Array:
        """Return the newest value of the grid at the rows."""
        newest = self.first + max(self.means - 1, 0)
        return signal[newest]


def draw_rows(logger: Logger, run: Conditions, device: Device, rng: np.random.Generator) -> Rows:
    n, dt = len(run.time), run.dt
    means = round(logger.period / dt) if logger.averaging else 0
    stretches = logger.keep or ((0.0, n * dt),)
    if means:
        first = np.arange(0, n - means + 1, means)
        time = (first + means / 2.0) * dt
        kept = np.any([(time >= a) & (time < b) for a, b in stretches], axis=0)
        time, first = time[kept], first[kept]
    else:
        time = np.concatenate([np.arange(a, b, logger.period) for a, b in stretches])
        time = time + logger.period * logger.jitter * rng.uniform(-0.5, 0.5, len(time))
        time = time[(time >= 0.0) & (time < (n - 1) * dt)]
        first = (time / dt).astype(int)
    # Of single samples a second or more apart the chip filters each to that bandwidth.
    rate = device.rate if means else 1.0 / min(logger.period, 1.0)
    averaged = means * dt
    return Rows(time, dt, means, first, averaged, rate, max(1.0, rate * averaged))


def fast_noise(noise: Noise, rows: Rows, rng: np.random.Generator) -> Array:
    """Return (m, 3) white noise of the rows."""
    size = 1.0 / np.sqrt(rows.averaged_s) if rows.averaged_s else np.sqrt(rows.rate)
    return noise.one_second * size * rng.standard_normal((len(rows.time), 3)) @ noise.mixing.T


def shaking(run: Conditions, rows: Rows, period: float, rng: np.random.Generator) -> Array:
    """Return (m, 3) vibration itself where rows are fast samples, else nothing."""
    if rows.means or period > 0.05:
        return np.zeros((len(rows.time), 3))
    wander = np.cumsum(rng.normal(0.0, np.sqrt(period), len(rows.time)))
    angle = 2.0 * np.pi * rng.uniform(0.2, 0.35) / period * rows.time + 3.0 * wander
    amplitude = np.sqrt(2.0 * np.maximum(rows.of(run.vibration), 0.0))
    return amplitude * np.sin(angle)[:, None]


def quantised(signal: Array, least_count: float, samples: float) -> Array:
    """Return the mean of `samples` whole counts, which is as much finer."""
    step = least_count / samples
    return np.round(signal / step) * step


def reference_thermometer(signal: Array, dt: float, rng: np.random.Generator) -> Array:
    """Return the reading of a PT100 or a thermocouple: a lag, an offset, steps of 0.05 K."""
    read = lag(signal, dt, rng.uniform(5.0, 20.0)) + rng.normal(0.0, 0.2)
    return np.round((read + rng.normal(0.0, 0.03, len(read))) / 0.05) * 0.05
