# SPDX-License-Identifier: Apache-2.0
"""reference_logger_node: PT100s and thermocouples of a data logger as temperature topics."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from imu_recording.ros.lifecycle_node import ConfiguredNode
from imu_recording.ros.messages import TemperatureSample, temperature_from_sample
from imu_recording.ros.parameter import NodeConfig, parameter
from imu_recording.ros.run_node import run_node
from sensor_msgs.msg import Temperature

from chamber_profile.periodic_thread import PeriodicThread
from chamber_profile.reference.logger import ReferenceLines, ReferenceLoggerPort, parse_columns

SILENCE_TIMEOUT_S = 10.0
"""A logger silent for this time is an error [s]."""


@dataclass(frozen=True)
class ReferenceLoggerConfig(NodeConfig):
    """Parameters of the node."""

    port: str = parameter('serial:///dev/reference_logger', 'serial:///dev/… or tcp://HOST:PORT')
    baudrate: int = parameter(9600, 'Speed of a serial line', unit='baud', bounds=(300, 4e6))
    delimiter: str = parameter(',', 'Between the fields of a line')
    columns: list[str] = parameter(  # noqa: RUF009 (a default factory underneath)
        [
            '1=chamber/temperature',
            '2=chamber/temperature_2',
            '3=dut1/chamber/device_temperature',
            '4=dut2/chamber/device_temperature',
            '5=dut3/chamber/device_temperature',
        ],
        'COLUMN=TOPIC for each temperature; columns count from 0',
    )


class ReferenceLoggerNode(ConfiguredNode):
    """Publishes each line of a data logger as temperatures, stamped with the time of receipt."""

    config_class = ReferenceLoggerConfig
    task = 'port'
    hardware = 'reference_logger'
    logs_status = True

    def __init__(self, **options: Any) -> None:
        super().__init__('reference_logger', **options)
        self._thread: PeriodicThread | None = None

    def setup(self, config: ReferenceLoggerConfig) -> None:
        """Prepare the port; it is opened at activation."""
        columns = parse_columns(config.columns)
        self._port = ReferenceLoggerPort(config.port, config.baudrate)
        self.lines = ReferenceLines(columns, config.delimiter)
        self._newest = self.now()
        self._outputs = {topic: self.output(Temperature, topic) for topic in columns.values()}
        self._entities.append(self._port.close)

    def activated(self) -> None:
        """Begin to read."""
        if self._capture is None:
            self._thread = PeriodicThread(lambda: self.on_bytes(self._port.read()), 0.0, self.stop)

    def deactivated(self) -> None:
        """Stop reading."""
        if self._thread is not None:
            self._thread.stop()
            self._thread = None

    def stop(self) -> None:
        """Release the port after an unexpected error."""
        self._port.close()

    def on_bytes(self, data: bytes) -> None:
        """Publish the whole lines that these bytes complete."""
        for reading in self.lines.feed(data):
            self._newest = self.now()
            for topic, temperature in reading.items():
                sample = TemperatureSample(self._newest, temperature, frame_id='chamber')
                self._outputs[topic].publish(temperature_from_sample(sample))

    def diagnostics(self) -> tuple[int, str, dict[str, Any]]:
        """State of the port: silence, and fields that were no temperatures."""
        if not hasattr(self, 'lines'):
            return 0, self.state, {}
        silent = (self.now() - self._newest) * 1e-9
        rejected = self.lines.rejected
        values = {
            'lines': self.lines.lines,
            'seconds since the last': round(silent, 1),
            'reconnects': max(self._port.reconnects, 0),
            **{f'rejected {topic}': count for topic, count in rejected.items()},
        }
        if silent > SILENCE_TIMEOUT_S:
            return 2, self._port.fault or f'no line for {silent:.0f} s', values
        if not self.lines.lines:
            return 1, self._port.fault or 'waiting for the first line', values
        if rejected:
            return 1, f'no temperature in {", ".join(sorted(rejected))}', values
        return 0, 'reading', values


def main() -> int:
    """Run the node."""
    return run_node(ReferenceLoggerNode)
