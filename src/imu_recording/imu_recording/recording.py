# SPDX-License-Identifier: Apache-2.0
"""IMU samples as columns, the value every other module takes or returns.

Also the errors of measurements that cannot be used, the up axis inferred from gravity, and one
hash of what was measured.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from html import escape
from typing import Any, TypeAlias

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
"""Values of `ImuRecording.up_axis`: the sensor axis that points away from the ground."""

SENSOR_FIELDS = {
    'accelerometer': 'linear_acceleration',
    'gyroscope': 'angular_velocity',
    'magnetometer': 'magnetic_field',
}
"""Field of the recording that each sensor measures."""

SENSOR_UNITS = {'accelerometer': 'm/s²', 'gyroscope': 'rad/s', 'magnetometer': 'T'}
"""SI unit of each sensor's field."""

SECOND_NS = 1_000_000_000
"""Nanoseconds in a second."""
STANDARD_GRAVITY = 9.80665
"""Standard gravity [m/s²], ISO 80000-3."""
TESLA_PER_GAUSS = 1e-4
GRAVITY_SHARE = 0.9
"""The axis must carry at least this share of the specific force, in most of the recording."""
LONGEST_MESSAGE_CHARACTERS = 1000
"""A message is one line of at most this many characters."""


class RecordingError(UserError):
    """Measurements that cannot be used as they are; the message names the value and a way out."""


class BagError(RecordingError):
    """A bag that cannot be read or written; the message names the file and a way out."""

    def __init__(self, message: str) -> None:
        line = ' '.join(message.splitlines())  # names in damaged files hold anything
        super().__init__(line[:LONGEST_MESSAGE_CHARACTERS])


@dataclass(frozen=True, eq=False, repr=False)
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
    pressure: FloatArray | None = None
    """(n,) pressure of the air at the device [Pa]."""
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
    """One of UP_AXES, or '' where neither stated nor inferable from gravity."""
    profile: str = ''
    """Name of the thermal profile."""
    compensated: str = ''
    """Device and hash of the thermal model that was subtracted; '' for what was measured."""
    simulated: str = ''
    """What simulated it; '' for what a device measured."""
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

    def __repr__(self) -> str:
        """Return what was recorded, in a line: device, run, samples, span, tracks."""
        summary = self.to_dict()
        rate = f' at {summary["rate_hz"]:.4g} Hz' if summary['rate_hz'] else ''
        known = self.temperature[np.isfinite(self.temperature)]
        die = f', die {known.min():.1f} … {known.max():.1f} °C' if len(known) else ''
        return (
            f'ImuRecording({self.device or "device not named"}, '
            f'{self.run or self.source or "run not named"}'
            f'{", " + self.up_axis + " up" if self.up_axis else ""}: {len(self)} samples{rate}, '
            f'{summary["duration_s"] / 3600.0:.3g} h{die}; '
            f'{", ".join(summary["channels"]) or "no further track"})'
        )

    def _repr_html_(self) -> str:
        """Return what was recorded as a table for a notebook."""
        rows = ''.join(
            f'<tr><th>{escape(name)}</th><td>{escape(_shown(value))}</td></tr>'
            for name, value in self.to_dict().items()
        )
        return f'<b>ImuRecording</b><table><tbody>{rows}</tbody></table>'

    def to_dict(self) -> dict[str, Any]:
        """Return a summary in plain values: device, run, up axis, rows, span, rate, channels.

        `rate_hz` is None where fewer than two rows make none; `channels` are the tracks that were
        logged beside the three sensors and the die temperature.
        """
        rows, span = len(self), float(self.time[-1]) if len(self) else 0.0
        return {
            'device': self.device,
            'run': self.run,
            'up_axis': self.up_axis,
            'rows': rows,
            'duration_s': span,
            'rate_hz': (rows - 1) / span if span > 0.0 else None,
            'channels': [
                item.name
                for item in fields(self)
                if item.default is None and getattr(self, item.name) is not None
            ],
        }

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


def _shown(value: Any) -> str:
    if isinstance(value, list):
        value = ', '.join(value)
    if value is None or value == '':
        return '–'
    return f'{value:.6g}' if isinstance(value, float) else str(value)


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


def infer_up_axis(linear_acceleration: FloatArray) -> str:
    """Return the entry of UP_AXES that carries gravity throughout, or '' where none does.

    `linear_acceleration` (n, 3) [m/s²] is specific force: +g on the axis pointing up (REP-145).

    >>> infer_up_axis(np.array([[0.1, -9.8, 0.2]] * 5))
    '-y'
    """
    sample = linear_acceleration[:: max(1, len(linear_acceleration) // 20_000)]
    # An axis that was never measured carries none that could be told.
    sample = np.where(np.isfinite(sample).any(axis=0), sample, 0.0)
    sample = sample[np.isfinite(sample).all(axis=1)]
    if not len(sample):
        return ''
    with np.errstate(over='ignore'):  # numbers no accelerometer gives make no axis point up
        norm = np.linalg.norm(sample, axis=1)
    if not 0.5 * STANDARD_GRAVITY < float(np.median(norm)) < 1.5 * STANDARD_GRAVITY:
        return ''
    middle = np.median(sample, axis=0)
    axis = int(np.argmax(np.abs(middle)))
    sign = np.sign(middle[axis])
    share = np.mean(sign * sample[:, axis] > GRAVITY_SHARE * norm)
    if share < GRAVITY_SHARE:
        return ''
    return UP_AXES[2 * axis + int(sign < 0)]


def columns_hash(recording: ImuRecording) -> str:
    """Return the SHA-256 of the decoded columns, in hexadecimal.

    Hashed are, in order of the fields of ImuRecording, the name of every track that is present
    and its values, row by row, as little-endian 64-bit numbers; every NaN counts as the same.
    Names, namespaces, paths and the stamps of held temperatures do not enter.
    """
    digest = hashlib.sha256()
    for item in fields(recording):
        column = getattr(recording, item.name)
        if isinstance(column, np.ndarray) and item.name != 'temperature_stamp':
            digest.update(item.name.encode())
            digest.update(np.ascontiguousarray(_canonical(column)).data)
    return digest.hexdigest()


def _canonical(column: np.ndarray) -> np.ndarray:
    """Return the column as little-endian 64-bit numbers with one bit pattern for NaN."""
    if column.dtype.kind == 'i':
        return column.astype('<i8', copy=False)
    column = column.astype('<f8', copy=False)
    missing = np.isnan(column)
    return np.where(missing, np.nan, column) if missing.any() else column
