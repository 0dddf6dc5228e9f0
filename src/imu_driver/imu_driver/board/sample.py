# SPDX-License-Identifier: Apache-2.0
"""A sample: raw counts to SI units in the published frame.

>>> parse_axis_map('-y +x +z')
((1, -1), (0, 1), (2, 1))
>>> try:
...     parse_axis_map('-x +y +z')
... except AxisMapError as error:
...     print(error)
axis map '-x +y +z' mirrors (determinant -1): a right-handed frame stays so only under +1
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Final, NamedTuple, TypeAlias

import numpy as np
from imu_recording.recording import FloatArray
from imu_recording.user_error import UserError

from imu_driver.board.lsm9ds1 import (
    SENSORS,
    TEMPERATURE_SENSITIVITY_C,
    scale,
    temperature_from_counts,
)
from imu_driver.wire.frames import MAGNETOMETER_NEW, TEMPERATURE_NEW, DataFrame

Vector: TypeAlias = tuple[float, float, float]


class Sample(NamedTuple):
    """Measurements of all sensors at one stamp; None where a sensor has no new value."""

    stamp: int
    """ROS time of measurement [ns]."""
    angular_velocity: Vector
    """[rad/s]."""
    linear_acceleration: Vector
    """[m/s²]."""
    magnetic_field: Vector | None
    """[T]."""
    temperature: float | None
    """[°C]."""


class SampleScale:
    """Turns data frames of one configuration into samples."""

    def __init__(
        self, full_scale: Mapping[str, float], axis_maps: Mapping[str, AxisMap] | None = None
    ) -> None:
        self._terms: list[tuple[int, float]] = []
        for offset, sensor in enumerate(SENSORS):
            factors = scale(sensor, full_scale[sensor])
            for axis, sign in (axis_maps or {}).get(sensor, IDENTITY_AXES):
                self._terms.append((3 * offset + axis, sign * float(factors[axis])))

    def sample(self, stamp: int, frame: DataFrame) -> Sample:
        """Return the sample of a frame measured at `stamp` [ns]."""
        counts = frame.counts
        value = [counts[index] * factor for index, factor in self._terms]
        flags = frame.flags
        magnetic_field = temperature = None
        if flags & MAGNETOMETER_NEW:
            magnetic_field = value[6], value[7], value[8]
        if flags & TEMPERATURE_NEW:
            temperature = temperature_from_counts(frame.temperature)
        return Sample(
            stamp=stamp,
            angular_velocity=(value[0], value[1], value[2]),
            linear_acceleration=(value[3], value[4], value[5]),
            magnetic_field=magnetic_field,
            temperature=temperature,
        )


TEMPERATURE_VARIANCE_K2: Final = TEMPERATURE_SENSITIVITY_C**2 / 12.0
"""[K²] of rounding to counts; the device's absolute accuracy is not specified."""


def diagonal(variance: float) -> tuple[float, ...]:
    """Return nine numbers, row-major: the covariance of three axes of one variance."""
    return (variance, 0.0, 0.0, 0.0, variance, 0.0, 0.0, 0.0, variance)


AxisMap: TypeAlias = tuple[tuple[int, int], tuple[int, int], tuple[int, int]]
"""For each published axis: index of the sensor's axis, sign."""

IDENTITY_AXES: Final[AxisMap] = ((0, 1), (1, 1), (2, 1))


class AxisMapError(UserError):
    """An axis map that is no rotation; the message names it."""


def parse_axis_map(text: str) -> AxisMap:
    """Return the map of a text such as '+x +y +z': the sensor axis along published x, y, z.

    Raises AxisMapError unless it is a rotation (each axis once, determinant +1).
    """
    found = re.findall(r'([+-]?)([xyz])', text)
    if re.sub(r'[+-]?[xyz]|[\s,]', '', text) or sorted(axis for _, axis in found) != [*'xyz']:
        raise AxisMapError(f'axis map {text!r}: expected each of x, y, z once, e.g. "-y +x +z"')
    first, second, third = (('xyz'.index(axis), -1 if sign == '-' else 1) for sign, axis in found)
    axis_map = (first, second, third)
    determinant = round(float(np.linalg.det(rotation(axis_map))))
    if determinant != 1:
        raise AxisMapError(
            f'axis map {text!r} mirrors (determinant {determinant}): '
            'a right-handed frame stays so only under +1'
        )
    return axis_map


def rotation(axis_map: AxisMap) -> FloatArray:
    """Return (3, 3) the matrix from sensor to published axes."""
    matrix = np.zeros((3, 3))
    for row, (column, sign) in enumerate(axis_map):
        matrix[row, column] = sign
    return matrix
