# SPDX-License-Identifier: Apache-2.0
"""Which topics make a recording, their types, and where they may stand.

Every list of tracks elsewhere is derived from TRACKS.
"""

from __future__ import annotations

from dataclasses import dataclass

IMU_TOPIC = 'imu/data_raw'
MAGNETIC_TOPIC = 'imu/mag'
TEMPERATURE_TOPIC = 'imu/temperature'
PHASE_TOPIC = 'chamber/phase'

IMU = 'sensor_msgs/msg/Imu'
MAGNETIC_FIELD = 'sensor_msgs/msg/MagneticField'
TEMPERATURE = 'sensor_msgs/msg/Temperature'
HUMIDITY = 'sensor_msgs/msg/RelativeHumidity'
PRESSURE = 'sensor_msgs/msg/FluidPressure'
VECTOR = 'geometry_msgs/msg/Vector3Stamped'
QUATERNION = 'geometry_msgs/msg/QuaternionStamped'
FLOAT = 'std_msgs/msg/Float64'
STRING = 'std_msgs/msg/String'

VALUE_OF_MESSAGE = {
    TEMPERATURE: 'temperature',
    HUMIDITY: 'relative_humidity',
    PRESSURE: 'fluid_pressure',
    VECTOR: 'vector',
    FLOAT: 'data',
}
"""Message types of a single quantity, and the field of the message that holds it."""

COMPENSATED = 'imu_compensated'
"""Where compensated messages stand beside those of `imu`, under the same names."""
APPLIED_MODEL = 'applied_model'
"""Latched text beside compensated messages: device and hash of the model that was subtracted."""

MESSAGES_LOST = 'messages_lost'
"""Key of custom_data under which a recorder says `<topic> <number>, …` of what it did not get."""
METADATA_KEYS = ('device', 'run', 'up_axis', 'profile', 'compensated', 'simulated')
"""Keys of a bag's custom_data that fill the fields of the same name."""


@dataclass(frozen=True)
class Track:
    """One topic of the logging contract."""

    topic: str
    """Name relative to the device's namespace."""
    message_type: str
    fields: tuple[str, ...]
    """Fields of ImuRecording it fills, one per group of columns."""
    shared: bool = False
    """Whether it may stand outside the device's namespace (one chamber, several devices)."""
    held: bool = True
    """Whether rows hold the newest sample not later than themselves."""
    event: bool = False
    """Whether it is sent on change, so that silence means nothing."""


TRACKS: tuple[Track, ...] = (
    Track(IMU_TOPIC, IMU, ('angular_velocity', 'linear_acceleration'), held=False),
    Track(MAGNETIC_TOPIC, MAGNETIC_FIELD, ('magnetic_field',), held=False),
    Track(TEMPERATURE_TOPIC, TEMPERATURE, ('temperature',)),
    Track('chamber/temperature', TEMPERATURE, ('chamber_temperature',), shared=True),
    Track('chamber/temperature_2', TEMPERATURE, ('chamber_temperature_2',), shared=True),
    Track('chamber/device_temperature', TEMPERATURE, ('device_temperature',), shared=True),
    Track('chamber/setpoint', TEMPERATURE, ('setpoint',), shared=True, event=True),
    Track('chamber/humidity', HUMIDITY, ('humidity',), shared=True),
    Track('imu/pressure', PRESSURE, ('pressure',)),
    Track('chamber/heater', FLOAT, ('heater',), shared=True, event=True),
    Track('chamber/compressor', FLOAT, ('compressor',), shared=True, event=True),
    Track('chamber/fan', FLOAT, ('fan',), shared=True, event=True),
    Track('imu/supply_voltage', FLOAT, ('supply_voltage',)),
    Track('imu/vibration', VECTOR, ('vibration',)),
    Track(PHASE_TOPIC, STRING, ('phase', 'cycle'), shared=True, event=True),
    Track('reference/orientation', QUATERNION, ('reference_orientation',), shared=True),
)
"""The logging contract; what is absent from a bag is absent from the recording."""

TRACK_OF_TOPIC = {track.topic: track for track in TRACKS}
TRACK_OF_FIELD = {field: track for track in TRACKS for field in track.fields}

MEASURED_FIELDS = tuple(name for name, track in TRACK_OF_FIELD.items() if not track.held)
"""Fields of ImuRecording that the three sensors measure, (n, 3) each."""
OPTIONAL_FIELDS = tuple(
    name
    for name, track in TRACK_OF_FIELD.items()
    if track.held and track.topic != TEMPERATURE_TOPIC
)
"""Fields of ImuRecording that are None where they were not logged."""
CHANNEL_FIELDS = tuple(
    name for name in OPTIONAL_FIELDS if TRACK_OF_FIELD[name].message_type in VALUE_OF_MESSAGE
)
"""Optional fields that are measured quantities: neither phase nor true attitude."""
THERMOMETER_FIELDS = tuple(
    name
    for name in CHANNEL_FIELDS
    if TRACK_OF_FIELD[name].message_type == TEMPERATURE and not TRACK_OF_FIELD[name].event
)
"""Temperatures that other thermometers than the die's measure."""
SWITCHED_FIELDS = tuple(
    name
    for name in CHANNEL_FIELDS
    if TRACK_OF_FIELD[name].message_type == FLOAT and TRACK_OF_FIELD[name].event
)
"""States or duties of the chamber's machines."""
