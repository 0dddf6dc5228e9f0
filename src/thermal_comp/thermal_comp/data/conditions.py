# SPDX-License-Identifier: Apache-2.0
"""The conditions of a measurement, a run or a part of it: all that a physical effect may see."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any, Literal, get_args

import numpy as np
from imu_recording.logging_contract import OPTIONAL_FIELDS
from imu_recording.recording import (
    STANDARD_GRAVITY,
    FloatArray,
    ImuRecording,
    IntArray,
    RecordingError,
)
from numpy.typing import NDArray

Sensor = Literal['accelerometer', 'gyroscope', 'magnetometer']
SENSORS: tuple[Sensor, ...] = get_args(Sensor)
INERTIAL_SENSORS: tuple[Sensor, ...] = ('accelerometer', 'gyroscope')
"""Sensors of the device's motion; a magnetometer measures the field around it."""
TABLE_ORDER: tuple[Sensor, ...] = ('gyroscope', 'accelerometer', 'magnetometer')
"""Order of the sensors in the paper's tables."""

REFERENCE_TEMPERATURE = 20.0
"""Die temperature [°C] the coefficients refer to (T_A of Betta et al. 2022, Table I)."""

EARTH_RATE_RAD_S = 7.292115e-5
"""Rotation of the Earth [rad/s] (WGS 84)."""


@dataclass(frozen=True, eq=False)
class Conditions:
    """Conditions of n samples of one run, as columns.

    `specific_force`, `angular_velocity` and `magnetic_field` are the true inputs in the sensor
    frame as far as known: from the truth while fitting, the measured values in the field.
    A channel that was not logged is None.
    """

    time: FloatArray
    """(n,) [s] since power-on, or since the first sample of the run where that is unknown."""
    temperature: FloatArray
    """(n,) die temperature [°C]."""
    specific_force: FloatArray
    """(n, 3) [m/s²]."""
    angular_velocity: FloatArray
    """(n, 3) [rad/s]."""
    magnetic_field: FloatArray
    """(n, 3) [T]."""
    time_before: float = 0.0
    """Time from the first sample of the campaign's first run to where `time` is zero [s]."""
    temperature_interval: float = 0.0
    """Time between measurements of `temperature` [s], with straight lines between; 0: each row."""
    temperature_counts: tuple[float, ...] = ()
    """Counts of the thermometer, ascending [°C]; empty where it has none, or they are unknown."""
    sensor: Sensor = 'accelerometer'
    """The sensor whose error an effect is to give."""
    reference_temperature: float = REFERENCE_TEMPERATURE
    """[°C]."""
    orientation: FloatArray | None = None
    """(3, 3) rotation from the chamber's frame into the sensor's; None where unknown."""
    hard_iron: FloatArray | None = None
    """(3,) constant offset in `magnetic_field` [T]; None where no orientations tell it."""
    chamber_temperature: FloatArray | None = None
    chamber_temperature_2: FloatArray | None = None
    device_temperature: FloatArray | None = None
    humidity: FloatArray | None = None
    pressure: FloatArray | None = None
    heater: FloatArray | None = None
    compressor: FloatArray | None = None
    fan: FloatArray | None = None
    supply_voltage: FloatArray | None = None
    vibration: FloatArray | None = None
    setpoint: FloatArray | None = None
    phase: IntArray | None = None
    cycle: IntArray | None = None

    def __len__(self) -> int:
        return len(self.time)

    @property
    def temperature_difference(self) -> FloatArray:
        """(n,) die temperature above the reference temperature [K]: the x of the equations."""
        difference: FloatArray = self.temperature - self.reference_temperature
        return difference

    @cached_property
    def temperature_rate(self) -> FloatArray:
        """(n,) dT/dt [K/s] by central differences, of a smoothed temperature; computed once."""
        rate: FloatArray = np.gradient(self.temperature, self.time)
        return rate

    @property
    def true_input(self) -> FloatArray:
        """(n, 3) what the sensor is meant to measure, in its SI unit."""
        return {
            'accelerometer': self.specific_force,
            'gyroscope': self.angular_velocity,
            'magnetometer': self.magnetic_field,
        }[self.sensor]

    def of(self, sensor: Sensor) -> Conditions:
        """Return the same conditions as seen by another sensor."""
        return replace(self, sensor=sensor)

    def rows(self, selection: slice | NDArray[np.bool_] | IntArray) -> Conditions:
        """Return the conditions of the selected rows."""
        taken: dict[str, Any] = {
            item.name: value[selection]
            for item in fields(self)
            if item.name not in PER_RUN
            and isinstance(value := getattr(self, item.name), np.ndarray)
        }
        return replace(self, **taken)

    def at(self, time: FloatArray) -> Conditions:
        """Return the conditions at other times: numbers on lines between, states as they were."""
        before = np.clip(np.searchsorted(self.time, time, side='right') - 1, 0, len(self) - 1)
        taken: dict[str, Any] = {
            item.name: np.interp(time, self.time, value)
            for item in fields(self)
            if isinstance(value := getattr(self, item.name), np.ndarray)
            and value.ndim == 1
            and value.dtype.kind == 'f'
            and item.name not in PER_RUN
        }
        return replace(self.rows(before), **taken)

    def has(self, channel: str) -> bool:
        """Tell whether a channel was logged: present and finite somewhere."""
        value = getattr(self, channel)
        if value is None:
            return False
        return bool(np.isfinite(value[:1]).any() or np.isfinite(value).any())


PER_RUN = ('orientation', 'hard_iron')
"""Conditions that are one for all samples of a run."""
CHANNELS = tuple(
    name for name in OPTIONAL_FIELDS if name in {item.name for item in fields(Conditions)}
)
"""Tracks of a recording, beyond the die temperature, that an effect can ask for."""


def logged_channels(runs: Sequence[Conditions]) -> frozenset[str]:
    """Return the channels that are known in every run, and 'orientation' where that is."""
    known = (*CHANNELS, 'orientation')
    return frozenset(c for c in known if all(run.has(c) for run in runs))


def field_conditions(
    recording: ImuRecording, reference_temperature: float = REFERENCE_TEMPERATURE
) -> Conditions:
    """Return the conditions as known in the field: the true inputs are the measured values."""
    channels = {name: getattr(recording, name) for name in CHANNELS}
    return Conditions(
        time=recording.time,
        temperature=recording.temperature,
        specific_force=recording.linear_acceleration,
        angular_velocity=recording.angular_velocity,
        magnetic_field=recording.magnetic_field,
        reference_temperature=reference_temperature,
        **channels,
    )


def settled_conditions(
    temperature: float, reference_temperature: float = REFERENCE_TEMPERATURE
) -> Conditions:
    """Return the conditions of one sample without inputs, at a temperature that is long held."""
    nothing = np.zeros((1, 3))
    return Conditions(
        time=np.zeros(1),
        temperature=np.array([temperature]),
        specific_force=nothing,
        angular_velocity=nothing,
        magnetic_field=nothing,
        reference_temperature=reference_temperature,
    )


def static_conditions(
    recording: ImuRecording,
    *,
    gravity: float = STANDARD_GRAVITY,
    reference_temperature: float = REFERENCE_TEMPERATURE,
    orientation: FloatArray | None = None,
) -> Conditions:
    """Return the conditions of a run in which the device does not move.

    Specific force is `gravity` along `up_axis`, angular velocity zero (Earth's rate is part of the
    run's level), magnetic field the run's mean.
    """
    n = len(recording)
    if not recording.up_axis:
        raise RecordingError(
            f'{recording.source or "recording"}: up_axis is not known, and gravity stays on '
            'no axis: turn an axis up or down for the whole run, or record one bag for each '
            'orientation'
        )
    up = np.zeros(3)
    up['xyz'.index(recording.up_axis[1])] = gravity if recording.up_axis[0] == '+' else -gravity
    measured = recording.magnetic_field
    seen = measured[np.isfinite(measured).all(axis=1)]
    field = seen.mean(axis=0) if len(seen) else np.full(3, np.nan)
    conditions = field_conditions(recording, reference_temperature)
    return replace(
        conditions,
        specific_force=np.broadcast_to(up, (n, 3)),
        angular_velocity=np.zeros((n, 3)),
        magnetic_field=np.broadcast_to(field, (n, 3)),
        orientation=orientation,
    )


def mounting_rotation(up_axis: str) -> FloatArray:
    """Return the (3, 3) rotation from the chamber's frame (z up) into the sensor's.

    The fixture turns the device cyclically (x up: x = Z, y = X, z = Y); an axis that points down
    is the same mounting turned by half about the axis after it.

    >>> mounting_rotation('+x') @ [0.0, 0.0, 1.0]
    array([1., 0., 0.])
    >>> mounting_rotation('-z') @ [0.0, 0.0, 1.0]
    array([ 0.,  0., -1.])
    """
    axis = 'xyz'.index(up_axis[1])
    rotation: FloatArray = np.roll(np.eye(3), axis + 1, axis=0)
    if up_axis[0] == '-':
        half_turn = -np.ones(3)
        half_turn[(axis + 1) % 3] = 1.0
        rotation = half_turn[:, None] * rotation
    return rotation
