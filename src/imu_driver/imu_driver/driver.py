# SPDX-License-Identifier: Apache-2.0
"""One running driver without ROS: its parameters, and what it reads.

One thread (`DeviceReader`, `BagReader`) reads bytes, makes samples and publishes them. While it
publishes, more wait in the line's own buffer (of a serial port half a second of the highest rate,
two at 238 Hz), and what does not fit there is a gap in their numbers, which is counted.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final
from urllib.parse import urlsplit

from imu_recording.ros.parameter import parameter
from imu_recording.user_error import UserError

from imu_driver.board.lsm9ds1 import SENSORS, scale
from imu_driver.board.reader import DeviceReader
from imu_driver.board.sample import Sample, parse_axis_map
from imu_driver.board.session import DeviceSession, SessionConfig
from imu_driver.board.stream_statistics import StreamStatistics
from imu_driver.board.transport import SerialTransport, TcpTransport, Transport
from imu_driver.replay import BagReader
from imu_driver.wire.codec import PROTOCOLS
from imu_driver.wire.frames import CommandCode

DATA_FRAME_BITS: Final = 31 * 10
"""A binary data frame on an 8N1 line."""


@dataclass(frozen=True)
class DriverParameters:
    """Parameters of the driver; 0 leaves the device as it is."""

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
    read_period: float = parameter(
        0.002,
        'Shortest time between two reads; samples that arrive meanwhile are processed together, '
        'at half the cost each; 0: every sample at once',
        unit='s',
        bounds=(0, 0.1),
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


class ImuDriver:
    """Reads samples from the transport of the parameters and publishes them in order."""

    def __init__(
        self,
        parameters: DriverParameters,
        *,
        now: Callable[[], int],
        publish: Callable[[list[Sample]], None],
        report: Callable[[str], None],
        air: Callable[[float], float] | None = None,
    ) -> None:
        """`air`: ambient temperature [°C] of a simulated board in a chamber, by time [s]."""
        self.parameters = parameters
        self.statistics = StreamStatistics()
        self.session: DeviceSession | None = None
        self.device_reader: DeviceReader | None = None
        """As `session`, None where a bag is read instead of a device."""
        self._publish = publish
        self._reader: DeviceReader | BagReader
        transport = parameters.transport
        if transport.startswith('bag:'):
            self._reader = BagReader(transport, deliver=self._deliver, report=report)
        else:
            self.session = DeviceSession(session_config(parameters))
            self._reader = self.device_reader = DeviceReader(
                transport_opener(transport, parameters.baudrate, parameters.output_data_rate, air),
                self.session,
                now=now,
                deliver=self._deliver,
                report=report,
                read_period=parameters.read_period,
            )

    def start(self) -> None:
        """Begin to read and publish."""
        self._reader.start()

    def stop(self) -> None:
        """Stop reading."""
        self._reader.stop()

    @property
    def has_ended(self) -> bool:
        """Whether a bag is read and all of it has been published."""
        return isinstance(self._reader, BagReader) and self._reader.ended

    @property
    def device(self) -> str:
        """Serial number of the device, or the name its bag tells; '' unknown."""
        if isinstance(self._reader, BagReader):
            return self._reader.recording.device
        information = self.session.information if self.session else None
        return information.serial_number if information else ''

    @property
    def supply_voltage(self) -> float:
        """Device supply [V]; 0 unknown."""
        information = self.session.information if self.session else None
        return information.supply_millivolts * 1e-3 if information else 0.0

    def restart_stream(self) -> str:
        """Let the device stop and start its stream; return the answer to who asked for it."""
        if self.session is None:
            raise UserError('a bag has no stream to restart')
        self.session.command(CommandCode.STOP)
        self.session.command(CommandCode.START)
        return 'restarting'

    def _deliver(self, samples: list[Sample]) -> None:
        self._publish(samples)
        for sample in samples:
            self.statistics.add(sample)


class TransportError(UserError):
    """A transport URL of no known form; the message names the forms."""


def session_config(parameters: DriverParameters) -> SessionConfig:
    """Return the settings wanted of the device; raise UserError where it has no such setting."""
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


def transport_opener(
    url: str, baudrate: int, rate: float = 0.0, air: Callable[[float], float] | None = None
) -> Callable[[], Transport]:
    """Return a function that opens the transport; raise TransportError where none can be.

    `rate` [Hz]: output data rate of a simulated device after power-on; `air` [°C]: ambient
    temperature of one in a chamber, as a function of time [s].
    """
    parts = urlsplit(url)
    path = parts.netloc + parts.path
    if parts.scheme == 'serial' and path:
        return lambda: SerialTransport(path, baudrate)
    if parts.scheme == 'tcp':
        try:
            host, port = parts.hostname, parts.port
        except ValueError:
            host, port = None, None
        if host and port:
            return lambda: TcpTransport(host, port)
    if parts.scheme == 'simulated' and parts.netloc:
        from imu_driver.emulator.transport import SimulatedTransport  # only now: slow to import

        transport = SimulatedTransport.from_url(url, rate, air)
        return lambda: transport
    raise TransportError(
        f'transport {url!r}: expected serial:///dev/serial/by-id/NAME, tcp://HOST:PORT, '
        'simulated://dut1 or bag://PATH'
    )
