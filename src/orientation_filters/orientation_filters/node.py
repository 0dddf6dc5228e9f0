# SPDX-License-Identifier: Apache-2.0
"""Nodes `complementary_filter` and `ahrs_filter`: imu/data_raw and imu/mag in, imu/data out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from geometry_msgs.msg import Vector3Stamped
from imu_recording.ros.lifecycle_node import ConfiguredNode
from imu_recording.ros.messages import (
    ImuSample,
    MagneticSample,
    VectorSample,
    fill_quaternion,
    fill_stamp,
)
from imu_recording.ros.parameter import NodeConfig, parameter
from imu_recording.ros.run_node import run_node
from imu_recording.stream_plausibility import StreamCheck
from imu_recording.user_error import UserError
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from rclpy.parameter import Parameter
from sensor_msgs.msg import Imu, MagneticField

from orientation_filters.ahrs.parameters import AhrsParameters
from orientation_filters.complementary.parameters import ComplementaryParameters
from orientation_filters.filters import preset_changes
from orientation_filters.live.filter import LiveEstimate, LiveFilter
from orientation_filters.parameters import PRESET_NAMES, FilterParameters, check_mount


@dataclass(frozen=True)
class OutputConfig(NodeConfig):
    """Parameters of the nodes' outputs."""

    publish_euler: bool = parameter(True, 'Publish roll, pitch, yaw [rad] on ~/euler')
    publish_tf: bool = parameter(False, 'Publish world → body on /tf (needs tf2_msgs)')
    world_frame_id: str = parameter('world', 'Name of the parent frame on /tf')
    body_frame_id: str = parameter('', 'Frame of the output; empty: as the input')


@dataclass(frozen=True)
class ComplementaryConfig(ComplementaryParameters, OutputConfig):
    """Parameters of complementary_filter."""


@dataclass(frozen=True)
class AhrsConfig(AhrsParameters, OutputConfig):
    """Parameters of ahrs_filter."""


def transform_class() -> Any:
    """Return tf2_msgs/TFMessage; raise ValueError where the package is absent."""
    try:
        from tf2_msgs.msg import TFMessage
    except ImportError as error:
        way = 'install ros-jazzy-tf2-msgs or set publish_tf:=false'
        raise UserError(
            f'publish_tf needs the package tf2_msgs, which is absent: {way}'
        ) from error
    return TFMessage


def transform_message(world_frame_id: str, sample: ImuSample, estimate: LiveEstimate) -> Any:
    """Return a TFMessage with the rotation world → body."""
    from geometry_msgs.msg import TransformStamped

    transform = TransformStamped(child_frame_id=sample.frame_id)
    transform.header.frame_id = world_frame_id
    fill_stamp(transform.header.stamp, sample.stamp)
    fill_quaternion(transform.transform.rotation, estimate.orientation)
    return transform_class()(transforms=[transform])


class FilterNode(ConfiguredNode):
    """Estimates orientation from imu/data_raw and imu/mag."""

    filter_name: ClassVar[str]
    event_driven = True
    task = 'orientation'
    expects = 'imu/data_raw'
    config: OutputConfig

    def __init__(self, **options: Any) -> None:
        self._preset = FilterParameters.preset
        super().__init__(f'{self.filter_name}_filter', **options)

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Give parameters that nobody set the values of the preset."""
        preset = self.get_parameter('preset').value  # one that does not exist is refused below
        changes = preset_changes(self.filter_name, self._preset, preset, self._values())
        for name in changes.keys() - self._parameter_overrides.keys():
            self.set_parameters([Parameter(name, value=changes[name])])
        if preset in PRESET_NAMES:
            self._preset = preset
        return super().on_configure(state)

    def setup(self, config: Any) -> None:
        """Create filter, inputs and outputs."""
        check_mount(config)
        topics = [self.resolve_topic_name(topic) for topic in ('imu/data_raw', 'imu/mag')]
        within = all(map(self._exchange.offers, topics))
        self.filter = LiveFilter(self.filter_name, config, in_order=within)
        self.check = StreamCheck()
        self._checks = not within  # nodes of this process have checked their samples already
        self._orientation = self.sample_output(Imu, 'imu/data')
        euler = config.publish_euler
        self._euler = self.sample_output(Vector3Stamped, '~/euler') if euler else None
        self._tf = self.output(transform_class(), '/tf') if config.publish_tf else None
        self.sample_input(Imu, 'imu/data_raw', self.on_imu)
        if config.use_magnetometer:
            self.sample_input(MagneticField, 'imu/mag', self.on_magnetic_field)

    def reconfigured(self, config: Any) -> None:
        """Take over changed parameters; the estimate goes on."""
        self.filter.set_parameters(config)

    def on_imu(self, sample: ImuSample) -> None:
        """Take an IMU sample."""
        if self._checks:
            self.check.on_imu(sample)
        self._publish(self.filter.add_imu(sample))

    def on_magnetic_field(self, sample: MagneticSample) -> None:
        """Take a magnetometer sample."""
        self._publish(self.filter.add_field(sample))

    def finish(self) -> None:
        """Publish the samples that still wait for a magnetometer sample: the input has ended."""
        self._publish(self.filter.flush())

    def diagnostics(self) -> tuple[int, str, dict[str, Any]]:
        """Return rate, jitter, disturbed fraction, bias, resets and counts."""
        if not hasattr(self, 'filter'):
            return super().diagnostics()
        level, said, values = self.filter.status()
        if self.check.objection:
            return 2, f'{self.check.objection}: the orientation is wrong', values
        return level, said, values

    def _publish(self, estimates: list[LiveEstimate]) -> None:
        if self.filter.refusal:
            self.refuse(self.filter.refusal)
        for found in estimates:
            measured = found.sample
            sample = ImuSample(  # `replace` takes five times as long
                stamp=measured.stamp,
                angular_velocity=measured.angular_velocity,
                linear_acceleration=measured.linear_acceleration,
                angular_velocity_covariance=measured.angular_velocity_covariance,
                linear_acceleration_covariance=measured.linear_acceleration_covariance,
                frame_id=self.config.body_frame_id or measured.frame_id,
                orientation=found.orientation,
                orientation_covariance=found.covariance,
            )
            self._orientation.send(sample)
            if self._euler:
                self._euler.send(VectorSample(sample.stamp, found.euler, sample.frame_id))
            if self._tf:
                self._tf.publish(transform_message(self.config.world_frame_id, sample, found))


class ComplementaryFilterNode(FilterNode):
    """Orientation from imu/data_raw and imu/mag on imu/data, by the complementary filter."""

    config_class = ComplementaryConfig
    filter_name = 'complementary'


class AhrsFilterNode(FilterNode):
    """Orientation from imu/data_raw and imu/mag on imu/data, by the indirect Kalman AHRS."""

    config_class = AhrsConfig
    filter_name = 'ahrs'


def main_complementary() -> int:
    """Run the node."""
    return run_node(ComplementaryFilterNode)


def main_ahrs() -> int:
    """Run the node."""
    return run_node(AhrsFilterNode)
