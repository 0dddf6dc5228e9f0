# SPDX-License-Identifier: Apache-2.0
"""Rate and jitter of a stream of samples; bias, noise and position of a device at rest."""

from __future__ import annotations

import json
from collections import deque
from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from imu_recording.recording import STANDARD_GRAVITY, UP_AXES, FloatArray
from imu_recording.user_error import UserError

from imu_driver.board.sample import Sample

REST_SPAN_S: Final = 5.0
"""[s] of samples evaluated."""
LEAST_REST_S: Final = 2.0
"""[s] of samples needed."""
MOST_REST_SAMPLES: Final = 5000
"""Samples kept."""
LARGEST_RATE_STD: Final = 0.02
"""[rad/s] A standard deviation above this is motion, not noise."""
LARGEST_ACCELERATION_STD: Final = 0.2
"""[m/s²] Likewise."""
SIGNIFICANT_DIGITS: Final = 4
"""Of the figures reported."""
LARGEST_MEAN_RATE: Final = 0.6
"""[rad/s] A mean above this is rotation (datasheet: zero-rate level ±30 dps typical)."""


class RestError(UserError):
    """The device is not at rest, or too few samples were received."""


class StreamStatistics:
    """Rate, jitter, newest temperature, and the last REST_SPAN_S of samples."""

    def __init__(self) -> None:
        self._recent: deque[Sample] = deque(maxlen=MOST_REST_SAMPLES)
        self._stamps: deque[int] = deque(maxlen=MOST_REST_SAMPLES)
        self.published = 0
        self.temperature = float('nan')
        """Newest [°C]."""

    def add(self, sample: Sample) -> None:
        """Add a published sample."""
        self._recent.append(sample)
        self._stamps.append(sample.stamp)
        self.published += 1
        if sample.temperature is not None:
            self.temperature = sample.temperature

    def take_rate(self) -> tuple[float, float]:
        """Return rate [Hz] and jitter (standard deviation of intervals) [s] since the last call.

        Of more than MOST_REST_SAMPLES samples the newest are used.
        """
        stamps = list(self._stamps)
        self._stamps.clear()
        self._stamps.extend(stamps[-1:])
        if len(stamps) < 3:
            return 0.0, 0.0
        intervals = np.diff(np.array(stamps, dtype=np.int64)) * 1e-9
        return float(1.0 / np.median(intervals)), float(intervals.std())

    def rest(self) -> dict[str, FloatArray]:
        """Return mean and standard deviation over the last REST_SPAN_S, device at rest.

        Keys: angular_velocity, angular_velocity_stddev, linear_acceleration,
        linear_acceleration_stddev, each (3,). Raises RestError.
        """
        samples = list(self._recent)
        if samples:
            since = samples[-1].stamp - round(REST_SPAN_S * 1e9)
            samples = [sample for sample in samples if sample.stamp > since]
        span = (samples[-1].stamp - samples[0].stamp) * 1e-9 if samples else 0.0
        full = len(samples) == MOST_REST_SAMPLES
        if span < LEAST_REST_S and not full:
            raise RestError(f'only {span:.1f} s were received, {LEAST_REST_S:g} s are needed')
        result = {}
        for name in ('angular_velocity', 'linear_acceleration'):
            values = np.array([getattr(sample, name) for sample in samples])
            result[name] = values.mean(axis=0)
            result[f'{name}_stddev'] = values.std(axis=0)
        if (
            result['angular_velocity_stddev'].max() > LARGEST_RATE_STD
            or result['linear_acceleration_stddev'].max() > LARGEST_ACCELERATION_STD
            or np.abs(result['angular_velocity']).max() > LARGEST_MEAN_RATE
        ):
            raise RestError('the device moves: leave it alone for 5 s and ask again')
        return result

    def up_axis(self) -> tuple[str, FloatArray]:
        """Return which axis points up and the mean reading [m/s²], device at rest."""
        mean = self.rest()['linear_acceleration']
        length = float(np.linalg.norm(mean))
        if abs(length - STANDARD_GRAVITY) > 2.0:
            raise RestError(f'at rest the sensor must read 9.8 m/s², it reads {length:.2f}')
        return up_axis([*mean]), mean


def rest_report(statistics: StreamStatistics) -> str:
    """Return gyroscope bias and the noise of one sample as JSON [rad/s, m/s²]."""
    rest = statistics.rest()
    names = {
        'angular_velocity': 'gyroscope_bias',
        'angular_velocity_stddev': 'angular_velocity_stddev',
        'linear_acceleration_stddev': 'linear_acceleration_stddev',
    }
    return json.dumps(
        {
            name: [float(f'{value:.{SIGNIFICANT_DIGITS}g}') for value in rest[key]]
            for key, name in names.items()
        }
    )


class SixPositionCheck:
    """Collects six positions at rest, one a call, and checks them.

    Positions are named after the axis that reads +g: the check is that six different ones are met
    and each reads g. Whether that axis is the one marked on the board, the operator sees.
    """

    def __init__(self) -> None:
        self._readings: dict[str, list[float]] = {}

    def take(self, statistics: StreamStatistics) -> str:
        """Add the present position; return its axis, and the missing ones or the result."""
        axis, mean = statistics.up_axis()
        self._readings[axis] = [float(value) for value in mean]
        reading = ', '.join(f'{value:.2f}' for value in mean)
        position = f'{axis} is up, reads [{reading}] m/s²'
        missing = [name for name in UP_AXES if name not in self._readings]
        if missing:
            return f'{position}; missing: {", ".join(missing)}'
        faults = check_six_positions(self._readings)
        self._readings = {}
        return f'{position}; all six positions: {"; ".join(faults) or "right"}'


def up_axis(linear_acceleration: Sequence[float]) -> str:
    """Return which axis points up, one of UP_AXES: the one that reads +g at rest."""
    axis = max(range(3), key=lambda i: abs(linear_acceleration[i]))
    return f'{"+" if linear_acceleration[axis] > 0 else "-"}{"xyz"[axis]}'


def check_six_positions(
    linear_acceleration: Mapping[str, Sequence[float]], tolerance: float = 1.5
) -> list[str]:
    """Return the faults of six readings at rest, one sentence each; empty if there are none.

    `linear_acceleration` maps the marked axis that pointed up (UP_AXES) to the mean reading
    [m/s²]. Each must read +g along that axis within `tolerance` [m/s²]. One wrong sign or one
    swapped pair shows as a mirrored frame; two wrong signs as a rotated one.
    """
    faults = [f'position {axis} is missing' for axis in UP_AXES if axis not in linear_acceleration]
    rows = []
    for axis in UP_AXES:
        if axis not in linear_acceleration:
            continue
        expected = np.zeros(3)
        expected['xyz'.index(axis[1])] = STANDARD_GRAVITY * (1 if axis[0] == '+' else -1)
        reading = np.asarray(linear_acceleration[axis], dtype=float)
        rows.append((expected, reading))
        if np.abs(reading - expected).max() > tolerance:
            values = ', '.join(f'{value:.2f}' for value in reading)
            faults.append(
                f'with {axis} up the sensor reads [{values}] m/s²: its {up_axis([*reading])} is up'
            )
    if len(rows) == len(UP_AXES):
        expected_rows, readings = (np.array(part) for part in zip(*rows, strict=True))
        fitted = np.linalg.lstsq(expected_rows, readings, rcond=None)[0]
        if np.linalg.det(fitted) < 0:
            faults.append('the accelerometer frame is mirrored: no axis map can make it right')
    return faults
