# SPDX-License-Identifier: Apache-2.0
"""The driver node: a device on a line to imu/data_raw, imu/mag and imu/temperature."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from imu_recording.ros.diagnostics import Status
from imu_recording.ros.lifecycle_node import ConfiguredNode
from imu_recording.ros.messages import ImuSample, MagneticSample, TemperatureSample
from imu_recording.ros.parameter import NodeConfig
from imu_recording.ros.run_node import run_node
from imu_recording.user_error import UserError
from sensor_msgs.msg import Imu, MagneticField, Temperature
from std_msgs.msg import Float64
from std_srvs.srv import Trigger

from imu_driver.board.sample import TEMPERATURE_VARIANCE_K2, Sample, diagonal
from imu_driver.board.session import WarningEvent
from imu_driver.board.stream_statistics import SixPositionCheck, rest_report
from imu_driver.driver import DriverParameters, ImuDriver
from imu_driver.driver_status import DriverStatus
from imu_driver.emulator.chamber_air import ChamberAir, follows_chamber

NO_ORIENTATION = (0.0, 0.0, 0.0, 0.0)
"""Orientation in the message of a device that has none; its covariance says so (REP-145)."""


@dataclass(frozen=True)
class DriverConfig(DriverParameters, NodeConfig):
    """Parameters of the node."""


class ImuDriverNode(ConfiguredNode):
    """Publishes what a device measures, stamped when it was measured.

    Topics imu/data_raw, imu/mag, imu/temperature and imu/supply_voltage; services
    ~/restart_stream, ~/measure_rest and ~/check_position.
    """

    config_class = DriverConfig
    task = 'stream'
    captures_bytes = True
    config: DriverConfig

    def __init__(self, name: str = 'imu_driver', **options: Any) -> None:
        self.driver: ImuDriver | None = None
        super().__init__(name, **options)
        self._positions = SixPositionCheck()
        self.create_service(Trigger, '~/restart_stream', self.on_restart_stream)
        self.create_service(Trigger, '~/measure_rest', self.on_measure_rest)
        self.create_service(Trigger, '~/check_position', self.on_check_position)

    def setup(self, config: DriverConfig) -> None:
        """Check that the driver can be built, and create the publishers."""
        self._air = ChamberAir()
        if follows_chamber(config.transport):
            self.input(Temperature, 'chamber/temperature', self.on_air)
        self._prepared: ImuDriver | None = self._new_driver(config)
        self.reconfigured(config)
        self._temperature = self.sample_output(Temperature, 'imu/temperature')
        self._magnetic_field = self.sample_output(MagneticField, 'imu/mag')
        self._imu = self.sample_output(Imu, 'imu/data_raw')
        self._supply = self.output(Float64, 'imu/supply_voltage')

    def activated(self) -> None:
        """Start to read."""
        self.driver = self._prepared or self._new_driver(self.config)
        self._status = DriverStatus(self.driver)
        self._prepared = None
        self._told = ''
        self._tell_device()
        self.driver.start()

    def deactivated(self) -> None:
        """Stop reading and release the line."""
        if self.driver:
            self.driver.stop()
            self.driver = None

    def reconfigured(self, config: DriverConfig) -> None:
        """Take over new noise figures."""
        self._variances = (
            diagonal(config.angular_velocity_stddev**2),
            diagonal(config.linear_acceleration_stddev**2),
            diagonal(config.magnetic_field_stddev**2),
        )

    def diagnostics(self) -> tuple[int, str, dict[str, Any]]:
        """Return the status of device and line, of the node while nothing is read."""
        if self.driver is None:
            return super().diagnostics()
        return self._status.report(self.now())

    def tasks(self) -> dict[str, Status]:
        """Return the status of the stream and, of a device, that of its clock."""
        tasks = super().tasks()
        if self.driver and self.driver.session:
            tasks['clock'] = self._status.clock(self.driver.session)
        return tasks

    def publish_diagnostics(self) -> None:
        """Publish the status and, where the board measures it, the supply; once a second."""
        super().publish_diagnostics()
        volts = self.driver.supply_voltage if self.driver else 0.0
        if volts:
            self._supply.publish(Float64(data=float(volts)))

    def publish(self, samples: list[Sample]) -> None:
        """Publish samples that came together; the messages are sent once all are converted."""
        with self._exchange.outbox:
            for sample in samples:
                self._publish_one(sample)

    def _publish_one(self, sample: Sample) -> None:
        """Publish, temperature first."""
        stamp, frame_id = sample.stamp, self.config.frame_id
        rate, force, field = self._variances
        if sample.temperature is not None:
            self._temperature.send(
                TemperatureSample(
                    stamp, sample.temperature, variance=TEMPERATURE_VARIANCE_K2, frame_id=frame_id
                )
            )
        if sample.magnetic_field is not None:
            self._magnetic_field.send(
                MagneticSample(
                    stamp,
                    sample.magnetic_field,
                    magnetic_field_covariance=field,
                    frame_id=frame_id,
                )
            )
        self._imu.send(
            ImuSample(
                stamp=stamp,
                angular_velocity=sample.angular_velocity,
                linear_acceleration=sample.linear_acceleration,
                angular_velocity_covariance=rate,
                linear_acceleration_covariance=force,
                frame_id=frame_id,
                orientation=NO_ORIENTATION,
            )
        )

    def on_air(self, message: Temperature) -> None:
        """Take over the air temperature of the chamber that the simulated board is in."""
        self._air.update(message.temperature)

    def on_restart_stream(self, _: Any, response: Any) -> Any:
        """Stop and start the device's stream."""
        return self._respond(response, ImuDriver.restart_stream)

    def on_measure_rest(self, _: Any, response: Any) -> Any:
        """Return gyroscope bias and noise over the last seconds as JSON."""
        return self._respond(response, lambda driver: rest_report(driver.statistics))

    def on_check_position(self, _: Any, response: Any) -> Any:
        """Take the present position into the six-position check."""
        return self._respond(response, lambda driver: self._positions.take(driver.statistics))

    def _respond(self, response: Any, answer: Callable[[ImuDriver], str]) -> Any:
        try:
            if self.driver is None:
                raise UserError('no device is being read')
            response.message = answer(self.driver)
            response.success = True
        except UserError as error:
            response.success, response.message = False, str(error)
        return response

    def _new_driver(self, config: DriverConfig) -> ImuDriver:
        return ImuDriver(
            config, now=self.now, publish=self.publish, report=self._report, air=self._air
        )

    def _tell_device(self) -> None:
        """Say on /diagnostics which device is read before its first sample comes."""
        device = self.driver.device if self.driver and not self._capture else ''
        if device != self._told:
            self._told = device
            self.send_diagnostics({self.task: (0, f'device {device}', {'device': device})})

    def _report(self, event: str) -> None:
        self._tell_device()
        if isinstance(event, WarningEvent):
            self.get_logger().warning(event)
        else:
            self.get_logger().info(event)


def main() -> int:
    """Run the node."""
    sys.setswitchinterval(5e-4)  # [s] to the next thread; 5 ms by default
    return run_node(ImuDriverNode)
