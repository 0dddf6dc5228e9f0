# SPDX-License-Identifier: Apache-2.0
"""Raw counts to SI samples in the published frame."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple, TypeAlias

from imu_driver.axis_map import IDENTITY, AxisMap
from imu_driver.frames import MAGNETOMETER_NEW, TEMPERATURE_NEW, DataFrame
from imu_driver.lsm9ds1 import SENSORS, scale, temperature_from_counts

Vector: TypeAlias = tuple[float, float, float]


class Sample(NamedTuple):
    """What one stamp measured; None where nothing new was measured."""

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
            for axis, sign in (axis_maps or {}).get(sensor, IDENTITY):
                self._terms.append((3 * offset + axis, sign * float(factors[axis])))

    def sample(self, stamp: int, frame: DataFrame) -> Sample:
        """Return the sample of a frame measured at `stamp` [ns]."""
        counts = frame.counts
        value = [counts[index] * factor for index, factor in self._terms]
        flags = frame.flags
        return Sample(
            stamp,
            (value[0], value[1], value[2]),
            (value[3], value[4], value[5]),
            (value[6], value[7], value[8]) if flags & MAGNETOMETER_NEW else None,
            temperature_from_counts(frame.temperature) if flags & TEMPERATURE_NEW else None,
        )
