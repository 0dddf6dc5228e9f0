# SPDX-License-Identifier: Apache-2.0
"""ROS node of the compensator: convert, call, publish."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from imu_recording.logging_contract import (
    APPLIED_MODEL,
    COMPENSATED,
    THERMOMETER_FIELDS,
    TRACK_OF_FIELD,
    VALUE_OF_MESSAGE,
)
from imu_recording.ros.diagnostics import NO_HARDWARE, node_of
from imu_recording.ros.lifecycle_node import ConfiguredNode
from imu_recording.ros.message_cdr import message_class
from imu_recording.ros.messages import (
    ImuSample,
    MagneticSample,
    TemperatureSample,
    stamp_of,
)
from imu_recording.ros.parameter import NodeConfig, parameter
from imu_recording.ros.run_node import run_node
from imu_recording.ros.topic_node import latched_qos
from imu_recording.stream_plausibility import StreamCheck
from imu_recording.thermometer import LiveThermometer
from sensor_msgs.msg import Imu, MagneticField, Temperature
from std_msgs.msg import String

from thermal_comp.compensation.recording import (
    DEFAULT_EXTRAPOLATION,
    EXTRAPOLATIONS,
    TIMEOUT_S,
)
from thermal_comp.compensation.state import restore_state, save_state
from thermal_comp.compensation.stream import CompensatedSamples, Compensator
from thermal_comp.data.thermometer import ThermometerComparison
from thermal_comp.effects.user_effects import effect_catalogue
from thermal_comp.model.file import check_device, load_model, model_label
from thermal_comp.model.values import ModelError, ThermalModel


@dataclass(frozen=True)
class ThermalCompConfig(NodeConfig):
    """Parameters of thermal_comp_node."""

    model: str = parameter('', 'Path of the model file; empty: pass data through')
    temperature_timeout: float = parameter(
        TIMEOUT_S, 'Age from which a temperature is not used', unit='s', bounds=(0.01, 3600.0)
    )
    extrapolate: str = parameter(
        DEFAULT_EXTRAPOLATION,
        'Outside the fitted temperatures: the tangent goes on, or the error of the edge is kept',
        choices=EXTRAPOLATIONS,
    )
    effects: list[str] = parameter(  # noqa: RUF009 (a field with a factory)
        [], "Python files, or folders of them, with effects of the user's own that the model has"
    )
    device: str = parameter('', 'Device the model has to be of; empty: any')
    again: bool = parameter(False, 'Compensate data that say they are compensated already')
    allow_other_device: bool = parameter(
        False, 'Compensate data of a driver that names another device than the model'
    )
    accept_units: bool = parameter(False, 'Compensate numbers that cannot be SI units')
    state_file: str = parameter('', 'File that keeps the history over a restart; empty: none')


class ThermalCompNode(ConfiguredNode):
    """Subtracts the thermal error a model predicts from imu/data_raw and imu/mag.

    The result is published on imu_compensated/data_raw and imu_compensated/mag.
    """

    config: ThermalCompConfig
    config_class = ThermalCompConfig
    event_driven = True
    task = 'compensation'
    expects = 'imu/data_raw'

    def __init__(self, **options: Any) -> None:
        super().__init__('thermal_comp', **options)

    def setup(self, config: ThermalCompConfig) -> None:
        """Load the model, subscribe to what it needs."""
        model = (
            load_model(config.model, effect_catalogue(config.effects))
            if config.model
            else ThermalModel('', {})
        )
        check_device(model, config.device)
        self.compensator = Compensator(
            model,
            temperature_timeout=config.temperature_timeout,
            extrapolation='clamp' if config.extrapolate == 'clamp' else 'line',
        )
        self._compensated = CompensatedSamples()
        self.check = StreamCheck()
        self.thermometer = LiveThermometer()
        self.comparison = ThermometerComparison()
        self._other_device = ''
        self._source: dict[str, str] = {}
        if config.state_file and (reason := restore_state(self.compensator, config.state_file)):
            self.get_logger().info(f'history begins anew: {reason}')
        self._imu = self.sample_output(Imu, 'imu_compensated/data_raw')
        self._mag = self.sample_output(MagneticField, 'imu_compensated/mag')
        self._applied = self.output(String, f'{COMPENSATED}/{APPLIED_MODEL}', latched=True)
        self._label = model_label(model) if model.sensors else ''
        self._applied_label = ''
        source = self.resolve_topic_name('imu/data_raw').rpartition('/')[0]
        self.input(String, f'{source}/{APPLIED_MODEL}', self.on_applied_model, qos=latched_qos())
        if model.device and not config.allow_other_device:
            self.diagnostics_input('imu/data_raw', self.on_diagnostics)
        self.sample_input(Temperature, 'imu/temperature', self.on_temperature)
        for name in THERMOMETER_FIELDS:
            if name not in self.compensator.channels:
                self.sample_input(
                    Temperature, TRACK_OF_FIELD[name].topic, partial(self.on_other, name)
                )
        for channel in sorted(self.compensator.channels):
            track = TRACK_OF_FIELD[channel]
            value = VALUE_OF_MESSAGE[track.message_type]
            callback = partial(self.on_channel, channel, value)
            self.input(message_class(track.message_type), track.topic, callback)
        self.sample_input(Imu, 'imu/data_raw', self.on_imu)
        self.sample_input(MagneticField, 'imu/mag', self.on_magnetic_field)
        if config.state_file:
            timer = self.create_timer(10.0, self.save_state)
            self._entities.append(partial(self.destroy_timer, timer))

    def on_applied_model(self, message: String) -> None:
        """Take in that the input is compensated already: passed on, unless `again` is set."""
        if not self.config.again:
            self.compensator.applied_before = message.data

    def on_diagnostics(self, message: DiagnosticArray) -> None:
        """Take in which device the driver reads: the model has to be of that one."""
        devices = {
            node_of(status.name): status.hardware_id
            for status in message.status
            if status.hardware_id not in ('', NO_HARDWARE)
        }
        if not devices or devices == self._source:
            return
        for name in self._senders() & devices.keys():
            self._source = devices  # which need not be looked for again
            self.check_source(devices[name])

    def _senders(self) -> set[str]:
        """Return the nodes that publish imu/data_raw; without any, those of the other inputs."""
        found = self.get_publishers_info_by_topic('imu/data_raw') or [
            sender
            for topic in ('imu/mag', 'imu/temperature')
            for sender in self.get_publishers_info_by_topic(topic)
        ]
        return {f'{s.node_namespace}/{s.node_name}'.lstrip('/') for s in found}

    def check_source(self, device: str) -> None:
        """Refuse to compensate data of this device with a model of another."""
        try:
            check_device(self.compensator.model, device)
        except ModelError as error:
            self._other_device = str(error)
        else:
            self._other_device = ''

    def on_temperature(self, sample: TemperatureSample) -> None:
        """Take in a die temperature."""
        self.thermometer.add(sample.stamp, sample.temperature)
        self.comparison.on_die(sample.stamp, sample.temperature)
        if self.check.on_temperature(sample.temperature) or self.config.accept_units:
            self.compensator.on_temperature(sample.stamp, sample.temperature)

    def on_other(self, name: str, sample: TemperatureSample) -> None:
        """Take in another thermometer's value, to compare the die's with."""
        self.comparison.on_other(name, sample.stamp, sample.temperature)

    def on_channel(self, channel: str, name: str, message: Any) -> None:
        """Take in a channel; messages without a stamp count from their receipt."""
        value = getattr(message, name)
        plain = (value.x, value.y, value.z) if channel == 'vibration' else float(value)
        stamp = stamp_of(message) if hasattr(message, 'header') else self.compensator.newest
        self.compensator.on_channel(channel, stamp, plain)
        if channel in THERMOMETER_FIELDS and isinstance(plain, float):
            self.comparison.on_other(channel, stamp, plain)

    def on_imu(self, sample: ImuSample) -> None:
        """Publish the compensated sample; orientation fields pass through.

        A sample that cannot be in SI units is passed on as it came.
        """
        if self._refused(self.check.on_imu(sample)):
            self._imu.send(sample)
            if self._other_device or self.check.objection:  # no single damaged sample
                self._tell_applied('')
            return
        rate, force = self.compensator.on_imu(
            sample.stamp, sample.angular_velocity, sample.linear_acceleration
        )
        self._imu.send(self._compensated.imu(sample, rate, force))
        self._tell_applied(self.compensator.applied_before or self._label)

    def _tell_applied(self, label: str) -> None:
        """Publish which model is subtracted, latched, where that changes."""
        if label != self._applied_label:
            self._applied_label = label
            self._applied.publish(String(data=label))

    def on_magnetic_field(self, sample: MagneticSample) -> None:
        """Publish the compensated field."""
        if self._refused(self.check.on_magnetic_field(sample.magnetic_field)):
            self._mag.send(sample)
            return
        field = self.compensator.on_magnetic_field(sample.stamp, sample.magnetic_field)
        self._mag.send(self._compensated.field(sample, field))

    def _refused(self, possible: bool) -> bool:
        if self._other_device:
            return True
        return not (self.config.accept_units or (possible and not self.check.objection))

    def save_state(self) -> None:
        """Write the history to the state file."""
        save_state(self.compensator, self.config.state_file)

    def deactivated(self) -> None:
        """Keep the history."""
        if self.config.state_file:
            self.save_state()

    def diagnostics(self) -> tuple[int, str, dict[str, Any]]:
        """Return the compensator's condition, and what is implausible in its input."""
        if not self.inputs:
            return 0, self.state, {}
        level, said, values = self.compensator.report()
        values['damaged'] = self.check.damaged
        if self._other_device:
            way = 'data pass through unchanged; parameter allow_other_device compensates them'
            return 2, f'{self._other_device}: {way}', values
        if self.check.objection and not self.config.accept_units:
            way = 'data pass through unchanged; parameter accept_units compensates them'
            return 2, f'{self.check.objection}: {way}', values
        notes = [self.thermometer.fault, self.comparison.fault]
        if self.check.damaged_now:
            notes.append('impossible samples pass through unchanged')
        told = [note for note in notes if note]
        return max(level, int(bool(told))), '; '.join([said, *told]), values


def main() -> int:
    """Run thermal_comp_node."""
    return run_node(ThermalCompNode)
