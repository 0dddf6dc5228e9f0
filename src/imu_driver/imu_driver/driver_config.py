# SPDX-License-Identifier: Apache-2.0
"""Parameters of the driver node, and what they mean for the session with the device."""

from __future__ import annotations

from dataclasses import dataclass

from imu_recording.ros.parameter import parameter

from imu_driver.board.lsm9ds1 import SENSORS, scale
from imu_driver.board.sample import parse_axis_map
from imu_driver.board.session import SessionConfig
from imu_driver.wire.codec import PROTOCOLS

DATA_FRAME_BITS = 31 * 10
"""A binary data frame on an 8N1 line."""


@dataclass(frozen=True)
class DriverParameters:
    """What a user may set; 0 leaves the device as it is."""

    transport: str = parameter(
        'serial:///dev/imu',
        'Where the device is: serial:///dev/serial/by-id/NAME, tcp://HOST:PORT, '
        'simulated://dut1 or bag://PATH',
    )
    protocol: str = parameter('auto', 'Encoding on the wire', choices=PROTOCOLS)
    baudrate: int = parameter(921600, 'Speed of a serial line', unit='baud', bounds=(300, 12e6))
    frame_id: str = parameter('imu_link', 'Frame of the published data (right-handed)')
    device: str = parameter('', 'Serial number that is accepted; empty: any')
    latency: float = parameter(
        0.0,
        'Shortest time from sample to arrival, beyond a frame on the serial line',
        unit='s',
        bounds=(-0.1, 0.1),
    )
    output_data_rate: float = parameter(
        0.0, 'Rate to set: 14.9, 59.5, 119, 238, 476 or 952', unit='Hz', bounds=(0, 1000)
    )
    gyroscope_full_scale: float = parameter(
        0.0, 'Full scale to set: 245, 500 or 2000', unit='dps', bounds=(0, 2000)
    )
    accelerometer_full_scale: float = parameter(
        0.0, 'Full scale to set: 2, 4, 8 or 16', unit='g', bounds=(0, 16)
    )
    magnetometer_full_scale: float = parameter(
        0.0, 'Full scale to set: 4, 8, 12 or 16', unit='gauss', bounds=(0, 16)
    )
    gyroscope_axis_map: str = parameter(
        '+x +y +z', 'Sensor axis along published x, y, z (a rotation)'
    )
    accelerometer_axis_map: str = parameter(
        '+x +y +z', 'Sensor axis along published x, y, z (a rotation)'
    )
    magnetometer_axis_map: str = parameter(
        '+x +y +z', 'Sensor axis along published x, y, z (a rotation)'
    )
    # Defaults: the noisiest axis of the simulated DUT1 … DUT3 over 30 s of the quiet zone (20 °C,
    # at rest, 238 Hz, most sensitive full scales); ~/measure_rest tells those of a device at hand.
    angular_velocity_stddev: float = parameter(
        6.3e-4, 'Noise of one sample', unit='rad/s', bounds=(0, 10), dynamic=True
    )
    linear_acceleration_stddev: float = parameter(
        1.63e-2, 'Noise of one sample', unit='m/s²', bounds=(0, 100), dynamic=True
    )
    magnetic_field_stddev: float = parameter(
        1.6e-6, 'Noise of one sample', unit='T', bounds=(0, 1), dynamic=True
    )


def session_config(parameters: DriverParameters) -> SessionConfig:
    """Return what the parameters want of the device; raise ValueError naming one it cannot do."""
    full_scale = {
        sensor: value
        for sensor in SENSORS
        if (value := getattr(parameters, f'{sensor}_full_scale'))
    }
    for sensor, value in full_scale.items():
        scale(sensor, value)
    on_the_line = DATA_FRAME_BITS / parameters.baudrate
    return SessionConfig(
        protocol=parameters.protocol,
        device=parameters.device,
        full_scale=full_scale,
        output_data_rate=parameters.output_data_rate,
        latency=parameters.latency
        + (on_the_line if parameters.transport.startswith('serial:') else 0.0),
        axis_maps={
            sensor: parse_axis_map(getattr(parameters, f'{sensor}_axis_map')) for sensor in SENSORS
        },
    )
