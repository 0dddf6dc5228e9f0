# SPDX-License-Identifier: Apache-2.0
"""Reading a simulated device: from a run in its environment to a recording."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from imu_recording.jit import njit
from imu_recording.logging_contract import CHANNEL_FIELDS
from imu_recording.recording import SECOND_NS, SENSOR_FIELDS, FloatArray, ImuRecording
from imu_recording.user_error import UserError

from imu_driver.board.lsm9ds1 import COUNT_MAX, COUNT_MIN, TEMPERATURE_SENSITIVITY_C
from imu_driver.simulation.devices import (
    REFERENCE_TEMPERATURE,
    SENSOR_RATE_HZ,
    DeviceParameters,
    SensorParameters,
)
from imu_driver.simulation.environment import Environment, low_pass
from imu_driver.simulation.pose import Motion, into_sensor_frame, rotation_vector_matrix
from imu_driver.simulation.run import DeviceRun, prepare_run, world_vector
from imu_driver.simulation.thermal import BOARD, DIE, PACKAGE

DIRECT_RATE_HZ = 10.0
"""Lowest rate at which every sample of the sensor is read, at the pace of its own clock [Hz]."""
VIBRATION_RATE_HZ = 119.0
"""Rate at which the variance within a sample's interval is taken [Hz]."""
VIBRATION_FREQUENCY_HZ = 24.5
"""A two-pole compressor motor's shaft [Hz]."""
SIMULATOR = 'imu_driver.simulation'
"""What `simulated` of a recording says."""
START_NS = 1_600_000_000_000_000_000
"""Stamp of the start of a run; runs of one campaign follow each other by a day."""
DAY_NS = 86_400 * SECOND_NS
STARTUP_FACTOR = 0.543
"""First sample of a start-up transient relative to the settled value (Tables III–V)."""
HELD_TRACKS = ('setpoint', 'phase', 'cycle')
AVERAGED_TRACKS = tuple(
    item.name
    for item in fields(Environment)
    if item.name in CHANNEL_FIELDS and item.name not in HELD_TRACKS
)
LOGGER_DECIMALS = {False: 2, True: 3}
"""Of a data logger, single samples and means: PT100 0.01 K, duty and humidity 1 %."""
THERMOCOUPLE_TIME_CONSTANT = 4.0
"""Lag of a thin thermocouple taped to the package [s]."""
THERMOCOUPLE_STD = 0.03
"""Noise of one reading [K]."""


@dataclass(frozen=True)
class ReadOut:
    """Way of reading a device: rate, single samples or means, start-up transient."""

    rate_hz: float
    mean: bool = False
    """Rows are means over their interval instead of single samples."""
    startup_time: float = 0.0
    """Time constant of a start-up transient in all channels [s]; 0: none."""
    number: int = 0
    """Number of the run in its campaign: sets the day it starts on."""

    @property
    def summed(self) -> int:
        """Number of samples of the sensor that one row is the mean of."""
        return max(round(SENSOR_RATE_HZ / self.rate_hz), 1) if self.mean else 1


def simulate_device(
    device: str | DeviceParameters,
    environment: Environment,
    *,
    rate_hz: float,
    seed: int | tuple[int, ...],
    orientation: str = '+z',
    motion: Motion | None = None,
    mean: bool = False,
) -> ImuRecording:
    """Return the recording of a device in an environment: single samples, or means over intervals.

    Rows below DIRECT_RATE_HZ come at the host's even pace, others at the pace of the sensor's own
    clock, which drifts with temperature. The same arguments give the same recording.
    """
    run = prepare_run(device, environment, seed=seed, orientation=orientation, motion=motion)
    return read_out(run, ReadOut(rate_hz, mean))


def read_out(run: DeviceRun, how: ReadOut) -> ImuRecording:
    """Return the recording of a run."""
    if not how.rate_hz > 0.0:
        raise UserError(f'rate {how.rate_hz:g} Hz: it must be above 0')
    if how.mean and run.motion:
        raise UserError(
            'a moving device has no meaningful means over intervals: use single samples'
        )
    time = sample_times(run, how)
    generator = np.random.default_rng((*run.seed, 3))
    columns: dict[str, Any]
    columns, reference = _measured(run, how, time, generator)
    if how.startup_time:
        rise = 1.0 - (1.0 - STARTUP_FACTOR) * np.exp(-(time - time[0]) / how.startup_time)
        columns = {name: value * rise[:, None] for name, value in columns.items()}
    stamp = START_NS + how.number * DAY_NS + np.round(time * 1e9).astype(np.int64)
    if how.mean:
        columns['vibration'] = _vibration_variance(run, how, time, generator)
    return ImuRecording(
        stamp=stamp,
        temperature=_thermometer(run, how, time, generator),
        supply_voltage=np.round(sampled(run, run.supply, time, how), 4),
        device_temperature=thermocouple(run, time, how, generator),
        reference_orientation=reference,
        device=run.device.name,
        up_axis=run.orientation,
        profile=run.environment.profile,
        simulated=SIMULATOR,
        **columns,
        **tracks(run, time, how),
    )


def sample_times(run: DeviceRun, how: ReadOut) -> FloatArray:
    """Return the true times of the samples [s]: the host's timer, or the sensor's clock."""
    grid = run.environment.time
    slope = run.device.rate_slope if run.rate_slope is None else run.rate_slope
    if how.rate_hz < DIRECT_RATE_HZ and run.rate_slope is None:
        first = 1 if how.mean else 0
        time: FloatArray = np.arange(first, grid[-1] * how.rate_hz + 1e-9) / how.rate_hz
        return time
    pace = how.rate_hz * (1.0 + run.device.rate_error) * (1.0 + slope * run.temperature_difference)
    count = np.concatenate(
        [[0.0], np.cumsum(0.5 * (pace[1:] + pace[:-1]) * run.environment.period)]
    )
    first = 1 if how.mean else 0
    times: FloatArray = np.interp(np.arange(first, count[-1]), count, grid)
    return times


def noise_std(sensor: SensorParameters, how: ReadOut) -> FloatArray:
    """Return (3,) standard deviation of the white noise of a row [SI unit]."""
    if how.mean:
        rounding = sensor.sensitivity**2 / 12.0 / how.summed
        std: FloatArray = np.sqrt(sensor.mean_std**2 * how.rate_hz + rounding)
        return std
    bandwidth = max(how.rate_hz, SENSOR_RATE_HZ)
    single: FloatArray = sensor.mean_std * np.sqrt(bandwidth)
    return single


def vibration_passed(how: ReadOut) -> float:
    """Return the share of the vibration's amplitude that the sensor's low-pass lets through.

    Second order, cut-off at a third of the sensor's output data rate.
    """
    cutoff = max(how.rate_hz, SENSOR_RATE_HZ) / 3.0
    return 1.0 / (1.0 + (VIBRATION_FREQUENCY_HZ / cutoff) ** 2)


def _measured(
    run: DeviceRun, how: ReadOut, time: FloatArray, generator: np.random.Generator
) -> tuple[dict[str, FloatArray], FloatArray | None]:
    """Return the columns of the three triads, and the true attitude of a moving device."""
    quaternion, rate = None, None
    if run.motion:
        quaternion, rate = run.motion.at(time, run.orientation)
    columns = {}
    inputs = {}
    for sensor in SENSOR_FIELDS:
        if quaternion is None:
            inputs[sensor] = np.broadcast_to(run.true_input(sensor), (len(time), 3))
        else:
            inputs[sensor] = into_sensor_frame(quaternion, world_vector(run.environment, sensor))
    if rate is not None:
        inputs['gyroscope'] = inputs['gyroscope'] + rate
    for sensor, name in SENSOR_FIELDS.items():
        columns[name] = _triad(run, how, sensor, time, inputs, generator)
    return columns, quaternion


def _triad(
    run: DeviceRun,
    how: ReadOut,
    sensor: str,
    time: FloatArray,
    inputs: dict[str, FloatArray],
    generator: np.random.Generator,
) -> FloatArray:
    parameters = run.device.sensor(sensor)
    matrix = np.diag(1.0 + parameters.scale_error) @ rotation_vector_matrix(
        parameters.misalignment
    )
    values = generator.standard_normal((len(time), 3))
    values *= noise_std(parameters, how)
    slow = run.errors[sensor]
    difference = run.temperature_difference
    if how.mean:
        slow, difference = sampled(run, slow, time, how), sampled(run, difference, time, how)
        place, step = np.arange(len(time), dtype=np.float64), 1.0
    else:
        place, step = time - run.environment.time[0], run.environment.period
    _add_slow(values, place, step, slow)
    _add_input(values, place, step, inputs[sensor], matrix, parameters.scale_slope * difference)
    if sensor == 'gyroscope':
        values += run.device.g_sensitivity * inputs['accelerometer'] @ G_SENSITIVITY_PATTERN
    if sensor == 'accelerometer' and not how.mean:
        shaking = vibration_passed(how) * np.sqrt(2.0 * sampled(run, run.vibration, time, how))
        values += shaking * np.sin(generator.uniform(0.0, 2 * np.pi, (len(time), 1)))
    quantise(values, parameters.sensitivity, how.summed)
    return values


G_SENSITIVITY_PATTERN = np.array([[0.6, 1.0, -0.4], [-0.8, 0.7, 0.9], [0.3, -1.0, 0.5]])
"""Pattern of the constant g-sensitivity, column per gyroscope axis."""


@njit(cache=True)
def _add_slow(values: FloatArray, place: FloatArray, step: float, slow: FloatArray) -> None:
    """Add slow (g, 3), given every `step`, to values (n, 3) at `place` (n,); linear between."""
    last = len(slow) - 2
    for k in range(len(place)):
        at = place[k] / step
        low = min(max(int(at), 0), last)
        part = at - low
        for axis in range(3):
            values[k, axis] += slow[low, axis] + part * (slow[low + 1, axis] - slow[low, axis])


@njit(cache=True)
def _add_input(
    values: FloatArray,
    place: FloatArray,
    step: float,
    true_input: FloatArray,
    matrix: FloatArray,
    scale: FloatArray,
) -> None:
    """Add the true input (n, 3) through the sensor's matrix, scale change (g,) every `step`."""
    last = len(scale) - 2
    for k in range(len(place)):
        at = place[k] / step
        low = min(max(int(at), 0), last)
        factor = 1.0 + scale[low] + (at - low) * (scale[low + 1] - scale[low])
        x, y, z = true_input[k, 0], true_input[k, 1], true_input[k, 2]
        for axis in range(3):
            seen = matrix[axis, 0] * x + matrix[axis, 1] * y + matrix[axis, 2] * z
            values[k, axis] += factor * seen


@njit(cache=True)
def quantise(values: FloatArray, sensitivity: float, summed: int) -> None:
    """Round values (n, 3) in place to means of `summed` int16 counts of `sensitivity`.

    At the ends of the range the counts saturate.
    """
    step = sensitivity / summed
    low, high = COUNT_MIN * summed, COUNT_MAX * summed
    for k in range(values.shape[0]):
        for axis in range(values.shape[1]):
            count = np.rint(values[k, axis] / step)
            values[k, axis] = min(max(count, low), high) * step


def _thermometer(
    run: DeviceRun, how: ReadOut, time: FloatArray, generator: np.random.Generator
) -> FloatArray:
    """Return (n,) on-chip thermometer [°C]: gain, offset, noise, steps of 1/16 K."""
    device = run.device
    true = sampled(run, run.nodes[:, DIE], time, how)
    above = (true - REFERENCE_TEMPERATURE) * (1.0 + device.thermometer_gain)
    noise = device.thermometer_noise
    reading = REFERENCE_TEMPERATURE + above + device.thermometer_offset
    if how.mean:
        noise = np.sqrt((noise**2 + TEMPERATURE_SENSITIVITY_C**2 / 12.0) / how.summed)
    reading += noise * generator.standard_normal(len(time))
    step = TEMPERATURE_SENSITIVITY_C / how.summed
    rounded: FloatArray = np.rint(reading / step) * step
    return rounded


def _vibration_variance(
    run: DeviceRun, how: ReadOut, time: FloatArray, generator: np.random.Generator
) -> FloatArray:
    """Return (n, 3) variance of acceleration within each row's interval, as estimated [(m/s²)²].

    Sample variance of noise and vibration at VIBRATION_RATE_HZ: χ² distributed about the truth.
    """
    freedom = max(VIBRATION_RATE_HZ / how.rate_hz - 1.0, 1.0)
    white = run.device.accelerometer.mean_std**2 * VIBRATION_RATE_HZ
    true = white + sampled(run, run.vibration, time, how)
    estimate: FloatArray = true * generator.chisquare(freedom, true.shape) / freedom
    shown: FloatArray = np.round(estimate, 7)
    return shown


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
    for name in AVERAGED_TRACKS:
        values = getattr(environment, name)
        if values is not None:
            taken[name] = np.round(sampled(run, values, time, how), LOGGER_DECIMALS[how.mean])
    row = np.searchsorted(environment.time, time + 1e-9, side='right') - 1
    for name in HELD_TRACKS:
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
    felt = low_pass(contact, THERMOCOUPLE_TIME_CONSTANT, run.environment.period) + offset
    noise = THERMOCOUPLE_STD * generator.standard_normal(len(time))
    if how.mean:
        noise = noise * np.sqrt(min(how.rate_hz, 1.0))
    shown: FloatArray = np.round(sampled(run, felt, time, how) + noise, 2)
    return shown
