# SPDX-License-Identifier: Apache-2.0
"""Between ROS messages and plain samples, for nodes; message classes are imported when needed.

Samples are named tuples of floats and tuples, made in a third of the time of a frozen dataclass;
stamps are integers [ns]. Message fields get `float(...)`: rclpy serialises ints and numpy scalars
as garbage without an error.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from imu_recording.recording import SECOND_NS

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
Covariance = tuple[float, ...]
"""Nine numbers, row-major; all 0: unknown; first −1: not reported (REP-145)."""

UNKNOWN_COVARIANCE: Covariance = (0.0,) * 9
NOT_REPORTED_COVARIANCE: Covariance = (-1.0,) + (0.0,) * 8


class ImuSample(NamedTuple):
    """One sensor_msgs/Imu."""

    stamp: int
    angular_velocity: Vector
    """[rad/s]"""
    linear_acceleration: Vector
    """[m/s²], specific force."""
    angular_velocity_covariance: Covariance = UNKNOWN_COVARIANCE
    linear_acceleration_covariance: Covariance = UNKNOWN_COVARIANCE
    frame_id: str = 'imu_link'
    orientation: Quaternion = (0.0, 0.0, 0.0, 1.0)
    """xyzw, sensor → world."""
    orientation_covariance: Covariance = NOT_REPORTED_COVARIANCE


class MagneticSample(NamedTuple):
    """One sensor_msgs/MagneticField."""

    stamp: int
    magnetic_field: Vector
    """[T]"""
    magnetic_field_covariance: Covariance = UNKNOWN_COVARIANCE
    frame_id: str = 'imu_link'


class TemperatureSample(NamedTuple):
    """One sensor_msgs/Temperature."""

    stamp: int
    temperature: float
    """[°C]"""
    variance: float = 0.0
    """[K²], 0: unknown."""
    frame_id: str = 'imu_link'


class VectorSample(NamedTuple):
    """One geometry_msgs/Vector3Stamped."""

    stamp: int
    vector: Vector
    frame_id: str = 'imu_link'


def stamp_of(message: Any) -> int:
    """Return the header's stamp [ns]."""
    stamp = message.header.stamp
    return int(stamp.sec) * SECOND_NS + int(stamp.nanosec)


def sample_from_imu(message: Any) -> ImuSample:
    """Return the sample of a sensor_msgs/Imu; vectors that are not reported are NaN."""
    of_rate = _covariance(message.angular_velocity_covariance)
    of_force = _covariance(message.linear_acceleration_covariance)
    return ImuSample(
        stamp=stamp_of(message),
        angular_velocity=_vector(message.angular_velocity, of_rate),
        linear_acceleration=_vector(message.linear_acceleration, of_force),
        angular_velocity_covariance=of_rate,
        linear_acceleration_covariance=of_force,
        frame_id=message.header.frame_id,
        orientation=_quaternion(message.orientation),
        orientation_covariance=_covariance(message.orientation_covariance),
    )


def sample_from_magnetic_field(message: Any) -> MagneticSample:
    """Return the sample of a sensor_msgs/MagneticField."""
    return MagneticSample(
        stamp=stamp_of(message),
        magnetic_field=_vector(message.magnetic_field, UNKNOWN_COVARIANCE),
        magnetic_field_covariance=_covariance(message.magnetic_field_covariance),
        frame_id=message.header.frame_id,
    )


def sample_from_temperature(message: Any) -> TemperatureSample:
    """Return the sample of a sensor_msgs/Temperature."""
    return TemperatureSample(
        stamp=stamp_of(message),
        temperature=float(message.temperature),
        variance=float(message.variance),
        frame_id=message.header.frame_id,
    )


def sample_from_vector(message: Any) -> VectorSample:
    """Return the sample of a geometry_msgs/Vector3Stamped."""
    vector = _vector(message.vector, UNKNOWN_COVARIANCE)
    return VectorSample(stamp_of(message), vector, message.header.frame_id)


def imu_from_sample(sample: ImuSample) -> Any:
    """Return a sensor_msgs/Imu."""
    from sensor_msgs.msg import Imu

    message = Imu()
    _fill_header(message.header, sample.stamp, sample.frame_id)
    _fill_vector(message.angular_velocity, sample.angular_velocity)
    _fill_vector(message.linear_acceleration, sample.linear_acceleration)
    message.angular_velocity_covariance = _nine(sample.angular_velocity_covariance)
    message.linear_acceleration_covariance = _nine(sample.linear_acceleration_covariance)
    message.orientation_covariance = _nine(sample.orientation_covariance)
    fill_quaternion(message.orientation, sample.orientation)
    return message


def magnetic_field_from_sample(sample: MagneticSample) -> Any:
    """Return a sensor_msgs/MagneticField."""
    from sensor_msgs.msg import MagneticField

    message = MagneticField()
    _fill_header(message.header, sample.stamp, sample.frame_id)
    _fill_vector(message.magnetic_field, sample.magnetic_field)
    message.magnetic_field_covariance = _nine(sample.magnetic_field_covariance)
    return message


def temperature_from_sample(sample: TemperatureSample) -> Any:
    """Return a sensor_msgs/Temperature."""
    from sensor_msgs.msg import Temperature

    message = Temperature()
    _fill_header(message.header, sample.stamp, sample.frame_id)
    message.temperature = float(sample.temperature)
    message.variance = float(sample.variance)
    return message


def humidity_message(stamp: int, humidity: float, frame_id: str = '') -> Any:
    """Return a sensor_msgs/RelativeHumidity; `humidity` 0 … 1."""
    from sensor_msgs.msg import RelativeHumidity

    message = RelativeHumidity()
    _fill_header(message.header, stamp, frame_id)
    message.relative_humidity = float(humidity)
    return message


def vector_message(stamp: int, vector: Sequence[float], frame_id: str = 'imu_link') -> Any:
    """Return a geometry_msgs/Vector3Stamped."""
    from geometry_msgs.msg import Vector3Stamped

    message = Vector3Stamped()
    _fill_header(message.header, stamp, frame_id)
    _fill_vector(message.vector, vector)
    return message


def vector_from_sample(sample: VectorSample) -> Any:
    """Return a geometry_msgs/Vector3Stamped."""
    return vector_message(sample.stamp, sample.vector, sample.frame_id)


def quaternion_message(stamp: int, orientation: Sequence[float], frame_id: str = '') -> Any:
    """Return a geometry_msgs/QuaternionStamped; `orientation` xyzw."""
    from geometry_msgs.msg import QuaternionStamped

    message = QuaternionStamped()
    _fill_header(message.header, stamp, frame_id)
    fill_quaternion(message.quaternion, orientation)
    return message


def float_message(value: float) -> Any:
    """Return a std_msgs/Float64."""
    from std_msgs.msg import Float64

    return Float64(data=float(value))


def fill_quaternion(quaternion: Any, orientation: Sequence[float]) -> None:
    """Set a geometry_msgs/Quaternion from xyzw."""
    quaternion.x, quaternion.y, quaternion.z, quaternion.w = (float(v) for v in orientation)


def fill_stamp(time: Any, stamp: int) -> None:
    """Set a builtin_interfaces/Time from nanoseconds."""
    seconds, nanoseconds = divmod(int(stamp), SECOND_NS)
    time.sec = seconds
    time.nanosec = nanoseconds


def _fill_header(header: Any, stamp: int, frame_id: str) -> None:
    fill_stamp(header.stamp, stamp)
    header.frame_id = str(frame_id)


def _fill_vector(vector: Any, values: Sequence[float]) -> None:
    vector.x, vector.y, vector.z = (float(v) for v in values)


def _vector(vector: Any, covariance: Sequence[float]) -> Vector:
    if covariance[0] == -1.0:
        nan = float('nan')
        return nan, nan, nan
    return float(vector.x), float(vector.y), float(vector.z)


def _quaternion(value: Any) -> Quaternion:
    return float(value.x), float(value.y), float(value.z), float(value.w)


def _covariance(values: Any) -> Covariance:
    return tuple(values.tolist())  # a twelfth of the time of value by value


def _nine(values: Sequence[float]) -> list[float]:
    return [float(value) for value in values]
