# SPDX-License-Identifier: Apache-2.0
"""The driver node: a device on a line to imu/data_raw, imu/mag and imu/temperature."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from imu_recording.lifecycle_node import ConfiguredNode, NodeConfig, run_node
from rclpy.impl.implementation_singleton import rclpy_implementation
from sensor_msgs.msg import Imu, MagneticField, Temperature
from std_srvs.srv import Trigger

from imu_driver.driver import ImuDriver
from imu_driver.driver_config import DriverParameters
from imu_driver.frames import CommandCode
from imu_driver.message_bytes import MessageBytes
from imu_driver.rest_report import PositionCheck, rest_report
from imu_driver.sample import Sample
from imu_driver.stream_statistics import RestError

RCLError = rclpy_implementation.RCLError


@dataclass(frozen=True)
class DriverConfig(DriverParameters, NodeConfig):
    """Parameters of the node."""


class ImuDriverNode(ConfiguredNode):
    """Publishes what a device measures, stamped when it was measured."""

    config_class = DriverConfig

    def __init__(self, name: str = 'imu_driver', **options: Any) -> None:
        self.driver: ImuDriver | None = None
        super().__init__(name, **options)
        for service, callback in (
            ('restart_stream', self.on_restart_stream),
            ('measure_rest', self.on_measure_rest),
            ('check_position', self.on_check_position),
        ):
            self.create_service(Trigger, f'~/{service}', callback)

    def setup(self, config: DriverConfig) -> None:
        """Check that the driver can be built, and create the publishers."""
        self._prepared: ImuDriver | None = self._new_driver(config)
        self._messages = _messages(config)
        self._positions = PositionCheck()
        self._temperature = self.output(Temperature, 'imu/temperature')
        self._magnetic_field = self.output(MagneticField, 'imu/mag')
        self._imu = self.output(Imu, 'imu/data_raw')

    def activated(self) -> None:
        """Start to read."""
        self.driver = self._prepared or self._new_driver(self.config)
        self._prepared = None
        self.driver.start()

    def deactivated(self) -> None:
        """Stop reading and release the line."""
        if self.driver:
            self.driver.stop()
            self.driver = None

    def reconfigured(self, config: DriverConfig) -> None:
        """Take over new noise figures."""
        self._messages = _messages(config)

    def diagnostics(self) -> tuple[int, str, dict[str, Any]]:
        """Say how the device and its line are."""
        if self.driver is None:
            return super().diagnostics()
        return self.driver.diagnostics(self.now())

    def publish(self, sample: Sample) -> None:
        """Publish a sample, unless Ctrl-C has taken the middleware away under the thread."""
        try:
            self._publish(sample)
        except RCLError:
            if self.context.ok():
                raise

    def _publish(self, sample: Sample) -> None:
        # The temperature first: what follows with the same stamp is compensated by it.
        messages = self._messages
        if sample.temperature is not None:
            self._temperature.publish(messages.temperature(sample.stamp, sample.temperature))
        if sample.magnetic_field is not None:
            self._magnetic_field.publish(
                messages.magnetic_field(sample.stamp, sample.magnetic_field)
            )
        self._imu.publish(messages.imu(sample))

    def on_restart_stream(self, _: Any, response: Any) -> Any:
        """Stop and start the device's stream."""
        session = self.driver.session if self.driver else None
        response.success = session is not None
        response.message = 'restarting' if session else 'no device is being read'
        if session:
            session.command(CommandCode.STOP)
            session.command(CommandCode.START)
        return response

    def on_measure_rest(self, _: Any, response: Any) -> Any:
        """Tell gyroscope bias and noise over the last seconds."""
        return self._answer(response, lambda driver: rest_report(driver.statistics))

    def on_check_position(self, _: Any, response: Any) -> Any:
        """Take the present position into the six-position check."""
        return self._answer(response, lambda driver: self._positions.take(driver.statistics))

    def _answer(self, response: Any, ask: Any) -> Any:
        try:
            response.message = ask(self.driver) if self.driver else 'no device is being read'
            response.success = self.driver is not None
        except RestError as error:
            response.success, response.message = False, str(error)
        return response

    def _new_driver(self, config: DriverConfig) -> ImuDriver:
        return ImuDriver(
            config, now=self.now, publish=self.publish, report=self.get_logger().info
        )


def _messages(config: DriverConfig) -> MessageBytes:
    return MessageBytes(
        config.frame_id,
        angular_velocity_stddev=config.angular_velocity_stddev,
        linear_acceleration_stddev=config.linear_acceleration_stddev,
        magnetic_field_stddev=config.magnetic_field_stddev,
    )


def main() -> int:
    """Run the node."""
    return run_node(ImuDriverNode)
