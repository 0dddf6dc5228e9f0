# SPDX-License-Identifier: Apache-2.0
"""The one noun everything flows through: IMU samples as columns."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from imu_recording.user_error import UserError

FloatArray: TypeAlias = NDArray[np.float64]
IntArray: TypeAlias = NDArray[np.int64]

PHASES = (
    'precondition',
    'ramp_down',
    'dwell_cold',
    'ramp_up',
    'dwell_hot',
    'dwell_reference',
    'final',
)
"""Phases of a thermal cycle, in order; `ImuRecording.phase` holds indices into this tuple."""

UP_AXES = ('+x', '-x', '+y', '-y', '+z', '-z')
"""What `ImuRecording.up_axis` may be: the sensor axis that points away from the ground."""

SENSOR_FIELDS = {
    'accelerometer': 'linear_acceleration',
    'gyroscope': 'angular_velocity',
    'magnetometer': 'magnetic_field',
}
"""Field of the recording that each sensor measures."""

SENSOR_UNITS = {'accelerometer': 'm/s²', 'gyroscope': 'rad/s', 'magnetometer': 'T'}
"""SI unit of each sensor's field."""


class RecordingError(UserError):
    """Measurements that cannot be used as they are; the message names the value and a way out."""


@dataclass(frozen=True, eq=False)
class ImuRecording:
    """IMU samples as columns: row i of every array was measured at stamp[i].

    Names and units are sensor_msgs'. Rows follow imu/data_raw. A MagneticField sample goes to the
    row of its stamp, else to the next row at most one IMU period later; rows without one hold NaN.
    `temperature` and the other tracks hold the newest sample not later than the row, NaN before
    the first. A track that was not logged is None. Arrays are read-only by convention.
    """

    stamp: IntArray
    """(n,) ROS time of measurement [ns], strictly increasing."""
    angular_velocity: FloatArray
    """(n, 3) [rad/s], sensor frame."""
    linear_acceleration: FloatArray
    """(n, 3) [m/s²], specific force: +g on the axis that points up (REP-145)."""
    magnetic_field: FloatArray
    """(n, 3) [T]; NaN where a row has no magnetometer sample."""
    temperature: FloatArray
    """(n,) die temperature [°C]."""

    temperature_stamp: IntArray | None = None
    """(n,) when the temperature a row holds was measured [ns], −1 before the first; None where
    that is the row's own stamp."""
    chamber_temperature: FloatArray | None = None
    """(n,) chamber air [°C]."""
    chamber_temperature_2: FloatArray | None = None
    """(n,) second chamber air sensor [°C]."""
    device_temperature: FloatArray | None = None
    """(n,) thermocouple on the device [°C]."""
    setpoint: FloatArray | None = None
    """(n,) chamber set-point [°C]."""
    humidity: FloatArray | None = None
    """(n,) relative humidity in the chamber, 0 … 1."""
    heater: FloatArray | None = None
    """(n,) heater state or duty, 0 … 1."""
    compressor: FloatArray | None = None
    """(n,) compressor state, 0 … 1."""
    fan: FloatArray | None = None
    """(n,) fan state, 0 … 1."""
    supply_voltage: FloatArray | None = None
    """(n,) device supply [V]."""
    vibration: FloatArray | None = None
    """(n, 3) variance of acceleration within the sample's interval [(m/s²)²]."""
    phase: IntArray | None = None
    """(n,) index into PHASES; −1 unknown."""
    cycle: IntArray | None = None
    """(n,) thermal cycle, 1 …; 0 outside the cycles (precondition, final)."""
    reference_orientation: FloatArray | None = None
    """(n, 4) true attitude where known, quaternion xyzw, sensor → ENU world; NaN where unknown."""

    frame_id: str = 'imu_link'
    device: str = ''
    """Serial number or name of the device; '' unknown."""
    run: str = ''
    """Name of the run: one recording in one orientation."""
    up_axis: str = ''
    """One of UP_AXES, or '' where neither told nor inferable from gravity."""
    profile: str = ''
    """Name of the thermal profile."""
    namespace: str = ''
    """ROS namespace the IMU topics were recorded in, '' or '/dut1'."""
    source: str = ''
    """Path the recording was read from; '' for one made in memory."""
    notes: tuple[str, ...] = field(default=())
    """What was dropped, repaired or inferred on the way here, one sentence each."""
    unplaced: Mapping[str, int] = field(default_factory=dict)
    """Topic → samples that belong to no row; more than one or two stand in the notes, too."""

    def __post_init__(self) -> None:
        n = len(self.stamp)
        for name, shape in _SHAPES.items():
            value = getattr(self, name)
            if value is not None and value.shape != (n, *shape):
                raise RecordingError(
                    f'{name} has shape {value.shape}, expected {(n, *shape)} to match {n} stamps'
                )
        if self.up_axis and self.up_axis not in UP_AXES:
            raise RecordingError(f'up_axis {self.up_axis!r} is none of {", ".join(UP_AXES)}')

    def __len__(self) -> int:
        return len(self.stamp)

    @property
    def time(self) -> FloatArray:
        """(n,) seconds since the first sample."""
        if not len(self.stamp):
            return np.empty(0)
        time: FloatArray = (self.stamp - self.stamp[0]) * 1e-9
        return time

    def rows(self, selection: slice | NDArray[np.bool_] | IntArray) -> ImuRecording:
        """Return the recording of the selected rows, every track alike."""
        taken = {
            name: value[selection]
            for name in _SHAPES
            if (value := getattr(self, name)) is not None
        }
        return replace(self, stamp=self.stamp[selection], **taken)

    def with_notes(self, *notes: str) -> ImuRecording:
        """Return the recording with further notes."""
        return replace(self, notes=self.notes + notes)


_SHAPES: dict[str, tuple[int, ...]] = {
    f.name: {
        'angular_velocity': (3,),
        'linear_acceleration': (3,),
        'magnetic_field': (3,),
        'vibration': (3,),
        'reference_orientation': (4,),
    }.get(f.name, ())
    for f in fields(ImuRecording)
    if f.name != 'stamp' and 'Array' in str(f.type)
}
