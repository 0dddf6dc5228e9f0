# SPDX-License-Identifier: Apache-2.0
"""Physical bounds of a model: a file that exceeds what sensors do is damaged or no model."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
from imu_recording.plausibility import POSSIBLE_RANGES
from imu_recording.recording import SENSOR_UNITS, STANDARD_GRAVITY, FloatArray

from thermal_comp.data.conditions import CHANNELS, Conditions, Sensor
from thermal_comp.effects.effect import Effect

LARGEST_ERROR = {'accelerometer': 10.0, 'gyroscope': 2.0, 'magnetometer': 1e-3}
"""Largest error of one effect within its range of temperature [m/s², rad/s, T]: gravity itself,
115 °/s where zero-rate levels are ±30 °/s, twenty times Earth's field."""
LARGEST_STD_RATIO = 1e3
"""Standard deviation of an error, over the largest one, above which it is unknown."""
DIE_TEMPERATURES_C = POSSIBLE_RANGES['temperature']
"""Temperatures a die can have [°C]."""
CYCLE_HOURS, CYCLE_ROWS = 6.0, 121
"""Length and rows of a typical cycle."""


def typical_conditions(
    low: float, high: float, reference_temperature: float, sensor: Sensor
) -> Conditions:
    """Return a slow cycle low → high → low [°C] in which every channel is present."""
    time = np.linspace(0.0, CYCLE_HOURS * 3600.0, CYCLE_ROWS)
    temperature = high - (high - low) * np.abs(np.linspace(-1.0, 1.0, CYCLE_ROWS))
    switch = (np.arange(CYCLE_ROWS) % 2).astype(float)
    channels: dict[str, Any] = dict.fromkeys(CHANNELS, switch)
    channels |= {
        'chamber_temperature': temperature + 2.0,
        'chamber_temperature_2': temperature + 2.0,
        'device_temperature': temperature + 1.0,
        'setpoint': temperature,
        'supply_voltage': 3.3 + 0.1 * switch,
        'pressure': 101_325.0 + 1e3 * switch,
        'vibration': np.full((CYCLE_ROWS, 3), 0.1),
        'phase': np.full(CYCLE_ROWS, 3, dtype=np.int64),
        'cycle': np.ones(CYCLE_ROWS, dtype=np.int64),
    }
    return Conditions(
        time=time,
        temperature=temperature,
        specific_force=np.full((CYCLE_ROWS, 3), STANDARD_GRAVITY),
        angular_velocity=np.ones((CYCLE_ROWS, 3)),
        magnetic_field=np.full((CYCLE_ROWS, 3), 5e-5),
        sensor=sensor,
        reference_temperature=reference_temperature,
        orientation=np.eye(3),
        **channels,
    )


def outside_temperatures(*values: float) -> str:
    """Return what is wrong with temperatures [°C] of a die, '' where nothing is."""
    low, high = DIE_TEMPERATURES_C
    wrong = [value for value in values if not low <= value <= high]
    return f'is {wrong[0]:g} °C, possible is {low:g} … {high:g} °C' if wrong else ''


def impossible_terms(
    terms: list[tuple[Effect, FloatArray, FloatArray]], conditions: Conditions
) -> Iterator[tuple[int, str, str]]:
    """Give number, field and reason of every effect whose error or uncertainty is impossible.

    Each term is an effect, its coefficients, and their covariance (size, size) in the order they
    are stored, in squares of their units. What counts is the standard deviation of the error that
    they make together: coefficients of two lags that are alike are uncertain, but cancel.
    """
    sensor = conditions.sensor
    limit, unit = LARGEST_ERROR[sensor], SENSOR_UNITS[sensor]
    for number, (effect, coefficients, covariance) in enumerate(terms):
        if not coefficients.size:
            continue
        columns = effect.columns(conditions)[0]
        with np.errstate(over='ignore', invalid='ignore'):
            error = _largest(columns, coefficients, effect)
            doubt = _largest_std(columns, coefficients.shape, covariance, effect)
        if not error <= limit:
            reason = f'{effect.name} would make an error of {error:.3g} {unit} within the range'
            yield number, 'coefficients', f'{reason}, possible is up to {limit:g} {unit}'
        elif not doubt <= LARGEST_STD_RATIO * limit:
            reason = f'the error of {effect.name} would be uncertain by {doubt:.3g} {unit}'
            yield number, 'covariance', reason


def _largest(columns: FloatArray, coefficients: FloatArray, effect: Effect) -> float:
    """Return the largest size of columns (n, p) or (n, 3, p) times coefficients."""
    per_run = coefficients if effect.per_run else coefficients[np.newaxis]
    return max(float(np.abs(columns @ each).max()) for each in per_run)


def _largest_std(
    columns: FloatArray, shape: tuple[int, ...], covariance: FloatArray, effect: Effect
) -> float:
    """Return the largest standard deviation of the error c · x over rows and axes, √(c Σ cᵀ).

    Columns c are (n, p) with coefficients ([runs,] p, 3), or (n, 3, p) with ([runs,] p).
    """
    runs = shape[0] if effect.per_run else 1
    size = len(covariance) // runs
    variances = []
    for start in range(0, len(covariance), size):
        block = covariance[start : start + size, start : start + size]
        for axis in range(3):
            shared = columns.ndim == 3
            rows = columns[:, axis] if shared else columns
            own = block if shared else block[axis::3, axis::3]
            variances.append(np.einsum('np,pq,nq->n', rows, own, rows, optimize=True).max())
    return float(np.sqrt(np.maximum(np.max(variances), 0.0)))


def impossible_sizes(sensor: Sensor, values: FloatArray) -> str:
    """Return what is wrong with sizes of errors or of noise, '' where nothing is."""
    limit, unit = LARGEST_ERROR[sensor], SENSOR_UNITS[sensor]
    largest = float(np.abs(values).max(initial=0.0))
    return '' if largest <= limit else f'is {largest:.3g} {unit}, possible is up to {limit:g}'
