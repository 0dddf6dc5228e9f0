# SPDX-License-Identifier: Apache-2.0
"""ROS shell of the compensator: convert, call, publish."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

from imu_recording.logging_contract import TRACK_OF_FIELD, VALUE_OF_MESSAGE
from imu_recording.ros.lifecycle_node import ConfiguredNode
from imu_recording.ros.message_cdr import message_class
from imu_recording.ros.messages import (
    imu_from_sample,
    magnetic_field_from_sample,
    sample_from_imu,
    sample_from_magnetic_field,
    stamp_of,
)
from imu_recording.ros.parameter import NodeConfig, parameter
from imu_recording.ros.run_node import run_node
from sensor_msgs.msg import Imu, MagneticField, Temperature

from thermal_comp.compensation.recording import TIMEOUT_S
from thermal_comp.compensation.state import restore_state, save_state
from thermal_comp.compensation.stream import Compensator, compensated_field, compensated_imu
from thermal_comp.model.file import load_model
from thermal_comp.model.values import ThermalModel


@dataclass(frozen=True)
class ThermalCompConfig(NodeConfig):
    """Parameters of thermal_comp_node."""

    model: str = parameter('', 'Path of the model file; empty: pass data through')
    temperature_timeout: float = parameter(
        TIMEOUT_S, 'Age from which a temperature is not used', unit='s', bounds=(0.01, 3600.0)
    )
    state_file: str = parameter('', 'File that keeps the history over a restart; empty: none')


class ThermalCompNode(ConfiguredNode):
    """Subtracts the thermal error a model predicts from imu/data_raw and imu/mag.

    What is left goes out on imu_compensated/data_raw and imu_compensated/mag.
    """

    config: ThermalCompConfig
    config_class = ThermalCompConfig
    event_driven = True
    expects = 'imu/data_raw'

    def __init__(self, **options: Any) -> None:
        super().__init__('thermal_comp', **options)

    def setup(self, config: ThermalCompConfig) -> None:
        """Load the model, subscribe to what it needs."""
        model = load_model(config.model) if config.model else ThermalModel('', {})
        self.compensator = Compensator(model, temperature_timeout=config.temperature_timeout)
        if config.state_file and (reason := restore_state(self.compensator, config.state_file)):
            self.get_logger().info(f'history begins anew: {reason}')
        self._imu = self.output(Imu, 'imu_compensated/data_raw')
        self._mag = self.output(MagneticField, 'imu_compensated/mag')
        self.input(Temperature, 'imu/temperature', self.on_temperature)
        for channel in sorted(self.compensator.channels):
            track = TRACK_OF_FIELD[channel]
            value = VALUE_OF_MESSAGE[track.message_type]
            callback = partial(self.on_channel, channel, value)
            self.input(message_class(track.message_type), track.topic, callback)
        self.input(Imu, 'imu/data_raw', self.on_imu)
        self.input(MagneticField, 'imu/mag', self.on_magnetic_field)
        if config.state_file:
            timer = self.create_timer(10.0, self.save_state)
            self._entities.append(lambda: self.destroy_timer(timer))

    def on_temperature(self, message: Temperature) -> None:
        """Take in a die temperature."""
        self.compensator.on_temperature(stamp_of(message), float(message.temperature))

    def on_channel(self, channel: str, name: str, message: Any) -> None:
        """Take in a channel; messages without a stamp count from their receipt."""
        value = getattr(message, name)
        plain = (value.x, value.y, value.z) if channel == 'vibration' else float(value)
        stamp = stamp_of(message) if hasattr(message, 'header') else self.compensator.newest
        self.compensator.on_channel(channel, stamp, plain)

    def on_imu(self, message: Imu) -> None:
        """Publish the compensated sample; orientation fields pass through."""
        sample = sample_from_imu(message)
        rate, force = self.compensator.on_imu(
            sample.stamp, sample.angular_velocity, sample.linear_acceleration
        )
        published = imu_from_sample(compensated_imu(sample, rate, force))
        published.orientation = message.orientation
        published.orientation_covariance = message.orientation_covariance
        self._imu.publish(published)

    def on_magnetic_field(self, message: MagneticField) -> None:
        """Publish the compensated field."""
        sample = sample_from_magnetic_field(message)
        field = self.compensator.on_magnetic_field(sample.stamp, sample.magnetic_field)
        self._mag.publish(magnetic_field_from_sample(compensated_field(sample, field)))

    def save_state(self) -> None:
        """Write the history to the state file."""
        save_state(self.compensator, self.config.state_file)

    def deactivated(self) -> None:
        """Keep the history."""
        if self.config.state_file:
            self.save_state()

    def diagnostics(self) -> tuple[int, str, dict[str, Any]]:
        """Return the compensator's condition."""
        return self.compensator.report() if self.inputs else (0, self.state, {})


def main() -> int:
    """Run thermal_comp_node."""
    return run_node(ThermalCompNode)
